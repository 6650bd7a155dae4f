"""Dry friction about standstill in the compiled joint: built up over an angle, rounded over a speed, or by the load."""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np
import pytest

from jointscope.diagnosis import kernel as k
from jointscope.diagnosis.kernel import laws as k_laws

sys.path.insert(0, str(Path(__file__).parent))
from packed_joint import packed, run  # type: ignore[import-not-found]


def test_presliding_friction_builds_up_over_its_angle_and_tends_to_coulombs():
    """From rest a travel d is met by T (1 - exp(-d/y)); with y far below the motion the ring-down is Coulomb's."""
    T, y = 30.0, 1e-3
    P, S = packed(K=0.0, J_L=1e3, PRE_TORQUE=T, PRE_ANGLE=y)
    S[k.PRE_SITE] = k.AT_LOAD
    _t, out = run(P, S, x=(0, 0, 0, 0.05), duration=0.2)
    q, a = out[:, k.X_Q], out[:, k.X_A]
    assert np.allclose(-1e3 * a, T * (1.0 - np.exp(-q / y)), atol=1e-3 * T)
    P, S = packed(PRE_TORQUE=4.0, PRE_ANGLE=2e-7)
    S[k.PRE_SITE] = k.AT_LOAD
    _, soft = run(P, S, x=(0, 0, 1e-3, 0), duration=0.3, rate=16384.0)
    _, dry = run(*packed(FRICTION_L=1, FL_PLUS=4.0, FL_MINUS=4.0), x=(0, 0, 1e-3, 0), duration=0.3, rate=16384.0)
    assert np.max(np.abs(soft[:, k.X_Q] - dry[:, k.X_Q])) < 2e-5


def test_bristles_end_on_the_curve_of_their_speed_and_without_breakaway_are_dahls():
    """After a travel of many y at a steady speed the friction is g(v) T; with no excess it is Dahl's at any speed."""
    T, y, v_s = 30.0, 1e-5, 0.02
    for v, level in ((0.001, 1.0 + 0.5 * np.exp(-0.0025)), (0.02, 1.0 + 0.5 * np.exp(-1.0)), (0.2, 1.0)):
        P, S = packed(K=0.0, J_L=1e6, PRE_TORQUE=T, PRE_ANGLE=y, PRE_EXCESS=0.5, PRE_SPEED=v_s)
        S[k.PRE_SITE] = k.AT_LOAD
        _, out = run(P, S, x=(0, 0, 0, v), duration=0.5)
        assert -1e6 * out[-1, k.X_A] == pytest.approx(T * level, rel=1e-3)
        P[k.PRE_EXPONENT] = 1.0
        _, out = run(P, S, x=(0, 0, 0, v), duration=0.5)
        assert -1e6 * out[-1, k.X_A] == pytest.approx(T * (1.0 + 0.5 * np.exp(-v / v_s)), rel=1e-3)
    P, S = packed(PRE_TORQUE=4.0, PRE_ANGLE=1e-5, PRE_EXCESS=0.0, PRE_SPEED=1.0)
    S[k.PRE_SITE] = k.AT_LOAD
    z = 0.3
    assert k_laws.bristle(z, 2e-6, 0.1, P) == pytest.approx(
        k_laws.hysteresis(z, 2e-6, 1e-5, k.DAHL, 0.0), rel=1e-12
    )
    assert k_laws.bristle(z, -2e-6, 0.1, P) == pytest.approx(
        k_laws.hysteresis(z, -2e-6, 1e-5, k.DAHL, 0.0), rel=1e-12
    )


@pytest.mark.parametrize("exponent", [0.05, 0.5, 1.0, 1.6])
def test_presliding_with_dahls_exponent_is_the_same_in_one_step_or_many(exponent):
    """u' = -u^i solved exactly; with i = 1/2 uniform elements' curve, 2 x - x^2 over the travel at which all slip."""
    whole = k_laws.remaining(1.3, 0.9, 1.0 - exponent)
    parts = 1.3
    for share in (0.2, 0.3, 0.4):
        parts = k_laws.remaining(parts, share, 1.0 - exponent)
    assert whole == pytest.approx(parts, rel=1e-12)
    small = k_laws.remaining(1.3, 1e-6, 1.0 - exponent)
    assert (small - 1.3) / 1e-6 == pytest.approx(-(1.3**exponent), rel=1e-4)
    for x in (0.1, 0.5, 1.0, 2.0):
        built = 1.0 - k_laws.remaining(1.0, 2.0 * x, 0.5)
        assert built == pytest.approx(2.0 * x - x * x if x < 1.0 else 1.0)
    assert k_laws.remaining(1.0, 0.7, 1e-9) == pytest.approx(math.exp(-0.7), rel=1e-6)
    assert k_laws.remaining(-0.2, 0.7, 1.0 - exponent) == pytest.approx(-0.2 * math.exp(-0.7))


def test_damped_bristles_ring_as_a_damped_spring_and_slide_as_undamped_ones():
    """LuGre: within the bristles J q'' + sigma_1 q' + sigma_0 q = 0; in steady sliding sigma_1 says nothing."""
    J, T, y, damping, n = 2.0, 30.0, 1e-3, 200.0, 4096
    P, S = packed(K=0.0, C=0.0, J_L=J, PRE_TORQUE=T, PRE_ANGLE=y, PRE_DAMPING=damping / T)
    S[k.PRE_SITE] = k.AT_LOAD
    w0 = np.sqrt(T / y / J)
    zeta = damping / (2.0 * J * w0)
    w = w0 * np.sqrt(1.0 - zeta**2)
    v0 = 1e-5 * w0  # a hundredth of the angle over which they bend
    t, out = run(P, S, x=(0, 0, 0, v0), duration=0.1, rate=float(n))
    expected = v0 / w * np.exp(-zeta * w0 * t) * np.sin(w * t)
    assert np.max(np.abs(out[:, k.X_Q] - expected)) < 0.012 * np.max(np.abs(expected))
    P, S = packed(
        K=0.0, J_L=1e6, PRE_TORQUE=T, PRE_ANGLE=1e-5, PRE_DAMPING=damping / T, PRE_EXCESS=0.5, PRE_SPEED=0.02
    )
    S[k.PRE_SITE] = k.AT_LOAD
    _, out = run(P, S, x=(0, 0, 0, 0.02), duration=0.5)
    assert -1e6 * out[-1, k.X_A] == pytest.approx(T * (1.0 + 0.5 * np.exp(-1.0)), rel=1e-3)


def test_rounded_stribeck_follows_its_curve_on_either_side_and_in_either_stepper():
    """-J a = T [1 + e exp(-(v/v_s)^2)] tanh(v/w_e) at any speed, odd in it; no excess is the rounded Coulomb law."""
    T, e, v_s, w_e = 30.0, 0.5, 0.02, 0.004
    for v in (-0.03, -0.002, 0.001, 0.02, 0.2):
        wanted = T * (1.0 + e * np.exp(-((v / v_s) ** 2))) * np.tanh(v / w_e)
        P, S = packed(K=0.0, J_L=1e6, ROUND_L=T, ROUND_L_SPEED=w_e, ROUND_L_EXCESS=e, ROUND_L_FALL=v_s)
        for site in (0, k.AT_MOTOR):  # presliding of no torque sends it through the other stepper
            S[k.PRE_SITE], P[k.PRE_ANGLE] = site, 1.0
            _, out = run(P, S, x=(0, 0, 0, v), duration=0.01)
            assert -1e6 * out[0, k.X_A] == pytest.approx(wanted, rel=1e-9)
    assert k_laws.rounded(T, w_e, 0.0, 1.0, -0.2, 0.003) == pytest.approx(0.8 * T * math.tanh(0.75), rel=1e-12)
    assert k_laws.rounded(T, w_e, 0.0, 1.0, -0.2, -0.003) == pytest.approx(-1.2 * T * math.tanh(0.75), rel=1e-12)
    assert k_laws.rounded(T, w_e, 0.0, 1.0, 0.0, 0.003) == pytest.approx(T * math.tanh(0.75), rel=1e-12)
    for v in (0.003, -0.003):  # the law that is slower to its end, T v / sqrt(v^2 + w_e^2)
        slower = v / math.sqrt(v**2 + w_e**2)
        assert k_laws.rounded(T, -w_e, 0.0, 1.0, 0.0, v) == pytest.approx(T * slower, rel=1e-12)


@pytest.mark.parametrize("switch", ["rounded", "presliding"])
def test_friction_by_load_is_its_share_of_the_transmitted_torque_once_it_slides(switch):
    """In a steady slide -J a = T_S + mu |T_S| sgn(v): at either sign of T_S it resists, and at none it is gone."""
    mu, J, stiffness = 0.1, 1e6, 2e5
    for wind_up in (-1e-3, 0.0, 1e-3):
        for v in (-0.02, 0.02):
            P, S = packed(K=stiffness, C=0.0, J_L=J)
            if switch == "rounded":
                P[k.ROUND_L_LOAD], P[k.ROUND_L_SPEED] = mu, 1e-4
            else:
                P[k.PRE_LOAD], P[k.PRE_ANGLE], S[k.PRE_SITE] = mu, 1e-7, k.AT_LOAD
            _, out = run(P, S, x=(wind_up, 0, 0, v), duration=0.01)
            T = out[-1, k.X_TS]
            assert J * out[-1, k.X_A] == pytest.approx(T - mu * abs(T) * math.copysign(1.0, v), rel=1e-9)


def test_a_gear_resists_less_where_it_drives_than_where_it_is_driven_back():
    """mu (1 - d) |T_S| where T_S v > 0 and mu (1 + d) |T_S| where it brakes, in either direction."""
    mu, d, J = 0.16, 0.19, 1e6
    for wind_up in (-1e-3, 1e-3):
        for v in (-0.02, 0.02):
            P, S = packed(K=2e5, C=0.0, J_L=J, ROUND_L_LOAD=mu, ROUND_L_SPEED=1e-4, ROUND_L_QUADRANT=d)
            _, out = run(P, S, x=(wind_up, 0, 0, v), duration=0.01)
            T = out[-1, k.X_TS]
            share = mu * (1.0 - d) if T * v > 0.0 else mu * (1.0 + d)
            assert J * out[-1, k.X_A] == pytest.approx(T - share * abs(T) * math.copysign(1.0, v), rel=1e-9)
