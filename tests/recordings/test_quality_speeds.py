"""A speed behind a low-pass is told from one that is late or noisy, and both from a right one."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from jointscope.recordings.campaign import Channel, Run, Stream
from jointscope.recordings.quality_speeds import Lag, lag_of, speed_findings

RATE, LINES = 1000.0, np.array([1.5, 7.0, 23.0, 61.0])
T = np.arange(4000) / RATE


def waves(transfer) -> np.ndarray:
    """Sum of lines of 1 rad each through ``transfer``(w)."""
    w = 2.0 * np.pi * LINES
    return np.sum([np.real(transfer(v) * np.exp(1j * v * T)) for v in w], axis=0)


ANGLE = waves(lambda w: 1.0)


def speed(transfer=lambda w: 1.0) -> np.ndarray:
    return waves(lambda w: 1j * w * transfer(w))


@pytest.mark.parametrize("corner", [5.0, 20.0, 80.0])
def test_a_low_pass_is_found_with_its_corner(corner):
    constant = 1.0 / (2.0 * math.pi * corner)
    filtered = speed(lambda w: 1.0 / (1.0 + 1j * w * constant))
    noisy = filtered + 0.002 * np.std(filtered) * np.random.default_rng(1).standard_normal(T.size)
    for given in (noisy, -2.0 * noisy + 0.3):
        lag = lag_of(ANGLE, given, RATE)
        assert lag is not None
        assert (lag.kind, lag.seconds) == ("low-pass", pytest.approx(constant, rel=0.03))


def test_a_late_speed_is_no_filtered_one():
    lag = lag_of(ANGLE, speed(lambda w: np.exp(-2e-3j * w)), RATE)
    assert lag is not None
    assert (lag.kind, lag.seconds) == ("delay", pytest.approx(2e-3, rel=0.05))


def test_slow_motion_does_not_tell_them_apart():
    w, rng = 2.0 * np.pi, np.random.default_rng(3)
    angle = np.sin(w * T) + 1e-3 * rng.standard_normal(T.size)
    for transfer in (1.0 / (1.0 + 4e-3j * w), np.exp(-4e-3j * w)):
        lag = lag_of(angle, np.real(w * transfer * np.exp(1j * w * T)), RATE)
        assert lag == Lag(pytest.approx(4e-3, rel=0.02), "either")


def test_a_right_a_noisy_and_a_silent_speed_are_left_alone():
    right = speed()
    noisy = right + 0.05 * np.std(right) * np.random.default_rng(2).standard_normal(T.size)
    assert [lag_of(ANGLE, x, RATE) for x in (right, noisy, np.zeros(T.size))] == [None] * 3


def test_the_finding_names_the_channel_and_needs_the_angle_beside_it():
    filtered = speed(lambda w: 1.0 / (1.0 + 1j * w / (2.0 * math.pi * 20.0)))
    channels = tuple(
        Channel(column=c, quantity=q, unit="rad", location="motor", role="output", samples=x)
        for c, q, x in (("th", "angle", ANGLE), ("om", "angular-velocity", filtered))
    )
    run = Run(
        id="a",
        experiment="torque-sweep",
        streams=(Stream(file="a.csv", sampling_rate=RATE, length=T.size, channels=channels),),
    )
    (found,) = speed_findings(run)
    assert (found.finding, found.channel) == ("lagging-speed", "om")
    assert "20 Hz" in found.detail
    elsewhere = (replace(channels[0], location="arm"), channels[1])
    assert not list(speed_findings(replace(run, streams=(replace(run.streams[0], channels=elsewhere),))))
