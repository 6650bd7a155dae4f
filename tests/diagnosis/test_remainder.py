"""What is left still follows the input, or it does not: a pickup in the sensor shows, noise and a right model do not."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from jointscope.diagnosis.adjudicate import judge
from jointscope.diagnosis.base import refit_base
from jointscope.diagnosis.effects import ActiveEffect, catalogue
from jointscope.diagnosis.noise import ANGULAR, block_key
from jointscope.diagnosis.predict import predict_outputs
from jointscope.diagnosis.remainder import Remainder, _rows, remainder_json, remainders
from jointscope.diagnosis.split import split_runs
from jointscope.diagnosis.verdict import Decision, Ranked, with_followed_input, with_remainder


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


def test_two_channels_of_one_kind_are_one_run(problem, recorded):
    """A run with two accelerometers alike has one residual: its energy counts once."""
    own = recorded(problem, 0.02, 0.1, seed=3)
    rng = np.random.default_rng(4)
    runs = []
    for run in own.runs:
        alike = next(o for o in run.outputs if o.quantity not in ANGULAR)
        again = replace(alike, data=alike.data + 0.02 * np.std(alike.data) * rng.standard_normal(alike.data.size))
        runs.append(replace(run, outputs=(*run.outputs, again)))
    own = replace(own, runs=tuple(runs))
    with ThreadPoolExecutor(1) as pool:
        split = split_runs(own)
        judgement = judge(refit_base(own, predict_outputs, split.estimate, pool), (), split.held_out)
        for which, energy in ((False, judgement.base.fitted), (True, judgement.base.held_out)):
            objective = judgement.held if which else judgement.objective
            for key in {block_key(run, o) for run in objective.prepared for o in run.outputs}:
                rows = _rows(objective, judgement.base, key, which)
                theirs = [
                    i for i, r in enumerate(objective.prepared) if key in {block_key(r, o) for o in r.outputs}
                ]
                assert rows.w.size == sum(sum(objective.whiteners[i].sizes) for i in theirs) == len(rows.columns)
                assert rows.w @ rows.w == pytest.approx(sum(energy[i] for i in theirs))
        assert any(r.stands for r in remainders(judgement, judgement.base))


def test_no_more_is_explained_than_is_left(problem, recorded, monkeypatch):
    """Columns that a whitener hardly looks at may stand for more than all that is left, but then they are not in it."""
    own = recorded(problem, 0.02, 0.1, seed=3)
    with ThreadPoolExecutor(1) as pool:
        split = split_runs(own)
        judgement = judge(refit_base(own, predict_outputs, split.estimate, pool), (), split.held_out)
    seen = remainders(judgement, judgement.base)

    def unlike(*args):
        rows = _rows(*args)
        return replace(rows, raw=50.0 * rows.raw)

    monkeypatch.setattr("jointscope.diagnosis.remainder._rows", unlike)
    for as_seen, blind in zip(seen, remainders(judgement, judgement.base), strict=True):
        rows = _rows(judgement.objective, judgement.base, blind.key, False)
        assert as_seen.material < blind.material == pytest.approx((rows.left / rows.signal) ** 0.5)


@pytest.mark.parametrize(
    ("left", "gain", "held_gain", "dispersion", "score", "verdict"),
    [
        (25.0, 80.0, 75.0, 1.0, 100.0, "unknown"),
        # most of what follows the input is still there: something else beside the named
        (60.0, 80.0, 70.0, 1.0, 100.0, "effects"),
        (25.0, 20.0, 10.0, 1.0, 100.0, "effects"),  # a third of what the named effect gains
        (25.0, 70.0, 0.0, 1.0, 100.0, "effects"),  # it does not carry over
        (
            0.0,
            80.0,
            75.0,
            1.0,
            100.0,
            "effects",
        ),  # the named effect leaves nothing of it: a sensor's resonance, say
        (25.0, 60.0, 30.0, 1.0, 100.0, "effects"),  # told by the base's own misfit ...
        (25.0, 60.0, 30.0, 2.5, 100.0, "unknown"),  # ... which is 2.5 times what noise is
        (
            25.0,
            8e5,
            7.5e5,
            1.0,
            1e6,
            "effects",
        ),  # all but 50 nats in a million are explained: that is the law's form
        (2500.0, 8e5, 7.5e5, 1.0, 1e6, "unknown"),
    ],
)
def test_what_the_input_explains_as_well_is_not_named(
    problem, recorded, deciding, left, gain, held_gain, dispersion, score, verdict
):
    own = recorded(problem, 0.02, seed=3)
    with ThreadPoolExecutor(1) as pool:
        split = split_runs(own)
        judgement = judge(refit_base(own, predict_outputs, split.estimate, pool), (), split.held_out)
        spec = next(s for s in catalogue(own) if s.name == "coulomb-friction")
        decision = deciding(judgement, ActiveEffect(spec, (spec.scale(own)[1], *spec.starts(own)[0])))
        decision = replace(decision, ranking=tuple(replace(r, score=score) for r in decision.ranking))
        key = ("hammer", True, "linear-acceleration", "arm")
        of_named = Remainder(key, left, left, left, 0.01)
        of_base = Remainder(key, gain, held_gain, held_gain, 0.01, dispersion=dispersion)
        assert with_followed_input(decision, (of_named,), (of_base,)).verdict == verdict


@pytest.mark.parametrize(
    ("explained", "material", "verdict"),
    [
        (0.5, 0.004, "effects"),  # less than a hundredth of what is named: its form
        (0.05, 0.004, "unknown"),
        (0.5, 0.1, "unknown"),
    ],
)
def test_what_is_left_is_held_against_what_was_explained(explained, material, verdict):
    """In nats it is half of it in each case: an instrument's noise may be so small that any form's error is many nats."""
    judged = SimpleNamespace(names=("delay@acquisition",))
    named = Ranked(judged.names, 1.0, 320.0, judged, SimpleNamespace(material=explained))
    decision = Decision("effects", judged, 1.0, (named,), None, (), SimpleNamespace())
    key = ("speed-motion", False, "wind-up", "transmission", "tangential", -1.0, 250.0)
    left = Remainder(key, 165.0, 75.0, 70.0, material)
    assert with_remainder(decision, (left,)).verdict == verdict
    assert (
        with_followed_input(replace(decision, candidates=(("a",), ("b",))), (left,), (left,)).verdict == "effects"
    )


@pytest.mark.parametrize(("echo", "stands"), [(0.0, True), (0.002, True), (0.004, False)])
def test_what_the_noise_of_the_input_may_do_is_no_mismatch(echo, stands):
    """A log shows the white part of its noise only; coloured noise of the same log rings by a few times as much."""
    key = ("speed-motion", False, "wind-up", "transmission", "tangential", -1.0, 1000.0)
    assert Remainder(key, 200.0, 150.0, 140.0, 0.01, echo).stands == stands


@pytest.mark.parametrize(("material", "verdict"), [(0.2, "effects"), (0.3, "unknown")])
def test_where_a_quarter_of_a_channel_still_follows_the_input_nothing_is_named(material, verdict):
    """However much was explained: a dead band of the drive is no gain, though a gain is worth 6000 nats."""
    judged = SimpleNamespace(names=("torque-gain@motor",))
    named = Ranked(judged.names, 1.0, 9e5, judged, SimpleNamespace(material=0.5))
    decision = Decision("effects", judged, 1.0, (named,), None, (), SimpleNamespace())
    key = ("speed-motion", False, "linear-acceleration", "arm", "tangential", 0.9, 1000.0)
    left = Remainder(key, 90.0, 120.0, 100.0, material)
    assert with_followed_input(decision, (left,), ()).verdict == verdict
