"""Which runs are kept back: by whole runs, stratified by experiment and level, independent of ids and order.

Overlapping windows of one run share its noise and its state, so a run is the smallest thing that may be held out
(Stone 1974 on the choice of the unit; here a take of the rig).
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from jointscope.diagnosis.prepare import PreparedRun, Problem

HOLD_EVERY = (
    3  # of a stratum sorted by level, the 2nd, 5th, 8th ... from the top are kept back: what is quiet shows little
)


@dataclass(frozen=True)
class Split:
    """Positions in ``problem.runs``.

    Attributes:
        estimate: Runs that are fitted, ascending.
        held_out: Runs that are only predicted, ascending; empty where none can be spared.
        reason: Why nothing was held out, or ``None``.
    """

    estimate: tuple[int, ...]
    held_out: tuple[int, ...]
    reason: str | None


def level(run: PreparedRun) -> float:
    """RMS of what drives the run: load force [N m] if any acts, else motor torque [N m], else commanded speed [rad/s]."""
    for drive in (run.load_force, run.motor_torque, run.speed_command):
        if drive is not None and np.any(drive):
            return float(np.sqrt(np.mean(np.square(drive))))
    return 0.0


def digest(run: PreparedRun) -> str:
    """A fingerprint of the recorded samples alone, so that no name and no order decides a tie."""
    lines = sorted(hashlib.sha256(np.ascontiguousarray(output.data)).hexdigest() for output in run.outputs)
    return hashlib.sha256("".join(lines).encode()).hexdigest()


def content_order(runs: tuple[PreparedRun, ...]) -> list[int]:
    """Positions of ``runs`` sorted by experiment, hold, level and fingerprint: the order in which all fits sum."""
    return sorted(
        range(len(runs)),
        key=lambda i: (runs[i].run.experiment, runs[i].run.brake, level(runs[i]), digest(runs[i])),
    )


def split_runs(problem: Problem) -> Split:
    """The campaign's own roles where it gives any, else every third run of each stratum sorted by level."""
    runs = problem.runs
    given = [run.role for run in runs]
    if "validate" in given:
        held = tuple(i for i, role in enumerate(given) if role == "validate")
        kept = tuple(i for i, role in enumerate(given) if role != "validate")
        if not kept:
            return Split(held, (), "every run is marked validate, so all of them had to be fitted")
        return Split(kept, held, None)
    if len(runs) == 1:
        return Split((0,), (), "there is one run only, and a part of a run is no independent test")
    strata: dict[tuple[str, bool], list[int]] = {}
    for i in content_order(runs):
        strata.setdefault((runs[i].run.experiment, runs[i].run.brake), []).append(i)
    held_out: list[int] = []
    for members in strata.values():
        if len(members) == 2:
            held_out.append(members[0])
        elif len(members) > 2:
            held_out.extend(members[-2::-HOLD_EVERY])
    if not held_out:  # one run per experiment: the cheapest experiment to lose is the one with the least to fit
        return Split(
            tuple(range(len(runs))),
            (),
            "every experiment was recorded once, so none can be kept back from the fit",
        )
    return Split(tuple(i for i in range(len(runs)) if i not in held_out), tuple(sorted(held_out)), None)
