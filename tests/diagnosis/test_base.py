"""Hits on a held joint tell stiffness, damping and inertia apart by their gain alone: y is 1/J times a function of K/J, c/J."""

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np

from jointscope.diagnosis import base
from jointscope.diagnosis.base import of_further_runs, refit_base
from jointscope.diagnosis.coordinates import coordinates
from jointscope.diagnosis.noise import MAX_ORDER, white
from jointscope.diagnosis.objective import Objective
from jointscope.diagnosis.predict import predict_outputs
from jointscope.diagnosis.prepare import prepare
from jointscope.diagnosis.refit import Fit, covariance, with_fresh_jacobian
from jointscope.diagnosis.split import split_runs

HITS, GAIN = 6, 0.02


def _scattered(run, gain, rng):
    """The hit as struck ``gain`` times as hard as was recorded, with noise."""
    stream = run.streams[0]
    force, y = stream.channels
    noisy = gain * y.samples + 2e-3 * np.std(y.samples) * rng.standard_normal(y.samples.size)
    return replace(run, streams=(replace(stream, channels=(force, replace(y, samples=noisy))),))


def test_an_inertia_is_no_surer_than_the_hits_gains(builders, plant):
    """sigma(ln J) = s_g / sqrt(hits), however many periods tell the frequency."""
    light = replace(plant, c=15.0, b_l=0.0)
    rng = np.random.default_rng(8)
    gains = 1.0 + GAIN * rng.standard_normal(HITS)
    runs = [
        _scattered(builders.hammer_run(light, 100.0 * (1 + k), f"h{k}", duration=3.0), g, rng)
        for k, g in enumerate(gains)
    ]
    problem = prepare(builders.campaign_of(runs))
    with ThreadPoolExecutor(1) as pool:
        stage = refit_base(problem, predict_outputs, tuple(range(HITS)), pool)
        fit = with_fresh_jacobian(stage.objective, stage.fit)
    where = fit.coordinates
    names = [problem.base.names[i] for i in where.free]
    k = names.index("load_inertia")
    theta, _ = where.unpack(fit.x)
    sigma = math.sqrt(covariance(fit)[k, k]) / abs(fit.x[k])
    assert stage.fit.gradient_ratio < 1e-3
    assert 0.7 < sigma / (stage.noise.gain / math.sqrt(HITS)) < 1.3
    inertia = theta[list(problem.base.names).index("load_inertia")]
    assert abs(inertia / light.J_L - 1.0) < 4.0 * GAIN / math.sqrt(HITS)


def test_a_model_that_goes_astray_does_not_say_how_noisy_other_runs_are(problem, truth):
    """A stop that the fitted runs never came to would make the held-out ones five hundred times as noisy."""
    split = split_runs(problem)
    astray = truth.copy()
    astray[problem.base.names.index("stiffness")] *= 1.3
    with ThreadPoolExecutor(1) as pool:
        stage = refit_base(problem, predict_outputs, split.estimate, pool)
        right, wrong = (truth, ()), (astray, ())
        alone, of_wrong, both, first = (
            of_further_runs(stage.objective, split.held_out, stage.noise, MAX_ORDER, models)[0]
            for models in ([right], [wrong], [wrong, right], [right, wrong])
        )
    level = [objective.whiteners[0].filters[0].sigma for objective in (alone, of_wrong, both, first)]
    assert level[1] > 5.0 * level[0]
    assert level[2] == level[3] == level[0]


def test_a_fit_that_gives_up_the_hits_does_not_say_how_noisy_they_are(problem, truth):
    """An arm thirty times as heavy hardly moves, as one does whose friction eats the drive's torque; hits know better."""
    names = problem.base.names
    heavy = truth.copy()
    for name in ("stiffness", "damping", "load_inertia"):
        heavy[names.index(name)] *= 30.0
    near = truth.copy()
    near[names.index("stiffness")] *= 1.01
    started = replace(problem, base=replace(problem.base, start=near))
    runs = tuple(range(len(problem.runs)))
    with ThreadPoolExecutor(1) as pool:
        where = coordinates(started)
        objective = Objective(started, predict_outputs, runs, pool)
        noise = white(objective.prepared)
        sunk, right = (
            Fit(where, where.pack(t, ()), np.zeros(1), np.zeros((1, where.n)), 0.0, True, True, 1)
            for t in (heavy, near)
        )
        hits = [key for key in noise.blocks if key[0] == "hammer"]
        given_up, _ = base._given_up(objective, objective.predictions(heavy, ()))
        assert set(given_up) == set(hits)  # those of motions are the friction's to explain
        assert base._given_up(objective, objective.predictions(near, ())) == ([], ())
        told, known = (base.rewhiten(objective, fit, noise, 0)[1] for fit in (sunk, right))
        led, fit = base._led_by(objective, where, hits)
        theta, _ = fit.coordinates.unpack(fit.x)
    for key in hits:
        assert told.blocks[key].marginal == known.blocks[key].marginal
    ratio = names.index("stiffness"), names.index("load_inertia")
    assert math.isclose(theta[ratio[0]] / theta[ratio[1]], truth[ratio[0]] / truth[ratio[1]], rel_tol=2e-3)
    assert np.array_equal(led.problem.base.start, theta)
