"""Hits to identify by, sweeps to be judged by: channels that no fitted run has are predicted and weighed all the same."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from jointscope.diagnosis.effects import catalogue
from jointscope.diagnosis.noise import block_key
from jointscope.diagnosis.pipeline import diagnose
from jointscope.diagnosis.predict import predict_outputs
from jointscope.diagnosis.prepare import prepare
from jointscope.diagnosis.search import Effort

QUICK = Effort(screen_hits=2, hits=4, others=2, singles=3, refine=6, beam=0, children=0, pairs=0, size=1)


GAP = 6.4e-5


def slack(t, x):
    """What play takes off the spring's and damper's torque, counted from the flank that the weight rests on."""
    delta, rate = x[0] - x[2], x[1] - x[3]
    kept = delta if delta > 0.0 else min(delta + GAP, 0.0)
    left_off = 1.9e5 * (delta - kept) + 60.0 * rate * (kept == 0.0)
    return left_off, -left_off


def whole_experiment_kept_back(own):
    """The diagnosis of three hits by play, sweeps kept back, and what holds for any of them."""
    specs = tuple(s for s in catalogue(own) if (s.name, s.location) == ("backlash", "transmission"))
    with ThreadPoolExecutor(1) as pool:
        found = diagnose(own, predict_outputs, specs, pool, effort=QUICK)
    assert {own.runs[i].run.experiment for i in found.split.held_out} == {"torque-sweep"}
    kinds = {block_key(run, output) for run in own.runs for output in run.outputs}
    assert kinds == set(found.judgement.noise.blocks)
    assert all(np.isfinite(found.judgement.base.held_out))
    return found


def takes(builders, plant):
    hits = [builders.hammer_run(plant, 100.0 + 40.0 * k, f"h{k}") for k in range(3)]
    sweeps = [replace(builders.sweep_run(plant, 40.0 + 5.0 * k, f"s{k}"), role="validate") for k in range(2)]
    return [*hits, *sweeps]


def test_nothing_is_named_where_nothing_was_left_out(builders, recorded):
    own = recorded(prepare(builders.campaign_of(takes(builders, builders.Plant()))), 0.01, seed=5)
    assert whole_experiment_kept_back(own).decision.verdict == "none"


def test_play_that_hits_show_foretells_the_sweeps_that_were_kept_back(builders, edited):
    rng = np.random.default_rng(5)

    def noisy(channel):
        if channel.quantity != "linear-acceleration":
            return channel
        clean = np.asarray(channel.samples)
        return replace(channel, samples=clean + 0.01 * np.std(clean) * rng.standard_normal(clean.size))

    rig = replace(builders.NAMEPLATE, motor_damping=2.0, load_damping=2.0)  # which hits on the brake don't tell
    runs = [edited(run, noisy) for run in takes(builders, builders.Plant(extra=slack))]
    found = whole_experiment_kept_back(prepare(builders.campaign_of(runs, rig)))
    assert found.decision.chosen.names == ("backlash@transmission",) and found.decision.verdict == "effects"
    gap = found.decision.chosen.fit.coordinates.unpack(found.decision.chosen.fit.x)[1][0].values[0]
    assert gap == pytest.approx(GAP, rel=0.02)
