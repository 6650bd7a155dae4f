"""What is left of hits fades with them where it is a mismatch, and stays where it is noise."""

import numpy as np

from jointscope.diagnosis.noise import block_key
from jointscope.diagnosis.prepare import prepare
from jointscope.diagnosis.unlike_noise import fades


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
