"""Two encoders read one after the other: at speed the wind-up holds v delay, which is the recorder's and not the joint's."""

from __future__ import annotations

import functools
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from jointscope.diagnosis.effects import ActiveEffect, catalogue
from jointscope.diagnosis.pipeline import diagnose
from jointscope.diagnosis.predict import predict_outputs
from jointscope.diagnosis.prepare import prepare
from jointscope.diagnosis.wind_up import WIND_UP
from jointscope.recordings.bandlimited import bandlimited

LATE = 2e-3  # s
STEP = 2e-7  # rad, the encoders' noise at the output


def spec_of(problem):
    return next(s for s in catalogue(problem) if (s.name, s.variant) == ("delay", "encoder"))


@pytest.fixture(scope="module")
def swung(builders):
    """The maker of four motions of a joint, motor torque and both encoders logged by one device that reads the arm's late."""

    @functools.cache
    def made(late: float):
        plant, rng = builders.Plant(eta=1.0), np.random.default_rng(8)
        runs = []
        for k, amplitude in enumerate((25.0, 60.0, 40.0, 80.0)):
            run = builders.sweep_run(plant, amplitude, f"m{k}", duration=2.0)
            stream = run.streams[1]
            torque, motor = stream.channels
            times = np.arange(stream.length) / stream.sampling_rate
            fine = np.arange(40 * stream.length) / (40.0 * stream.sampling_rate)
            logged = CubicSpline(fine, plant.n * bandlimited(torque.samples, stream.sampling_rate, 0.0)(fine))
            motion, _ = plant.motion(lambda u: 0.0, lambda u, T=logged: float(T(u)), False, run.arm_angle, 2.0)
            q_s, q = motion(times)[0], motion(np.maximum(times - late, 0.0))[2]
            noise = STEP * rng.standard_normal((2, times.size))
            arm = builders.channel("qa", "angle", "rad", "arm", "output", q + noise[1])
            motor = replace(motor, samples=plant.n * (q_s + noise[0]))
            runs.append(replace(run, streams=(replace(stream, channels=(torque, motor, arm)),)))
        return builders.campaign_of(runs, replace(builders.NAMEPLATE, efficiency=1.0))

    return made


def answered(campaign, effort):
    problem = prepare(campaign)
    with ThreadPoolExecutor(2) as pool:
        return diagnose(problem, predict_outputs, catalogue(problem), pool, effort=effort).decision


def test_at_a_speed_the_wind_up_holds_speed_times_delay(swung):
    problem = prepare(swung(0.0))
    run, theta = problem.runs[0], problem.base.start
    position = next(i for i, o in enumerate(run.outputs) if o.quantity == WIND_UP)
    late = (ActiveEffect(spec_of(problem), (1e-4,)),)
    plain, shifted = (predict_outputs(run, theta, effects, problem)[position] for effects in ((), late))
    arm = run.outputs[position]
    speed = replace(arm, quantity="angular-velocity", location="arm", times=arm.times - 0.5e-4)
    (v,) = predict_outputs(replace(run, outputs=(speed,)), theta, (), problem)
    assert shifted - plain == pytest.approx(1e-4 * v, abs=0.01 * 1e-4 * np.max(np.abs(v)))


def test_a_late_encoder_is_named_with_its_delay(swung, one_effect):
    decision = answered(swung(LATE), one_effect)
    assert (decision.verdict, decision.chosen.names) == ("effects", ("delay@acquisition",))
    _, (found,) = decision.chosen.fit.coordinates.unpack(decision.chosen.fit.x)
    assert found.values[0] == pytest.approx(LATE, rel=0.05)


def test_encoders_read_together_are_left_alone(swung, one_effect):
    assert answered(swung(0.0), one_effect).verdict == "none"


def test_encoders_of_two_devices_have_a_delay_of_their_own(problem):
    assert spec_of(problem).possible(problem) is not None
