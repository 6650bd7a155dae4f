"""What is left still follows the input, or it does not: a pickup in the sensor shows, noise and a right model do not."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from jointscope.diagnosis.adjudicate import judge
from jointscope.diagnosis.base import refit_base
from jointscope.diagnosis.noise import ANGULAR
from jointscope.diagnosis.predict import predict_outputs
from jointscope.diagnosis.remainder import remainder_json, remainders
from jointscope.diagnosis.split import split_runs


def recorded(problem, pickup, seed=3):
    """The problem's own predictions as data, noise on them, and in accelerations ``pickup`` times what drives the run."""
    rng = np.random.default_rng(seed)
    runs = []
    for run in problem.runs:
        outputs = []
        for o, y in zip(run.outputs, predict_outputs(run, problem.base.start, (), problem), strict=True):
            drive = run.motor if run.motor_moves else run.load
            if not o.observed:
                y = y + 0.02 * np.std(y) * rng.standard_normal(y.size)
            if o.quantity not in ANGULAR and drive is not None:
                u = drive.signal(o.times)
                y = y + pickup * np.std(y) / max(np.std(u), 1e-12) * u
            outputs.append(replace(o, data=y))
        runs.append(replace(run, outputs=tuple(outputs)))
    return replace(problem, runs=tuple(runs))


@pytest.fixture(scope="module")
def found(problem):
    left = {}
    with ThreadPoolExecutor(1) as pool:
        for pickup in (0.0, 0.1):
            own = recorded(problem, pickup)
            split = split_runs(own)
            judgement = judge(refit_base(own, predict_outputs, split.estimate, pool), (), split.held_out)
            left[pickup] = remainders(judgement, judgement.base)
    return left


def test_a_pickup_of_the_input_stands_out(found):
    assert any(r.stands for r in found[0.1])
    best = found[0.1][0]
    assert best.held_gain == pytest.approx(best.foretold, rel=0.5)
    assert remainder_json(found[0.1])[0]["share_of_signal"] > 0.01


def test_noise_on_a_right_model_does_not(found):
    assert found[0.0] and not any(r.stands for r in found[0.0])
    assert all(r.gain < 0.0 for r in found[0.0])
    assert remainder_json(found[0.0]) == []
