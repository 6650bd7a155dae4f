"""What is stated of nothing but the motor begins at the motor's own size."""

from __future__ import annotations

import math

import pytest

from jointscope.diagnosis.assembly import BASE_INDEX
from jointscope.diagnosis.parameters import base_spec
from jointscope.recordings.campaign import Nameplate

MOTOR = dict(reduction_ratio=14.0, motor_inertia=1.2e-5, reducer_inertia=3.8e-6)


def begun(**stated):
    start = base_spec(Nameplate(topology="two-inertia", motion="rotational", **stated), ()).start
    return float(start[BASE_INDEX["load_inertia"]])


def test_a_load_of_which_nothing_is_stated_begins_at_the_motors_inertia():
    assert begun(**MOTOR) == pytest.approx(14.0**2 * (1.2e-5 + 3.8e-6))


def test_what_is_stated_comes_first():
    assert begun(**MOTOR, inertia_reference=0.4) == 0.4
    assert begun(**MOTOR, arm_mass=2.0, arm_com_radius=0.1) == pytest.approx(1.3 * 2.0 * 0.1**2)


def test_where_nothing_at_all_is_stated_something_must_be():
    assert math.isclose(begun(), 1.0)
