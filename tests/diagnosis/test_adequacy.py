"""The floor is what repeats differ by; explained is energy explained beyond it."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from jointscope.diagnosis.adequacy import (
    Block,
    _Pair,
    _standard_error,
    adequacy,
    input_period,
    share_explained,
)
from jointscope.diagnosis.noise import BlockNoise, NoiseModel, block_key

RATE = 500.0
T = np.arange(5000) / RATE


def repeat(data, drive):
    output = SimpleNamespace(
        quantity="linear-acceleration", location="arm", direction="tangential", radius=0.9, rate=RATE, step=None, data=data,
        mask=np.ones(len(data), bool), low_cutoff=0.5, high_pass=None,
    )  # fmt: skip
    motor = SimpleNamespace(samples=drive, signal=SimpleNamespace(rate=RATE, step=None))
    return SimpleNamespace(
        run=SimpleNamespace(experiment="torque-sweep", brake=False), mode="observer", motor=motor, load=None,
        command=None, load_force=None, motor_torque=drive, speed_command=None, outputs=(output,),
    )  # fmt: skip


def sweep():
    return np.sin(2 * np.pi * (4.0 * T + 3.0 * T**2))


def judged(mismatch_left, seed=1):
    """Two repeats: truth = model + mismatch, noise 0.05; the candidate leaves a share of the mismatch."""
    rng = np.random.default_rng(seed)
    truth, mismatch = sweep(), 0.2 * np.sin(2 * np.pi * 9.0 * T)
    runs = [repeat(truth + mismatch + 0.05 * rng.standard_normal(len(T)), sweep()) for _ in range(2)]
    noise = NoiseModel(
        {block_key(r, r.outputs[0]): BlockNoise(np.array([1.0]), 0.05, 0.05, 0.0) for r in runs}, 0.01, 3e-5
    )
    base = [(truth,)] * 2
    model = [(truth + (1 - mismatch_left) * mismatch,)] * 2
    return adequacy(runs, noise, base, model)


def test_the_floor_is_the_noise_of_repeats_whatever_the_mismatch():
    """Half the difference of two repeats has the noise's mean square."""
    block = judged(1.0).blocks[0]
    assert np.isclose(block.floor, 0.05**2 / np.mean(np.square(sweep() - np.median(sweep()))), rtol=0.25)


def test_explained_runs_from_nothing_to_all():
    """A candidate that leaves half the amplitude explains three quarters of the energy."""
    assert abs(judged(1.0).explained) < 0.02
    assert np.isclose(judged(0.5).explained, 0.75, atol=0.03)
    assert np.isclose(judged(0.0).explained, 1.0, atol=0.03)


@pytest.mark.parametrize(("frequency", "left"), [(0.1, False), (20.0, True)])
def test_what_an_observer_follows_of_an_angle_is_no_mismatch(frequency, left):
    """A slow error of an encoder is the same in both runs and counts for nothing; a fast one of its size does."""
    rng = np.random.default_rng(5)
    error = 0.02 * np.sin(2 * np.pi * frequency * T)
    runs = []
    for _ in range(2):
        run = repeat(sweep() + error + 1e-4 * rng.standard_normal(len(T)), sweep())
        run.outputs[0].quantity, run.outputs[0].followed_to = "angle", 4.0
        runs.append(run)
    noise = NoiseModel(
        {block_key(r, r.outputs[0]): BlockNoise(np.array([1.0]), 1e-4, 1e-4, 0.0) for r in runs}, 0.0, 0.0
    )
    found = adequacy(runs, noise, [(sweep(),)] * 2, [(sweep(),)] * 2)
    assert (found.base_left > 0.01) is left


@pytest.mark.parametrize(("hit", "left"), [(True, False), (False, True)])
def test_a_constant_in_a_hits_acceleration_is_no_mismatch(hit, left):
    """Nothing that is held accelerates for long; where something moves, the same constant does count."""
    rng = np.random.default_rng(9)
    push = np.where(np.abs(T - 0.5) < 0.004, 100.0, 0.0)
    ring = np.where(T > 0.5, np.exp(-(T - 0.5)) * np.sin(60.0 * (T - 0.5)), 0.0)
    runs = []
    for _ in range(2):
        run = repeat(ring + 0.02 + 2e-3 * rng.standard_normal(len(T)), push)
        if hit:
            run.run.experiment, run.run.brake, run.load_force = "hammer", True, push
        runs.append(run)
    noise = NoiseModel(
        {block_key(r, r.outputs[0]): BlockNoise(np.array([1.0]), 2e-3, 2e-3, 0.0) for r in runs}, 0.01, 3e-5
    )
    found = adequacy(runs, noise, [(ring,)] * 2, [(ring,)] * 2)
    assert (found.base_left > 0.01) is left


def test_a_periodic_excitation_is_known_and_a_sweep_is_not():
    """A multisine of 1 Hz spacing repeats every second."""
    rng = np.random.default_rng(3)
    multisine = sum(np.sin(2 * np.pi * f * T + rng.uniform(0, 6)) for f in range(11, 61))
    assert np.isclose(input_period(repeat(multisine, multisine)), 1.0, atol=1.5 / RATE)
    assert input_period(repeat(sweep(), sweep())) is None


def test_noise_that_comes_in_bursts_agrees_by_chance_as_often_as_its_error_says():
    """A ring of random size and phase behind a resonance, 60 pairs of takes: their common energy scatters by its error."""
    rng = np.random.default_rng(11)
    after = np.maximum(T - 4.0, 0.0)
    ring = np.exp(-3.0 * after) * (T > 4.0)
    common, error = [], []
    for _ in range(60):
        runs = []
        for _ in range(2):
            a, b = 0.3 * rng.standard_normal(2)
            echo = ring * (a * np.cos(2 * np.pi * 29.0 * after) + b * np.sin(2 * np.pi * 29.0 * after))
            runs.append(repeat(sweep() + echo + 0.02 * rng.standard_normal(len(T)), sweep()))
        noise = NoiseModel(
            {block_key(r, r.outputs[0]): BlockNoise(np.array([1.0]), 0.05, 0.05, 0.0) for r in runs}, 0.0, 0.0
        )
        block = adequacy(runs, noise, [(sweep(),)] * 2, [(sweep(),)] * 2).blocks[0]
        common.append(block.model_common)
        error.append(block.error)
    assert 0.6 < np.std(common) / np.sqrt(np.mean(np.square(error))) < 1.4


def test_pairs_that_differ_by_more_than_their_noise_tells_are_less_sure():
    """The mean's error is at least that of their own scatter; too few pairs have none to tell."""
    values = [250.0, 91.0, -46.0, -3.0, 2.0, -18.0, 110.0, 73.0]
    found = [_Pair(v, v, v, 100.0) for v in values]
    scatter = np.std(values, ddof=1) / np.sqrt(len(values))
    assert _standard_error(found) == pytest.approx(scatter)
    assert _standard_error([_Pair(v, v, v, 1e6) for v in values]) == pytest.approx(1e3 / np.sqrt(len(values)))
    assert _standard_error(found[:3]) == pytest.approx(10.0 / np.sqrt(3.0))
    assert np.isnan(_standard_error([]))


@pytest.mark.parametrize(
    ("base", "left", "error", "explained"),
    [(0.9, 0.04, 0.001, 0.956), (0.9, 0.3, 0.2, 1.0), (0.9, 0.7, 0.1, 0.222), (0.1, 0.05, 0.04, 0.0)],
)
def test_what_does_not_stand_out_of_the_scatter_is_not_left(base, left, error, explained):
    block = Block(("k",), 1000, base, left, base, left, error)
    assert block.explained == pytest.approx(explained, abs=1e-3)


@pytest.mark.parametrize(
    ("base", "left", "explained"),
    [
        (0.41, 0.0001, 0.832),  # hits of three levels, of which the model leaves nothing: that was no noise
        (0.41, 0.2, 0.15),  # half of what is left may be noise: nothing is known of it
        (0.00005, 0.0, 0.15),  # too little to count
    ],
)
def test_records_without_a_like_one_count_where_the_model_leaves_nothing_of_them(base, left, explained):
    motions = Block(("motions",), 1000, 0.026, 0.022, 0.025, 0.02125, 1e-4)
    hits = Block(("hits",), 1000, base, left, math.nan, math.nan, math.nan)
    assert share_explained([motions, hits]) == pytest.approx(explained, abs=1e-3)
    assert math.isnan(share_explained([hits]))
