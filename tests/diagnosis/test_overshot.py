"""A search that stopped short in a curved valley is begun again from beyond; what is near the data is left alone."""

import numpy as np

from jointscope.diagnosis.effects import ActiveEffect, catalogue
from jointscope.diagnosis.overshot import overshot
from jointscope.diagnosis.refit import least_squares
from jointscope.diagnosis.search import Hypothesis, profile_loss


def strong(problem, share):
    """A loop of this share of the wind-up's torque, stiff enough to yield at a fifth of the wind-up."""
    spec = next(s for s in catalogue(problem) if s.name == "hysteresis" and s.variant == "maxwell-slip")
    torque = share * problem.scales.torque
    return ActiveEffect(spec, (torque, torque / (0.2 * problem.scales.wind_up)))


def test_a_loop_that_damping_stands_in_for_is_reached_from_beyond(problem, recorded, fitted):
    """Stuck at a third of the loop, the base fitted beside it as it is: the valley's floor is reached from its other side."""
    loop = strong(problem, 0.12)
    data = recorded(problem, 2e-3, effects=(loop,))
    objective, at = fitted(data, loop)
    start = at(data.base.start, strong(problem, 0.04))
    short = least_squares(objective, start.coordinates, start.x, iterations=2, tolerance=1e-2, simulations=12)
    stuck = Hypothesis((loop.spec,), short, profile_loss(objective, short.w))
    (found,) = overshot(objective, [stuck])
    assert found.fit.chi2 < 0.2 * short.chi2
    (effect,) = found.fit.coordinates.unpack(found.fit.x)[1]
    np.testing.assert_allclose(effect.values[0], loop.values[0], rtol=0.1)


def test_what_is_near_the_data_is_not_begun_again(problem, recorded, fitted):
    loop = strong(problem, 0.02)
    data = recorded(problem, 2e-3, effects=(loop,))
    objective, at = fitted(data, loop)
    fit = at(data.base.start, loop)
    assert overshot(objective, [Hypothesis((loop.spec,), fit, profile_loss(objective, fit.w))]) == []
    assert overshot(objective, []) == []
