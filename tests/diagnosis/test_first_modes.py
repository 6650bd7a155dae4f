"""Hits of an arm whose second mode is the louder one: the base begins at the mode that moves farthest."""

import numpy as np
import pytest

from jointscope.diagnosis.responses import Response, first_modes, fitted

K, J, C = 2.1e5, 5.3, 70.0  # of the first mode, at 32 Hz
SECOND = 120.0  # Hz


def struck(share):
    """Accelerance [rad/s^2 per N m] of a joint, and ``share`` times its mass line of a mode at ``SECOND``."""
    f = np.geomspace(2.0, 300.0, 160)
    s, w = 2j * np.pi * f, 2.0 * np.pi * SECOND
    H = s * s / (J * s * s + C * s + K) + share / J * s * s / (s * s + 0.03 * w * s + w * w)
    return Response(f, H, np.ones(f.size), False, False, False, True, ())


def test_of_one_mode_there_is_nothing_to_leave_out():
    assert first_modes((struck(0.0), struck(0.001))) == ()


def test_what_lies_below_the_loud_mode_is_left():
    (first,) = first_modes((struck(3.0),))
    assert 40.0 < first.f.max() < SECOND / 1.5 + 1.0
    assert np.array_equal(first.H, struck(3.0).H[: first.f.size])


def test_the_joint_is_found_where_all_lines_together_follow_the_loud_mode(problem):
    """Within 5 and 10 % from the lines below, where the loud mode adds a little; from all lines K is a third too small."""
    measured = (struck(3.0),)
    names = list(problem.base.names)
    places = [names.index(n) for n in ("stiffness", "damping", "load_inertia")]
    low, whole = (fitted(problem.base, m, (problem.base.start,)) for m in (first_modes(measured), measured))
    assert low[places[0]] == pytest.approx(K, rel=0.05)
    assert low[places[2]] == pytest.approx(J, rel=0.1)
    assert abs(np.log(whole[places[0]] / K)) > np.log(1.5)
