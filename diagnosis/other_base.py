"""Laws sought from another base than that of all runs, where a mismatch has pulled that away from what is known of the rig.

What is known is what hits on the brake say by themselves, else the stiffness that the campaign states. Cogging of 3.2 N m
took a motor's stiffness of 15 kN m/rad, stated as 19.5, to 160: from there the cogging is met at a wrong order, and what
it leaves is a drive's lag. From the stated stiffness it is found at once, and the stiffness beside it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from jointscope.diagnosis.base import EARLY_ORDER, Stage, rewhiten
from jointscope.diagnosis.brake_first import of_the_brake
from jointscope.diagnosis.candidates import candidates_for, residuals_of
from jointscope.diagnosis.refit import Fit, with_fresh_jacobian
from jointscope.diagnosis.search import Effort, Hypothesis, fit_singles, screen_on, seen

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from jointscope.diagnosis.effects import EffectSpec
    from jointscope.diagnosis.noise import NoiseModel
    from jointscope.diagnosis.objective import Objective

    Vector = NDArray[np.float64]

LOST = 2.0  # times the stiffness that is stated, or its inverse, beyond which it is the fit that is off and no nameplate


def as_stated(objective: Objective, base: Fit) -> Vector | None:
    """The start's base parameters with the stated stiffness; ``None`` where none is stated, or the base's is about that."""
    names, known = objective.problem.base.names, objective.problem.rig.stiffness_reference
    if known is None or "stiffness" not in names:
        return None
    where, stiffness = base.coordinates, names.index("stiffness")
    theta, _ = where.unpack(base.x)
    if stiffness not in where.free or known / LOST <= theta[stiffness] <= LOST * known:
        return None
    found = where.start.copy()
    found[stiffness] = known
    return found


def from_other_base(
    stage: Stage,
    objective: Objective,
    noise: NoiseModel,
    base: Fit,
    specs: Sequence[EffectSpec],
    effort: Effort,
) -> list[Hypothesis]:
    """The single effects that lead from what is known of the rig, fitted from there with the base free.

    Args:
        objective: The runs of the search under ``noise``, to which losses refer.
        base: Of these runs.
        specs: The laws that may be named.

    Returns:
        Nothing where the base is not far from what is known.
    """
    theta = of_the_brake(objective, base)
    if theta is None:
        theta = as_stated(objective, base)
    if theta is None:
        return []
    there = replace(base, x=base.coordinates.pack(theta, ()), fresh=False)
    own, _, _ = rewhiten(objective, there, noise, EARLY_ORDER)
    start = with_fresh_jacobian(own, there)
    left = residuals_of(stage.objective, stage.objective.predictions(theta, ()))
    screening = screen_on(own, start, candidates_for(stage.objective.problem, specs, left), effort)
    return [seen(objective, h) for h in fit_singles(own, start, screening, effort)]
