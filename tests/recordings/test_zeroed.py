"""An amplifier's offset comes off before a diagnosis; what is no constant, or no offset, stays."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from jointscope.recordings.campaign import Campaign, Channel, Nameplate, Run, Stream
from jointscope.recordings.quality_rest import CERTAIN, quiet_level
from jointscope.recordings.zeroed import zeroed

RATE, N, HIT = 1024.0, 4096, 256


def hit(rng, force_offset=0.0, sensor_offset=0.0, coupling="dc", plane="horizontal"):
    t = np.clip((np.arange(N) - HIT) / RATE, 0.0, None)
    force = 200.0 * np.exp(-(((t - 0.005) / 0.002) ** 2)) * (t > 0) + 0.1 * rng.standard_normal(N)
    ring = 30.0 * np.exp(-8.0 * t) * np.sin(250.0 * t) + 0.02 * rng.standard_normal(N)
    more = {"coupling": coupling, "low_cutoff": 0.5} if coupling == "ac" else {}
    channels = (
        Channel(column="f", quantity="force", unit="N", location="arm", role="input", radius=0.8, samples=force + force_offset),
        Channel(column="a", quantity="linear-acceleration", unit="m/s^2", location="arm", role="output", radius=0.9,
                samples=ring + sensor_offset, **more),
    )  # fmt: skip
    stream = Stream(file="a.csv", sampling_rate=RATE, length=N, channels=channels)
    rig = Nameplate(topology="two-inertia", motion="rotational", plane=plane)
    return Campaign(
        path=Path("."), rig=rig, runs=(Run(id="h", experiment="hammer", streams=(stream,), brake=True),)
    )


def samples(campaign):
    return [np.asarray(c.samples) for c in campaign.runs[0].streams[0].channels]


def test_what_is_sound_is_the_same_campaign(rng):
    campaign = hit(rng)
    found, lines = zeroed(campaign)
    assert found is campaign and lines == ()


@pytest.mark.parametrize(("force", "sensor", "named"), [(1.5, 0.0, "force"), (0.0, -0.6, "linear-acceleration")])
def test_an_offset_comes_off_to_the_scatter_of_its_quiet_start(force, sensor, named):
    sound = hit(np.random.default_rng(3))
    found, lines = zeroed(hit(np.random.default_rng(3), force, sensor))
    assert len(lines) == 1 and lines[0].startswith(f"{named} at the arm (run h)") and "subtracted" in lines[0]
    for clean, done in zip(samples(sound), samples(found), strict=True):
        assert np.allclose(clean, done, atol=0.02)
    again, further = zeroed(found)
    assert again is found and further == ()


def test_weight_on_a_dc_sensor_stays(rng):
    campaign = hit(rng, sensor_offset=-9.81, plane="vertical")
    assert zeroed(campaign)[0] is campaign


def test_a_coupling_that_is_still_charging_stays(rng):
    campaign = hit(rng, coupling="ac")
    stream = campaign.runs[0].streams[0]
    charging = 5.0 * np.exp(-np.arange(N) / RATE / 0.3)
    channels = (stream.channels[0], replace(stream.channels[1], samples=stream.channels[1].samples + charging))
    run = replace(campaign.runs[0], streams=(replace(stream, channels=channels),))
    campaign = replace(campaign, runs=(run,))
    assert zeroed(campaign)[0] is campaign


def _louder(campaign, factor, name):
    stream = campaign.runs[0].streams[0]
    force, ring = stream.channels
    channels = (replace(force, samples=force.samples * factor), replace(ring, samples=ring.samples * factor))
    return replace(campaign.runs[0], id=name, streams=(replace(stream, channels=channels),))


@pytest.mark.parametrize("offset", [0.0, 0.4])
def test_what_an_amplifier_adds_to_quiet_hits_comes_off_the_loud_ones_too(offset):
    """0.4 of 30 is more than half a per cent, of 300 less: alone the loud hit keeps it, beside quiet ones it doesn't."""
    quiet = [hit(np.random.default_rng(k), sensor_offset=offset) for k in (3, 4)]
    loud = hit(np.random.default_rng(5))
    ten = _louder(loud, 10.0, "loud")
    raised = replace(ten.streams[0].channels[1], samples=10.0 * samples(loud)[1] + offset)
    ten = replace(ten, streams=(replace(ten.streams[0], channels=(ten.streams[0].channels[0], raised)),))
    runs = tuple(replace(c.runs[0], id=f"q{k}") for k, c in enumerate(quiet))
    alone, none = zeroed(replace(loud, runs=(ten,)))
    assert none == () and alone.runs[0] is ten
    found, lines = zeroed(replace(loud, runs=(*runs, ten)))
    assert len(lines) == (3 if offset else 0)
    left = found.runs[-1].streams[0].channels[1].samples[: HIT - 20]
    assert abs(np.mean(left)) < 0.05


def test_one_offset_is_taken_off_where_readings_agree_and_each_its_own_where_they_do_not():
    def means(offsets):
        runs = [hit(np.random.default_rng(k), sensor_offset=x).runs[0] for k, x in enumerate(offsets)]
        campaign = hit(np.random.default_rng(0))
        done, _ = zeroed(replace(campaign, runs=tuple(replace(r, id=str(k)) for k, r in enumerate(runs))))
        return [c.taken_off for c in (r.streams[0].channels[1] for r in done.runs)]

    assert len(set(means([0.6, 0.6, 0.6]))) == 1
    drifted = means([0.4, 0.6, 0.8])
    assert np.allclose(drifted, [0.4, 0.6, 0.8], atol=0.02) and len(set(drifted)) == 3


def test_a_run_without_the_others_offset_keeps_its_samples():
    runs = [hit(np.random.default_rng(k), sensor_offset=x).runs[0] for k, x in enumerate([0.6, 0.61, 0.0])]
    campaign = hit(np.random.default_rng(0))
    done, lines = zeroed(replace(campaign, runs=tuple(replace(r, id=str(k)) for k, r in enumerate(runs))))
    assert len(lines) == 2
    assert done.runs[2].streams[0].channels[1].samples is runs[2].streams[0].channels[1].samples


def upright(offset, angles, tilt=0.0, gain=1.0):
    """Hits of a standing arm in several postures, seen by a dc sensor."""
    rng = np.random.default_rng(7)
    weights = [gain * 9.80665 * (np.cos(q) * np.cos(tilt) + np.sin(q) * np.sin(tilt)) for q in angles]
    runs = [
        replace(hit(rng, sensor_offset=offset + w, plane="vertical").runs[0], id=f"h{k}", arm_angle=q)
        for k, (q, w) in enumerate(zip(angles, weights, strict=True))
    ]
    return replace(hit(rng, plane="vertical"), runs=tuple(runs))


def test_an_offset_beside_the_weight_comes_off_and_the_weight_stays():
    campaign = upright(-0.27, (0.0, -0.4, -0.9))
    found, lines = zeroed(campaign)
    assert len(lines) == 3
    for before, after in zip(campaign.runs, found.runs, strict=True):
        gone = before.streams[0].channels[1].samples - after.streams[0].channels[1].samples
        assert gone == pytest.approx(np.full(N, -0.27), abs=0.01)


@pytest.mark.parametrize(
    "campaign",
    [
        upright(0.0, (0.0, -0.4, -0.9)),
        upright(0.0, (0.0, -0.4, -0.9), tilt=0.05),
        upright(0.0, (0.0, -0.4, -0.9), gain=1.05),
        upright(-0.27, (-0.9, -0.9)),
    ],
    ids=["sound", "tilted", "gain", "one posture"],
)
def test_what_may_be_a_share_of_the_weight_stays(campaign):
    assert zeroed(campaign)[0] is campaign


def test_what_one_posture_leaves_open_is_said():
    (line,) = zeroed(upright(-0.27, (-0.9, -0.9)))[1]
    assert "-0.27 m/s^2" in line and "an offset, a gain or a tilt" in line and "another posture" in line
    assert zeroed(upright(0.0, (-0.9, -0.9)))[1] == ()
    assert zeroed(upright(0.0, (0.0, -0.4, -0.9), tilt=0.05))[1] == ()  # the postures tell


POSTURES = (0.0, -0.4, -0.9) * 5


def test_an_offset_that_no_single_reading_is_sure_of_comes_off_and_as_small_a_share_of_the_weight_stays():
    one = upright(-0.015, POSTURES[:1]).runs[0]
    reading = quiet_level(one, one.signals[1])
    assert reading is not None
    assert abs(reading[0] - 9.80665) < CERTAIN * reading[1]
    found, lines = zeroed(upright(-0.015, POSTURES))
    assert len(lines) == len(POSTURES)
    off = [c.taken_off for run in found.runs for c in run.streams[0].channels[1:]]
    assert off == pytest.approx([-0.015] * len(POSTURES), abs=2e-3)
    shared = upright(0.0, POSTURES, gain=0.998)
    assert zeroed(shared)[0] is shared
