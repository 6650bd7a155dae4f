"""Whether a named effect keeps its size within a run: grease that thins as it is sheared is no Coulomb friction.

The effect's whitened column, times a ramp from -1 at the beginning of each run to 1 at its end, is fitted beside all free
parameters of the model (a score test, Rao 1948): its coefficient over the effect's size is how far the size moves away
from its mean by the end. Ring-downs are left out: there a law's form, which need not be the true one, changes with the
level and so with time. Sweeps, which change their frequency with time, count as motions do, which go there and back: right
names of a form that is a little wrong moved by 4 % in them at most. The held-out runs must gain by the same change.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.adjudicate import Judged, Judgement
from jointscope.diagnosis.gates import AS_FORETOLD, HELD
from jointscope.diagnosis.objective import Objective

if TYPE_CHECKING:
    from jointscope.diagnosis.coordinates import Coordinates

Vector = NDArray[np.float64]

FAMILIES = ("dissipative", "hysteretic", "stiffness", "input", "sensor-gain")
STEADY = ("speed-motion", "torque-sweep")  # experiments whose level is about the same early and late
CHANGES = 0.25  # of the size, away from its mean by the end, beyond which it is another law's
WHOLE = 1.0  # of the size: an effect that turned its sign within a run is no size that changed, but a form that is a little wrong
SURE = 5.0  # standard errors
TOLERANCE = 1e-9  # of the strongest direction of the parameters, below which they are not told apart


@dataclass(frozen=True)
class Change:
    """How the size of an effect moves within runs.

    Attributes:
        name: ``effect@location``.
        relative: Departure from its mean size at the end of a run, over that size [-]; at the beginning the opposite.
        error: Standard error of it [-].
        gain: On the fitted runs, net of Occam [nats].
        held_gain, foretold: On the held-out runs, found and due if true [nats].
    """

    name: str
    relative: float
    error: float
    gain: float
    held_gain: float
    foretold: float

    @property
    def stands(self) -> bool:
        """Large, beyond chance, without a change of sign, and carried over."""
        large = WHOLE > abs(self.relative) > max(CHANGES, SURE * self.error)
        return large and self.gain > HELD and self.held_gain > max(HELD, AS_FORETOLD * self.foretold)


def _ramp(objective: Objective) -> Vector:
    """-1 to 1 over the kept samples of every output of a steady run, 0 in the others, shape (n,)."""
    parts: list[Vector] = []
    for run, whitener in zip(objective.prepared, objective.whiteners, strict=True):
        steady = run.run.experiment in STEADY
        parts.extend(np.linspace(-1.0, 1.0, size) if steady else np.zeros(size) for size in whitener.sizes)
    return np.concatenate(parts) if parts else np.zeros(0)


def _amplitude(where: Coordinates, x: Vector, position: int) -> tuple[int, float]:
    """Coordinate of the amplitude of the effect at ``position``, and how far it is from nothing there; its sign too."""
    spec = where.effects[position]
    j = where.effect_slices()[position].start + spec.amplitude
    if where.logarithm[j]:
        return j, 1.0
    null = spec.parameters[spec.amplitude].null or 0.0
    return j, float(x[j] - null / where.scale[j])


def changes(judgement: Judgement, judged: Judged) -> tuple[Change, ...]:
    """The change of every effect of a model for which a change of size is another law.

    Returns:
        Nothing without held-out runs, or where no run is steady.
    """
    objective, held = judgement.objective, judgement.held
    named = [
        (k, s)
        for k, s in enumerate(judged.hypothesis.specs)
        if s.family in FAMILIES and not s.profiled and s.run_weights is None and s.name != "stiffness-drift"
    ]
    fitted, kept = _ramp(objective), _ramp(held)
    if not named or not fitted.any() or not kept.any():
        return ()
    where, x = judged.fit.coordinates, judged.fit.x
    w, held_w = objective.residual(x, where), held.residual(x, where)
    columns = objective.columns(x, where, w, range(where.n))
    held_columns = held.columns(x, where, held_w, range(where.n))
    dispersion = max(1.0, float(w @ w) / w.size)
    found = []
    for position, spec in named:
        j, size = _amplitude(where, x, position)
        ramped, held_ramped = columns[:, j] * fitted, held_columns[:, j] * kept
        if size == 0.0 or not ramped.any():
            continue
        parts = _explained(columns, np.column_stack([w, ramped]))
        left, beside = (np.column_stack([w, ramped]) - columns @ parts).T
        held_left, held_beside = (np.column_stack([held_w, held_ramped]) - held_columns @ parts).T
        size_of_column = float(beside @ beside)
        if size_of_column <= TOLERANCE * float(ramped @ ramped):  # the parameters can do the same
            continue
        step = -float(beside @ left) / size_of_column
        held_child = held_left + step * held_beside
        found.append(
            Change(
                name=f"{spec.name}@{spec.location}",
                relative=step / size,
                error=math.sqrt(dispersion / size_of_column) / abs(size),
                gain=0.5 * step**2 * size_of_column / dispersion - 0.5 * math.log(w.size),
                held_gain=0.5 * float(held_left @ held_left - held_child @ held_child) / dispersion,
                foretold=0.5 * step**2 * float(held_beside @ held_beside) / dispersion,
            )
        )
    return tuple(found)


def _explained(columns: NDArray[np.float64], targets: NDArray[np.float64]) -> NDArray[np.float64]:
    """Coefficients of the columns that explain most of every target, shape (n_columns, n_targets)."""
    size = np.linalg.norm(columns, axis=0)
    size[size == 0.0] = 1.0
    return np.asarray(np.linalg.lstsq(columns / size, targets, rcond=TOLERANCE)[0] / size[:, None])


def changes_json(found: Sequence[Change]) -> list[dict[str, Any]]:
    """``changes`` of diagnosis.json: named effects whose size is not the same early and late in a run."""
    return [
        {
            "effect": c.name, "change": round(2.0 * c.relative, 3), "standard_error": round(2.0 * c.error, 3),
            "gain_nats": round(c.gain, 1), "held_out_gain_nats": round(c.held_gain, 1),
            "sentence": f"{c.name} comes nearest, but from the beginning of a run to its end its size "
            f"{'grows' if c.relative > 0.0 else 'falls'} by {200.0 * abs(c.relative):.0f} +- {200.0 * c.error:.0f} % "
            "of its mean, in runs that were not fitted too",
        }
        for c in found
        if c.stands
    ]  # fmt: skip
