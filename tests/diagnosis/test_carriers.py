"""A carrier by posture: its line over the postures' stiffnesses, and a start from which its law is found."""

from __future__ import annotations

import math

import numpy as np
import pytest

from jointscope.diagnosis.carriers import softenings

K, B = 1.65e5, 9.0e-8


@pytest.mark.parametrize(("kappa", "direction"), [(0.0, math.pi / 4.0), (1.6, 0.0), (3.0, -math.pi / 2.0)])
def test_stiffness_and_compliance_are_found_again_over_the_postures(kappa, direction):
    angles = np.array([0.0, 0.0, 0.5, 0.9, 1.6, 2.4, -0.7])
    own = 1.0 / (1.0 / K + B * np.square(kappa + np.cos(angles - direction)))
    best, *further = softenings(angles, own, 1e-4 * own, (0.4, kappa, 6.0))
    assert (best.stiffness, best.compliance) == pytest.approx((K, B), rel=1e-6)
    assert best.eccentricity == kappa
    assert math.cos(best.direction - direction) == pytest.approx(1.0) or (
        kappa == 0.0 and math.cos(2.0 * (best.direction - direction)) == pytest.approx(1.0)
    )
    assert all(line.left >= best.left for line in further)


def test_a_joint_that_is_stiffer_where_a_carrier_would_feel_it_more_has_none():
    """No line of a positive compliance rises with what is felt."""
    angles = np.linspace(0.0, math.pi / 2.0, 5)
    own = K * (1.0 + 0.05 * np.square(np.cos(angles)))
    assert all(line.direction != 0.0 for line in softenings(angles, own, 1e-3 * own, (0.0,)))
