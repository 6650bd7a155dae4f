"""A whole draw of outside campaigns: resumable, sealed at the end, in the layout that ``prove`` reads.

There is no distance from the nearest rival here: ``z_d`` of the truth is z itself and ``nearest`` is empty, so a
proof's bands say how visible a case is, not how distinct from its look-alikes. z is an rms ratio, not a norm.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np

from jointscope.sim.concealed.seal import folder_digest
from jointscope.sim.draws import Draw, make_draw
from jointscope.sim.outside.case import Case, Concealed, draw_case
from jointscope.sim.outside.intent import OrderKind, intent_of
from jointscope.sim.outside.paperwork import paper_of, write_case
from jointscope.sim.outside.sensing import Record

ENGINE: Final = "outside"
REDRAWN: Final = 4  # times that a case which flies apart is drawn anew


@dataclass(frozen=True)
class Order:
    """What is asked for: one draw; ``draw`` only says what it is for, the laws are the same in all."""

    seed: int
    cases: int
    kind: OrderKind = "mixed"
    draw: str = "test"

    @property
    def as_json(self) -> dict[str, object]:
        """As it stands in the folder and in the truth."""
        return {**asdict(self), "engine": ENGINE}


def case_name(order: Order, index: int) -> str:
    """A name without meaning."""
    words = np.random.SeedSequence([order.seed, index, 7]).generate_state(1, np.uint64)
    return f"{int(words[0]) >> 24:010x}"


def produce(order: Order, folder: Path, workers: int = 1) -> str:
    """Write ``order``'s cases into ``folder`` and seal their truth (see :func:`jointscope.sim.draws.make_draw`)."""
    names = tuple(case_name(order, index) for index in range(order.cases))
    return make_draw(Draw(order.as_json, names, partial(make_case, order)), folder, workers)


def make_case(order: Order, index: int, directory: Path) -> dict[str, Any]:
    """Draw case ``index``, write its campaign into ``directory``, return the truth about it."""
    case = _drawn(order, index)
    campaign, file_format = paper_of(case, np.random.default_rng(np.random.SeedSequence([order.seed, index, 13])))
    write_case(campaign, directory, file_format)
    return _truth(order, index, case, directory, [run.id for run in campaign.runs])


def _drawn(order: Order, index: int) -> Case:
    intent = intent_of(order.seed, order.kind, index)
    for again in range(REDRAWN):
        try:
            return draw_case(intent, np.random.SeedSequence([order.seed, index, 17, again]))
        except FloatingPointError:
            if again == REDRAWN - 1:
                raise
    raise AssertionError("unreachable")


def _truth(order: Order, index: int, case: Case, directory: Path, ids: list[str]) -> dict[str, Any]:
    rig, seen = case.setup.rig, case.visibility
    strength = None
    if seen is not None:
        strength = {"z": seen.z, "z_d": seen.z, "nearest": "", "materiality": seen.share}
    return {
        "case": directory.name,
        "index": index,
        "kind": case.intent.kind,
        "draw": order.draw,
        "engine": ENGINE,
        "experiments": case.setup.experiments,
        "hard": case.intent.hard,
        "motion": "translational" if rig.slide else "rotational",
        "channels": sorted({name for record in case.records for name in record}),
        "effects": [_effect(case, effect) for effect in case.effects],
        "strength": strength,
        "wanted": case.intent.band if case.effects else None,
        "parameters": {
            "stiffness": rig.stiffness, "inertia": rig.load_inertia, "damping": rig.damping,
            "motor_damping": rig.motor_damping, "load_damping": rig.load_damping,
        },
        "noise": asdict(case.noise),
        "floor": {
            run: _floor(clean, record) for run, clean, record in zip(ids, case.clean, case.records, strict=True)
        },
        "digest": folder_digest(directory),
    }  # fmt: skip


def _effect(case: Case, effect: Concealed) -> dict[str, Any]:
    name, location = effect.label.split("@")
    return {
        "effect": name, "location": location, "law": effect.law.name, "departs": effect.law.departs,
        "listed": case.intent.kind != "unlisted", "main": effect.law.main,
        "parameters": dict(effect.sized.build.parameters), "z": effect.sized.visibility.z, "size": effect.sized.size,
    }  # fmt: skip


def _floor(clean: Mapping[str, Any], record: Record) -> dict[str, float]:
    """Per output channel, the error of a perfect model over the recording (rms; angles less their first value)."""
    found: dict[str, float] = {}
    for name in ("acceleration", "arm", "motor"):
        if name in record:
            whole = record[name] - (record[name][0] if name != "acceleration" else 0.0)
            size = float(np.sqrt(np.mean(whole**2)))
            found[name] = float(np.sqrt(np.mean((record[name] - clean[name]) ** 2))) / max(size, 1e-300)
    return found
