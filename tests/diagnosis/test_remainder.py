"""What is left still follows the input, or it does not: a pickup in the sensor shows, noise and a right model do not."""

from concurrent.futures import ThreadPoolExecutor

import pytest

from jointscope.diagnosis.adjudicate import judge
from jointscope.diagnosis.base import refit_base
from jointscope.diagnosis.predict import predict_outputs
from jointscope.diagnosis.remainder import remainder_json, remainders
from jointscope.diagnosis.split import split_runs


@pytest.fixture(scope="module")
def found(problem, recorded):
    left = {}
    with ThreadPoolExecutor(1) as pool:
        for pickup in (0.0, 0.1):
            own = recorded(problem, 0.02, pickup, seed=3)
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
