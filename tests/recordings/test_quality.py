"""Each finding of a single channel: planted it is named, absent it is not."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from jointscope.recordings.campaign import Campaign, Channel, Nameplate, Run, Stream
from jointscope.recordings.quality import NAMES, recorded_findings

RATE, N, HIT = 1024.0, 4096, 256
T = np.arange(N) / RATE
RIG = Nameplate(topology="two-inertia", motion="rotational", plane="vertical")


def pulse(at, height=200.0, contact=0.007):
    """A half sine of ``contact`` [s] that begins at sample ``at``."""
    phase = (T - at / RATE) / contact
    return np.where((phase > 0) & (phase < 1), height * np.sin(np.pi * np.clip(phase, 0, 1)), 0.0)


def ringing(at, swing=30.0, frequency=40.0, damping=0.03):
    t = np.clip(T - at / RATE, 0.0, None)
    return swing * np.exp(-2 * np.pi * frequency * damping * t) * np.sin(2 * np.pi * frequency * t)


@pytest.fixture
def force(rng):
    return pulse(HIT) + 0.1 * rng.standard_normal(N)


@pytest.fixture
def acceleration(rng):
    return ringing(HIT) + 0.02 * rng.standard_normal(N)


def hammer(force, acceleration, gaps="refuse", experiment="hammer", **changes):
    sensor = {"coupling": "ac", "low_cutoff": 0.5} | changes
    channels = (
        Channel(column="f", quantity="force", unit="N", location="arm", role="input", radius=0.8, samples=force),
        Channel(column="a", quantity="linear-acceleration", unit="m/s^2", location="arm", role="output", radius=0.9,
                samples=acceleration, **sensor),
    )  # fmt: skip
    stream = Stream(file="a.csv", sampling_rate=RATE, length=N, gaps=gaps, channels=channels)
    run = Run(id="hit", experiment=experiment, streams=(stream,), brake=True)
    return Campaign(path=Path("."), rig=RIG, runs=(run,))


def named(campaign):
    found = recorded_findings(campaign)
    assert all(finding.finding in NAMES and "\n" not in finding.detail for finding in found)
    return {(finding.finding, finding.channel) for finding in found}


def test_a_clean_hit_has_no_findings(force, acceleration):
    assert named(hammer(force, acceleration)) == set()


def test_silence_before_a_pulse_read_by_two_sensors_has_no_findings_without_noise():
    assert named(hammer(pulse(HIT), ringing(HIT))) == set()


@pytest.mark.parametrize("share", [0.08, 0.3, 1.0])
@pytest.mark.parametrize("late", [20, 40, 1500])
def test_a_second_contact_is_a_double_hit(force, acceleration, share, late):
    assert named(hammer(force + pulse(HIT + late, 200.0 * share), acceleration)) == {("double-hit", "f")}


def test_the_ringing_of_an_anti_alias_filter_is_no_second_contact(acceleration, rng):
    k = np.arange(N) - HIT
    ring = 150.0 * np.sinc((k + 0.3) / 1.0)  # what is left of a pulse far shorter than a sample
    found = named(hammer(ring + 0.01 * rng.standard_normal(N), acceleration))
    assert found == {("undersampled-pulse", "f")}


def test_a_signal_cut_off_is_clipped_and_a_peak_at_full_scale_overloaded(force, acceleration):
    clipped = np.clip(acceleration, -20.0, 20.0)
    assert named(hammer(force, clipped)) == {("clipping", "a")}
    assert named(hammer(force, acceleration, full_scale=29.0)) == {("overload", "a")}
    assert named(hammer(force, acceleration, full_scale=100.0)) == set()


def test_the_turning_points_of_a_coarse_record_are_not_clipped(force):
    slow = np.round(30.0 * np.sin(2 * np.pi * 1.5 * np.clip(T - HIT / RATE, 0, None)), 0)
    assert ("clipping", "a") not in named(hammer(force, slow))


def test_a_constant_channel_is_dead_and_so_is_one_that_hears_no_hit(force, acceleration, rng):
    assert named(hammer(force, np.full(N, 0.7))) == {("dead-channel", "a")}
    assert named(hammer(force, 0.02 * rng.standard_normal(N))) == {("dead-channel", "a")}
    assert ("dead-channel", "f") in named(hammer(0.1 * rng.standard_normal(N), acceleration))


def test_offsets_of_force_and_sensor(force, acceleration):
    assert named(hammer(force + 1.5, acceleration)) == {("offset", "f")}
    assert named(hammer(force, acceleration + 0.6)) == {("offset", "a")}


def test_gravity_on_a_dc_sensor_is_no_offset(force, acceleration):
    assert named(hammer(force, acceleration + 9.81, coupling="dc", low_cutoff=None)) == set()


def test_an_iepe_sensor_that_still_settles(force, acceleration):
    settling = 1.5 * np.exp(-2 * np.pi * 0.5 * T)
    assert named(hammer(force, acceleration + settling)) == {("unsettled-iepe", "a")}


def test_a_recording_that_ends_too_soon(force, rng):
    endless = ringing(HIT, damping=0.001) + 0.02 * rng.standard_normal(N)
    assert named(hammer(force, endless)) == {("truncated-decay", "a")}


def test_few_bits(force, acceleration):
    assert named(hammer(force, np.round(acceleration / 2.0) * 2.0)) == {("quantisation", "a")}
    assert named(hammer(force, np.round(acceleration / 0.05) * 0.05)) == set()


@pytest.mark.parametrize("mains", [50.0, 60.0])
def test_mains_hum(force, acceleration, mains):
    hum = 0.2 * np.sin(2 * np.pi * mains * T + 1.0)
    assert named(hammer(force, acceleration + hum)) == {("mains-hum", "a")}


@pytest.mark.parametrize("frequency", [49.8, 50.0, 60.0])
def test_a_resonance_at_the_mains_frequency_is_no_hum(force, frequency, rng):
    ring = ringing(HIT, frequency=frequency, damping=0.01) + 0.02 * rng.standard_normal(N)
    assert ("mains-hum", "a") not in named(hammer(force, ring))


def test_a_multisine_with_a_line_at_the_mains_frequency_is_no_hum(rng):
    lines = np.arange(11.0, 251.0)
    multisine = np.sum(
        [np.cos(2 * np.pi * f * T + p) for f, p in zip(lines, rng.uniform(0, 6, lines.size), strict=True)], 0
    )
    campaign = hammer(multisine, multisine, experiment="free")
    assert ("mains-hum", "a") not in named(campaign)


def test_gaps_and_stuck_samples(force, acceleration):
    holed = np.array(acceleration)
    holed[300:330] = np.nan
    assert named(hammer(force, holed, gaps="mask")) == {("sample-gaps", "a")}
    stuck = np.array(acceleration)
    stuck[280:300] = stuck[280]
    assert named(hammer(force, stuck)) == {("sample-gaps", "a")}


def torque_run(samples, rate=500.0, quantity="torque", unit="N m", location="motor", role="input", **more):
    channel = Channel(
        column="t", quantity=quantity, unit=unit, location=location, role=role, samples=samples, **more
    )
    stream = Stream(file="a.csv", sampling_rate=rate, length=samples.size, channels=(channel,))
    return Campaign(path=Path("."), rig=RIG, runs=(Run(id="r", experiment="torque-sweep", streams=(stream,)),))


def test_a_held_log_is_named_with_its_true_rate(rng):
    values = rng.standard_normal(500)
    found = recorded_findings(torque_run(np.repeat(values, 4)))
    assert [f.finding for f in found] == ["held-samples"]
    assert "125 Hz" in found[0].detail
    assert recorded_findings(torque_run(rng.standard_normal(2000))) == []


def test_a_speed_that_is_not_zero_at_rest_is_offset(rng):
    speed = np.concatenate([np.zeros(100), np.sin(np.linspace(0, 6, 900))]) + 1e-4 * rng.standard_normal(1000)
    run = {"quantity": "angular-velocity", "unit": "rad/s", "role": "output"}
    assert named(torque_run(speed, **run)) == set()
    assert named(torque_run(speed + 0.05, **run)) == {("offset", "t")}


def test_a_drive_that_stands_still_on_purpose_is_not_dead(rng):
    still = torque_run(np.full(500, 0.2), quantity="angle", unit="rad", role="output")
    assert named(still) == {("dead-channel", "t")}
    braked = replace(still, runs=(replace(still.runs[0], brake=True, experiment="hammer"),))
    assert named(braked) == set()


@pytest.mark.parametrize(
    ("label", "unit", "quantity", "fault"),
    [
        ("g", "N", "force", True),
        ("N", "N", "force", False),
        ("lbf", "N", "force", True),
        ("g", "m/s^2", "linear-acceleration", True),
        ("m/s²", "m/s^2", "linear-acceleration", False),
        ("mV", "N", "force", False),
        ("furlong", "N", "force", False),
        (None, "N", "force", False),
    ],
)
def test_the_files_own_label_against_the_declaration(rng, label, unit, quantity, fault):
    campaign = torque_run(
        rng.standard_normal(500), quantity=quantity, unit=unit, location="arm", radius=1.0, file_unit=label
    )
    found = [f for f in recorded_findings(campaign) if f.finding == "suspicious-unit"]
    assert bool(found) == fault


def test_degrees_for_radians():
    arm = torque_run(np.linspace(0.0, 120.0, 500), quantity="angle", unit="rad", location="arm", role="output")
    found = recorded_findings(arm)
    assert [f.finding for f in found] == ["suspicious-unit"]
    assert 'unit = "deg"' in found[0].toml
    tilted = replace(arm, runs=(replace(arm.runs[0], arm_angle=-60.0, streams=()),))
    assert [f.toml for f in recorded_findings(tilted)] == ["arm_angle = -1.0472"]
    level = torque_run(np.linspace(0.0, 2.1, 500), quantity="angle", unit="rad", location="arm", role="output")
    assert recorded_findings(level) == []


def test_jittered_stamps_are_reported_once_per_stream(force, acceleration):
    campaign = hammer(force, acceleration)
    run = campaign.runs[0]
    stream = replace(run.streams[0], jitter=2e-4)
    jittered = replace(campaign, runs=(replace(run, streams=(stream,)),))
    assert named(jittered) == {("time-jitter", "f")}
