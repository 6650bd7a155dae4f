"""What the force cell's noise makes the model do is known, and a hit's likelihood allows for it."""

from dataclasses import replace

import numpy as np
import pytest

from jointscope.diagnosis.input_scatter import pushes
from jointscope.diagnosis.noise import BlockNoise, NoiseModel, block_key
from jointscope.diagnosis.predict import predict_outputs
from jointscope.diagnosis.prepare import prepare
from jointscope.diagnosis.whiten import run_whitener, without_scatter

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
    return y, pushes(run, truth, (), problem, predict_outputs, y)


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


def test_a_quiet_cell_and_a_run_without_a_hit_have_none(bench, problem, truth):
    """Without noise in the quiet part of the record there is nothing to allow for, nor in a sweep."""
    for run in problem.runs:
        y = predict_outputs(run, truth, (), problem)
        assert pushes(run, truth, (), problem, predict_outputs, y) is None


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
