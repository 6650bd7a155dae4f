"""Effects whose size is their own frequency: fitted from where they stand in the data, beside the stated base.

A joint that the model has rigid is absent at an infinite frequency, not at a zero amplitude. What it does at 100 Hz says
nothing of what it does at 20 Hz, and the base, refitted without it, has taken its other springs elsewhere to stand in for
it. So it is laid out over a grid of frequencies beside the prepared and the refitted base, the base free to first order;
the nearest of each is fitted with its frequency held, then freed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.coordinates import coordinates
from jointscope.diagnosis.effects import ActiveEffect
from jointscope.diagnosis.refit import Fit, least_squares
from jointscope.diagnosis.screen import Tangent, tangent
from jointscope.diagnosis.search import Effort, Hypothesis, held_at, name_of, of_own_frequency, profile_loss

if TYPE_CHECKING:
    from jointscope.diagnosis.effects import EffectSpec
    from jointscope.diagnosis.objective import Objective

Vector = NDArray[np.float64]

STEP = 1.2  # from one frequency of the grid to the next
LOWEST = 8.0  # Hz of the grid
HELD = 5  # steps with the frequency held
SIMULATIONS = 100  # per fit: modes of neighbouring joints are told apart by converged fits only


def resonances(
    objective: Objective, base: Fit, candidates: Sequence[ActiveEffect], effort: Effort
) -> list[Hypothesis]:
    """Every mode of a frequency of its own, fitted from the frequency and the base at which it is nearest to the data."""
    first: dict[str, ActiveEffect] = {}
    for active in filter(of_own_frequency, candidates):
        first.setdefault(name_of(active.spec), active)
    if not first:
        return []
    where = coordinates(objective.problem)
    x = where.pack(where.start, ())
    w = objective.residual(x, where)
    stated = Fit(where, x, w, objective.columns(x, where, w, range(where.n)), math.nan, False, True, 1 + where.n)
    tried = [trial for active in first.values() for trial in _grid(active)]
    nearest: dict[str, tuple[float, ActiveEffect, Fit]] = {}
    for parent in (stated, base):
        there = tangent(parent.w, parent.jacobian)
        theta, _ = parent.coordinates.unpack(parent.x)

        own = float(there.w @ there.w)
        costs = objective.map(partial(_left, objective, theta, there), tried)
        for cost, active in zip(costs, tried, strict=True):
            name = name_of(active.spec)
            if cost < own - effort.worth and (name not in nearest or cost < nearest[name][0]):
                nearest[name] = (cost, active, parent)
    found = []
    for _, active, parent in sorted(nearest.values(), key=lambda n: n[0]):
        fit = _fitted(objective, active, parent)
        if fit.chi2 < base.chi2:
            found.append(Hypothesis((active.spec,), fit, profile_loss(objective, fit.w)))
    return found


def _left(objective: Objective, theta: Vector, base: Tangent, active: ActiveEffect) -> float:
    """w'w beside the base at ``theta``, free to first order."""
    parts = [objective.run_residual(i, theta, (active,)) for i in range(len(objective.runs))]
    rest = base.project(np.concatenate(parts))
    return float(rest @ rest)


def _grid(active: ActiveEffect) -> list[ActiveEffect]:
    position = active.spec.amplitude
    highest = active.spec.parameters[position].upper
    count = math.floor(math.log(highest / LOWEST) / math.log(STEP))
    values = list(active.values)
    found = []
    for frequency in LOWEST * STEP ** np.arange(count + 1):
        values[position] = float(frequency)
        found.append(ActiveEffect(active.spec, tuple(values)))
    return found


def _fitted(objective: Objective, active: ActiveEffect, parent: Fit) -> Fit:
    spec: EffectSpec = active.spec
    where = coordinates(objective.problem, (spec,))
    n = parent.coordinates.n
    x = where.pack(parent.coordinates.unpack(parent.x)[0], (active,))
    new = objective.columns(x, where, objective.residual(x, where), range(n, where.n))
    there = least_squares(
        objective, held_at(where, x, [n + spec.amplitude]), x, jacobian=np.concatenate([parent.jacobian, new], axis=1),
        iterations=HELD, tolerance=1e-2, simulations=SIMULATIONS // 4,
    )  # fmt: skip
    return least_squares(
        objective, where, there.x, jacobian=there.jacobian, iterations=30, tolerance=3e-3, simulations=SIMULATIONS,
    )  # fmt: skip
