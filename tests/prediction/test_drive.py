"""The drive's law, found from runs of a loop that is known."""

import math

import numpy as np
import pytest
from scipy import signal

from jointscope.identification.drive import _response, identify_drive
from jointscope.identification.drive_law import drive_from_json
from jointscope.models.parameters import Joint
from jointscope.prediction.integrate import Loop, integrate
from jointscope.prediction.plant import plant_of

K_P, K_I = 0.08, 0.6


def smooth_step(x):
    x = np.clip(x, 0.0, 1.0)
    return x**3 * (10 - 15 * x + 6 * x**2)


def command(t, top=246.0):
    up = smooth_step(t / 0.4) - smooth_step((t - 2.0) / 0.4)
    return top * (up - (smooth_step((t - 2.4) / 0.4) - smooth_step((t - 4.4) / 0.4)))


def closed_loop_run(
    bench,
    rng,
    *,
    noise=0.0,
    angle_noise=0.0,
    limit=math.inf,
    channels=("angle",),
    friction=0.0,
    J_f=0.0,
    id="m1",
    top=246.0,
):
    """A speed motion of the paper's rig, logged at 500 Hz, with an optional drag the base model lacks."""
    model = bench.model()
    run = bench.run("speed-motion", bench.stream(500.0, length=2400), id=id)
    plant = plant_of(model, run)
    rate, n = 4000.0, 19_200
    t = np.arange(2 * n + 1) / (2 * rate)
    w_c = command(t, top)
    hold = plant.holding_torque(0.0)
    loop = Loop(
        command=w_c, command_rate=np.gradient(w_c, t), law=np.array([K_P, K_I, J_f, 0.0, hold, limit]), share=1.0
    )
    drag = -friction * np.sign(w_c) * np.minimum(np.abs(w_c) / 5.0, 1.0)
    motion = integrate(plant, start=0.0, rate=rate, arm_angle=0.0, motor_torque=0 * t, load_torque=drag, loop=loop)
    every = slice(None, None, 8)
    T = motion.torque[every] + noise * 0.01 * rng.standard_normal(n // 8 + 1)
    made = {
        "angle": (
            "angle",
            "motor",
            141.0 * motion.motor_angle[every] + (noise * 1e-3 + angle_noise) * rng.standard_normal(T.size),
        ),
        "arm": ("angle", "arm", motion.angle[every]),
        "speed": ("angular-velocity", "motor", 141.0 * motion.motor_speed[every]),
    }
    outputs = [
        bench.channel(q, where, "output", x, column=q + where) for q, where, x in (made[c] for c in channels)
    ]
    stream = bench.stream(
        500.0,
        bench.channel("torque", "motor", "input", T, column="T"),
        bench.channel("speed-command", "motor", "input", w_c[::16], column="w_c"),
        *outputs,
    )
    return bench.run("speed-motion", stream, id=id), motion


@pytest.mark.parametrize("channels", [("angle",), ("speed",)])
def test_the_law_is_recovered_from_a_clean_run(bench, rng, channels):
    run, _ = closed_loop_run(bench, rng, channels=channels)
    drive = identify_drive(bench.campaign(run))
    assert drive.proportional == pytest.approx(K_P, rel=2e-3)
    assert drive.integral == pytest.approx(K_I, rel=5e-3)
    assert drive.acceleration_feedforward == 0.0
    assert drive.torque_limit is None
    assert drive.explained > 0.9999


def test_friction_that_the_base_model_lacks_does_not_bend_the_law(bench, rng):
    run, _ = closed_loop_run(bench, rng, friction=40.0, noise=1.0)
    drive = identify_drive(bench.campaign(run))
    assert drive.proportional == pytest.approx(K_P, rel=0.02)
    assert drive.integral == pytest.approx(K_I, rel=0.03)


def test_a_torque_limit_is_seen_and_its_samples_are_left_out(bench, rng):
    run, _ = closed_loop_run(bench, rng, limit=1.2)
    drive = identify_drive(bench.campaign(run))
    assert drive.torque_limit == pytest.approx(1.2, rel=1e-3)
    assert drive.proportional == pytest.approx(K_P, rel=0.01)


def test_a_feed_forward_is_found_where_there_is_one(bench, rng):
    run, _ = closed_loop_run(bench, rng, J_f=4e-4, noise=0.3)
    drive = identify_drive(bench.campaign(run))
    assert drive.acceleration_feedforward == pytest.approx(4e-4, rel=0.1)
    assert drive.proportional == pytest.approx(K_P, rel=0.03)


def test_without_the_motor_s_motion_the_law_follows_through_the_joint(bench, rng):
    run, _ = closed_loop_run(bench, rng, channels=(), noise=0.3)
    joint: Joint = bench.model().as_joint()
    drive = identify_drive(bench.campaign(run), joint, gravity_moment=12 * 9.80665 * 0.4)
    assert drive.proportional == pytest.approx(K_P, rel=0.05)
    assert drive.integral == pytest.approx(K_I, rel=0.05)


def test_validation_runs_are_not_touched(bench, rng):
    run, _ = closed_loop_run(bench, rng)
    from dataclasses import replace

    assert identify_drive(bench.campaign(replace(run, role="validate"))) is None


def test_a_campaign_without_a_speed_command_has_no_law(bench, rng):
    run = bench.run("torque-sweep", bench.stream(500.0, bench.channel("torque", "motor", "input", np.ones(600))))
    assert identify_drive(bench.campaign(run), bench.model().as_joint()) is None


def test_a_command_that_has_nothing_to_do_with_the_torque_gives_no_law(bench, rng):
    t = np.arange(2400) / 500.0
    run = bench.run(
        "speed-motion",
        bench.stream(
            500.0,
            bench.channel("torque", "motor", "input", rng.standard_normal(2400)),
            bench.channel("speed-command", "motor", "input", command(t), column="w"),
            bench.channel("angle", "motor", "output", np.cumsum(command(t)) / 500.0),
        ),
    )
    assert identify_drive(bench.campaign(run)) is None


def test_the_law_survives_its_json(bench, rng):
    run, _ = closed_loop_run(bench, rng, limit=1.2)
    drive = identify_drive(bench.campaign(run))
    again = drive_from_json(drive.to_json())
    assert again.proportional == drive.proportional
    assert again.torque_limit == drive.torque_limit
    assert again.standard_errors == pytest.approx(drive.standard_errors)


@pytest.mark.parametrize("first", [0.0, 0.3])
def test_the_loop_answers_as_a_simulation_of_it_does(first):
    """The recursive filters in place of ``lsim``'s loop over samples, also for a command that begins at once."""
    inertia, stiffness = 3.0, 3.0 * (2.0 * np.pi * 20.0) ** 2
    plant, law = np.array([inertia, 41.0, stiffness]), np.array([200.0, 3000.0])
    joint = np.array([6.0 * inertia, 400.0, 9.0 * stiffness, stiffness])
    closed = np.polyadd(np.polymul([1.0, 0.0], joint), np.polymul(law, plant))
    numerator = np.polymul(law, joint)
    u = first + np.cumsum(np.random.default_rng(3).standard_normal(3000)) * 0.01
    u[0] = first
    simulated = signal.lsim((numerator, closed), u, np.arange(u.size) / 1000.0)[1]
    found = _response(numerator, closed, u, 1e-3)
    np.testing.assert_allclose(found, simulated, atol=1e-7 * np.max(np.abs(simulated)))


@pytest.mark.parametrize("friction", [0.0, 40.0])
@pytest.mark.parametrize("angle_noise", [0.03, 0.1, 0.3])
def test_a_noisy_angle_does_not_bend_the_law(bench, rng, angle_noise, friction):
    """A tenth of a radian of noise per sample makes more speed than the loop's own error: K_p was a fiftieth of itself."""
    run, _ = closed_loop_run(bench, rng, noise=1.0, angle_noise=angle_noise, friction=friction)
    drive = identify_drive(bench.campaign(run))
    assert drive.proportional == pytest.approx(K_P, rel=0.1)
    assert drive.integral == pytest.approx(K_I, rel=0.05)
