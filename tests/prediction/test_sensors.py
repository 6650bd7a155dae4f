"""What channels read of a known motion."""

import math

import numpy as np
import pytest

from jointscope.errors import RefusedError
from jointscope.models.parameters import STANDARD_GRAVITY as g
from jointscope.prediction.integrate import Motion
from jointscope.prediction.plant import Plant
from jointscope.prediction.sensors import ac_coupled, read_channel

RATE = 8000.0
W = 2 * math.pi * 5.0
PLANT = Plant(
    motor="free", load_inertia=3.0, stiffness=2e5, damping=50.0, motor_inertia=9.0, ratio=141.0, gain=98.7
)


@pytest.fixture
def motion():
    t = np.arange(8000) / RATE
    q, w, a = 0.3 * np.sin(W * t), 0.3 * W * np.cos(W * t), -0.3 * W**2 * np.sin(W * t)
    return Motion(
        start=0.0, rate=RATE, motor_angle=q, motor_speed=w, motor_acceleration=a, angle=q, speed=w, acceleration=a,
        torque=np.cos(W * t),
    )  # fmt: skip


def read(bench, motion, quantity, location="arm", rig=None, rate=1000.0, fastest=1000.0, **extra):
    stream = bench.stream(rate, bench.channel(quantity, location, "output", **extra), length=800)
    signal = bench.run("free", stream).signals[0]
    t = stream.times
    return t, read_channel(signal, t, motion, PLANT, rig or bench.rig, fastest)


def test_a_dc_tangential_accelerometer_feels_gravity(bench, motion):
    t, y = read(bench, motion, "linear-acceleration", radius=0.95)
    q = 0.3 * np.sin(W * t)
    assert y == pytest.approx(-0.95 * W**2 * q + g * np.cos(q), abs=1e-6)


def test_a_radial_accelerometer_feels_the_centripetal_pull_and_gravity(bench, motion):
    t, y = read(bench, motion, "linear-acceleration", radius=0.95, direction="radial")
    q, w = 0.3 * np.sin(W * t), 0.3 * W * np.cos(W * t)
    assert y == pytest.approx(-0.95 * w**2 + g * np.sin(q), abs=1e-6)


def test_on_a_horizontal_plane_gravity_is_not_felt(bench, motion):
    t, y = read(bench, motion, "linear-acceleration", rig=bench.horizontal(), radius=1.0)
    assert y == pytest.approx(-0.3 * W**2 * np.sin(W * t), abs=1e-6)


def test_an_ac_sensor_loses_a_constant_and_follows_the_first_order_high_pass():
    t = np.arange(40_000) / RATE
    cutoff, f = 2.0, 3.0
    y = ac_coupled(9.81 + np.sin(2 * np.pi * f * t), RATE, cutoff)
    H = 1j * f / (1j * f + cutoff)
    steady = np.imag(H * np.exp(2j * np.pi * f * t))
    assert y[-8000:] == pytest.approx(steady[-8000:], abs=2e-5)
    assert ac_coupled(np.full(100, 9.81), RATE, cutoff) == pytest.approx(0.0)


@pytest.mark.parametrize(
    ("quantity", "order"), [("angle", 0), ("angular-velocity", 1), ("angular-acceleration", 2)]
)
def test_the_motor_turns_n_times_as_far(bench, motion, quantity, order):
    _, arm = read(bench, motion, quantity, "arm")
    t, motor = read(bench, motion, quantity, "motor")
    assert motor == pytest.approx(141.0 * arm)
    wave = (np.sin, np.cos, lambda x: -np.sin(x))[order]
    assert arm == pytest.approx(0.3 * W**order * wave(W * t), abs=1e-5)


def test_torque_and_current_differ_by_the_torque_constant(bench, motion):
    rig = bench.horizontal(torque_constant=0.458)
    _, torque = read(bench, motion, "torque", "motor", rig)
    _, current = read(bench, motion, "current", "motor", rig)
    _, output = read(bench, motion, "torque", "motor", rig, side="output")
    assert torque == pytest.approx(0.458 * current)
    assert output == pytest.approx(141.0 * torque)


def test_a_slow_channel_keeps_nothing_above_its_own_half_rate(bench):
    t = np.arange(16000) / RATE
    slow, fast = np.sin(2 * np.pi * 20.0 * t), np.sin(2 * np.pi * 180.0 * t)
    zero = np.zeros(t.size)

    def motion(a):
        return Motion(
            start=0.0, rate=RATE, motor_angle=zero, motor_speed=zero, motor_acceleration=zero, angle=zero, speed=zero,
            acceleration=a, torque=zero,
        )  # fmt: skip

    times, y = read(bench, motion(slow + fast), "angular-acceleration", rate=250.0, fastest=8000.0)
    inner = (times > 0.3) & (times < 1.7)
    assert y[inner] == pytest.approx(np.sin(2 * np.pi * 20.0 * times[inner]), abs=2e-3)


def test_a_quantity_without_a_meaning_is_refused_by_name(bench, motion):
    with pytest.raises(RefusedError, match="voltage"):
        read(bench, motion, "voltage", "motor")
