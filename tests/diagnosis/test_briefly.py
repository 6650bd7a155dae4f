"""What the search leaves out of a run says nothing more: alike periods, and steps that resolve no more."""

from dataclasses import replace

import numpy as np
import pytest

from jointscope.diagnosis.briefly import ENOUGH, LONG, PER_PERIOD, briefly
from jointscope.diagnosis.predict import predict_outputs
from jointscope.diagnosis.prepare import prepare
from jointscope.recordings.campaign import Run, Stream

RATE, PERIOD = 1000.0, 2.0
FAST = 1e4  # Hz; a joint for which no grid is fine enough to be coarsened


def multisine(t):
    """Twelve lines of random phase, period ``PERIOD``."""
    phases = np.random.default_rng(3).uniform(0.0, 2.0 * np.pi, 12)
    lines = (3, 5, 9, 15, 21, 27, 33, 41, 51, 61, 71, 81)
    return sum(np.sin(2.0 * np.pi * k * t / PERIOD + p) for k, p in zip(lines, phases, strict=True))


def chirp(t):
    """From 1 to 40 Hz over the whole record."""
    return 3.0 * np.sin(2.0 * np.pi * (t + 19.5 * t**2 / t[-1]))


def later_louder(t):
    """The multisine, half as strong at first."""
    return multisine(t) * np.where(t < 0.6 * t[-1], 0.5, 1.0)


def prepared(builders, torque, seconds):
    """A sweep of the two-inertia rig, an accelerometer on the arm; only the shapes matter."""
    t = np.arange(round(seconds * RATE)) / RATE
    noise = np.random.default_rng(1).normal(0.0, 1.0, t.size)
    channels = (
        builders.channel("T", "torque", "N m", "motor", "input", torque(t)),
        builders.channel("a", "angular-acceleration", "rad/s^2", "arm", "output", noise),
    )
    stream = Stream(file="s.csv", sampling_rate=RATE, length=t.size, channels=channels)
    return prepare(builders.campaign_of([Run(id="s", experiment="torque-sweep", streams=(stream,))]))


def test_a_periodic_run_is_searched_by_its_first_periods(builders):
    run = prepared(builders, multisine, 60.0).runs[0]
    assert run.steps > LONG
    part = briefly(run, FAST)
    assert ENOUGH <= part.steps < run.steps / 3
    (whole,), (kept,) = run.outputs, part.outputs
    np.testing.assert_array_equal(kept.data, whole.data[: kept.data.size])
    np.testing.assert_array_equal(part.motor_half, run.motor_half[: 2 * part.steps + 1])
    assert kept.times[-1] < part.time[-1]


@pytest.mark.parametrize("torque", [chirp, later_louder])
def test_what_changes_on_the_way_is_searched_whole(builders, torque):
    run = prepared(builders, torque, 60.0).runs[0]
    assert briefly(run, FAST) is run


def test_a_short_run_is_searched_whole(builders):
    run = prepared(builders, multisine, 10.0).runs[0]
    assert run.steps < LONG
    assert briefly(run, FAST) is run


def test_a_run_whose_angle_goes_farther_later_is_searched_whole(builders):
    run = prepared(builders, multisine, 60.0).runs[0]
    run = replace(run, observed_half=np.linspace(0.0, 1.0, run.observed_half.size))
    assert briefly(run, FAST) is run


@pytest.mark.parametrize("f", [PER_PERIOD, 10.0])
def test_a_slow_joint_is_searched_on_half_the_grid_and_foretold_alike(builders, f):
    problem = prepared(builders, multisine, 10.0)
    (run,) = problem.runs
    theta = problem.theta(stiffness=3.0 * (2.0 * np.pi * f) ** 2, damping=30.0, load_inertia=3.0)
    half = briefly(run, f)
    assert half.grid_rate == run.grid_rate / 2.0
    fine, coarse = (predict_outputs(r, theta, (), problem)[0] for r in (run, half))
    assert fine.shape == coarse.shape
    assert np.std(fine - coarse) < 2e-3 * np.std(fine)


def test_a_joint_that_half_the_grid_does_not_resolve_keeps_it(builders):
    (run,) = prepared(builders, multisine, 10.0).runs
    assert briefly(run, 1.01 * run.grid_rate / 2.0 / PER_PERIOD) is run


@pytest.fixture
def struck(builders):
    """One hit on the two-inertia rig, which rings at its own resonance alone."""
    return prepare(builders.campaign_of([builders.hammer_run(builders.Plant(), 100.0, "h")]))


def test_a_hit_is_searched_on_half_the_grid_and_foretold_alike(struck):
    (run,) = struck.runs
    half = briefly(run, struck.scales.frequency)
    assert half.grid_rate == run.grid_rate / 2.0
    (fine,), (coarse,) = (predict_outputs(r, struck.theta(), (), struck) for r in (run, half))
    assert np.std(fine - coarse) < 1e-3 * np.std(fine)


def test_a_hit_keeps_the_grid_that_its_structure_rings_in(struck):
    (run,) = struck.runs
    (output,) = run.outputs
    ring = np.std(output.data) * np.sin(2.0 * np.pi * 0.2 * run.grid_rate * output.times)
    assert (
        briefly(replace(run, outputs=(replace(output, data=output.data + ring),)), 10.0).grid_rate == run.grid_rate
    )
