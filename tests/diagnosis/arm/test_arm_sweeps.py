"""An arm's sweeps from recordings to a verdict: MuJoCo's motion under noise, with a loop in a reducer and without one."""

from __future__ import annotations

import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
import planar  # type: ignore[import-not-found]

from jointscope.diagnosis import rounds
from jointscope.diagnosis.arm import kernel
from jointscope.diagnosis.arm.pipeline import diagnose_arm
from jointscope.diagnosis.arm.predict import free_prediction, predict_outputs
from jointscope.diagnosis.arm.prepare import prepare_arm

NOISE = 0.01  # of each accelerometer's size


def noisy(run, rng, name):
    """The run once more, as another take: noise on its accelerometers and its angle."""

    def heard(channel):
        if channel.role != "output":
            return channel
        size = 2e-5 if channel.quantity == "angle" else NOISE * float(np.std(channel.samples))
        return replace(channel, samples=channel.samples + size * rng.standard_normal(channel.samples.size))

    streams = tuple(replace(s, channels=tuple(heard(c) for c in s.channels)) for s in run.streams)
    return replace(run, id=name, streams=streams)


@pytest.fixture(scope="module")
def sweeps(tmp_path_factory):
    """Three takes of one sweep, none longer than 1.5 s."""
    campaign = planar.swept(tmp_path_factory.mktemp("sweeps"))
    rng = np.random.default_rng(5)
    runs = tuple(noisy(campaign.runs[0], rng, f"s{k}") for k in range(3))
    return prepare_arm(replace(campaign, runs=runs))


def test_sweeps_of_a_plain_arm_are_answered_none(sweeps, monkeypatch):
    def in_less_of_it(run, frequency):
        raise AssertionError("the path of a driven joint keeps the whole grid")

    monkeypatch.setattr(rounds, "briefly", in_less_of_it)
    with ThreadPoolExecutor(2) as pool:
        found = diagnose_arm(sweeps, pool)
    assert found.decision.verdict == "none"
    theta, _ = found.decision.chosen.fit.coordinates.unpack(found.decision.chosen.fit.x)
    assert theta[sweeps.place("stiffness", 0)] == pytest.approx(40000.0, rel=0.03)


def test_what_drifts_below_a_sweep_is_not_foretold(sweeps):
    run, theta = sweeps.arm_runs[0], sweeps.base.start.copy()
    theta[sweeps.offset_place] += 2.0  # what a log's zero does to a rotor that nothing holds
    predicted = free_prediction(run, theta, (), sweeps)
    angle = next(k for k, probe in enumerate(run.probes) if probe < 0)
    assert kernel.DRIVEN in run.kinds
    slow = float(np.mean(predicted[angle]) - predicted[angle][0])
    assert abs(slow) < 0.5 * float(np.std(predicted[angle]))


def test_a_motor_whose_speed_alone_was_recorded_is_followed(tmp_path_factory):
    """Its integral is the path, as right as the angle's; the speed is compared, and no less foretold."""
    campaign = planar.swept(tmp_path_factory.mktemp("speeds"))
    run = campaign.runs[0]

    def speed(channel):
        if channel.quantity != "angle":
            return channel
        rate = next(s.sampling_rate for s in run.streams if channel in s.channels)
        return replace(
            channel, quantity="angular-velocity", unit="rad/s", samples=np.gradient(channel.samples) * rate
        )

    streams = tuple(replace(s, channels=tuple(speed(c) for c in s.channels)) for s in run.streams)
    problems = [prepare_arm(replace(campaign, runs=(r,))) for r in (run, replace(run, streams=streams))]
    by_angle, by_speed = (p.arm_runs[0] for p in problems)
    travel = float(np.ptp(by_angle.path))
    assert travel > 0.0 and np.max(np.abs(by_speed.path - by_angle.path)) < 0.01 * travel
    (turning,) = (k for k, probe in enumerate(by_speed.probes) if probe < 0)
    output = by_speed.outputs[turning]
    assert output.quantity == "angular-velocity" and output.observed
    theta = problems[1].base.start
    foretold = predict_outputs(by_speed, theta, (), problems[1])[turning]
    left = (output.data - foretold)[output.mask]
    assert float(np.std(left)) < 0.05 * float(np.std(output.data[output.mask]))
