"""Hysteresis in the compiled joint: rate-independent, dissipative, and Bouc and Wen's equation where it has a shape."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from jointscope.diagnosis import kernel as k
from jointscope.diagnosis.effects.hysteresis import SPECS as HYSTERESIS
from jointscope.diagnosis.effects.hysteresis import slip_levels
from jointscope.diagnosis.kernel import laws as k_laws

sys.path.insert(0, str(Path(__file__).parent))
from packed_joint import packed, run  # type: ignore[import-not-found]


@pytest.mark.parametrize("kind", [k.DAHL, k.BOUC_WEN, k.MAXWELL_SLIP, k.ELASTIC_SLIP])
def test_hysteresis_is_rate_independent_dissipates_and_starts_stiff(kind):
    """The loop in (Delta, T) is the same at any rate, has an area above zero and the initial slope K + T/D."""
    area = []
    for f in (1.0, 7.0):
        P, S = packed(HYST_TORQUE=10.0, HYST_ANGLE=1e-4, HYST_KIND=kind, MOTOR=k.MOTOR_PRESCRIBED, J_L=1e12)
        _, out = run(P, S, y=lambda t, f=f: 1e-3 * np.sin(2 * np.pi * f * t), duration=2 / f, rate=4096.0 * f)
        delta = out[:, k.X_QS] - out[:, k.X_Q]
        T = out[:, k.X_TS]
        last = len(T) // 2
        area.append(np.trapezoid(T[last:], delta[last:]))
        slope = (T[20] - T[0]) / (delta[20] - delta[0])
        assert slope == pytest.approx(1.9e5 + 1e5, rel=0.08 if kind == k.DAHL else 0.03)
        assert np.max(np.abs(T - 1.9e5 * delta)) <= 10.0 * 1.0001
    assert area[0] > 0.0
    assert area[1] == pytest.approx(area[0], rel=1e-3)


def loop(P, S, amplitude, rate=8192.0):
    """The second turn of a slow sine of the motor [rad, N m], less the spring's own torque."""
    _, out = run(P, S, y=lambda t: amplitude * np.sin(2 * np.pi * t), duration=2.0, rate=rate)
    delta, T = out[:, k.X_QS] - out[:, k.X_Q], out[:, k.X_TS]
    half = len(T) // 2
    return delta[half:], T[half:] - P[k.K] * delta[half:]


@pytest.mark.parametrize("spread", [1.0, 4.0, 30.0])
def test_slipping_springs_lose_what_each_of_them_slips(spread):
    """Each spring k/8 with the limit Y loses 4 (k/8) Y (A - Y) a turn once A > Y, and nothing below."""
    P, S = packed(HYST_TORQUE=10.0, HYST_ANGLE=1e-4, HYST_KIND=k.MAXWELL_SLIP, MOTOR=k.MOTOR_PRESCRIBED, J_L=1e12)
    levels = np.array(slip_levels(spread))
    assert np.mean(levels) == pytest.approx(1.0) and levels[-1] / levels[0] == pytest.approx(spread)
    P[k.HYST_LEVEL_0 : k.HYST_LEVEL_0 + k.SLIP_ELEMENTS] = levels
    for amplitude in (0.5e-4, 1.5e-4, 1e-3):
        delta, T = loop(P, S, amplitude)
        slipped = np.maximum(amplitude - 1e-4 * levels, 0.0)
        expected = 4.0 * 10.0 / 1e-4 / 8.0 * np.sum(1e-4 * levels * slipped)
        assert np.trapezoid(T, delta) == pytest.approx(expected, rel=2e-3, abs=1e-9)


@pytest.mark.parametrize("shape", [-1.4, -1.0, -0.3, 1.0])
@pytest.mark.parametrize(("z", "travel"), [(0.0, 1.7), (-0.6, 2.2), (0.4, -0.9), (0.5, 0.2)])
def test_a_shaped_loop_is_bouc_and_wens(shape, z, travel):
    """z' = 1 - |z| (sgn(z x') + shape) per travel x, by Euler's steps."""
    steps = 200_000
    h = travel / steps
    value = z
    for _ in range(steps):
        value += h * (1.0 - abs(value) * (np.sign(value * travel) + shape))
    assert k_laws.hysteresis(z, travel * 1e-5, 1e-5, k.BOUC_WEN_SHAPED, shape) == pytest.approx(value, abs=3e-5)


@pytest.mark.parametrize("travel", [0.3e-5, -2e-5])
def test_a_loop_of_shape_zero_is_dahls(travel):
    assert k_laws.hysteresis(0.3, travel, 1e-5, k.BOUC_WEN_SHAPED, 0.0) == pytest.approx(
        k_laws.hysteresis(0.3, travel, 1e-5, k.DAHL, 0.0), rel=1e-12
    )


def test_a_loop_of_bouc_and_wens_first_power_is_what_the_law_says():
    """z' = (v/D)(1 - |z| (sgn(v z) + 1)/2) with D = T/stiffness, there and back again, by Euler's steps."""
    spec = next(s for s in HYSTERESIS if s.variant == "bouc-wen-linear")
    P, S = packed()
    torque, stiffness = 12.0, 3e5
    spec.apply(SimpleNamespace(P=P, S=S), (torque, stiffness), 1.0)
    value, state, steps = 0.0, 0.0, 100_000
    for travel in (5e-5, -9e-5, 3e-5):
        h = travel / steps * stiffness / torque
        for _ in range(steps):
            value += h * (1.0 - abs(value) * (np.sign(value * travel) + 1.0) / 2.0)
        state = k_laws.hysteresis(state, travel, P[k.HYST_ANGLE], S[k.HYST_KIND], P[k.HYST_SHAPE])
        assert P[k.HYST_TORQUE] * state == pytest.approx(torque * value, rel=1e-4)


def test_a_loop_of_shape_below_minus_one_stiffens_and_dissipates():
    """The tangent at the turning point is steeper than at the start, and the loop still has an area."""
    P, S = packed(
        HYST_TORQUE=10.0, HYST_ANGLE=1e-3, HYST_KIND=k.BOUC_WEN_SHAPED, MOTOR=k.MOTOR_PRESCRIBED, J_L=1e12
    )
    P[k.HYST_SHAPE] = -1.4
    _, out = run(P, S, y=lambda t: 1e-3 * np.sin(2 * np.pi * t), duration=2.0, rate=4096.0)
    delta, T = out[:, k.X_QS] - out[:, k.X_Q], out[:, k.X_TS]
    slope = np.gradient(T, delta)
    assert slope[900] > 1.9e5 + 1.2e4 > 1.9e5 + 1.05e4 > slope[10]
    assert np.trapezoid(T[4096:], delta[4096:]) > 0.0


def test_hysteresis_within_its_yield_angle_is_a_spring():
    """Before any element slips a Maxwell-slip joint is only stiffer: no loss."""
    P, S = packed(HYST_TORQUE=10.0, HYST_ANGLE=1e-2, HYST_KIND=k.MAXWELL_SLIP)
    w = math.sqrt((1.9e5 + 1e3) / 3.0)
    t, out = run(P, S, x=(0, 0, 0, 1e-4 * w), duration=0.5)
    np.testing.assert_allclose(out[:, k.X_Q], 1e-4 * np.sin(w * t), atol=1e-8)
