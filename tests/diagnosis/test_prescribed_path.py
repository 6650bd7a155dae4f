"""A motion that is prescribed by its record: where it rests, friction does not reverse with the record's noise."""

import numpy as np
import pytest

from jointscope.diagnosis.effects import ActiveEffect, catalogue
from jointscope.diagnosis.predict import predict_outputs
from jointscope.diagnosis.prepare import prepare
from jointscope.diagnosis.prescribed_path import STANDS_OUT, prescribed_path, speed_noise
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
