"""A loop beside the spring, alone, begun where its stiffness and its loss are taken out of the base.

Of a joint whose springs slip one after the other, the base has taken a stiffness between the two ends and a loss that is all
viscous. A loop that is added to it makes it too stiff and too damped; every hit then slips by turns against its record, and
the fit ends in a valley nearby, in which a spring that is not straight explains as much. So where all that was fitted leaves
much, loops of all sizes are tried at less stiffness and less damping, and fitted under the noise that they themselves leave.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.afresh import under_noise_of_its_own
from jointscope.diagnosis.assembly import BASE_INDEX
from jointscope.diagnosis.base import Stage, representative, worst_misfit
from jointscope.diagnosis.coordinates import coordinates
from jointscope.diagnosis.effects import ActiveEffect
from jointscope.diagnosis.modes_apart import MUCH
from jointscope.diagnosis.noise import white
from jointscope.diagnosis.objective import whitened
from jointscope.diagnosis.own_hit import is_hit
from jointscope.diagnosis.refit import with_fresh_jacobian
from jointscope.diagnosis.search import Hypothesis, name_of, profile_loss

if TYPE_CHECKING:
    from jointscope.diagnosis.effects import EffectSpec
    from jointscope.diagnosis.objective import Objective

Vector = NDArray[np.float64]

LOOP, LAW = "hysteresis@transmission", "slip-spread"  # the others are tried from where this one ends
HITS = 6  # over which the trials are compared
TORQUES = (0.03, 0.1, 0.3)  # of the torque that the hits wind up
ANGLES = (0.05, 0.15, 0.5, 1.5)  # of the wind-up, by which the loop yields
SPREAD = 12.0  # of the last slip over the first
DAMPED = (1.0, 0.3, 0.1)  # of the base's damping
SOFTER = (1.0, 0.5, 0.0)  # of the loop's stiffness, by which the base's is too high


def loops(
    stage: Stage,
    objective: Objective,
    base: Hypothesis,
    known: Sequence[Hypothesis],
    specs: Sequence[EffectSpec],
) -> list[Hypothesis]:
    """A loop fitted alone; none without hits, or where anything that was fitted leaves little.

    Args:
        objective: Under whose noise the fits are compared with others.
        base: The base alone, fitted to the runs of ``objective``.
        known: What was fitted to them.
        specs: The laws that may be named.
    """
    law = next((spec for spec in specs if name_of(spec) == LOOP and spec.variant == LAW), None)
    if law is None or not any(is_hit(run) for run in objective.prepared):
        return []
    best = min([base, *known], key=lambda h: h.loss)
    if worst_misfit(objective.prepared, objective.predictions(*best.fit.coordinates.unpack(best.fit.x))) < MUCH:
        return []
    noise = white(stage.objective.prepared)
    own = whitened(stage.objective, noise, None)
    few = [i for i in representative(own.problem, own.runs, HITS, 0) if is_hit(own.problem.runs[i])]
    hits = own.restricted(tuple(own.runs.index(i) for i in few))
    theta, _ = base.fit.coordinates.unpack(base.fit.x)
    trials = list(_trials(stage, theta, law))
    where = coordinates(objective.problem, (law,))
    alone = under_noise_of_its_own(own, noise, where, where.pack(*trials[hits.nearest(trials)]))
    fit = with_fresh_jacobian(objective, alone)
    return [Hypothesis((law,), fit, profile_loss(objective, fit.w))]


def _trials(stage: Stage, theta: Vector, spec: EffectSpec) -> Iterator[tuple[Vector, tuple[ActiveEffect, ...]]]:
    """Base parameters and the loop, over a grid."""
    scales = stage.objective.problem.scales
    for share in TORQUES:
        for angle in ANGLES:
            torque, stiffness = share * scales.torque, share / angle * scales.torque / scales.wind_up
            loop = ActiveEffect(spec, (torque, stiffness, *(SPREAD for _ in spec.parameters[2:])))
            for damped in DAMPED:
                for softer in SOFTER:
                    there = theta.copy()
                    there[BASE_INDEX["damping"]] *= damped
                    there[BASE_INDEX["stiffness"]] -= softer * stiffness
                    if there[BASE_INDEX["stiffness"]] > 0.0:
                        yield there, (loop,)
