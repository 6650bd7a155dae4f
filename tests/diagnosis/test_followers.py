"""What goes where the motor goes tells which way round it is, whatever rubs or cogs at the motor."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from jointscope.diagnosis.followers import beside_own_position, followers_polarities
from jointscope.diagnosis.problem import Observed
from jointscope.diagnosis.responses import channel_key
from jointscope.recordings.bandlimited import bandlimited

RATE, RADIUS = 1000.0, 0.6
T = np.arange(4000) / RATE


def turned(t=T):
    """A turn there and half back [rad], at rest at both ends, and its second derivative."""
    w = 2.0 * np.pi / t[-1]
    angle = 0.4 * (1.0 - np.cos(w * t)) + 0.1 * (1.0 - np.cos(2.0 * w * t))
    return angle, w * w * (0.4 * np.cos(w * t) + 0.4 * np.cos(2.0 * w * t))


def output(data, **more):
    base = dict(
        quantity="linear-acceleration", location="arm", direction="tangential", radius=RADIUS, rate=RATE, device=0,
        times=T, data=data, mask=np.ones(T.size, dtype=bool), gravity=0.0, low_cutoff=None,
    )  # fmt: skip
    return SimpleNamespace(**{**base, **more})


def run_of(*outputs):
    motor = Observed("motor", False, bandlimited(turned()[0], RATE, 0.0), 1)
    half = np.zeros(2 * T.size + 1)
    return SimpleNamespace(
        observed=motor, outputs=outputs, motor=object(), load=None, load_half=half, motor_moves=True, spring=True
    )


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_an_acceleration_is_the_angle_twice_differentiated(sign):
    """Beside twice its own size of ringing at the resonance, and of noise."""
    rng = np.random.default_rng(4)
    slow = RADIUS * turned()[1]
    ringing = 2.0 * np.std(slow) * np.sin(2.0 * np.pi * 22.0 * T)
    seen = output(sign * (slow + ringing + np.std(slow) * rng.standard_normal(T.size)))
    run = run_of(seen)
    assert followers_polarities((run,)) == {channel_key(run, seen): sign}


def test_what_a_high_pass_turns_is_turned_back():
    slow = np.fft.irfft(
        np.fft.rfft(RADIUS * turned()[1])
        * (lambda f: 1j * f / (1j * f + 0.8))(np.fft.rfftfreq(T.size, 1.0 / RATE))
    )
    seen = output(slow, low_cutoff=0.8)
    run = run_of(seen)
    assert followers_polarities((run,)) == {channel_key(run, seen): 1.0}


def test_what_does_not_tell_is_left_out():
    """Noise, a sensor along the arm, one that weighs, and a run without the motor's angle."""
    rng = np.random.default_rng(5)
    slow = -RADIUS * turned()[1]
    silent = [output(rng.standard_normal(T.size)), output(slow, direction="radial"), output(slow, gravity=9.8)]
    assert followers_polarities((run_of(*silent),)) == {}
    told = run_of(output(slow))
    told.observed = None
    assert followers_polarities((told,)) == {}


def test_an_accelerometer_is_not_turned_round_by_a_motor_that_rubs(builders, plant):
    """Prepared as recorded, and as recorded the other way up."""
    from jointscope.diagnosis.prepare import prepare

    def signs(campaign):
        problem = prepare(campaign)
        return {o.polarity for r in problem.runs for o in r.declared if o.quantity == "linear-acceleration"}

    rubs = dataclasses.replace(plant, extra=lambda t, x: (-60.0 * np.tanh(x[1] / 1e-3), 0.0))
    runs = [builders.sweep_run(rubs, amplitude, f"sweep {amplitude:g}") for amplitude in (70.0, 90.0)]
    campaign = builders.campaign_of(runs)
    assert signs(campaign) == {1.0}


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_body_that_is_struck_is_no_accelerometer_turned_round(sign):
    """A stop throws it back: its own position says so too."""
    rng = np.random.default_rng(5)
    _, slow = turned()
    struck = 30.0 * np.std(slow) * np.exp(-(((T - 2.0) / 0.004) ** 2))
    moved = np.cumsum(np.cumsum(slow + struck)) / RATE**2
    position = output(moved, quantity="position", location="load")
    seen = output(
        sign * (slow + struck) + 0.2 * np.std(slow) * rng.standard_normal(T.size),
        quantity="acceleration", location="load",
    )  # fmt: skip
    run = run_of(position, seen)
    assert beside_own_position((run,)) == {channel_key(run, seen): (channel_key(run, position), sign)}
    assert beside_own_position((run_of(seen),)) == {}
