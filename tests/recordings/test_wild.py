"""Single wild readings are bridged; pulses, impacts, steps of an encoder and noise are left as they are."""

from dataclasses import replace

import numpy as np
import pytest

from jointscope.recordings.campaign import Campaign, Channel, Nameplate, Run, Stream
from jointscope.recordings.wild import tamed, wild_readings

RATE, N = 2000.0, 4000


def ring_down(rng, noise=0.05):
    t = np.clip(np.arange(N) / RATE - 0.1, 0.0, None)
    return 40.0 * np.exp(-6.0 * t) * np.sin(250.0 * t) + noise * rng.standard_normal(N)


def test_wild_readings_are_found_wherever_the_motion_is_and_nothing_else(rng):
    x = ring_down(rng)
    at = np.array([90, 330, 1200, 3500])
    x[at] += [6.0, -9.0, 3.0, 2.0]
    assert np.array_equal(wild_readings(x), at)
    assert wild_readings(ring_down(rng)).size == 0


def test_a_bridged_reading_is_as_near_the_motion_as_its_neighbours(rng):
    clean = ring_down(rng, 0.0)
    wild = clean.copy()
    wild[400] += 25.0
    campaign, lines = tamed(recording(wild))
    assert lines == ("linear-acceleration at the arm (run h): 1 single wild reading bridged",)
    (stream,) = campaign.runs[0].streams
    assert np.max(np.abs(np.asarray(stream.channels[0].samples) - clean)) < 0.01


@pytest.mark.parametrize(
    "made",
    [
        lambda t, rng: np.sign(np.sin(300.0 * t)) + 0.01 * rng.standard_normal(t.size),  # blows and steps
        lambda t, rng: np.round(200.0 * np.sin(3.0 * t)) * 0.01,  # an encoder's steps
        lambda t, rng: 0.01 * np.round(0.6 * rng.standard_normal(t.size)),  # its last bit
        lambda t, rng: 90.0 * np.exp(-(((t - 0.3) / 4e-4) ** 2)) + 0.1 * rng.standard_normal(t.size),  # a hard tip
        lambda t, rng: 5.0 * (np.arange(t.size) % 37 == 0) + 0.01 * rng.standard_normal(t.size),  # what is regular
        lambda t, rng: rng.standard_t(5, t.size),  # noise with heavy tails
    ],
)
def test_what_is_no_accident_stays(made, rng):
    assert wild_readings(made(np.arange(N) / RATE, rng)).size == 0


def test_what_drives_a_rig_and_what_is_sound_stay(rng):
    sound = recording(ring_down(rng))
    assert tamed(sound)[0] is sound
    pulse = np.zeros(N)
    pulse[200] = 300.0
    driven = recording(pulse)
    stream = driven.runs[0].streams[0]
    force = replace(stream.channels[0], quantity="force", unit="N", role="input")
    driven = replace(driven, runs=(replace(driven.runs[0], streams=(replace(stream, channels=(force,)),)),))
    assert tamed(driven)[0] is driven


def recording(samples):
    from pathlib import Path

    channel = Channel(column="a", quantity="linear-acceleration", unit="m/s^2", location="arm", role="output", radius=0.9,
                      samples=samples)  # fmt: skip
    stream = Stream(file="a.csv", sampling_rate=RATE, length=N, channels=(channel,))
    rig = Nameplate(topology="two-inertia", motion="rotational", plane="horizontal")
    return Campaign(
        path=Path("."), rig=rig, runs=(Run(id="h", experiment="hammer", streams=(stream,), brake=True),)
    )
