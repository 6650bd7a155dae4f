"""A structural loss in an arm's reducer: what it adds to the damping of each posture, and where it can't be told."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from jointscope.diagnosis.arm import kernel
from jointscope.diagnosis.arm.effects import UNLIKE_POSTURES, _structural

K, LOSS = 4.4e4, 0.06


def arm(*inertias):
    """An arm of one joint, hit in postures of these inertias."""
    runs = tuple(SimpleNamespace(plant=SimpleNamespace(mass=np.full((1, 1, 1), inertia))) for inertia in inertias)
    return SimpleNamespace(arm_runs=runs, mask=lambda run: (True,), facts=SimpleNamespace(joints=("shoulder",)))


@pytest.mark.parametrize("inertia", [4.7, 14.4])
def test_at_its_resonance_a_posture_loses_what_a_complex_spring_does(inertia):
    """c w = eta K at w^2 = K/J, so the mode's loss, c w/K, is eta whatever the posture; the viscous part stays."""
    (law,) = _structural(arm(4.7, 14.4), 0)
    P = np.zeros((1, kernel.COLUMNS))
    P[0, kernel.STIFFNESS], P[0, kernel.DAMPING] = K, 2.7
    plant = SimpleNamespace(mass=np.full((1, 1, 1), inertia))
    law.apply(SimpleNamespace(P=P, run=SimpleNamespace(plant=plant)), (LOSS,), 1.0)
    w = math.sqrt(K / inertia)
    assert (P[0, kernel.DAMPING] - 2.7) * w / K == pytest.approx(LOSS)


def test_in_postures_alike_it_is_damping():
    assert _structural(arm(5.0, 5.0 * 0.99 * UNLIKE_POSTURES), 0) == []
    assert len(_structural(arm(5.0, 5.0 * 1.01 * UNLIKE_POSTURES), 0)) == 1
