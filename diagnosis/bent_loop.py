"""A loop and a spring that is not straight, together: begun where the damping that stood in for the loop is taken away.

Of a joint with both, a loss that is all viscous is what the base has taken: as much as half of the critical one. Beside
it the bent spring alone finds a valley, the loop alone another or none; and from neither is the other found, as the loop
has to come while the damping goes. So where a base is that damped, and all that was fitted leaves much, loops of all
sizes are tried beside each fitted spring at a tenth of the base's damping and less, and at less stiffness, which a loop
adds to.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.assembly import BASE_INDEX
from jointscope.diagnosis.base import worst_misfit
from jointscope.diagnosis.coordinates import coordinates
from jointscope.diagnosis.modes_apart import MUCH
from jointscope.diagnosis.refit import least_squares
from jointscope.diagnosis.screen import trial_effects
from jointscope.diagnosis.search import Hypothesis, name_of, profile_loss

if TYPE_CHECKING:
    from jointscope.diagnosis.effects import ActiveEffect, EffectSpec
    from jointscope.diagnosis.objective import Objective

Vector = NDArray[np.float64]

SPRING, LOOP = "stiffness-nonlinearity@transmission", "hysteresis@transmission"
BENDS, LOOPS = ("cubic", "piecewise", "smooth"), ("dahl", "maxwell-slip")
SOME, LEAST = 0.2, 50.0  # of what the leading effect gains, and nats, that the spring must alone
HEAVY = 0.1  # of the critical damping, in a base that stands for a loop's loss
DAMPED = (0.1, 0.02)  # of the base's damping
SOFTER = (0.7, 0.85, 1.0)  # of the stiffness beside the spring alone
SPRINGS = 2  # laws of the bent spring beside which loops are tried
SIMULATIONS = 200  # of a fit, at most


def bent_loop(
    objective: Objective,
    base: Hypothesis,
    singles: Sequence[Hypothesis],
    pairs: Sequence[Hypothesis],
    specs: Sequence[EffectSpec],
) -> list[Hypothesis]:
    """Both together, fitted; none where the spring alone explains little, any set leaves little, or the base is lightly damped.

    Args:
        base: The base alone, fitted to the runs of ``objective``.
        singles: Single effects fitted to them, the best first.
        pairs: Sets fitted to them beside these.
        specs: The laws that may be named.
    """
    needed = max(SOME * max((base.loss - h.loss for h in singles), default=0.0), LEAST)
    alone = [h for h in singles if len(h.specs) == 1 and base.loss - h.loss > needed]
    springs = [h for h in alone if h.names == (SPRING,) and h.specs[0].variant in BENDS]
    if not springs or _damping_ratio(base) < HEAVY:
        return []
    best = min([*singles, *pairs], key=lambda h: h.loss)
    predictions = objective.predictions(*best.fit.coordinates.unpack(best.fit.x))
    if worst_misfit(objective.prepared, predictions) < MUCH:
        return []
    loops = [spec for spec in specs if name_of(spec) == LOOP and spec.variant in LOOPS]
    return [_fitted(objective, base, spring, loop) for spring in springs[:SPRINGS] for loop in loops]


def _damping_ratio(base: Hypothesis) -> float:
    theta, _ = base.fit.coordinates.unpack(base.fit.x)
    stiffness, inertia, damping = (theta[BASE_INDEX[n]] for n in ("stiffness", "load_inertia", "damping"))
    return float(damping / (2.0 * np.sqrt(stiffness * inertia))) if stiffness * inertia > 0.0 else 0.0


def _fitted(objective: Objective, base: Hypothesis, spring: Hypothesis, loop: EffectSpec) -> Hypothesis:
    """The loop beside the spring, from where the two together leave least."""
    where = coordinates(objective.problem, (*spring.specs, loop))
    trials = list(_trials(objective, base, spring, loop))
    start = where.pack(*trials[objective.nearest(trials)])
    fit = least_squares(objective, where, start, iterations=20, tolerance=3e-3, simulations=SIMULATIONS)
    return Hypothesis((*spring.specs, loop), fit, profile_loss(objective, fit.w))


def _trials(
    objective: Objective, base: Hypothesis, spring: Hypothesis, loop: EffectSpec
) -> Iterator[tuple[Vector, tuple[ActiveEffect, ...]]]:
    """Base parameters and the two effects, over a grid."""
    damping = base.fit.coordinates.unpack(base.fit.x)[0][BASE_INDEX["damping"]]
    theta, bent = spring.fit.coordinates.unpack(spring.fit.x)
    for trial in trial_effects(loop, objective.problem, (0, 1, 2)):
        for damped in DAMPED:
            for softer in SOFTER:
                there = theta.copy()
                there[BASE_INDEX["damping"]] = damped * damping
                there[BASE_INDEX["stiffness"]] *= softer
                yield there, (*bent, trial)
