"""Play fitted to the first periods after each hit, then to more and more of them.

Between the flanks an oscillation has no period of its own: after twenty of them a gap that is off by a fiftieth has it out
of step, and a search from anywhere else ends in the next of many valleys. Over the first two periods there is one valley,
and it is wide. What it gives starts the fit to a few more, and the last of these starts the fit to whole runs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from jointscope.diagnosis.assembly import BASE_INDEX, BASE_NAMES
from jointscope.diagnosis.base import representative
from jointscope.diagnosis.coordinates import coordinates
from jointscope.diagnosis.effects import ActiveEffect
from jointscope.diagnosis.objective import whitened
from jointscope.diagnosis.opening import opening
from jointscope.diagnosis.refit import Fit, least_squares
from jointscope.diagnosis.search import Hypothesis, held_at, name_of, profile_loss

if TYPE_CHECKING:
    from jointscope.diagnosis.base import Stage
    from jointscope.diagnosis.coordinates import Coordinates
    from jointscope.diagnosis.effects import EffectSpec
    from jointscope.diagnosis.effects.spec import Values
    from jointscope.diagnosis.noise import NoiseModel
    from jointscope.diagnosis.objective import Objective
    from jointscope.diagnosis.problem import Problem

PLAY = "backlash@transmission"
FIRST = (2.0, 3.0, 4.5, 6.5)  # periods of the base's resonance after the hit, one fit each
WIDER = 1.15  # times the periods before, from there on; a play's basin narrows as fast
WIDEST = WIDER**4  # the same at most, where each part foretells the next
FORETOLD = 1.02  # times the misfit that a fit leaves, up to which it was foretold
LAST = 80.0  # periods, beyond which a ring-down is over
STIFFER = (1.0, 1.06, 1.12, 1.2, 1.3, 1.45, 1.6, 1.8)  # times the base's stiffness, which a gap makes too soft
GAPS = (0.01, 0.02, 0.04, 0.08, 0.15, 0.3, 0.6)  # of the largest wind-up
DEPTHS = (0.15, 0.5)  # of the gap, over which rounded flanks give way
LAWS = 3  # fitted to whole runs ...
AS_NEAR = 1.5  # ... if their misfit over the first periods is no more than this times the least
HITS = 6  # that are followed; all count once whole runs are fitted
TRIED = 4  # starts fitted to the first window
SHARP, ROUND = (
    1e-3,
    1e-4,
)  # of a parameter's size, over which contacts are differenced: below, an event moves by whole steps
SHOWN = ("stiffness", "damping", "load_inertia", "load_damping", "gravity_moment")  # by hits on a held joint
RUBS = BASE_INDEX["load_damping"], BASE_INDEX["motor_damping"]
EFFORT_FIRST, EFFORT_FURTHER, EFFORT_WHOLE = (
    (15, 120),
    (10, 60),
    (20, 120),
)  # iterations and simulations of one fit


def ring_downs(stage: Stage, objective: Objective, base: Fit, specs: Sequence[EffectSpec]) -> list[Hypothesis]:
    """The laws of play among ``specs`` that follow the hits best, fitted so; none where no held joint was hit.

    Args:
        stage: All runs that are fitted, and the noise beside the base: every hit's first periods count.
        objective: The runs of the search, to which whole runs are fitted.
        base: What the base leaves of them.
    """
    problem, hits = objective.problem, struck_on_the_brake(stage)
    laws = [spec for spec in specs if name_of(spec) == PLAY and spec.variant != "off-centre"]
    if not hits or problem.scales.wind_up <= 0.0:
        return []
    hit, noise = replace(stage.objective, runs=hits, whiteners=()), stage.noise
    theta, _ = base.coordinates.unpack(base.x)
    begun = sorted((over_first_periods(hit, noise, theta, spec) for spec in laws), key=lambda fit: fit.chi2)
    near = [fit for fit in begun[:LAWS] if fit.chi2 < AS_NEAR * begun[0].chi2]
    return over_whole(hit, noise, objective, base, near)


def struck_on_the_brake(stage: Stage) -> tuple[int, ...]:
    """The fitted runs in which a held joint was hit; a few of every level where there are many."""
    problem = stage.objective.problem
    struck = (i for i in stage.objective.runs if problem.runs[i].load is not None)
    held = tuple(i for i in struck if problem.runs[i].mode == "braked")
    return representative(problem, held, HITS, HITS)


def over_first_periods(hit: Objective, noise: NoiseModel, theta: np.ndarray, spec: EffectSpec) -> Fit:
    """The law fitted to the first periods after each hit, from the best of a grid.

    Args:
        hit: The hits, not whitened.
        noise: Beside the base.
        theta: Parameters of the base.
        spec: A law of play.
    """
    near = within(hit, noise, FIRST[0])
    where = coarse(coordinates(near.problem, (spec,)))
    return over_first(hit, noise, near, where, _starts(near, theta, spec, where))


def over_first(
    hit: Objective, noise: NoiseModel, near: Objective, where: Coordinates, starts: Sequence[np.ndarray]
) -> Fit:
    """The best of ``starts`` fitted to the first window, ``near``, and then to the next few."""
    fit = min((_fit(near, where, x, EFFORT_FIRST) for x in starts), key=lambda fit: fit.chi2)
    for periods in FIRST[1:]:
        fit = _fit(within(hit, noise, periods), where, fit.x, EFFORT_FIRST)
    return fit


def over_whole(
    hit: Objective, noise: NoiseModel, objective: Objective, base: Fit, begun: Sequence[Fit]
) -> list[Hypothesis]:
    """What was begun over first periods, fitted to whole runs; without what explains nothing there."""
    found = []
    for fit in begun:
        whole = _whole(objective, base, _along(hit, noise, fit))
        if whole.chi2 < base.chi2:
            found.append(Hypothesis(whole.coordinates.effects, whole, profile_loss(objective, whole.w)))
    return found


def _along(hit: Objective, noise: NoiseModel, fit: Fit) -> Fit:
    """The fit to all of the ring-downs, by way of ever longer parts; the better it foretells one, the longer the next."""
    periods, wider = FIRST[-1] * WIDER, WIDER
    longest = max(hit.problem.runs[i].steps / hit.problem.runs[i].grid_rate for i in hit.runs)
    while periods < min(LAST, longest * hit.problem.scales.frequency):
        part = within(hit, noise, periods)
        foretold = part.residual(fit.x, fit.coordinates)
        fit = _fit(part, fit.coordinates, fit.x, EFFORT_FURTHER)
        well = float(foretold @ foretold) < FORETOLD * fit.chi2
        wider = min(wider * WIDER, WIDEST) if well else WIDER
        periods *= wider
    return fit


def _fit(objective: Objective, where: Coordinates, x: np.ndarray, effort: tuple[int, int]) -> Fit:
    return least_squares(objective, where, x, iterations=effort[0], tolerance=3e-3, simulations=effort[1])


def _whole(objective: Objective, base: Fit, fit: Fit) -> Fit:
    """Fitted on to whole runs, once with steps across contacts and once with small ones."""
    where = coordinates(objective.problem, fit.coordinates.effects)
    rough = _fit(objective, coarse(where), _beside_motions(objective, base, fit, where), EFFORT_WHOLE)
    return _fit(objective, where, rough.x, EFFORT_WHOLE)


def _beside_motions(objective: Objective, base: Fit, fit: Fit, where: Coordinates) -> np.ndarray:
    """Where the hits' fit goes on from in runs whose motor moves: what hits don't show is fitted beside what they do.

    The motor rubs by what the base's damping held of both ends together; without it a joint that drifts off is all
    that is left to be seen.
    """
    theta, effects = fit.coordinates.unpack(fit.x)
    if all(run.mode == "braked" for run in objective.prepared):
        return fit.x
    before, _ = base.coordinates.unpack(base.x)
    both = before[RUBS[0]] + before[RUBS[1]]
    theta[RUBS[1]] = max(both - theta[RUBS[0]], before[RUBS[1]])
    x = where.pack(theta, effects)
    shown = [k for k, place in enumerate(where.free) if BASE_NAMES[place] in SHOWN]
    held = held_at(where, x, [*shown, *range(where.n_base, where.n)])
    return _fit(objective, held, x, EFFORT_FIRST).x


def coarse(where: Coordinates) -> Coordinates:
    """The coordinates, differenced over steps that contacts do not jump within."""
    rounded = any(spec.variant == "rounded" for spec in where.effects)
    return replace(where, step=np.full_like(where.step, ROUND if rounded else SHARP))


def _starts(near: Objective, theta: np.ndarray, spec: EffectSpec, where: Coordinates) -> list[np.ndarray]:
    """The nearest of a grid of stiffnesses, gaps and depths, as coordinates."""
    wind_up = near.problem.scales.wind_up
    trials = []
    for factor in STIFFER:
        stiffer = theta.copy()
        stiffer[BASE_INDEX["stiffness"]] *= factor
        for gap in GAPS:
            for depth in DEPTHS if len(spec.parameters) > 1 else DEPTHS[:1]:
                values = _shaped(spec, near.problem, gap * wind_up, depth)
                trials.append((stiffer, ActiveEffect(spec, values)))
    costs = near.map(lambda trial: near.misfit(trial[0], (trial[1],)), trials)
    order = np.argsort(costs, kind="stable")
    return [where.pack(trials[k][0], (trials[k][1],)) for k in order[:TRIED]]


def _shaped(spec: EffectSpec, problem: Problem, gap: float, depth: float) -> Values:
    """The law at this gap, its flanks giving way, or its corners bent, over this share of it."""
    if len(spec.parameters) == 1:
        return (gap,)
    over = depth if spec.parameters[1].name == "corner" else depth * gap
    return (gap, over, *spec.starts(problem)[0][1:])


def within(hit: Objective, noise: NoiseModel, periods: float) -> Objective:
    """The hits up to ``periods`` after each began, whitened by ``noise``."""
    runs = list(hit.problem.runs)
    for i in hit.runs:
        runs[i] = opening(runs[i], periods / hit.problem.scales.frequency)
    return whitened(replace(hit, problem=replace(hit.problem, runs=tuple(runs))), noise, None)
