"""Ripple and kinematic error of an arm's joint: the equations by another integrator, the energy, and the phase of a start."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from jointscope.diagnosis.arm import kernel as k
from jointscope.diagnosis.arm.periodic import lines

J_L, J_M, K, C, B = 3.0, 2.0, 4e4, 6.0, 3.0
RIPPLE, ERROR = (k.RIPPLE, k.RIPPLE_ORDER, k.RIPPLE_PHASE), (k.ERROR, k.ERROR_ORDER, k.ERROR_PHASE)


def row(values, places, reacts=0.0, damping=C, rubs=B):
    """A joint with a line of ``values`` at ``places``."""
    P = np.zeros((1, k.COLUMNS))
    P[0, [k.STIFFNESS, k.DAMPING, k.ROTOR_INERTIA, k.ROTOR_DAMPING]] = K, damping, J_M, rubs
    P[0, [k.STRIBECK_SPEED, k.SOFT_WIDTH]] = 1.0
    P[0, list(places)] = values
    P[0, k.ERROR_REACTS] = reacts
    return P


def travelled(P, speed, torque, duration=1.0, rate=8000.0):
    """q'', and the rotor's angle, of a joint that coasts at ``speed`` under a constant torque."""
    steps = round(duration * rate)
    zero, one = np.zeros((1, 1, 1)), np.ones((1, 1, 1))
    half = np.zeros(2 * steps + 1)
    readings, rotor = np.empty((steps + 1, 1)), np.zeros(steps + 1)
    x = np.array([0.0, speed, 0.0, speed])
    assert k.travel(
        one / J_L, np.zeros((1, 1)), zero, zero, one, zero, zero, np.zeros((1, 1)), np.zeros(1), -1, 0.0, 1.0,
        P, np.array([k.DRIVEN]), 0, half, half + torque, half, 0.0, 0.0, 1.0 / rate, readings, rotor, x,
    )  # fmt: skip
    return readings[:, 0], rotor, x


def solved(P, speed, torque, duration=1.0, rate=8000.0):
    """The same by an adaptive method of eighth order, from the equations."""
    p = P[0]

    def rates(t, x):
        y, w, s, v = x
        at = p[k.ERROR_ORDER] * s + p[k.ERROR_PHASE]
        e, slope = p[k.ERROR] * (np.sin(at) - np.sin(p[k.ERROR_PHASE])), p[k.ERROR] * p[k.ERROR_ORDER] * np.cos(at)
        T = K * (s - y + e) + p[k.DAMPING] * (v - w + slope * v)
        drive = torque + p[k.RIPPLE] * np.sin(p[k.RIPPLE_ORDER] * s + p[k.RIPPLE_PHASE])
        return [w, T / J_L, v, (drive - T * (1.0 + p[k.ERROR_REACTS] * slope) - p[k.ROTOR_DAMPING] * v) / J_M]

    t = np.arange(round(duration * rate) + 1) / rate
    found = solve_ivp(rates, (0.0, t[-1]), [0.0, speed, 0.0, speed], "DOP853", t, rtol=1e-10, atol=1e-12)
    return np.array([rates(0.0, x)[1] for x in found.y.T])


@pytest.mark.parametrize(
    ("values", "places", "reacts"),
    [((5.0, 240.0, 0.7), RIPPLE, 0.0), ((2e-4, 200.0, 1.1), ERROR, 0.0), ((2e-4, 200.0, 1.1), ERROR, 1.0)],
)
def test_a_line_is_what_the_equations_say(values, places, reacts):
    P = row(values, places, reacts)
    found, expected = travelled(P, 0.4, 2.0)[0], solved(P, 0.4, 2.0)
    assert np.std(expected) > 0.05
    np.testing.assert_allclose(found, expected, atol=2e-4 * np.ptp(expected))


@pytest.mark.parametrize(("reacts", "kept"), [(1.0, True), (0.0, False)])
def test_an_error_that_reacts_does_no_work(reacts, kept):
    a, order, phase = 4e-4, 150.0, 0.3
    P = row((a, order, phase), ERROR, reacts, damping=0.0, rubs=0.0)
    x = travelled(P, 0.5, 0.0, 0.9)[2]
    wound = x[2] - x[0] + a * (math.sin(order * x[2] + phase) - math.sin(phase))
    energy = 0.5 * (J_L * x[1] ** 2 + J_M * x[3] ** 2 + K * wound**2)
    begun = 0.5 * (J_L + J_M) * 0.5**2
    assert bool(abs(energy - begun) < 1e-5 * begun) is kept


def problem(travel):
    """A driven joint of ratio 100 that travels so far [rad]."""
    run = SimpleNamespace(driven=0, ratio=100.0, path=np.linspace(0.0, travel, 50))
    return SimpleNamespace(arm_runs=(run,), facts=SimpleNamespace(joints=("a",)), wind_up=np.array([1e-3]))


def test_lines_need_a_motor_that_turns():
    assert lines(problem(0.05), 0, 100.0) == []
    assert {(s.name, s.location) for s in lines(problem(0.3), 0, 100.0)} == {
        ("torque-ripple", "motor:a"),
        ("transmission-error", "transmission:a"),
    }


@pytest.mark.parametrize(("recorded", "begins"), [(12.5, 12.5), (None, 30.0)])
def test_a_start_elsewhere_moves_the_phase_by_the_motors_own_angle(recorded, begins):
    ripple = next(s for s in lines(problem(0.3), 0, 100.0) if s.name == "torque-ripple")
    angle = () if recorded is None else (SimpleNamespace(observed=True, offset=recorded),)
    run = SimpleNamespace(driven=0, ratio=100.0, initial_angle=0.3, outputs=angle)
    P = np.zeros((1, k.COLUMNS))
    ripple.apply(SimpleNamespace(run=run, P=P), (5.0, 2.0, 0.1), 1.0)
    assert P[0, k.RIPPLE_ORDER] == 200.0
    assert P[0, k.RIPPLE_PHASE] == pytest.approx(0.1 + 2.0 * begins)
    assert ripple.sensible((5.0, 2.04, 0.1)) and not ripple.sensible((5.0, 1.5, 0.1))
