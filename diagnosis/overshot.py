"""Where the leading effects still leave much: fitted again from beyond where the search stopped.

Of a strong effect the base, fitted without it, has taken a share: damping stands in for a loop, stiffness for a soft middle.
From there to where the effect has all of its own the misfit falls along a narrow curved valley, in which a search ends by
its count of steps. Started with a multiple of the amplitude that was found, it comes down the far side, which is short.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from jointscope.diagnosis.base import relative_misfit
from jointscope.diagnosis.refit import least_squares
from jointscope.diagnosis.screen import resized
from jointscope.diagnosis.search import Hypothesis, profile_loss

if TYPE_CHECKING:
    from jointscope.diagnosis.objective import Objective

MUCH = 0.12  # of the data's rms, left in the median channel by what leads
BEYOND = 2.5  # times the amplitude that was found
STEPS, SIMULATIONS = 20, 80
LOWER = 0.97  # of the misfit, that a fit must reach to count


def overshot(objective: Objective, leading: Sequence[Hypothesis]) -> list[Hypothesis]:
    """Those of ``leading`` that fit better from beyond; none where the first of them is near the data."""
    if not leading:
        return []
    first = leading[0].fit
    if relative_misfit(objective.prepared, objective.predictions(*first.coordinates.unpack(first.x))) < MUCH:
        return []
    found = []
    for h in leading:
        where = h.fit.coordinates
        theta, effects = where.unpack(h.fit.x)
        x = where.pack(theta, tuple(resized(effect, BEYOND) for effect in effects))
        fit = least_squares(objective, where, x, iterations=STEPS, tolerance=1e-3, simulations=SIMULATIONS)
        if fit.chi2 < LOWER * h.fit.chi2:
            found.append(Hypothesis(h.specs, fit, profile_loss(objective, fit.w)))
    return found
