"""A torque log's broadband part is torque where the arm answers to it, and noise where the arm is silent."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from jointscope.diagnosis.answered import answered
from jointscope.diagnosis.input_noise import second_order
from jointscope.diagnosis.inputs import Drive
from jointscope.recordings.bandlimited import bandlimited
from jointscope.recordings.campaign import Channel, Run, Stream

RATE, NOISE = 1000.0, 0.1
T = np.arange(8000) / RATE
SMOOTH = 5.0 * np.sin(2.0 * np.pi * 0.4 * T)


def take(seed: int, share_true: float, sensor: float = 0.02):
    """(run, log, noise): white torque of which a share drives a resonance at 48 Hz; the rest is only logged."""
    rng = np.random.default_rng(seed)
    real = np.sqrt(share_true) * NOISE * rng.standard_normal(T.size)
    logged = np.sqrt(1.0 - share_true) * NOISE * rng.standard_normal(T.size)
    ringing = lfilter([0.05], second_order(48.0, 0.03, RATE), SMOOTH + real)
    acceleration = ringing + sensor * rng.standard_normal(T.size)
    channel = Channel(
        column="a",
        quantity="linear-acceleration",
        unit="m/s^2",
        location="arm",
        role="output",
        samples=acceleration,
    )
    stream = Stream(file="daq.csv", sampling_rate=RATE, length=T.size, channels=(channel,))
    run = Run(id=f"r{seed}", experiment="speed-motion", streams=(stream,))
    samples = SMOOTH + real + logged
    return run, Drive(bandlimited(samples, RATE), 0, 1.0, True, samples), NOISE


def test_torque_that_shakes_the_arm_is_answered():
    assert answered([take(seed, 1.0) for seed in range(4)]) is True


@pytest.mark.parametrize("seed", range(0, 40, 4))
def test_noise_that_is_only_logged_is_not(seed):
    """Negative control, ten draws."""
    assert answered([take(seed + k, 0.0) for k in range(4)]) is False


def test_a_short_take_tells_nothing():
    run, log, noise = take(1, 1.0)
    short = log.samples[:600]
    assert answered([(run, replace(log, samples=short, signal=bandlimited(short, RATE)), noise)]) is None


def test_a_run_without_an_accelerometer_tells_nothing():
    _, *rest = take(1, 1.0)
    bare = Run(
        id="b",
        experiment="speed-motion",
        streams=(Stream(file="x.csv", sampling_rate=RATE, length=T.size, channels=()),),
    )
    assert answered([(bare, *rest)]) is None
