"""A motion that is prescribed by its record: where it rests, friction does not reverse with the record's noise."""

from dataclasses import dataclass

import numpy as np
import pytest

from jointscope.diagnosis.adequacy import adequacy
from jointscope.diagnosis.effects import ActiveEffect, catalogue
from jointscope.diagnosis.noise import white
from jointscope.diagnosis.predict import predict_outputs
from jointscope.diagnosis.prepare import prepare
from jointscope.diagnosis.prescribed_path import (
    INVERSE_CORNER,
    STANDS_OUT,
    prescribed_path,
    speed_noise,
    where_it_moves,
)
from jointscope.diagnosis.recorder_step import decimal_step
from jointscope.diagnosis.sizes import typical_sizes
from jointscope.recordings.campaign import Nameplate, Run, Stream

RATE = 1000.0
T = np.arange(4000) / RATE
MOVING = (T > 1.0) & (T < 3.0)
MASS, DRAG, FRICTION = 40.0, 90.0, 25.0


def motion(size=0.02):
    """A carriage that rests for a second, goes twice there and back, and rests again [m], with its speed and acceleration."""
    w = 2.0 * np.pi
    s = np.where(MOVING, T - 1.0, 0.0)
    window = np.sin(0.5 * np.pi * s) ** 4
    q = size * window * np.sin(w * s)
    return q, np.gradient(q, T), np.gradient(np.gradient(q, T), T)


def test_a_speed_that_does_not_stand_out_of_its_records_noise_is_none():
    """At rest nothing moves; in motion the speed is that of the angle, and what it loses is within the stated noise."""
    q, v, _ = motion()
    noisy = q + 2e-8 * np.random.default_rng(5).standard_normal(q.size)
    _, speed, _ = prescribed_path(noisy, RATE, 0.0, T)
    rest = (T < 0.8) | ((T > 3.2) & (T < 3.9))
    assert not np.any(speed[rest])
    fast = np.abs(v) > 1e-3
    np.testing.assert_allclose(speed[fast], v[fast], atol=2e-3 * np.abs(v).max())


@pytest.mark.parametrize("sigma", [1e-8, 3e-6])
def test_the_noise_of_a_speed_is_that_of_its_angle_through_the_low_pass(sigma):
    """s_v = 2 pi s sqrt(2 f_c^3/(3 f_s)): measured on white noise within a fifth, whatever its size."""
    rng = np.random.default_rng(3)
    noise = sigma * rng.standard_normal(20000)
    path, speed, _ = prescribed_path(noise, RATE, 0.0, np.arange(200, 19800) / RATE)
    own = np.gradient(path) * RATE
    assert np.std(own) == pytest.approx(speed_noise(noise, RATE, 60.0), rel=0.2)
    assert np.mean(speed != 0.0) < 1e-3
    assert STANDS_OUT > 3.0


def test_steps_of_an_encoder_are_no_speed_either():
    q, _, _ = motion()
    coarse = 1e-6 * np.round(q / 1e-6)
    _, speed, _ = prescribed_path(coarse, RATE, 0.0, T)
    assert not np.any(speed[(T < 0.8) | ((T > 3.2) & (T < 3.9))])


@pytest.fixture
def bench(builders):
    """A carriage that is moved, and the force that it takes: its mass, oil and dry friction."""
    rng = np.random.default_rng(11)
    runs = []
    for k, size in enumerate((0.02, 0.035)):
        q, v, a = motion(size)
        force = MASS * a + DRAG * v + FRICTION * np.sign(np.where(MOVING, v, 0.0))
        channels = (
            builders.channel("x", "position", "m", "load", "input", q + 2e-8 * rng.standard_normal(q.size)),
            builders.channel("F", "force", "N", "load", "output", force + 0.3 * rng.standard_normal(q.size)),
        )
        stream = Stream(file=f"{k}.csv", sampling_rate=RATE, length=T.size, channels=channels)
        runs.append(Run(id=f"m{k}", experiment="speed-motion", streams=(stream,)))
    rig = Nameplate(
        topology="single-dof",
        motion="translational",
        plane="horizontal",
        ground_spring=False,
        inertia_reference=50.0,
    )
    return prepare(builders.campaign_of(runs, rig))


def test_the_force_of_a_prescribed_motion_is_mass_oil_and_friction_in_si(bench):
    """What is left is the sensor's noise and the corners that a low-pass rounds; before, friction rattled at rest."""
    assert bench.torque_calibrated
    law = next(
        s for s in catalogue(bench) if (s.name, s.location, s.variant) == ("coulomb-friction", "load", "plain")
    )
    theta = bench.theta(load_inertia=MASS, load_damping=DRAG)
    for run in bench.runs:
        y = predict_outputs(run, theta, (ActiveEffect(law, (FRICTION,)),), bench)[0]
        left = run.outputs[0].data - y
        rest = (run.outputs[0].times > 0.1) & (run.outputs[0].times < 0.8)
        assert np.std(left[rest]) < 0.35
        assert np.median(np.abs(left)) < 0.4


def test_sizes_of_a_prescribed_motion_come_from_the_force_that_was_recorded(bench):
    """They were those of the acceleration: a friction of 25 N then lay beyond its bounds."""
    sizes = typical_sizes(bench, bench.base.start)
    peak = max(np.max(np.abs(run.outputs[0].data)) for run in bench.runs)
    assert sizes.torque == pytest.approx(peak)
    limits = {
        p.name: p.upper
        for s in catalogue(bench)
        if s.name == "coulomb-friction"
        for p in s.parameters
        if p.null == 0.0
    }
    assert limits["torque"] > 2.0 * FRICTION


def test_at_rest_a_rigid_axis_is_not_scored_and_a_sprung_one_is(bench, builders):
    """Dry friction bears at rest whatever it is asked to, up to its breakaway; a spring says its stiffness there."""
    for run in bench.runs:
        output = run.outputs[0]
        well_inside = (output.times > 1.3) & (output.times < 1.7)
        assert np.mean(output.mask[well_inside]) > 0.9
        assert np.mean(output.mask[output.times < 0.9]) < 0.01  # but where a record begins
    sprung = prepare(builders.campaign_of([turntable(builders)], TEST_STAND))
    assert np.all(sprung.runs[0].outputs[0].mask[50:-50])


TEST_STAND = Nameplate(
    topology="single-dof", motion="rotational", plane="horizontal", ground_spring=True,
    inertia_reference=2.0, stiffness_reference=4000.0, load_damping=9.0,
)  # fmt: skip


def turntable(builders, unit="N m"):
    """An arm on a torsion spring that is turned by hand, and the torque that it takes."""
    q, v, a = motion(0.01)
    torque = 2.4 * a + 12.0 * v + 5200.0 * q
    channels = (
        builders.channel("q", "angle", "rad", "arm", "input", q),
        builders.channel("T", "torque", unit, "arm", "output", torque),
    )
    return Run(
        id="t",
        experiment="speed-motion",
        brake=True,
        streams=(Stream(file="t.csv", sampling_rate=RATE, length=T.size, channels=channels),),
    )


def test_the_torque_at_an_arm_whose_angle_is_prescribed_is_foretold(builders):
    """J a + b v + K q within what the low-pass takes off; it was taken for an acceleration, and foretold as none."""
    problem = prepare(builders.campaign_of([turntable(builders)], TEST_STAND))
    run = problem.runs[0]
    assert run.takes(run.outputs[0]) and not run.answers
    theta = problem.theta(load_inertia=2.4, load_damping=12.0, damping=0.0, stiffness=5200.0)
    y = predict_outputs(run, theta, (), problem)[0]
    assert np.std(run.outputs[0].data - y) < 2e-3 * np.std(run.outputs[0].data)


@pytest.mark.parametrize("recorded", [True, False])
def test_a_motor_that_turns_by_its_record_shows_what_its_turn_shows(builders, recorded):
    """Lines and friction of the motor are possible; its damping is free where the torque that it took was recorded."""
    q, _, _ = motion(0.5)
    channels = [
        builders.channel("qm", "angle", "rad", "motor", "input", 100.0 * q),
        builders.channel("q", "angle", "rad", "arm", "output", q),
    ]
    if recorded:
        channels.append(builders.channel("T", "torque", "N m", "motor", "output", 0.02 * q))
    rig = Nameplate(
        topology="two-inertia", motion="rotational", plane="horizontal", reduction_ratio=100.0, motor_inertia=9e-5,
        reducer_inertia=6e-5, inertia_reference=2.4, stiffness_reference=22000.0, efficiency=0.8,
    )  # fmt: skip
    stream = Stream(file="m.csv", sampling_rate=RATE, length=T.size, channels=tuple(channels))
    problem = prepare(builders.campaign_of([Run(id="m", experiment="speed-motion", streams=(stream,))], rig))
    run = problem.runs[0]
    assert run.mode == "prescribed-motor" and run.turns and not run.motor_moves
    assert run.answers is recorded
    possible = {(s.name, s.location) for s in catalogue(problem) if s.possible(problem) is None}
    assert possible >= {("transmission-error", "transmission"), ("coulomb-friction", "motor")}
    assert bool(problem.base.free[problem.base.names.index("motor_damping")]) is recorded


def test_the_force_of_a_prescribed_motion_counts_in_the_verdict(bench):
    """What a drive answers is its own law's affair; what a prescribed motion takes is the rig's."""
    theta = bench.theta(load_inertia=MASS, load_damping=DRAG)
    law = next(
        s for s in catalogue(bench) if (s.name, s.location, s.variant) == ("coulomb-friction", "load", "plain")
    )
    base = [predict_outputs(run, theta, (), bench) for run in bench.runs]
    better = [predict_outputs(run, theta, (ActiveEffect(law, (FRICTION,)),), bench) for run in bench.runs]
    fit = adequacy(bench.runs, white(bench.runs), base, better)
    (block,) = fit.blocks
    assert block.base > 0.3
    assert fit.at_least > 0.97


def test_per_unit_of_an_unknown_input_no_maker_figure_bounds_an_inertia(builders):
    """A slide of 125 kg driven by a force in volts is one of 3 per volt: its bounds and start are not the maker's."""
    t = np.arange(2000) / 500.0
    force = np.sin(2.0 * np.pi * 1.5 * t)
    x = -force / (3.0 * (2.0 * np.pi * 1.5) ** 2)
    channels = (
        builders.channel("u", "force", "1", "load", "input", force),
        builders.channel("x", "position", "m", "load", "output", x),
    )
    rig = Nameplate(
        topology="single-dof",
        motion="translational",
        plane="horizontal",
        ground_spring=False,
        inertia_reference=125.0,
    )
    stream = Stream(file="u.csv", sampling_rate=500.0, length=t.size, channels=channels)
    problem = prepare(builders.campaign_of([Run(id="u", experiment="speed-motion", streams=(stream,))], rig))
    assert not problem.torque_calibrated
    i = problem.base.names.index("load_inertia")
    assert problem.base.lower[i] < 3.0 < problem.base.upper[i]


@pytest.mark.parametrize("pace", [43, 1003])
def test_a_carriage_at_constant_speed_has_its_scales_noise_though_no_difference_shows_a_step(pace):
    """There and back at a whole number of steps a sample, with rests between: the rests are rests."""
    step = 1e-7
    leg = np.concatenate([np.zeros(400), pace * np.arange(1, 601), np.full(400, 600 * pace)])
    q = step * np.concatenate([leg, leg[::-1]]).astype(float)
    assert decimal_step(q) == pytest.approx(step)
    _, speed, _ = prescribed_path(q, RATE, 0.0, np.arange(q.size) / RATE)
    rest = np.r_[100:280, 1120:1680, 2520:2700]
    assert not np.any(speed[rest])
    assert np.all(np.abs(speed[np.r_[450:950]]) > 0.0)


def test_a_record_in_full_precision_lies_on_no_decimal_place():
    x = np.random.default_rng(3).standard_normal(500)
    assert decimal_step(x) == 0.0
    assert decimal_step(np.zeros(10)) == 0.0
    assert decimal_step(np.round(x, 3)) == pytest.approx(1e-3)


@dataclass(frozen=True)
class Recorded:
    quantity: str
    times: np.ndarray
    mask: np.ndarray


def test_nothing_is_scored_within_the_low_passs_reach_of_where_a_rigid_axis_turns():
    """The smoothed speed turns elsewhere than the true one: a friction that turns with it is a spike."""
    half = np.arange(8001) / 2000.0
    speed = np.where(np.abs(half - 2.0) < 0.3, 0.0, np.sin(2.0 * np.pi * 0.5 * half))
    force = Recorded("force", half[::2], np.ones(half[::2].size, dtype=bool))
    scored = where_it_moves((force,), half, speed, 1000.0)[0].mask
    turns = [0.0, 1.0, 1.7, 2.3, 3.0]
    away = np.min(np.abs(half[::2, None] - np.array(turns)), axis=1)
    moves = speed[::2] != 0.0
    assert not np.any(scored & ~moves)
    assert not np.any(scored & (away < 0.4 / INVERSE_CORNER))
    assert np.all(scored[moves & (away > 0.7 / INVERSE_CORNER)])
