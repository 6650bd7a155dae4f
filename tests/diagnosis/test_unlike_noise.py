"""What is left of hits fades with them where it is a mismatch, and stays where it is noise."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from jointscope.diagnosis.noise import block_key
from jointscope.diagnosis.prepare import prepare
from jointscope.diagnosis.unlike_noise import fades, grows_with_signal, left_in_proportion, still_grows


def hit_and_key(builders):
    problem = prepare(
        builders.campaign_of((builders.hammer_run(builders.Plant(), 300.0, "hit"),), builders.NAMEPLATE)
    )
    (run,) = problem.runs
    (output,) = run.outputs
    return run, output, block_key(run, output)


def test_an_error_in_proportion_to_the_motion_fades(builders):
    run, output, key = hit_and_key(builders)
    assert fades(run, (0.3 * output.data,)) == {key}


def test_noise_as_large_as_the_motion_does_not(builders):
    run, output, _ = hit_and_key(builders)
    rng = np.random.default_rng(11)
    for _ in range(20):
        noise = np.std(output.data) * np.convolve(
            rng.standard_normal(output.data.size + 7), np.ones(8) / 3.0, "valid"
        )
        assert fades(run, (output.data - noise,)) == set()


@pytest.mark.parametrize(("share", "grows"), [(1.6, 0.4), (0.0, 0.0)])
def test_an_error_as_large_as_a_hit_grows_with_it_where_it_fades(builders, share, grows):
    """Its innovation is as large as an instrument's noise has: by that alone it would pass for noise."""
    run, output, key = hit_and_key(builders)
    rng = np.random.default_rng(11)
    noise = np.std(output.data) * rng.standard_normal(output.data.size)
    left = share * output.data if share else noise
    judgement = SimpleNamespace(
        noise=SimpleNamespace(blocks={key: SimpleNamespace(grown=0.4, marginal=1.0, sigma=0.7)}),
        objective=SimpleNamespace(prepared=(run,)),
        base=SimpleNamespace(predictions=((output.data - left,),)),
    )
    fit = SimpleNamespace(blocks=(SimpleNamespace(key=key, base=0.9**2),))
    assert grows_with_signal(judgement, fit) == grows


@pytest.mark.parametrize(
    ("kappa", "explained", "at_least", "quantity", "base", "beyond"),
    [
        (0.10, math.nan, 0.55, "linear-acceleration", 0.1, 2.0),  # a third of the base's error is left
        (0.10, math.nan, 0.70, "linear-acceleration", 0.1, 0.0),  # what was named explains most
        (0.10, 0.99, 0.15, "linear-acceleration", 0.1, 0.0),  # runs that are alike tell it from noise
        (0.00, math.nan, 0.15, "linear-acceleration", 0.1, 0.0),  # nothing grows: the rest is noise
        (0.10, math.nan, 0.15, "angle", 0.1, 0.0),  # an angle drifts
        (0.10, math.nan, 0.15, "linear-acceleration", 0.7, 0.0),  # a motion that is noise for the most part
    ],
)
def test_an_error_in_proportion_beside_what_was_named_is_no_noise(
    kappa, explained, at_least, quantity, base, beyond
):
    key = ("speed-motion", False, quantity, "arm", "tangential", 1.0, 1000.0)
    judgement = SimpleNamespace(
        noise=SimpleNamespace(blocks={key: SimpleNamespace(grown=kappa, marginal=1.0, sigma=0.8)}),
        objective=SimpleNamespace(prepared=()),
        base=SimpleNamespace(predictions=()),
    )
    block = SimpleNamespace(key=key, base=base**2)
    fit = SimpleNamespace(explained=explained, at_least=at_least, blocks=(block,))
    assert left_in_proportion(judgement, fit, 0.6) == pytest.approx(beyond)


@pytest.mark.parametrize(
    ("left", "sigma", "explained", "grows"),
    [
        (0.93, 1.0, 0.0, 0.0),  # a wind-up of two coarse encoders is their noise, as large as what they show
        (0.93, 0.3, 0.0, 0.9),  # what sticks and slips leaves as much, and its own past foretells it
        (0.2, 1.0, 0.0, 0.9),  # a small error that grows with the motion
        (0.2, 1.0, 0.95, 0.0),  # of which the model explains what repeats itself
    ],
)
def test_beside_a_model_a_record_of_noise_says_nothing(left, sigma, explained, grows):
    key = ("free", False, "wind-up", "transmission", "tangential", -1.0, 1000.0)
    judgement = SimpleNamespace(
        noise=SimpleNamespace(blocks={key: SimpleNamespace(grown=0.9, marginal=1.0, sigma=sigma)}),
        objective=SimpleNamespace(prepared=()),
        base=SimpleNamespace(predictions=()),
    )
    fit = SimpleNamespace(blocks=(SimpleNamespace(key=key, model=left**2, explained=explained),))
    assert still_grows(judgement, fit, 0.9) == grows
