"""Whether the joint's own parameters are the same in every run: grease that warms from run to run is no single damping.

Of each free parameter theta of the joint one number per run is fitted to the whitened residual w by its column a = dw/dtheta,

    d = -a'w / a'a,

once to the odd and once to the even parts of each run. What the number of one half explains of the other half no noise
explains: it must carry over, and move the parameter by more than runs are known to differ by.

A motion's torque holds next to nothing at the joint's resonance but the noise of its log, by which the model rings and the
joint does not; the more damping, the less of that. So a motion's own damping is not asked for.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.gates import AS_FORETOLD
from jointscope.diagnosis.verdict import beyond

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jointscope.diagnosis.adjudicate import Judged, Judgement
    from jointscope.diagnosis.objective import Objective
    from jointscope.diagnosis.verdict import Decision

Vector = NDArray[np.float64]

LEAST = {  # relative rms departure from the common value, beyond which runs differ
    "stiffness": 0.02,
    "load_inertia": 0.02,
    "damping": 0.15,
    "motor_damping": 0.15,
    "load_damping": 0.15,
}
RUNG_BY_NOISE = ("damping", "speed-motion")
PARTS = 16  # of a run, the odd ones against the even
FEWEST = 3  # runs that must show a departure each
SURE = 5.0  # standard errors of a departure that shows
CARRIED = 20.0  # nats that one half must foretell of the other


@dataclass(frozen=True)
class Varying:
    """How a parameter of the joint departs from its common value, run by run.

    Attributes:
        name: Of the base parameter.
        runs: Identifiers.
        departures, errors: Relative to the common value [-], one per run.
        shown: Root mean square of the departures of the runs that show it, where each counts by what it shows [-].
        carried, foretold: What one half of each run explains of the other, found and due if true [nats].
    """

    name: str
    runs: tuple[str, ...]
    departures: tuple[float, ...]
    errors: tuple[float, ...]
    shown: float
    carried: float
    foretold: float

    @property
    def stands(self) -> bool:
        """Large, in several runs, and carried over."""
        clear = sum(abs(d) > SURE * e for d, e in zip(self.departures, self.errors, strict=True))
        due = max(CARRIED, AS_FORETOLD * self.foretold)
        return self.shown > LEAST[self.name] and clear >= FEWEST and self.carried > due


def varying(judgement: Judgement, judged: Judged) -> tuple[Varying, ...]:
    """Every free parameter of the joint, by how clearly runs differ in it, over fitted and held-out runs.

    None of prescribed motions: what their records' noise takes off a parameter hangs on how far each run moves.
    """
    if any(run.mode.startswith("prescribed") for run in judgement.objective.prepared):
        return ()
    where, x = judged.fit.coordinates, judged.fit.x
    base = judgement.objective.problem.base
    theta, _ = where.unpack(x)
    tested = [(k, int(i)) for k, i in enumerate(where.free) if base.names[i] in LEAST and theta[i] > 0.0]
    found: dict[int, list[tuple[str, float, float, float, float]]] = {k: [] for k, _ in tested}
    for objective in (judgement.objective, judgement.held):
        if not objective.runs:
            continue
        w = objective.residual(x, where)
        columns = objective.columns(x, where, w, [k for k, _ in tested])
        for run, rows, halves in zip(objective.prepared, objective.slices, _halves(objective), strict=True):
            for (k, i), a in zip(tested, columns[rows].T, strict=True):
                if (base.names[i], run.run.experiment) == RUNG_BY_NOISE:
                    continue
                per_unit = float(where.per_unit(x)[k]) / float(theta[i])
                one = _one_run(a, w[rows], halves, per_unit)
                if one is not None:
                    found[k].append((run.run.id, *one))
    told = [_varying(base.names[i], found[k]) for k, i in tested if found[k]]
    return tuple(sorted(told, key=lambda v: -v.carried))


def _halves(objective: Objective) -> list[NDArray[np.bool_]]:
    """Which rows of each run lie in odd parts of it, each shape (n_kept,)."""
    return [
        np.concatenate([(np.arange(size) * PARTS // max(size, 1)) % 2 == 1 for size in whitener.sizes])
        for whitener in objective.whiteners
    ]


def _one_run(
    a: Vector, w: Vector, odd: NDArray[np.bool_], per_unit: float
) -> tuple[float, float, float, float] | None:
    """Relative departure, its error, and what halves explain of each other, found and due [nats]."""
    sizes = [float(a[half] @ a[half]) for half in (odd, ~odd)]
    if min(sizes) <= 0.0:
        return None
    steps = [-float(a[half] @ w[half]) / size for half, size in zip((odd, ~odd), sizes, strict=True)]
    carried, foretold = 0.0, 0.0
    for step, other, size in zip(steps, (~odd, odd), reversed(sizes), strict=True):
        carried -= step * float(a[other] @ w[other]) + 0.5 * step**2 * size
        foretold += 0.5 * step**2 * size
    dispersion = max(1.0, float(w @ w) / w.size)
    whole = sum(sizes)
    step = -float(a @ w) / whole
    return step * per_unit, math.sqrt(dispersion / whole) * per_unit, carried / dispersion, foretold / dispersion


def _varying(name: str, of_runs: Sequence[tuple[str, float, float, float, float]]) -> Varying:
    runs, departures, errors, carried, foretold = zip(*of_runs, strict=True)
    d, e = np.array(departures), np.array(errors)
    clear = np.abs(d) > SURE * e
    shown = float(np.sqrt(np.mean(np.square(d[clear])))) if clear.any() else 0.0
    return Varying(name, runs, departures, errors, shown, sum(carried), sum(foretold))


def with_varying(decision: Decision, found: Sequence[Varying]) -> Decision:
    """``none`` in view of parameters that no run shares with the others: that is no joint with one value of each."""
    standing = [v for v in found if v.stands]
    if decision.verdict != "none" or not standing:
        return decision
    ratio = max(v.shown / LEAST[v.name] for v in standing)
    return replace(
        decision,
        verdict="unknown",
        probability=beyond(ratio),
        unknown_reason="outside-catalogue",
    )


def varying_json(found: Sequence[Varying]) -> list[dict[str, Any]]:
    """``between_runs`` of diagnosis.json: parameters of the joint that are not the same in all runs."""
    return [
        {
            "parameter": v.name, "rms_departure": round(v.shown, 4), "carried_nats": round(v.carried, 1),
            "sentence": _sentence(v),
            "by_run": {
                run: {"departure": round(d, 4), "standard_error": round(e, 4)}
                for run, d, e in zip(v.runs, v.departures, v.errors, strict=True)
            },
        }
        for v in found
        if v.stands
    ]  # fmt: skip


def _sentence(v: Varying) -> str:
    low, high = int(np.argmin(v.departures)), int(np.argmax(v.departures))

    def said(k: int) -> str:
        return f"{100.0 * v.departures[k]:+.3g} +- {100.0 * v.errors[k]:.2g} % in {v.runs[k]}"

    return f"the {v.name.replace('_', ' ')} is not the same in every run: {said(low)}, {said(high)} of its common value"
