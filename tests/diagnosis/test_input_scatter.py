"""What the noise of a recorded input makes the model do is known, and the likelihood allows for it."""

from dataclasses import replace

import numpy as np
import pytest

from jointscope.diagnosis.assembly import BASE_INDEX
from jointscope.diagnosis.input_scatter import STRENGTH, VISCOSITY, pushes
from jointscope.diagnosis.noise import BlockNoise, NoiseModel, block_key
from jointscope.diagnosis.own_hit import scatters_whole
from jointscope.diagnosis.predict import predict_outputs
from jointscope.diagnosis.prepare import prepare
from jointscope.diagnosis.relog import LOGS, driven_by
from jointscope.diagnosis.whiten import run_whitener, without_scatter
from jointscope.recordings.campaign import Run, Stream

NOISE = 1.0  # N
SENSOR = 0.02  # m/s^2


def with_input_scatter(builders, edited, plant, size, seed):
    """One hit of 100 N, its force recorded with white noise."""
    rng = np.random.default_rng(seed)

    def noisy(channel):
        if channel.quantity != "force":
            return channel
        samples = np.asarray(channel.samples)
        return replace(channel, samples=samples + size * rng.standard_normal(samples.size))

    return prepare(builders.campaign_of([edited(builders.hammer_run(plant, 100.0, "a", duration=0.8), noisy)]))


@pytest.fixture(scope="module")
def noisy(builders, edited, plant):
    return with_input_scatter(builders, edited, plant, NOISE, 1)


def columns(problem, truth):
    run = problem.runs[0]
    y = predict_outputs(run, truth, (), problem)
    return y, pushes(run, truth, (), problem, predict_outputs, y, oil=False)


def test_the_columns_are_the_response_to_noise_in_the_contact(noisy, truth):
    """The model is linear: its response to any noise in the contact is the columns times that noise."""
    run = noisy.runs[0]
    y, pushed = columns(noisy, truth)
    touched = np.flatnonzero(run.load.samples)
    assert np.isclose(run.load.noise, 0.8 * NOISE, rtol=0.1)  # N m at the hammer's radius
    assert pushed[0].shape == (y[0].size, touched.size)
    eta = np.random.default_rng(2).standard_normal(touched.size)
    force = run.load.samples.copy()
    force[touched] += run.load.noise * eta
    from jointscope.recordings.bandlimited import bandlimited

    signal = bandlimited(force, run.load.signal.rate, run.load.signal.start)
    half = run.t0 + np.arange(2 * run.steps + 1) / (2.0 * run.grid_rate)
    moved = replace(run, load=replace(run.load, samples=force, signal=signal), load_half=signal(half))
    change = predict_outputs(moved, truth, (), noisy)[0] - y[0]
    assert np.linalg.norm(change - pushed[0] @ eta) < 0.01 * np.linalg.norm(change)


def test_a_quiet_cell_has_none(problem, truth):
    """Without noise in the quiet part of the record there is nothing to allow for."""
    for run in problem.runs:
        if run.run.experiment == "hammer":
            y = predict_outputs(run, truth, (), problem)
            assert pushes(run, truth, (), problem, predict_outputs, y, oil=False) is None


def test_a_log_s_noise_rings_in_the_span_of_its_columns(builders, edited, plant, truth):
    """What logs that were not looked at do has the columns' energy, a third of it or more in their span; angles have none."""
    rng = np.random.default_rng(5)

    def noisy(channel):
        if channel.quantity != "torque":
            return channel
        samples = np.asarray(channel.samples)
        return replace(channel, samples=samples + 0.01 * np.std(samples) * rng.standard_normal(samples.size))

    problem = prepare(builders.campaign_of([edited(builders.sweep_run(plant, 30.0, "s"), noisy)]))
    run = problem.runs[0]
    y = predict_outputs(run, truth, (), problem)
    pushed = pushes(run, truth, (), problem, predict_outputs, y, oil=False)
    for output, whole in zip(run.outputs, pushed, strict=True):
        columns_of = whole[:, :LOGS]
        if output.quantity == "angle":
            assert not columns_of.any()
            continue
        basis = np.linalg.qr(columns_of)[0]
        relog = replace(run, index=99).relogged  # other noises
        k = run.outputs.index(output)
        fresh = [predict_outputs(driven_by(run, relog, turn), truth, (), problem)[k] - y[k] for turn in range(10)]
        energy = np.mean([x @ x for x in fresh])
        assert np.isclose(np.sum(np.square(columns_of)), energy, rtol=0.3)
        within = np.mean([np.sum(np.square(basis.T @ x)) for x in fresh])
        assert within > 0.33 * energy  # 24 directions of 2048


def test_at_the_truth_a_hit_is_as_likely_as_its_noise(builders, edited, plant, truth):
    """Over 12 takes w'w is the number of samples where the cell's noise is allowed for; without it a tenth more and above."""
    ratios, bare = [], []
    for seed in range(12):
        problem = with_input_scatter(builders, edited, plant, NOISE, seed)
        run = problem.runs[0]
        rng = np.random.default_rng([seed, 1])
        (output,) = run.outputs
        output = replace(output, data=output.data + SENSOR * rng.standard_normal(output.data.size))
        run = replace(run, outputs=(output,))
        y, pushed = columns(problem, truth)
        noise = NoiseModel({block_key(run, output): BlockNoise(np.array([1.0]), SENSOR, SENSOR, 0.0)}, 0.002, 3e-6)
        left = [output.data - y[0]]
        for found, columns_of in ((ratios, pushed), (bare, None)):
            whitener = run_whitener(run, noise, y, columns_of)
            w = whitener(left)[:, 0] * whitener.filters[0].sigma / SENSOR  # the take's own scale undone
            found.append(float(w @ w) / w.size)
        cleaned = without_scatter(run, noise, y, run_whitener(run, noise, None), pushed)
        assert np.std(cleaned[0]) < 1.1 * SENSOR
    assert 0.9 < np.mean(ratios) < 1.05
    assert np.mean(bare) > 1.1


def test_the_last_column_is_what_warmer_oil_does(builders, plant):
    """One standard deviation of viscosity, motor and load alike; nothing where nothing is viscous, nor in a hit."""
    problem = prepare(
        builders.campaign_of([builders.sweep_run(plant, 30.0, "s"), builders.hammer_run(plant, 90.0, "h")])
    )
    theta = problem.base.start.copy()
    for name, value in (("motor_damping", 2.0), ("load_damping", 3.0)):
        theta[BASE_INDEX[name]] = value
    warm, dry = theta.copy(), theta.copy()
    for name in ("motor_damping", "load_damping"):
        warm[BASE_INDEX[name]] *= 1.0 - VISCOSITY
        dry[BASE_INDEX[name]] = 0.0
    for run in problem.runs:
        y, moved = (predict_outputs(run, at, (), problem) for at in (theta, warm))
        pushed = pushes(run, theta, (), problem, predict_outputs, y, oil=True)
        if run.run.experiment == "hammer":
            assert pushed is None
            continue
        for column, a, b in zip(pushed, moved, y, strict=True):
            assert np.array_equal(column[:, -1], a - b)
        still = pushes(run, dry, (), problem, predict_outputs, predict_outputs(run, dry, (), problem), oil=True)
        assert still is None or still[0].shape[1] == pushed[0].shape[1] - 1


def free_hit(builders, plant, harder):
    """A joint whose drive is off is hit ``harder`` times as hard as the record says; its motor's angle is recorded."""
    rate, peak = 1024.0, 100.0
    t = np.arange(int(1.2 * rate)) / rate
    force = peak * np.exp(-(((t - 0.1) / 0.002) ** 2))

    def load(u):
        return harder * 0.8 * peak * float(np.exp(-(((u - 0.1) / 0.002) ** 2)))

    motion, f = plant.motion(load, lambda u: 0.0, False, 0.0, t[-1] + 0.01)
    x = motion(t)
    a = 0.95 * np.array([f(u, s)[3] for u, s in zip(t, x.T, strict=True)])
    channels = (
        builders.channel("f", "force", "N", "arm", "input", force, radius=0.8),
        builders.channel("a", "linear-acceleration", "m/s^2", "arm", "output", a, radius=0.95),
        builders.channel("th", "angle", "rad", "motor", "output", x[0] * plant.n),
    )
    stream = Stream(file="h.csv", sampling_rate=rate, length=t.size, channels=channels)
    run = Run(id="h", experiment="hammer", streams=(stream,), arm_angle=0.0, hold={"": "free"})
    rig = replace(builders.NAMEPLATE, plane="horizontal", arm_mass=None, arm_com_radius=None)
    return prepare(builders.campaign_of([run], rig))


def test_a_harder_hit_on_a_joint_that_is_followed_is_its_own_column(builders, plant):
    """Held to the recorded angle the model does not answer in proportion to the force; what a harder hit adds is known still."""
    level = replace(plant, weight=0.0)
    sizes = {"stiffness": level.K, "damping": level.c, "load_inertia": level.J_L}
    problem = free_hit(builders, level, 1.0 + STRENGTH)
    truth = problem.theta(**sizes, motor_damping=2.0, load_damping=2.0)
    run = problem.runs[0]
    assert run.mode == "observer"
    assert not scatters_whole(run)
    y, pushed = columns(problem, truth)
    for output, told, column in zip(run.outputs, y, pushed, strict=True):
        left = (output.data - told)[output.mask]
        assert np.linalg.norm(left - column[output.mask, -1]) < 0.1 * np.linalg.norm(left)
        departure = (told - told[0])[output.mask]
        share = float(left @ departure) / float(departure @ departure)
        if output.quantity == "angle":  # no multiple of the response itself says it
            assert np.linalg.norm(left - share * departure) > 0.3 * np.linalg.norm(left)
