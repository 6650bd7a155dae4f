"""Does `diagnose --simulated` say what a simulator of someone else's has wrong, lacks, or holds too much?

A machine is recorded in MuJoCo, and a simulator of it, in MuJoCo too, hands over outputs without noise. By turns the
simulator is the machine itself, has a joint that is too stiff under an arm that is too heavy, lacks an effect that the
machine has, or holds one that the machine has not. Effects are those of the test draw's laws, drawn until they are told
from their look-alikes by at least ``TOLD`` standard deviations. Each case goes through the command line.

  python -m jointscope.experiments.prove.simulated_check --out out/simulated --cases 20 --workers 2
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from jointscope.atomic import write_text
from jointscope.experiments.prove.measures import wilson
from jointscope.progress import track
from jointscope.sim.concealed import paperwork
from jointscope.sim.concealed.bench import Bench, draw_bench
from jointscope.sim.concealed.concealment import conceal
from jointscope.sim.concealed.law import Effect
from jointscope.sim.concealed.measurement import noisy
from jointscope.sim.concealed.rehearsal import declared, rehearse
from jointscope.sim.concealed.yardstick import changed

KINDS: Final = ("same", "parameters", "lacks", "holds")
OFF: Final = {"stiffness": 0.15, "load_inertia": 0.10}  # of the logarithm, in the simulator of wrong parameters
STATED: Final = {"stiffness": "stiffness", "load_inertia": "inertia"}  # what diagnosis.json calls them
TOLD: Final = 15.0  # z_d of an effect that either side holds
DRAWN: Final = 12  # effects, until one is told
WITHIN: Final = 0.03  # of the true ratio, the stated one
COMMAND: Final = (sys.executable, "-m", "jointscope", "diagnose")


@dataclass(frozen=True)
class Outcome:
    """One simulator and what is said of it.

    Attributes:
        kind: Of the simulator, see ``KINDS``.
        effect: That one of the two sides holds; empty.
        left_out: Effects said to be missing in the simulator; ``contradicted`` those said to be too many.
        ratios: Simulated over recorded of the parameters said to differ [-].
        right: Whether nothing but the difference is said, and that.
        message: Why there is no answer; empty.
    """

    seed: int
    kind: str
    effect: str
    experiments: str
    left_out: tuple[str, ...]
    contradicted: tuple[str, ...]
    ratios: dict[str, float]
    right: bool
    message: str = ""


def told(bench: Bench, rng: np.random.Generator) -> tuple[Effect, ...]:
    """A single effect that can be told from its look-alikes, or as near to that as ``DRAWN`` draws come."""
    best: tuple[float, tuple[Effect, ...]] = (-1.0, ())
    for _ in range(DRAWN):
        effects, measured = conceal(bench, "single", "test", rng)
        if measured is not None and measured.z_d > best[0]:
            best = (measured.z_d, effects)
        if best[0] >= TOLD:
            break
    return best[1]


def write_sides(seed: int, kind: str, folder: Path) -> tuple[Bench, str]:
    """Write ``folder/recorded`` and ``folder/simulated``; the bench, and the label of the effect one of them holds."""
    rng = np.random.default_rng([seed, 21])
    bench = draw_bench(rng, "test", experiments=("HS", "HSM", "H")[seed // len(KINDS) % 3])
    effects = told(bench, rng) if kind in ("lacks", "holds") else ()
    held = effects if kind == "holds" else ()
    rig = changed(bench.rig, OFF) if kind == "parameters" else bench.rig
    takes = range(len(bench.plan.takes))
    machine = [declared(c, bench.plan.devices)
               for c in rehearse(bench.rig, bench.plan, effects if kind == "lacks" else (), takes)]  # fmt: skip
    noise = np.random.default_rng([seed, 22])
    records = [noisy(channels, bench.plan.devices, bench.noise, noise) for channels in machine]
    outputs = [declared(c, bench.plan.devices) for c in rehearse(rig, bench.plan, held, takes)]
    for name, side in (("recorded", records), ("simulated", outputs)):
        paper = np.random.default_rng([seed, 23])
        plate = paperwork.nameplate(bench.rig, bench.topology, bench.motion, paper, 0.15)
        paperwork.write_case(paperwork.campaign(bench.rig, bench.plan, side, plate, paper), folder / name)
    return bench, effects[0].label if effects else ""


def is_right(
    kind: str, effect: str, left_out: Sequence[str], contradicted: Sequence[str], ratios: dict[str, float]
) -> bool:
    """Whether the difference is said, and nothing else."""
    wanted = ([effect] if kind == "lacks" else [], [effect] if kind == "holds" else [])
    if (list(left_out), list(contradicted)) != wanted:
        return False
    if kind != "parameters":
        return kind != "same" or not ratios
    return all(said in ratios and abs(np.log(ratios[said]) - OFF[name]) < WITHIN for name, said in STATED.items())


def check(seed: int) -> Outcome:
    """One case through the command line."""
    kind = KINDS[seed % len(KINDS)]
    with tempfile.TemporaryDirectory(prefix="simulated-") as scratch:
        folder = Path(scratch)
        bench, effect = write_sides(seed, kind, folder)
        recorded, simulated, answered = folder / "recorded", folder / "simulated", folder / "out"
        words = [*COMMAND, str(recorded), "--simulated", str(simulated), "--out", str(answered)]
        done = subprocess.run([*words, "--workers", "1"], capture_output=True, text=True, check=False,
                              env={**os.environ, "OMP_NUM_THREADS": "1"})  # fmt: skip
        empty = Outcome(seed, kind, effect, bench.experiments, (), (), {}, False)
        if done.returncode:
            return replace(empty, message=done.stderr[-300:])
        answer: dict[str, Any] = json.loads((answered / "diagnosis.json").read_text(encoding="utf-8"))
    said = answer["simulation"]
    ratios = {
        name: row["simulated"] / row["recorded"] for name, row in said["behaves_like"].items() if row["differs"]
    }
    left_out, contradicted = tuple(said["left_out"]), tuple(said["contradicted"])
    right = is_right(kind, effect, left_out, contradicted, ratios)
    return replace(empty, left_out=left_out, contradicted=contradicted, ratios=ratios, right=right)


def kept(out: Path, seed: int) -> Outcome:
    """The case's outcome, computed unless ``out`` holds it."""
    file = out / f"case-{seed}.json"
    if not file.is_file():
        write_text(file, json.dumps(asdict(check(seed))) + "\n")
    held = json.loads(file.read_text(encoding="utf-8"))
    return Outcome(**{**held, "left_out": tuple(held["left_out"]), "contradicted": tuple(held["contradicted"])})


def run(out: Path, cases: int, first_seed: int, workers: int) -> list[Outcome]:
    """``cases`` simulators on ``workers`` processes; finished ones are kept in ``out``."""
    out.mkdir(parents=True, exist_ok=True)
    with ThreadPoolExecutor(workers) as pool:
        jobs = [pool.submit(kept, out, seed) for seed in range(first_seed, first_seed + cases)]
        for job in track(as_completed(jobs), "comparing", cases):
            job.result()
    found = [job.result() for job in jobs]
    write_text(out / "simulated.json", json.dumps([asdict(one) for one in found], indent=1) + "\n")
    return found


def main() -> int:
    """Print the share right by kind, and what was said of the others."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--cases", type=int, default=20)
    parser.add_argument("--first-seed", type=int, default=1000)
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    found = run(options.out, options.cases, options.first_seed, options.workers)
    for kind in KINDS:
        mine = [one for one in found if one.kind == kind]
        share = wilson(sum(one.right for one in mine), len(mine))
        print(f"{kind:10s} right {share.hits} of {share.cases} (95 %: {share.low:.2f} to {share.high:.2f})")
    for one in found:
        if not one.right:
            said = ", ".join([*(f"lacks {n}" for n in one.left_out), *(f"holds {n}" for n in one.contradicted),
                              *(f"{n} x{r:.3f}" for n, r in one.ratios.items())])  # fmt: skip
            print(
                f"  {one.seed} {one.kind} {one.effect} ({one.experiments}): {one.message or said or 'no difference'}"
            )
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
