r"""The leading effects of an arm, fitted again from where its links weigh what the file says.

Where only forces move an arm, it moves alike if its masses, springs and dampers are s times as large and the force is, too:

    m, K, c -> s m, s K, s c,    F -> s F,    a law T(x) -> s T(x)

so a force gain (or a sensor's) and a scale are one and the same, and only the stated masses tell them apart. A base without
the effect ends at a scale of its own, and from there a law whose force is not in proportion to the angle has to take its
angles along, x -> x/s at the same torque: a narrow curved valley, in which a search stays where it is. So each leading set
is started once more from the file's masses, its stiffnesses, dampings and angles taken along.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from jointscope.diagnosis.refit import least_squares
from jointscope.diagnosis.search import Hypothesis, profile_loss

if TYPE_CHECKING:
    from jointscope.diagnosis.effects import ActiveEffect
    from jointscope.diagnosis.objective import Objective

WEIGHED = "link_mass"  # of the file's: a factor
ALONG = ("stiffness", "damping", "motor_damping", "drive_stiffness", "drive_damping", "load_damping", WEIGHED)
ALIKE = 0.02  # of the scale, within which a search has not stayed anywhere else
STEPS, SIMULATIONS = 12, 60


def angles(unit: str) -> int:
    """Power of an angle in a parameter's unit, at a torque that stays: -1 of N m/rad, and of an inertia [kg m^2]."""
    if unit.startswith("kg"):
        return -1
    above, _, below = unit.partition("/")
    return sum(sign * _power(part) for sign, part in ((1, above), (-1, below)))


def _power(part: str) -> int:
    return sum(int(power or 1) for power in re.findall(r"\brad(?:\^(\d))?", part))


def rescaled(objective: Objective, leading: Sequence[Hypothesis]) -> list[Hypothesis]:
    """Those of ``leading`` that fit better from the stated masses; none where no link's mass is free or was moved."""
    names = objective.problem.base.names
    found = []
    for h in leading:
        where = h.fit.coordinates
        theta, effects = where.unpack(h.fit.x)
        weighed = [k for k in where.free if names[k].startswith(WEIGHED)]
        moved = math.exp(sum(math.log(theta[k]) for k in weighed) / len(weighed)) if weighed else 1.0
        if abs(math.log(moved)) < ALIKE:
            continue
        for k in where.free:
            if names[k].partition(":")[0] in ALONG:
                theta[k] /= moved
        x = where.pack(theta, tuple(_at_scale(effect, moved) for effect in effects))
        fit = least_squares(objective, where, x, iterations=STEPS, tolerance=1e-3, simulations=SIMULATIONS)
        if fit.chi2 < h.fit.chi2:
            found.append(Hypothesis(h.specs, fit, profile_loss(objective, fit.w)))
    return found


def _at_scale(effect: ActiveEffect, moved: float) -> ActiveEffect:
    values = tuple(
        value * moved ** angles(parameter.unit)
        for parameter, value in zip(effect.spec.parameters, effect.values, strict=True)
    )
    return replace(effect, values=values)
