"""Torque from phase currents: Clarke, the sign through zero, gravity at the start, and where it must be given up."""

import numpy as np
import pytest

from jointscope.errors import RefusedError
from jointscope.prediction.currents import current_vector, envelope_torque, torque_from_currents
from jointscope.recordings.campaign import Channel, Nameplate, Run, Stream

RATE, POLES, KT = 10_000.0, 5, 0.458
RIG = Nameplate(
    topology="arm", motion="rotational", reduction_ratio=141.0, motor_inertia=1e-3, reducer_inertia=3.2e-4,
    torque_constant=KT, pole_pairs=POLES,
)  # fmt: skip


def phases(torque, angle):
    i_q = torque / KT
    return tuple(-i_q * np.sin(POLES * angle - 2 * np.pi * k / 3) for k in range(3))


def run_of(torque, speed, *, noise=0.005, start=0.7, command=True, seed=0, channels=3):
    """A run whose motor turns at ``speed`` [rad/s] under ``torque`` [N m]; both of shape (n,)."""
    rng = np.random.default_rng(seed)
    angle = start + np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]))]) / RATE
    currents = tuple(
        Channel(
            column=f"i_{name}", quantity="phase-current", unit="A", location="motor", role="input",
            samples=i + noise * rng.normal(size=i.size),
        )
        for name, i in zip("uvw"[:channels], phases(torque, angle), strict=False)
    )  # fmt: skip
    streams = [Stream(file="i.npz", sampling_rate=RATE, length=torque.size, channels=currents)]
    if command:
        told = Channel(
            column="speed", quantity="speed-command", unit="rad/s", location="motor", role="input",
            samples=speed[::20].copy(),
        )  # fmt: skip
        streams.append(Stream(file="plc.csv", sampling_rate=RATE / 20, length=told.samples.size, channels=(told,)))
    return Run(id="r", experiment="speed-motion", streams=tuple(streams))


@pytest.fixture
def motion():
    t = np.arange(30_000) / RATE
    speed = 100.0 * np.sin(2 * np.pi * t / 3.0)
    return t, 0.6 * np.cos(2 * np.pi * 0.9 * t) + 0.1 * np.sin(2 * np.pi * 17.0 * t), speed


def test_three_phases_make_one_vector():
    angle = np.linspace(0.0, 3.0, 100)
    torque = np.linspace(-1.0, 1.0, 100)
    assert np.allclose(current_vector(phases(torque, angle)), torque / KT * np.exp(1j * POLES * angle))


def test_the_sign_is_kept_through_every_zero(motion):
    _, torque, speed = motion
    found = torque_from_currents(run_of(torque, speed), RIG, torque[0])
    assert np.sqrt(np.mean((found.values - torque) ** 2) / np.mean(torque**2)) < 0.01
    assert found.anchored
    assert not found.doubts


@pytest.mark.parametrize("start", [0.0, 0.3, 2.0, 5.9])
def test_where_the_rotor_stood_does_not_matter(motion, start):
    _, torque, speed = motion
    found = torque_from_currents(run_of(torque, speed, start=start), RIG, torque[0])
    assert np.max(np.abs(found.values - torque)) < 0.03


def test_gravity_fixes_the_sign(motion):
    _, torque, speed = motion
    up = torque_from_currents(run_of(torque, speed), RIG, 1.0)
    down = torque_from_currents(run_of(torque, speed), RIG, -1.0)
    assert np.allclose(up.values, -down.values)


def test_without_a_command_the_vector_alone_is_enough(motion):
    _, torque, speed = motion
    found = torque_from_currents(run_of(torque, speed, command=False), RIG, torque[0])
    assert np.sqrt(np.mean((found.values - torque) ** 2) / np.mean(torque**2)) < 0.01


def test_a_long_silence_is_reported_where_it_is():
    """No current for 0.3 s while the rotor turns at an unannounced speed: the sign behind it is a guess."""
    t = np.arange(20_000) / RATE
    torque = np.where((t > 0.8) & (t < 1.1), 0.0, 0.5)
    found = torque_from_currents(run_of(torque, np.full(t.size, 60.0), command=False), RIG, 1.0)
    assert len(found.doubts) == 1
    assert found.doubts[0].start == pytest.approx(0.8, abs=0.02)
    assert found.doubts[0].end == pytest.approx(1.1, abs=0.02)


def test_a_quick_passage_through_zero_is_no_doubt():
    t = np.arange(20_000) / RATE
    found = torque_from_currents(run_of(0.5 * np.cos(2 * np.pi * 40.0 * t), np.full(t.size, 60.0)), RIG, 1.0)
    assert not found.doubts


def test_no_current_at_rest_leaves_the_sign_open(motion):
    t, _, speed = motion
    torque = 0.5 * np.clip(t - 0.5, 0.0, 1.0)
    assert not torque_from_currents(run_of(torque, speed), RIG, 1.0).anchored


def test_the_envelope_is_right_while_the_motor_turns_fast_under_one_sign():
    t = np.arange(20_000) / RATE
    run = run_of(np.full(t.size, 0.5), np.full(t.size, 200.0), noise=0.0)
    inner = slice(2000, -2000)
    assert np.max(np.abs(envelope_torque(run, RIG)[inner] - 0.5)) < 5e-3


def test_the_envelope_loses_the_sign(motion):
    _, torque, speed = motion
    run = run_of(torque, speed)
    assert np.min(envelope_torque(run, RIG)) >= 0.0
    assert np.sqrt(np.mean((envelope_torque(run, RIG) - torque) ** 2) / np.mean(torque**2)) > 0.5


def test_two_phases_are_refused(motion):
    _, torque, speed = motion
    with pytest.raises(RefusedError, match="needs three"):
        torque_from_currents(run_of(torque, speed, channels=2), RIG, 1.0)
