"""Two encoders are compared by their difference: what moves both alike is no mismatch of the transmission."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from jointscope.diagnosis.assembly import BASE_INDEX
from jointscope.diagnosis.channels import observe
from jointscope.diagnosis.held_out_detail import shown_between_devices, wind_up_error
from jointscope.diagnosis.noise import quantum
from jointscope.diagnosis.predict import build, integrate, predict_outputs
from jointscope.diagnosis.wind_up import WIND_UP, with_wind_up


@pytest.fixture(scope="module")
def swept(problem, truth):
    """A torque sweep with both encoders, noise-free, prepared but not yet paired."""
    run = next(r for r in problem.runs if r.mode == "observer" and r.motor_moves)
    motor = next(o for o in run.outputs if o.observed)
    arm = replace(motor, location="arm", observed=False)
    states = integrate(build(run, truth, (), problem))
    arm = replace(arm, data=observe(states, build(run, truth, (), problem), run, arm))
    return replace(run, outputs=(motor, arm))


def test_the_difference_takes_the_arms_place_and_the_motors_angle_stays(swept):
    paired = with_wind_up(swept)
    motor, other = paired.outputs
    assert motor is swept.outputs[0]
    assert (other.quantity, other.location, other.floating) == (WIND_UP, "transmission", True)
    assert other.data == pytest.approx(swept.outputs[0].data / swept.ratio - swept.outputs[1].data)


def test_the_true_model_predicts_it(swept, problem, truth):
    paired = with_wind_up(swept)
    predicted = predict_outputs(paired, truth, (), problem)[1]
    kept = paired.outputs[1].mask
    error = (paired.outputs[1].data - predicted)[kept]
    assert np.std(error) < 0.01 * np.std(paired.outputs[1].data[kept])


def test_what_moves_both_sides_alike_leaves_it_unchanged(swept):
    motor, arm = swept.outputs
    drift = 0.3 * np.sin(0.7 * motor.times)
    moved = replace(
        swept, outputs=(replace(motor, data=motor.data + swept.ratio * drift), replace(arm, data=arm.data + drift))
    )
    plain, shaken = (with_wind_up(run).outputs[1].data for run in (swept, moved))
    assert shaken == pytest.approx(plain, abs=1e-12)


@pytest.mark.parametrize(("by_motor", "by_arm"), [(2.0e-4, 5.0e-5), (0.0, 5.0e-5)])
def test_its_step_is_that_of_both_encoders(swept, by_motor, by_arm):
    """Of the difference's own levels the closest two are far nearer; what is rounded off is the steps' sum of squares."""

    def rounded(output, step):
        return replace(output, data=np.round(output.data / step) * step if step else output.data, step=None)

    motor, arm = swept.outputs
    pair = replace(swept, outputs=(rounded(motor, by_motor * swept.ratio), rounded(arm, by_arm)))
    assert quantum(with_wind_up(pair).outputs[1]) == pytest.approx(np.hypot(by_motor, by_arm), rel=0.02)


def test_encoders_of_two_devices_are_compared_one_by_one(swept):
    motor, arm = swept.outputs
    apart = replace(swept, outputs=(motor, replace(arm, device=arm.device + 1)))
    assert with_wind_up(apart).outputs == apart.outputs


def test_a_held_motor_leaves_everything_as_it_is(problem):
    braked = next(r for r in problem.runs if not r.motor_moves)
    assert with_wind_up(braked) is braked


def test_a_wind_up_between_two_devices_shows_the_better_model(swept, problem, truth):
    """Each angle follows whatever moves both; their difference says which joint twists, and is the same as one device's."""
    motor, arm = swept.outputs
    drift = 0.05 * np.sin(0.7 * motor.times)
    apart = replace(
        swept,
        outputs=(
            replace(motor, data=motor.data + swept.ratio * drift),
            replace(arm, device=arm.device + 1, data=arm.data + drift + 0.2),
        ),
    )
    softer = truth.copy()
    softer[BASE_INDEX["stiffness"]] *= 0.8
    of_two, of_one = replace(problem, runs=(apart,)), replace(problem, runs=(with_wind_up(swept),))
    right, wrong = (truth, ()), (softer, ())
    for model in (right, wrong):
        assert wind_up_error(of_two, (0,), model) == pytest.approx(wind_up_error(of_one, (0,), model), abs=0.02)
    assert shown_between_devices(of_two, (0,), wrong, right)
    assert not shown_between_devices(of_two, (0,), right, wrong)
    assert not shown_between_devices(of_two, (0,), right, right)
    assert not shown_between_devices(of_one, (0,), wrong, right)  # where it is a channel, that decides
