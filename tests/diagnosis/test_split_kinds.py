"""Hits to identify by, sweeps to be judged by: channels that no fitted run has are predicted and weighed all the same."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from jointscope.diagnosis.effects import ActiveEffect, catalogue
from jointscope.diagnosis.noise import block_key
from jointscope.diagnosis.pipeline import diagnose
from jointscope.diagnosis.predict import predict_outputs
from jointscope.diagnosis.prepare import prepare
from jointscope.diagnosis.search import Effort

QUICK = Effort(screen_hits=2, hits=4, others=2, singles=3, refine=6, beam=0, children=0, pairs=0, size=1)


@pytest.mark.parametrize("size", [0.0, 1.0])
def test_an_experiment_may_be_kept_back_as_a_whole(builders, recorded, size):
    """Nothing is named where nothing was left out; play that the hits show is, and foretells the sweeps better."""
    plant = builders.Plant()
    hits = [builders.hammer_run(plant, 100.0 + 40.0 * k, f"h{k}") for k in range(5)]
    sweeps = [replace(builders.sweep_run(plant, 40.0 + 5.0 * k, f"s{k}"), role="validate") for k in range(2)]
    own = prepare(builders.campaign_of([*hits, *sweeps]))
    specs = tuple(s for s in catalogue(own) if (s.name, s.location) == ("backlash", "transmission"))
    effects = (ActiveEffect(specs[0], (size * specs[0].scale(own)[1],)),) if size else ()
    own = recorded(own, 0.01, seed=5, effects=effects)
    with ThreadPoolExecutor(1) as pool:
        found = diagnose(own, predict_outputs, specs, pool, effort=QUICK)
    assert {own.runs[i].run.experiment for i in found.split.held_out} == {"torque-sweep"}
    kinds = {block_key(run, output) for run in own.runs for output in run.outputs}
    assert kinds == set(found.judgement.noise.blocks)
    assert all(np.isfinite(found.judgement.base.held_out))
    assert found.decision.verdict == ("effects" if size else "none")
