"""A law of which only an overtone is there is that overtone's sine, and says the same."""

from __future__ import annotations

import math

import numpy as np
import pytest

from jointscope.diagnosis.effects import REGISTRY, ActiveEffect
from jointscope.diagnosis.effects.periodic import harmonics
from jointscope.diagnosis.main_order import by_main_order

LAWS = {(s.name, s.variant): s for s in REGISTRY}


@pytest.mark.parametrize(
    ("overtones", "k"), [((0.0, 0.0, 4.8, 6.4), 3), ((3.0, -4.0, 0.1, 0.0), 2)], ids=["third", "second"]
)
def test_the_overtone_that_carries_it_becomes_the_line(overtones, k):
    law = LAWS["torque-ripple", "cogging-harmonic"]
    found = by_main_order(ActiveEffect(law, (0.05, 6.0, 2.1, *overtones)), REGISTRY)
    assert found.spec is LAWS["torque-ripple", "cogging"]
    amplitude, order, phase = found.values
    assert order == 6.0 * k
    x = np.linspace(0.0, 2.0 * np.pi, 100)
    whole = sum(a * np.sin(o * x + p) for a, o, p in harmonics((0.0, 6.0, 2.1, *overtones)))
    assert np.max(np.abs(amplitude * np.sin(order * x + phase) - whole)) < 0.11
    assert amplitude == pytest.approx(math.hypot(*overtones[2 * k - 4 : 2 * k - 2]))


def test_a_line_with_overtones_stays():
    effect = ActiveEffect(LAWS["torque-ripple", "cogging-harmonic"], (5.0, 6.0, 2.1, 1.0, 0.0, 3.0, 0.0))
    assert by_main_order(effect, REGISTRY) is effect
    plain = ActiveEffect(LAWS["torque-ripple", "cogging"], (5.0, 6.0, 2.1))
    assert by_main_order(plain, REGISTRY) is plain
