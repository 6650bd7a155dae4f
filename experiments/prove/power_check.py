"""Is an effect of the size that "could not have been seen" says, put into the null campaign, detected in 80 % of cases?

Null campaigns of the concealed generator are diagnosed; for effects drawn from the list of what could not have been seen,
the same rig is recorded anew in MuJoCo with that effect at that size and fresh noise, and diagnosed again. Detected means
that the verdict is no longer "none".

  python -m jointscope.experiments.prove.power_check --out out/power --nulls 20 --each 3
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from jointscope.atomic import write_text
from jointscope.diagnosis.effects import catalogue
from jointscope.diagnosis.power import unseen
from jointscope.experiments.prove.measures import wilson
from jointscope.experiments.prove.next_experiment_check import answer, recorded, small
from jointscope.experiments.rehearsal.sizing import sized
from jointscope.progress import track
from jointscope.sim.concealed import catalogue as concealed
from jointscope.sim.concealed.bench import draw_bench


@dataclass(frozen=True)
class Injection:
    """One effect at the size that should just show.

    Attributes:
        factor: Size over what was stated.
        detected: Whether the verdict was not "none"; ``named`` whether it was the effect itself.
    """

    seed: int
    effect: str
    experiments: str
    size: float
    unit: str
    limited_by: str
    factor: float
    detected: bool
    named: bool


def inject(seed: int, each: int, factor: float, pool: ThreadPoolExecutor) -> list[Injection]:
    """One null campaign and ``each`` effects at their stated sizes."""
    rng = np.random.default_rng([seed, 11])
    bench = small(draw_bench(rng, "development", experiments=("H", "HS", "S", "HSM")[seed % 4]))
    null = answer(recorded(bench, (), seed), frozenset(), pool)
    if null.decision.verdict != "none":
        return []
    stated = unseen(null.problem, null.judgement, null.judgement.base, catalogue(null.problem), pool)
    choices = [u for u in stated if u.size is not None]
    found: list[Injection] = []
    for k in rng.permutation(len(choices)):
        said = choices[int(k)]
        laws = [
            law for law in concealed.laws("development")
            if (law.effect, law.location) == (said.effect, said.location) and not law.departs
            and law.applies(bench.setting)
        ]  # fmt: skip
        effect = sized(laws[0], bench.setting, said, factor, rng) if laws else None
        if effect is None:
            continue
        labels = frozenset({effect.label, *concealed.rivals(effect.label)})
        try:
            later = answer(recorded(bench, (effect,), seed + 100_000 + int(k)), labels, pool)
        except FloatingPointError:
            continue
        names = later.decision.ranking[0].names if later.decision.verdict == "effects" else ()
        found.append(
            Injection(
                seed, effect.label, bench.experiments, float(said.size or 0.0), said.unit, said.limited_by, factor,
                later.decision.verdict != "none", effect.label in names,
            )
        )  # fmt: skip
        if len(found) == each:
            break
    return found


def summarise(found: Sequence[Injection]) -> dict[str, Any]:
    """Share detected with its Wilson interval."""
    return {
        "detected": asdict(wilson(sum(i.detected for i in found), len(found))),
        "named": asdict(wilson(sum(i.named for i in found), len(found))),
        "wanted": [0.70, 0.95],
        "injections": [asdict(i) for i in found],
    }


def run(out: Path, nulls: int, each: int, first_seed: int, factor: float) -> dict[str, Any]:
    """Inject into ``nulls`` campaigns; finished ones are kept in ``out``."""
    out.mkdir(parents=True, exist_ok=True)
    found: list[Injection] = []
    with ThreadPoolExecutor(1) as pool:
        for seed in track(range(first_seed, first_seed + nulls), "injecting", nulls):
            file = out / f"null-{seed}-{factor:g}.json"
            if not file.is_file():
                write_text(file, json.dumps([asdict(i) for i in inject(seed, each, factor, pool)]) + "\n")
            found.extend(Injection(**held) for held in json.loads(file.read_text(encoding="utf-8")))
    summary = summarise(found)
    write_text(out / "power.json", json.dumps(summary, indent=1) + "\n")
    return summary


def main() -> int:
    """Print the share detected."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--nulls", type=int, default=20)
    parser.add_argument("--each", type=int, default=3, help="effects per null campaign")
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--factor", type=float, default=1.0, help="size over what is stated")
    options = parser.parse_args()
    summary = run(options.out, options.nulls, options.each, options.first_seed, options.factor)
    for name in ("detected", "named"):
        s = summary[name]
        print(f"{name} {s['hits']} of {s['cases']}: {s['share']:.2f} (95 %: {s['low']:.2f} to {s['high']:.2f})")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
