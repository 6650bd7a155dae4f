"""Which links' masses recordings of an arm weigh, and at what scale its leading effects are fitted."""

import numpy as np
import pytest

from jointscope.diagnosis.arm.prepare import _apart
from jointscope.diagnosis.rescaled import angles

RNG = np.random.default_rng(11)


def known(parts):
    return [np.ones(parts.shape[1]), 1.0 / (2.0 + parts.sum(0))]


def test_as_many_masses_are_free_as_postures_tell_apart():
    """Four postures: the spring's scale and an inertia beside it leave two; the two that differ most."""
    parts = RNG.uniform(0.0, 0.3, (5, 4))
    taken = _apart(known(parts), dict(enumerate(parts)), [0, 1, 2, 3, 4])
    assert sum(taken) == 2
    assert taken == _apart(
        known(parts), dict(enumerate(np.repeat(parts, 3, axis=1).reshape(5, -1)[:, ::3])), [0, 1, 2, 3, 4]
    )


def test_a_mass_that_changes_alike_with_another_is_not_free_beside_it():
    parts = RNG.uniform(0.0, 0.3, (2, 6))
    both = {3: parts[0], 4: 0.4 * parts[0] + 0.05, 5: parts[1]}
    assert _apart(known(parts), both, [3, 4, 5]) == [True, False, True]
    assert _apart(known(parts), {}, [3]) == [False]


@pytest.mark.parametrize(
    ("unit", "power"),
    [("rad", 1), ("rad/s", 1), ("N m/rad", -1), ("N m/rad^3", -3), ("N m s/rad", -1), ("kg m^2", -1), ("N m", 0), ("Hz", 0),
     ("1", 0), ("s/rad", -1)],
)  # fmt: skip
def test_a_parameter_goes_with_the_angles_power_in_its_unit(unit, power):
    """The same torque at x/s: twice the stiffness is half the angle and half the inverse of a cubic's cube."""
    assert angles(unit) == power
