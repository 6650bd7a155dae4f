"""Where the base ends far from the data: laws tried from the starts that the hits' own spectra gave.

A spring whose stiffness changes within a ring-down slips by whole turns against any fixed one. Then the refitted base has
wandered off, its tangent says nothing, and what counts is which trial follows the phase as it stands. So it is where an arm
runs into a stop: no base follows that, and one that hardly moves at all is the least wrong of them.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.base import EARLY_ORDER, Stage, relative_misfit, rewhiten
from jointscope.diagnosis.coordinates import coordinates
from jointscope.diagnosis.effects import PAYLOADS, ActiveEffect
from jointscope.diagnosis.noise import white
from jointscope.diagnosis.objective import whitened
from jointscope.diagnosis.refit import Fit, least_squares, with_fresh_jacobian
from jointscope.diagnosis.screen import resized
from jointscope.diagnosis.search import Effort, Hypothesis, fit_child, name_of, profile_loss

if TYPE_CHECKING:
    from jointscope.diagnosis.coordinates import Coordinates
    from jointscope.diagnosis.effects import EffectSpec
    from jointscope.diagnosis.noise import NoiseModel
    from jointscope.diagnosis.objective import Objective

Vector = NDArray[np.float64]

ASTRAY = 0.5  # of the data's rms, left by the base in the median channel
FAMILIES = ("stiffness", "hysteretic", "contact")
FACTORS = (1.0, 2.0, 4.0, -1.0, -2.0, -4.0)  # times the trials' sizes
TRIED = 4  # laws fitted
REFITTED = 60  # simulations of all runs under one noise
# of the base's inertia, at which a payload is tried
LEVELS = (0.25, 0.35, 0.5, 0.6, 0.7, 0.85, 1.0, 1.2, 1.4, 2.0)
LIES = (0.0, 0.5, 1.0)  # of the way from the lower group to the upper, where the base may lie
NOISES = 2  # of its own, one after the other


def afresh(
    objective: Objective, base: Fit, candidates: Sequence[ActiveEffect], effort: Effort
) -> list[Hypothesis]:
    """The laws of the spring that follow the data best from the prepared start, fitted from there.

    Returns:
        Nothing where the base is near the data, or where no trial is nearer than the start itself.
    """
    theta, _ = base.coordinates.unpack(base.x)
    if relative_misfit(objective.prepared, objective.predictions(theta, ())) < ASTRAY:
        return []
    where = coordinates(objective.problem)
    x = where.pack(where.start, ())
    w = objective.residual(x, where)
    start = Fit(where, x, w, objective.columns(x, where, w, range(where.n)), math.nan, False, True, 1 + where.n)
    trials = [
        resized(active, factor)
        for active in candidates
        if active.spec.family in FAMILIES
        for factor in FACTORS
        if factor > 0.0 or _two_sided(active)
    ]
    costs = objective.map(lambda active: objective.misfit(where.start, (active,)), trials)
    nearest: dict[tuple[str, str], tuple[float, ActiveEffect]] = {}
    for found, active in sorted(zip(costs, trials, strict=True), key=lambda pair: pair[0]):
        if found < start.chi2:
            nearest.setdefault((name_of(active.spec), active.spec.variant), (found, active))
    noise = white(objective.prepared)
    own = whitened(objective, noise, None)
    fitted = []
    for _, active in list(nearest.values())[:TRIED]:
        there = coordinates(objective.problem, (active.spec,))
        alone = under_noise_of_its_own(own, noise, there, there.pack(where.start, (active,)))
        fits = [fit_child(objective, start, [active], effort), with_fresh_jacobian(objective, alone)]
        fit = min((fit for fit in fits if fit is not None), key=lambda fit: fit.chi2)
        if fit.chi2 < base.chi2:
            fitted.append(Hypothesis((active.spec,), fit, profile_loss(objective, fit.w)))
    return fitted


def under_noise_of_its_own(own: Objective, noise: NoiseModel, where: Coordinates, x: Vector) -> Fit:
    """Fitted from ``x`` under ``noise``, then under what that leaves: under a lost base's the hits weigh next to nothing."""
    fit = least_squares(own, where, x, simulations=REFITTED)
    for _ in range(NOISES):
        own, noise, _ = rewhiten(own, fit, noise, EARLY_ORDER)
        fit = least_squares(own, where, fit.x, simulations=REFITTED)
    return replace(fit, fresh=False)


def sorted_afresh(stage: Stage, objective: Objective, specs: Sequence[EffectSpec]) -> list[Hypothesis]:
    """What some runs carry and others do not, fitted under noise of its own where the base lies between the two groups.

    Such a base leaves so much, in proportion to the signal, that under its noise no response at all is as good as any; or it
    is a fifth too stiff and too heavy, so that it follows the loaded runs with the motor held and the unloaded ones with it free.

    Args:
        objective: Under whose noise the fits are compared with others.
        specs: Laws with their runs chosen.
    """
    chosen = [spec for spec in specs if spec.name == PAYLOADS[0].name]
    found = []
    for spec in chosen:
        fit = _under_its_own_noise(stage, spec)
        here = with_fresh_jacobian(objective, fit)  # of these runs, not of those fitted
        found.append(Hypothesis((spec,), here, profile_loss(objective, here.w)))
    return found


def _under_its_own_noise(stage: Stage, spec: EffectSpec) -> Fit:
    """Fitted from the best of a grid: where between the two groups the base lies, and by how much it rings too little.

    The runs' own inertias give the ratio of the two groups' frequencies and no level: K, c, J and what is carried may all be
    ``level`` times as large and ring as fast.
    """
    problem, own, noise = stage.objective.problem, stage.objective, stage.noise
    where = coordinates(problem, (spec,))
    theta, _ = stage.fit.coordinates.unpack(stage.fit.x)
    names, of = problem.base.names, problem.own
    inertia = names.index(of.inertia)
    dynamic = [names.index(of.stiffness), names.index(of.damping), inertia]
    carried = float(theta[inertia]) * of.unit
    step = spec.scale(problem)[1] / carried

    def start(grid: tuple[float, float]) -> tuple[Vector, ActiveEffect]:
        level, lies = grid
        moved = theta.copy()
        moved[inertia] *= 1.0 - lies * step
        moved[dynamic] *= level
        return moved, ActiveEffect(spec, (level * step * carried, *spec.starts(problem)[0]))

    grid = list(itertools.product(LEVELS, LIES))
    starts = [(base, (active,)) for base, active in map(start, grid)]
    base, active = starts[own.nearest(starts)]
    return under_noise_of_its_own(own, noise, where, where.pack(base, active))


def _two_sided(active: ActiveEffect) -> bool:
    parameter = active.spec.parameters[active.spec.amplitude]
    return parameter.lower < 0.0 < parameter.upper
