"""Projected score tests in output space: what each candidate would explain beyond the refitted parents, without a fit.

For candidate k with shape psi: s = L^-1 [y(theta, eps psi) - y(theta)] at a finite amplitude eps (a secant), B the
whitened tangent space of what is fitted already, P = I - B B^+; gain = (s'P w)^2 / (s'P s), the decrease of w'w to
first order with every parent parameter refitted (B.2, stage 5). Only simulations are differentiated, never data.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.effects import ActiveEffect
from jointscope.diagnosis.objective import Objective
from jointscope.diagnosis.refit import Fit

if TYPE_CHECKING:
    from jointscope.diagnosis.effects import EffectSpec
    from jointscope.diagnosis.prepare import Problem

Vector = NDArray[np.float64]

AMPLITUDE_REACH = (0.05, 5.0)  # how far a secant is trusted beyond the amplitude it was taken at
PASSES = 3  # at most, towards a trial's own amplitude
INVISIBLE = 1e-8  # |P s| below this share of |s|, or of a unit residual: absorbed by the parents


@dataclass(frozen=True, eq=False)
class Trial:
    """One candidate at one trial size and shape.

    Attributes:
        active: The effect as simulated.
        direction: P s / |P s|, shape (n,), single precision.
        size: |P s|.
        gain: Decrease of w'w to first order, 0 where the sign is not admitted.
        factor: Amplitude that minimises w'w, relative to the one tried.
        absorbed: Share of |s|^2 that the parents' parameters reproduce.
    """

    active: ActiveEffect
    direction: NDArray[np.float32]
    size: float
    gain: float
    factor: float
    absorbed: float

    @property
    def spec(self) -> EffectSpec:
        """The candidate."""
        return self.active.spec


def trial_effects(spec: EffectSpec, problem: Problem, sizes: Sequence[int] = (1,)) -> list[ActiveEffect]:
    """The candidate at its starts: amplitudes ``sizes`` (0 small, 1 medium, 2 large, -k: small 10^-k) by shapes."""
    amplitude = spec.amplitude
    scale = spec.scale(problem)
    found = []
    for shape in spec.starts(problem):
        for size in sizes:
            value = scale[size] if size >= 0 else scale[0] * 10.0**size
            values = list(shape)
            values.insert(amplitude, value)
            for position in spec.proportional:
                values[position] *= value / scale[1]
            found.append(ActiveEffect(spec, tuple(float(v) for v in values)))
    return found


def resized(active: ActiveEffect, factor: float) -> ActiveEffect:
    """The effect with its amplitude's departure from null multiplied, inside its range."""
    position = active.spec.amplitude
    parameter = active.spec.parameters[position]
    null = 0.0 if parameter.null is None else float(parameter.null)
    value = active.values[position]
    if np.isinf(null) or parameter.log:
        moved = value * factor if not np.isinf(null) else value / factor
    else:
        moved = null + factor * (value - null)
    moved = float(np.clip(moved, parameter.lower, parameter.upper))
    values = list(active.values)
    for other in active.spec.proportional:
        values[other] *= moved / value if value != 0.0 else 1.0
    values[position] = moved
    return ActiveEffect(active.spec, tuple(values))


def one_sided(spec: EffectSpec) -> bool:
    """Whether the amplitude may only lie on one side of its null value."""
    parameter = spec.parameters[spec.amplitude]
    null = 0.0 if parameter.null is None else float(parameter.null)
    return not parameter.lower < null < parameter.upper


@dataclass(frozen=True, eq=False)
class Tangent:
    """What is fitted already: residual and an orthonormal basis of its tangent space.

    Attributes:
        w: P w, shape (n,).
        basis: Orthonormal, shape (n, k).
    """

    w: Vector
    basis: NDArray[np.float64]

    def project(self, s: NDArray[np.float64]) -> NDArray[np.float64]:
        """P s."""
        return s - self.basis @ (self.basis.T @ s)


def tangent(w: Vector, jacobian: NDArray[np.float64]) -> Tangent:
    """Projection off the columns of ``jacobian``."""
    size = np.linalg.norm(jacobian, axis=0)
    columns = jacobian[:, size > 0.0] / size[size > 0.0]
    u, singular, _ = np.linalg.svd(columns, full_matrices=False)
    basis = u[:, singular > 1e-9 * singular.max()] if singular.size else np.zeros((len(w), 0))
    return Tangent(w - basis @ (basis.T @ w), basis)


def score(active: ActiveEffect, departure: Vector, parents: Tangent) -> Trial | None:
    """The trial from its whitened secant ``departure`` = L^-1 [y(with) - y(without)], or ``None`` where nothing is left."""
    whole = float(departure @ departure)
    s = parents.project(departure)
    left = float(s @ s)
    if not np.isfinite(whole) or left <= max(INVISIBLE * whole, 1e-12):
        return None
    inner = float(s @ parents.w)
    factor = inner / left
    gain = inner**2 / left
    if factor <= 0.0 and one_sided(active.spec):
        gain, factor = 0.0, 0.0
    size = math.sqrt(left)
    return Trial(active, (s / size).astype(np.float32), size, gain, factor, 1.0 - left / whole)


def screen(
    objective: Objective, fit: Fit, parents: Tangent, rows: Vector, candidates: Sequence[ActiveEffect]
) -> list[Trial]:
    """Score ``candidates`` on top of ``fit`` over the runs of ``objective``; candidates that can't be seen are left out.

    Args:
        rows: w of ``fit`` over these runs, shape (n,).
    """
    theta, effects = fit.coordinates.unpack(fit.x)

    def task(active: ActiveEffect) -> Trial | None:
        parts = [objective.run_residual(i, theta, (*effects, active)) for i in range(len(objective.runs))]
        return score(active, rows - np.concatenate(parts), parents)

    return [trial for trial in objective.map(task, candidates) if trial is not None]


def best_per_spec(trials: Sequence[Trial]) -> list[Trial]:
    """The best trial of each candidate, best first; ties keep the catalogue's order."""
    best: dict[int, Trial] = {}
    for trial in trials:
        known = best.get(id(trial.spec))
        if known is None or trial.gain > known.gain:
            best[id(trial.spec)] = trial
    return sorted(best.values(), key=lambda t: -t.gain)


def refined(
    objective: Objective, fit: Fit, parents: Tangent, rows: Vector, trials: Sequence[Trial]
) -> list[Trial]:
    """The trials taken again at the amplitude that they themselves asked for; the better of the two is kept.

    Those that asked for less than a trial's reach are taken again: where an oscillation has slipped by a radian, its
    amplitude says little of the size that fits.
    """
    current = list(trials)
    for taken in range(PASSES):
        far = [t for t in current if taken == 0 or 0.0 < t.factor < AMPLITUDE_REACH[0]]
        if not far:
            break
        sizes = [float(np.clip(t.factor, *AMPLITUDE_REACH)) if t.factor > 0 else -0.3 for t in far]
        resizings = [resized(t.active, size) for t, size in zip(far, sizes, strict=True)]
        by_spec = {id(t.spec): t for t in screen(objective, fit, parents, rows, resizings)}
        current = [
            by_spec[id(t.spec)] if id(t.spec) in by_spec and honest(by_spec[id(t.spec)]) >= honest(t) else t
            for t in current
        ]
    return sorted(current, key=lambda t: -t.gain)


def honest(trial: Trial) -> float:
    """The gain at the amplitude tried, not at the one extrapolated to: gain (1 - (1 - 1/factor)^2)."""
    return trial.gain * (1.0 - (1.0 - 1.0 / trial.factor) ** 2) if trial.factor > 0.0 else 0.0


@dataclass(frozen=True, eq=False)
class Pair:
    """Two trials of different candidates, both amplitudes free.

    Attributes:
        gain: Decrease of w'w to first order.
        trials: With the factors that they ask for together: look-alikes may each be there and hide the other.
    """

    gain: float
    trials: tuple[Trial, Trial]


def pairs(trials: Sequence[Trial], w: Vector) -> list[Pair]:
    """Every pair of trials of different candidates, best first."""
    if len(trials) < 2:
        return []
    d = np.stack([t.direction for t in trials])
    gram = (d @ d.T).astype(float)
    inner = (d @ w.astype(np.float32)).astype(float)
    found = []
    for i in range(len(trials)):
        for j in range(i + 1, len(trials)):
            if trials[i].spec is trials[j].spec:
                continue
            determinant = 1.0 - gram[i, j] ** 2
            if determinant < 0.02:
                continue
            a = (inner[i] - gram[i, j] * inner[j]) / determinant
            b = (inner[j] - gram[i, j] * inner[i]) / determinant
            if (a <= 0.0 and one_sided(trials[i].spec)) or (b <= 0.0 and one_sided(trials[j].spec)):
                continue
            found.append((float(a * inner[i] + b * inner[j]), i, j, float(a), float(b)))
    return [
        Pair(gain, (replace(trials[i], factor=a / trials[i].size), replace(trials[j], factor=b / trials[j].size)))
        for gain, i, j, a, b in sorted(found, key=lambda f: -f[0])
    ]
