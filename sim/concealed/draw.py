"""One case of a draw: rig, runs, effects of a chosen hardness, noise, and the truth about it.

A case depends on the draw's seed and its own index only, so the order of work and the number of workers don't matter.
What is drawn before the effect (experiments, rig, devices, noise) is drawn from streams of its own, alike for cases
with and without one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from jointscope.sim.concealed import paperwork
from jointscope.sim.concealed.bench import Bench, draw_bench
from jointscope.sim.concealed.concealment import CaseKind, conceal
from jointscope.sim.concealed.law import Draw, Effect
from jointscope.sim.concealed.measurement import noisy
from jointscope.sim.concealed.rehearsal import declared, rehearse
from jointscope.sim.concealed.seal import folder_digest
from jointscope.sim.concealed.strength import Strength

Real = NDArray[np.float64]
DrawKind = Literal["nulls", "singles", "pairs", "unlisted", "undecidable", "mixed"]
SHARES: dict[DrawKind, dict[CaseKind, float]] = {
    "nulls": {"null": 1.0},
    "singles": {"single": 1.0},
    "pairs": {"pair": 1.0},
    "unlisted": {"unlisted": 1.0},
    "undecidable": {"undecidable": 1.0},
    "mixed": {
        "null": 0.33, "single": 0.34, "pair": 0.165, "unlisted": 0.11, "undecidable": 0.055,
    },
}  # fmt: skip
REDRAWN = 4  # times that a case which flies apart is drawn anew


@dataclass(frozen=True)
class Order:
    """What is asked for: one draw."""

    seed: int
    cases: int
    kind: DrawKind
    draw: Draw


def case_name(order: Order, index: int) -> str:
    """A name without meaning."""
    words = np.random.SeedSequence([order.seed, index, 7]).generate_state(1, np.uint64)
    return f"{int(words[0]) >> 24:010x}"


@dataclass(frozen=True, eq=False)
class Case:
    """What is decided about a case before anything is recorded."""

    kind: CaseKind
    bench: Bench
    effects: tuple[Effect, ...]
    measured: Strength | None


def decide(order: Order, index: int, again: int = 0) -> Case:
    """Bench and effects of case ``index``; ``again``: other effects on the same bench, where the first flew apart."""
    kinds, bench_seed, effect_seed, _, _ = np.random.SeedSequence([order.seed, index]).spawn(5)
    kind = _kind(order, np.random.default_rng(kinds))
    bench = draw_bench(np.random.default_rng(bench_seed), order.draw)
    rng = np.random.default_rng([*effect_seed.generate_state(4), again] if again else effect_seed)
    effects, measured = conceal(bench, kind, order.draw, rng)
    return Case(kind, bench, effects, measured)


def recorded(order: Order, index: int) -> tuple[Case, list[dict[str, Real]]]:
    """Case ``index`` and what its runs would record without noise.

    How hard a case is is measured on a few of its runs; one that flies apart in another is drawn anew, and
    so is one of which no law can be simulated on its rig.

    Raises:
        FloatingPointError: Every one of the draws did.
    """
    for again in range(REDRAWN):
        try:
            case = decide(order, index, again)
            return case, rehearse(case.bench.rig, case.bench.plan, case.effects, range(len(case.bench.plan.takes)))
        except FloatingPointError:
            if again == REDRAWN - 1:
                raise
    raise AssertionError("unreachable")


def make_case(order: Order, index: int, directory: Path) -> dict[str, Any]:
    """Draw case ``index``, write its campaign into ``directory``, return the truth about it."""
    case, clean = recorded(order, index)
    bench = case.bench
    noise_seed, paper_seed = np.random.SeedSequence([order.seed, index]).spawn(5)[3:]
    noise_rng = np.random.default_rng(noise_seed)
    clean = [declared(channels, bench.plan.devices) for channels in clean]
    records = [noisy(channels, bench.plan.devices, bench.noise, noise_rng) for channels in clean]
    paper = np.random.default_rng(paper_seed)
    plate = paperwork.nameplate(bench.rig, bench.topology, bench.motion, paper, 0.35 if bench.hard else 0.15)
    campaign = paperwork.campaign(bench.rig, bench.plan, records, plate, paper)
    paperwork.write_case(campaign, directory)
    return _truth(order, index, case, clean, records, directory, [run.id for run in campaign.runs])


def _kind(order: Order, rng: np.random.Generator) -> CaseKind:
    shares = SHARES[order.kind]
    return list(shares)[int(rng.choice(len(shares), p=np.array(list(shares.values())) / sum(shares.values())))]


def _truth(
    order: Order, index: int, case: Case, clean: Sequence[Mapping[str, Real]],
    records: Sequence[Mapping[str, Real]], directory: Path, ids: Sequence[str],
) -> dict[str, Any]:  # fmt: skip
    kind, bench, effects, measured = case.kind, case.bench, case.effects, case.measured
    joint = bench.rig.joint
    return {
        "case": directory.name,
        "index": index,
        "kind": kind,
        "draw": order.draw,
        "experiments": bench.experiments,
        "topology": bench.topology,
        "hard": bench.hard,
        "motion": bench.motion,
        "channels": sorted({name for record in records for name in record}),
        "effects": [
            {
                "effect": effect.law.effect, "location": effect.law.location, "law": effect.law.law,
                "departs": effect.law.departs, "listed": kind != "unlisted", "main": effect.law.main,
                "parameters": effect.reported(bench.setting), "values": dict(effect.values),
            }
            for effect in effects
        ],
        "strength": asdict(measured) if measured is not None else None,
        "parameters": {
            "stiffness": joint.stiffness, "inertia": joint.load_inertia, "damping": joint.damping,
            "motor_damping": joint.motor_damping, "load_damping": joint.load_damping,
        },
        "noise": asdict(bench.noise),
        "floor": {run: _floor(a, b) for run, a, b in zip(ids, clean, records, strict=True)},
        "digest": folder_digest(directory),
    }  # fmt: skip


def _floor(clean: Mapping[str, Real], record: Mapping[str, Real]) -> dict[str, float]:
    """Per output channel, the error of a perfect model over the recording (rms; angles less their first value)."""
    out = {}
    for name in ("acceleration", "arm", "motor"):
        if name in record:
            whole = record[name] - (record[name][0] if name != "acceleration" else 0.0)
            size = float(np.sqrt(np.mean(whole**2)))
            out[name] = float(np.sqrt(np.mean((record[name] - clean[name]) ** 2))) / max(size, 1e-300)
    return out
