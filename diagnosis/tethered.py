"""The search once more from a base that stays where it was expected, where the base alone has run away.

Without a hit, what little a held torque log shows of a resonance is best met by a joint as stiff as a rock: the least wrong
of rigid bodies. Nothing that acts on the spring can be screened from there, and no effect alone leads back. So the
stiffness and the inertia that ended far from their start are held there while effects are sought, and let go beside them.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from jointscope.diagnosis.base import Stage, refit_base
from jointscope.diagnosis.coordinates import coordinates
from jointscope.diagnosis.polish import viewed
from jointscope.diagnosis.refit import least_squares
from jointscope.diagnosis.search import Hypothesis, profile_loss

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jointscope.diagnosis.objective import Objective

FAR = 3.0  # times its start, or of it, beyond which a base is not believed
TETHERED = ("stiffness", "load_inertia")
LET_GO = 4  # sets found so, fitted with the base free


def run_away(stage: Stage) -> tuple[int, ...]:
    """Positions in the base of what ended far from its start."""
    base = stage.objective.problem.base
    theta, _ = stage.fit.coordinates.unpack(stage.fit.x)
    return tuple(
        k
        for k, name in enumerate(base.names)
        if name in TETHERED
        and base.free[k]
        and base.start[k] > 0.0
        and abs(math.log(max(float(theta[k]), 1e-300) / float(base.start[k]))) > math.log(FAR)
    )


def tethered(stage: Stage, positions: Sequence[int]) -> Stage:
    """The base refitted with the parameters at ``positions`` held at their start."""
    objective = stage.objective
    base = objective.problem.base
    lower, upper = np.array(base.lower, float), np.array(base.upper, float)
    lower[list(positions)] = upper[list(positions)] = np.asarray(base.start)[list(positions)]
    problem = replace(objective.problem, base=replace(base, lower=lower, upper=upper))
    return refit_base(problem, objective.predict, objective.runs, objective.pool)


def beside(
    objective: Objective, hypotheses: Sequence[Hypothesis], others: Sequence[Hypothesis]
) -> tuple[Hypothesis, ...]:
    """``hypotheses``, and the leading ones of a tethered search with the base free, all under the noise of ``objective``."""
    found = [viewed(objective, h) for h in hypotheses]
    for h in sorted(others, key=lambda h: h.loss)[:LET_GO]:
        where = coordinates(objective.problem, h.fit.coordinates.effects)
        x = where.pack(*h.fit.coordinates.unpack(h.fit.x))
        fit = least_squares(objective, where, x, iterations=30, tolerance=1e-3)
        found.append(Hypothesis(h.specs, fit, profile_loss(objective, fit.w)))
    return tuple(sorted(found, key=lambda h: h.loss))
