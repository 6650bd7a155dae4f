"""What lies below a sweep's band is nobody's to foretell; a motion and a commanded run keep everything."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import chirp

from jointscope.recordings.campaign import Channel, Nameplate, Run, Stream
from jointscope.recordings.drift import BELOW, drift_corner, drift_free

RATE = 500.0
T = np.arange(5000) / RATE
RIG = Nameplate(topology="two-inertia", motion="rotational", plane="horizontal")


def channel(column, quantity, role, samples) -> Channel:
    return Channel(column=column, quantity=quantity, unit="1", location="motor", role=role, samples=samples)


@pytest.fixture
def sweep() -> Run:
    """A torque swept over 6-60 Hz, with the motor's angle."""
    channels = (
        channel("T", "torque", "input", chirp(T, 6.0, T[-1], 60.0)),
        channel("th", "angle", "output", np.zeros(T.size)),
    )
    stream = Stream(file="a.csv", sampling_rate=RATE, length=T.size, channels=channels)
    return Run(id="a", experiment="torque-sweep", streams=(stream,))


def test_the_cut_lies_below_the_sweep(sweep):
    corner = drift_corner(sweep, RIG)
    assert corner is not None
    assert 2.0 < corner < 4.0


def test_a_motion_a_held_motor_and_a_commanded_run_keep_everything(sweep):
    (stream,) = sweep.streams
    commanded = replace(
        stream, channels=(*stream.channels, channel("w", "speed-command", "input", np.zeros(T.size)))
    )
    for run in (
        replace(sweep, experiment="speed-motion"),
        replace(sweep, brake=True),
        replace(sweep, hold={"": "locked"}),
        replace(sweep, streams=(commanded,)),
    ):
        assert drift_corner(run, RIG) is None


def test_a_mass_on_a_spring_does_not_drift_and_one_without_does(sweep):
    held, free = (replace(RIG, topology="single-dof", ground_spring=spring) for spring in (True, False))
    assert drift_corner(sweep, held) is None
    assert drift_corner(sweep, free) == drift_corner(sweep, RIG)


def test_a_drift_goes_and_the_band_stays():
    wave, drift = np.sin(2.0 * np.pi * 6.0 * T), 0.3 + 2.0 * T + 0.7 * T**2
    inner = slice(500, -500)
    left = drift_free(wave + drift, BELOW * 6.0, RATE)
    assert (left - drift[0])[inner] == pytest.approx(wave[inner], abs=0.03)


def test_a_diverged_prediction_stays_as_it_is():
    x = np.array([0.0, np.inf] * 50)
    assert drift_free(x, 1.0, RATE) is x
