r"""How clearly an effect would show in these recordings, once the refit has taken what it can.

An effect of amplitude a changes the outputs by y(theta, a) - y(theta); the refit of the base (and of what was found)
takes away what it can, and what is left is judged by the gates of ``adjudicate``. With P the projection off the refit
and dtheta its step,

    z(a)   = |P L^-1 [y(theta, a) - y(theta + dtheta)]|      over the fitted runs,
    z_h(a) = |L^-1 [y(theta, a) - y(theta + dtheta)]|        over the held-out runs,
    s(a)   = rms of the same in a channel over its signal's rms.

The likelihood gain of a true effect is z^2 / 2 + z n with n standard normal, so that it passes a gate of g nats at 80 %
where z exceeds sqrt(2 g + 0.84^2) + 0.84. An experiment in which an effect changes less than the noise of a torque log does
(``echo``) counts by how loud it is beside that.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.adjudicate import (
    PROFILED,
    REAL_PICKED,
    REAL_PLACE,
    REAL_SORTED,
    REAL_UNREVEALED,
    UNREACHED,
    Judged,
    Judgement,
)
from jointscope.diagnosis.base import representative
from jointscope.diagnosis.effects.spec import made_to_show
from jointscope.diagnosis.energies import Kind, by_experiment, energies_between
from jointscope.diagnosis.gates import (
    CARRIES_OVER,
    EVIDENT,
    HELD,
    MATERIAL,
    REAL,
    REAL_FURTHER,
    REAL_UNREACHED,
    TELLING,
    share_needed,
)
from jointscope.diagnosis.objective import Objective, Predictions
from jointscope.diagnosis.per_run import labelling_cost
from jointscope.diagnosis.screen import Tangent, tangent
from jointscope.diagnosis.split import level

if TYPE_CHECKING:
    from jointscope.diagnosis.effects import ActiveEffect, EffectSpec

Vector = NDArray[np.float64]

SURE_ENOUGH = 0.84  # standard normal quantile of a detection in 80 % of repetitions
MARGIN = 1.2  # without it 38 of 54 such sizes were detected (prove.power_check, seeds 3001 to 3018)
HITS, OTHERS = 2, 1  # runs of each kind that stand for all
STEPS = 2  # of the refit that takes what it can
RUN_AWAY = 1e100  # of a prediction whose square would overflow


@dataclass(frozen=True, eq=False)
class Sample:
    """A few runs that stand for all.

    Attributes:
        weights: Per run: root of the drive's energy in all runs of its kind over that in those chosen of it.
        count: Runs that they stand for.
        before: Their predictions by the chosen hypothesis.
    """

    objective: Objective
    weights: Vector
    count: int
    before: Predictions

    def whitened(self, data: Sequence[Sequence[Vector]], model: Sequence[Sequence[Vector]]) -> Vector:
        """Weighted L^-1 (data - model) over all rows."""
        parts = [
            weight * whitener([a - b for a, b in zip(ys, ms, strict=True)])[:, 0]
            for weight, whitener, ys, ms in zip(self.weights, self.objective.whiteners, data, model, strict=True)
        ]
        return np.concatenate([np.zeros(0), *parts])

    def predictions(self, theta: Vector, effects: tuple[ActiveEffect, ...]) -> Predictions:
        """One run at a time: callers work in parallel by effect."""
        problem = self.objective.problem
        return tuple(
            self.objective.predict(problem.runs[run], theta, effects, problem) for run in self.objective.runs
        )


@dataclass(frozen=True, eq=False)
class Yard:
    """The chosen hypothesis over the runs that stand for all.

    Attributes:
        tangent: What the refit takes to first order.
        asked: Nats asked of an effect before its own costs.
        samples: Of all fitted runs.
        missed: Per channel: least explained energy over the signal's.
        echo: What the noise of a torque log makes the model do, the same per channel; what is less is not heard.
        echo_nats: The same per experiment [nats], fitted and held-out runs.
    """

    fitted: Sample
    held: Sample
    judged: Judged
    jacobian: NDArray[np.float64]
    tangent: Tangent
    asked: float
    samples: int
    missed: dict[Kind, float]
    echo: dict[Kind, float]
    echo_nats: dict[str, float]


@dataclass(frozen=True)
class Seen:
    """How an effect shows: z of the fitted and the held-out runs [-], and what it explains over what is material [-]."""

    z: float
    z_held: float
    shown: float


def _sample(objective: Objective, judged: Judged) -> Sample:
    chosen = representative(objective.problem, objective.runs, HITS, OTHERS)
    few = objective.restricted([i for i, run in enumerate(objective.runs) if run in chosen])
    runs = objective.problem.runs
    energy: dict[tuple[str, bool], list[float]] = {}
    for i in objective.runs:
        total = energy.setdefault((runs[i].run.experiment, runs[i].run.brake), [0.0, 0.0])
        own = max(level(runs[i]), 1e-9) ** 2
        total[0] += own
        total[1] += own if i in chosen else 0.0
    shares = [energy[run.run.experiment, run.run.brake] for run in few.prepared]
    weights = np.array([math.sqrt(whole / part) for whole, part in shares])
    return Sample(few, weights, len(objective.runs), few.predictions(*judged.fit.coordinates.unpack(judged.fit.x)))


def yard_of(judgement: Judgement, judged: Judged) -> Yard:
    """What effects are measured against."""
    fitted, held = _sample(judgement.objective, judged), _sample(judgement.held, judged)
    few, fit = fitted.objective, judged.fit
    w = few.residual(fit.x, fit.coordinates)
    rows = np.concatenate([np.full(p.stop - p.start, s) for p, s in zip(few.slices, fitted.weights, strict=True)])
    jacobian = few.columns(fit.x, fit.coordinates, w, range(fit.coordinates.n)) * rows[:, None]
    beyond = jacobian.copy()
    beyond[:, list(fit.coordinates.limited)] = 0.0  # what the refit takes by them is within their bounds already
    parents = len(judged.names)
    needed = share_needed(parents, exact=all(spec.exact for spec in judged.hypothesis.specs))
    missed = {}
    for key, (left, signal) in judged.energies.items():
        explained = max(judgement.base.energies[key][0] - left, 0.0) / signal if signal > 0.0 else 0.0
        missed[key] = max(MATERIAL**2, needed**2 * explained / (1.0 - needed**2))
    samples = sum(sum(v.sizes) for v in judgement.objective.whiteners)
    echo = {
        k: e / judged.energies[k][1] for k, e in judgement.echo.energies.items() if judged.energies[k][1] > 0.0
    }
    asked = REAL if parents == 0 else REAL_FURTHER
    return Yard(
        fitted,
        held,
        judged,
        jacobian,
        tangent(w * rows, beyond),
        asked,
        samples,
        missed,
        echo,
        judgement.echo.nats,
    )


def seen(yard: Yard, active: ActiveEffect) -> Seen:
    """How the effect shows, base and found effects moved to follow."""
    fit = yard.judged.fit
    theta, effects = fit.coordinates.unpack(fit.x)
    data = yard.fitted.predictions(theta, (*effects, active))
    held = yard.held.predictions(theta, (*effects, active))
    if not all(np.all(np.isfinite(y)) for ys in (*data, *held) for y in ys):
        return Seen(math.inf, math.inf, math.inf)
    x, moved = _followed(yard, data)
    left = yard.tangent.project(yard.fitted.whitened(data, moved))
    moved_held = yard.held.predictions(*fit.coordinates.unpack(x))
    nats = _nats(yard.fitted, left)
    nats_held = _nats(yard.held, yard.held.whitened(held, moved_held))
    between = energies_between(yard.fitted.objective.prepared, data, moved)
    explained = {key: changed / signal for key, (changed, signal) in between.items() if signal > 0.0}
    loud = {
        name: (gained + nats_held.get(name, 0.0)) / yard.echo_nats[name]
        for name, gained in nats.items()
        if yard.echo_nats.get(name, 0.0) > 0.0
    }
    for key, share in explained.items():
        if yard.echo.get(key, 0.0) > 0.0:
            loud[str(key[0])] = max(loud.get(str(key[0]), 0.0), share / yard.echo[key])
    z, z_held = (
        math.sqrt(sum(2.0 * gained * min(loud.get(name, 1.0), 1.0) ** 2 for name, gained in known.items()))
        for known in (nats, nats_held)
    )
    shown = [
        math.sqrt(max(share - yard.echo.get(key, 0.0), 0.0) / yard.missed.get(key, MATERIAL**2))
        for key, share in explained.items()
    ]
    return Seen(z, z_held, max(shown, default=0.0))


def _followed(yard: Yard, data: Predictions) -> tuple[Vector, Predictions]:
    """(parameters, predictions) of the refit to ``data``, by a few Gauss-Newton steps with the Jacobian as it was."""
    fit = yard.judged.fit
    x, moved = fit.x, yard.fitted.before
    left = yard.fitted.whitened(data, moved)
    for _ in range(STEPS):
        step = np.linalg.lstsq(yard.jacobian, -left, rcond=1e-10)[0]
        further = np.clip(x + np.clip(step, -0.7, 0.7), fit.coordinates.lower, fit.coordinates.upper)
        there = yard.fitted.predictions(*fit.coordinates.unpack(further))
        if not all(np.all(np.abs(y) < RUN_AWAY) for ys in there for y in ys):
            break
        less = yard.fitted.whitened(data, there)
        if not less @ less < left @ left:
            break
        x, moved, left = further, there, less
    return x, moved


def _nats(sample: Sample, w: Vector) -> dict[str, float]:
    """Half of w'w of every experiment."""
    halves = np.array([0.5 * float(w[rows] @ w[rows]) for rows in sample.objective.slices])
    return by_experiment(halves, sample.objective.prepared)


def _needed(nats: float) -> float:
    """z at which a gate is passed in 80 % of repetitions."""
    return math.sqrt(2.0 * nats + SURE_ENOUGH**2) + SURE_ENOUGH


def clearance(yard: Yard, spec: EffectSpec, found: Seen) -> tuple[float, str]:
    """(the least of what shows over what the gates ask, what limits it: ``noise`` or ``materiality``)."""
    problem = yard.fitted.objective.problem
    asked = yard.asked
    if spec.family == "periodic":
        asked = max(asked, REAL_PICKED)
    if spec.local:
        asked = max(asked, REAL_PLACE)
    if spec.run_weights is not None:
        asked = max(asked, REAL_SORTED)
    if not made_to_show(spec, problem.runs):
        asked = max(asked, REAL_UNREVEALED)
    cost = 0.5 * len(spec.parameters) * math.log(max(yard.samples, 2)) + labelling_cost(spec)
    cost += PROFILED * yard.fitted.count * spec.profiled
    clear = found.z / _needed(asked + cost)
    if yard.held.count:
        due = min(TELLING, CARRIES_OVER * 0.5 * found.z**2 * yard.held.count / yard.fitted.count)
        held = found.z_held / _needed(max(HELD, due))
        unreached = found.z / _needed(max(asked, REAL_UNREACHED) + cost)
        clear = unreached if found.z_held**2 < UNREACHED * found.z**2 else min(clear, held)
    shown = max(found.shown, found.z / _needed(EVIDENT + cost))
    return (clear / MARGIN, "noise") if clear < shown else (shown / MARGIN, "materiality")
