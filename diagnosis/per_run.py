"""Effects that act in some runs more than in others: which runs those are, from the runs themselves.

A payload or a stiffness that drifts from take to take is known by which takes it concerns. Neither order nor ids may
tell that, so every run's own inertia and stiffness are scored: a payload needs two clearly parted groups of inertia, of
one experiment's runs or of all, a drift a spread of stiffness beyond the estimates' own errors (``drifts``). Who carries
a payload is then asked of its fit, run by run. The freedom of choosing is paid for in the evidence (``labelling_cost``):
n ln 2 nats for a choice of members, ln n! for an order.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.base import EARLY_ORDER, Stage, of_further_runs
from jointscope.diagnosis.coordinates import coordinates
from jointscope.diagnosis.drifts import FEWEST, drifting, follows_posture, settling, telling
from jointscope.diagnosis.effects import DRIFT_PER_RUN, PAYLOADS, ActiveEffect, payloads, with_run_weights
from jointscope.diagnosis.objective import Objective
from jointscope.diagnosis.refit import Fit, least_squares

if TYPE_CHECKING:
    from jointscope.diagnosis.coordinates import Coordinates
    from jointscope.diagnosis.effects import EffectSpec
    from jointscope.diagnosis.prepare import Problem

Vector = NDArray[np.float64]

PARTED = 4.0  # distance of two groups over the scatter within, or over the median standard error
SOFTENED = 0.2  # of all scatter, below which no run's own standard error is believed
ALIKE = 2.0  # ratio of two experiments' steps within which they show one payload
OWN_STARTS = (1.0, 0.6, 0.67, 0.75, 0.85, 0.9, 0.94, 0.97, 1.03, 1.06, 1.1, 1.15, 1.25, 1.35, 1.5, 1.7)
OWN_VALLEYS = 3  # at most, whose bottoms are compared: the start that lies lowest may lie in another one
OWN_STEPS = 8  # at most, towards a run's own number
HALVED = 5  # times at most, that a step goes too far
SETTLED = 0.1  # of its standard error, below which another step tells nothing
TRIED = 0.3  # of the size that the runs' own estimates give, at which a law is tried too, and at the inverse
ASKED = 2  # times that a payload is fitted and every run asked whether it carries it


def _all_runs(stage: Stage) -> Objective:
    """All runs of the problem, held-out ones too, whitened by the noise of ``stage``."""
    every_run = tuple(range(len(stage.objective.problem.runs)))
    theta, effects = stage.fit.coordinates.unpack(stage.fit.x)
    return of_further_runs(stage.objective, every_run, stage.noise, EARLY_ORDER, [(theta, effects)])[0]


def run_steps(stage: Stage, name: str, everything: Objective | None = None) -> tuple[Vector, Vector]:
    """Each run's own relative departure of one base parameter and its standard error, shape (n_runs,) of the problem.

    Runs that say nothing of the parameter get an infinite error. ``everything``: all runs under the noise of ``stage``.
    """
    problem, where = stage.objective.problem, stage.fit.coordinates
    everything = _all_runs(stage) if everything is None else everything
    position = int(np.flatnonzero(where.free == problem.base.names.index(name))[0])
    found = everything.map(lambda i: _own(everything, i, stage.fit.x, where, position), range(len(problem.runs)))
    return np.array([step for step, _ in found]), np.array([error for _, error in found])


def _own(
    everything: Objective, i: int, together: Vector, where: Coordinates, position: int
) -> tuple[float, float]:
    """One run's own departure of a coordinate from ``together``, relative, and its standard error; Gauss-Newton.

    Several steps and starts: a frequency that is 2 % off has slipped out of phase before the arm is quiet.
    """

    def left(value: float) -> Vector:
        x = together.copy()
        x[position] = value
        return everything.run_residual(i, *where.unpack(x))

    start = float(together[position])
    tried = [(left(start * factor), start * factor) for factor in sorted(OWN_STARTS)]
    costs = [float(w @ w) for w, _ in tried]
    around = [math.inf, *costs, math.inf]
    valleys = [k for k, cost in enumerate(costs) if cost <= min(around[k], around[k + 2])]
    lowest = sorted(valleys, key=lambda k: costs[k])[:OWN_VALLEYS]
    found = [_down(left, *tried[k], where.difference(together, position)) for k in lowest]
    _, own, error = min(found, key=lambda each: each[0])
    return (own - start) / start, error / abs(start)


def _down(left: Callable[[float], Vector], w: Vector, own: float, small: float) -> tuple[float, float, float]:
    """(what is left, where, standard error) at the bottom of a valley, from ``own``, which leaves ``w``; Gauss-Newton."""
    error = math.inf
    for _ in range(OWN_STEPS):
        column = (left(own + small) - w) / small
        size = float(column @ column)
        if not size > 0.0:
            break
        error = 1.0 / math.sqrt(size)
        move = -float(column @ w) / size
        for _ in range(HALVED):
            after = left(own + move)
            if float(after @ after) < float(w @ w):
                break
            move *= 0.5
        else:
            break
        own, w = own + move, after
        if abs(move) < SETTLED * error:
            break
    return float(w @ w), own, error


def two_groups(values: Vector, errors: Vector) -> NDArray[np.bool_] | None:
    """Members of the upper group where the runs part in two beyond doubt, shape of ``values``; else ``None``.

    The cut of the sorted values that leaves least weighted scatter within (2-means in one dimension). A single normal
    population cut so has its halves 2.7 scatters apart, a uniform one 3.5.
    """
    known = telling(values, errors)
    if known.sum() < FEWEST:
        return None
    v, e = values[known], errors[known]
    weight = 1.0 / (np.square(e) + np.square(SOFTENED * np.std(v)) + 1e-300)
    order = np.argsort(v, kind="stable")
    best: tuple[float, float, float] | None = None
    for k in range(1, len(v)):
        low, high = order[:k], order[k:]
        means = [float(np.average(v[g], weights=weight[g])) for g in (low, high)]
        parts = zip((low, high), means, strict=True)
        scatter = sum(float(weight[g] @ np.square(v[g] - m)) for g, m in parts)
        if best is None or scatter < best[0]:
            best = (scatter, means[1] - means[0], 0.5 * float(v[order[k - 1]] + v[order[k]]))
    assert best is not None
    within = math.sqrt(best[0] / float(np.sum(weight)))
    if best[1] < PARTED * max(within, float(np.median(e))):
        return None
    return np.asarray(known & (values > best[2]))


def labelling_cost(spec: EffectSpec) -> float:
    """What the choice of runs costs [nats]; 0 for effects that act alike in all."""
    if spec.run_weights is None:
        return 0.0
    n = len(spec.run_weights)
    return n * math.log(2.0) if spec.name == PAYLOADS[0].name else math.lgamma(n + 1.0)


@dataclass(frozen=True, eq=False)
class Loaded:
    """Who seems to carry a payload.

    Attributes:
        members: Runs that do, shape (n_runs,).
        step: How much it adds, relative [-].
        sure: Runs that their own experiment's two groups sort, shape (n_runs,): another experiment's level tells less.
            Where no experiment has two, those that the two groups of all sort.
    """

    members: NDArray[np.bool_]
    step: float
    sure: NDArray[np.bool_]


def loaded(problem: Problem, inertia: Vector, errors: Vector) -> Loaded | None:
    """Who seems to carry a payload and how much it adds, or ``None``.

    Every experiment is sorted by its own two groups, as what a model lacks shifts the inertia of one against another's;
    where it has none, by the cut of the experiment that tells most, and where none has any, by the two groups of all.
    """
    kinds = np.array([run.run.experiment for run in problem.runs])
    ordered = sorted(sorted(set(kinds)), key=lambda k: -int(np.sum(telling(inertia, errors) & (kinds == k))))
    parted = [p for p in (_parted(inertia, errors, kinds == kind) for kind in ordered) if p is not None]
    if not parted:
        everyone = _parted(inertia, errors, np.ones_like(errors, dtype=bool))
        parted = [] if everyone is None else [everyone]
    if not parted:
        return None
    first = parted[0]
    members = np.isfinite(errors) & (inertia > first.cut)
    sure = np.zeros_like(members)
    for found in parted:
        if 1.0 / ALIKE < found.step / first.step < ALIKE:
            members[found.these] = found.members[found.these]
            sure |= found.these & found.known
    return Loaded(members, first.step, sure)


@dataclass(frozen=True, eq=False)
class _Parted:
    """Two groups of some runs.

    Attributes:
        these: The runs, shape (n_runs,).
        known: Those of them that tell, shape (n_runs,).
        members: Of the upper group, shape (n_runs,).
        cut: Half way between the groups.
        step: From group to group.
    """

    these: NDArray[np.bool_]
    known: NDArray[np.bool_]
    members: NDArray[np.bool_]
    cut: float
    step: float


def _parted(inertia: Vector, errors: Vector, these: NDArray[np.bool_]) -> _Parted | None:
    own = np.where(these, errors, np.inf)
    members = two_groups(inertia, own)
    if members is None:
        return None
    known = telling(inertia, own)
    upper, lower = inertia[known & members], inertia[known & ~members]
    cut = 0.5 * float(upper.min() + lower.max())
    return _Parted(these, known, members, cut, float(np.median(upper) - np.median(lower)))


def _payloads(stage: Stage, problem: Problem, everything: Objective) -> tuple[EffectSpec, ...]:
    laws = [spec for spec in payloads(problem) if spec.possible(problem) is None]
    own = problem.own
    found = loaded(problem, *run_steps(stage, own.inertia, everything))
    if found is None:
        return ()
    members = found.members
    theta, _ = stage.fit.coordinates.unpack(stage.fit.x)
    size = found.step * float(theta[problem.base.names.index(own.inertia)]) * own.unit
    fullest = laws[-1]
    for _ in range(ASKED):
        asked = _who_carries(stage, everything, with_run_weights(fullest, _weights(members), problem), size)
        asked = np.where(found.sure, members, asked)
        if asked.all() or not asked.any() or np.array_equal(asked, members):
            break
        members = asked
    members = _whole_experiments(stage, laws, members, found.sure, size)
    return tuple(_about(with_run_weights(spec, _weights(members), problem), size) for spec in laws)


def _about(spec: EffectSpec, size: float) -> EffectSpec:
    """The law with trials about the size that the runs' own estimates give: one far off slips out of phase."""
    return replace(spec, scale=lambda problem: (TRIED * size, size, size / TRIED))


def _weights(members: NDArray[np.bool_]) -> tuple[float, ...]:
    return tuple(float(m) for m in members)


def _fitted(stage: Stage, spec: EffectSpec, size: float) -> Fit:
    """A payload of about ``size`` [kg m^2 or kg] beside what is fitted already, roughly fitted."""
    where = coordinates(stage.objective.problem, (*stage.fit.coordinates.effects, spec))
    theta, effects = stage.fit.coordinates.unpack(stage.fit.x)
    start = ActiveEffect(spec, (size, *spec.starts(stage.objective.problem)[0]))
    return least_squares(
        stage.objective, where, where.pack(theta, (*effects, start)), iterations=5, tolerance=1e-2, simulations=40
    )


def _who_carries(stage: Stage, everything: Objective, spec: EffectSpec, size: float) -> NDArray[np.bool_]:
    """Which runs are nearer to what the fitted payload predicts with it than without, shape (n_runs,)."""
    fit = _fitted(stage, spec, size)
    theta, (*others, payload) = fit.coordinates.unpack(fit.x)
    misfits = []
    for weight in (0.0, 1.0):
        all_alike = replace(spec, run_weights=(weight,) * len(stage.objective.problem.runs))
        predictions = everything.predictions(theta, (*others, ActiveEffect(all_alike, payload.values)))
        left = [everything.whiten_run(i, y) for i, y in enumerate(predictions)]
        misfits.append([float(w @ w) for w in left])
    return np.asarray(np.array(misfits[1]) < np.array(misfits[0]))


def _whole_experiments(
    stage: Stage, laws: Sequence[EffectSpec], members: NDArray[np.bool_], sure: NDArray[np.bool_], size: float
) -> NDArray[np.bool_]:
    """The same where experiments that show no two groups carry it in every run or in none, if that fits better.

    Run by run it can't be asked of them: the base's other parameters have come to terms with it.
    """
    problem = stage.objective.problem
    kinds = np.array([run.run.experiment for run in problem.runs])

    def misfit(carriers: NDArray[np.bool_]) -> float:
        specs = (with_run_weights(law, _weights(carriers), problem) for law in laws)
        return min(_fitted(stage, spec, size).chi2 for spec in specs)

    best = math.inf
    for kind in sorted(set(kinds) - set(kinds[sure])):
        for every in (False, True):
            trial = np.where(kinds == kind, every, members)
            if trial.all() or not trial.any() or np.array_equal(trial, members):
                continue
            best = misfit(members) if math.isinf(best) else best
            found = misfit(trial)
            if found < best:
                best, members = found, trial
    return members


def per_run_specs(stage: Stage, problem: Problem) -> tuple[EffectSpec, ...]:
    """Payload and drift from run to run, where the runs' own estimates suggest them."""
    free = {problem.base.names[i] for i in np.flatnonzero(problem.base.free)}
    carried = problem.own.inertia in free and any(spec.possible(problem) is None for spec in payloads(problem))
    drifts = "stiffness" in free and DRIFT_PER_RUN.possible(problem) is None
    if not carried and not drifts:
        return ()
    everything = _all_runs(stage)
    found: list[EffectSpec] = []
    if carried:
        found.extend(_payloads(stage, problem, everything))
    if drifts:
        stiffness, errors = run_steps(stage, "stiffness", everything)
        angles = np.array([run.initial_angle for run in problem.runs])
        ways = [drifting(stiffness, errors), settling(stiffness, errors)]
        for weights in ways if not follows_posture(stiffness, errors, angles) else []:
            if weights is not None:
                drift = with_run_weights(DRIFT_PER_RUN, tuple(float(r) for r in weights), problem)
                found.append(_about(drift, float(weights @ stiffness) / float(weights @ weights)))
    return tuple(found)
