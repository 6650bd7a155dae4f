"""Scores of the proof: right is right, failures are wrong, intervals are Wilson's, seals can't be swapped."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from jointscope.experiments.prove import diagnosing, leak, measures
from jointscope.experiments.prove.diagnosing import Answer
from jointscope.experiments.prove.judging import FAMILIES, judge
from jointscope.experiments.prove.proof import prove
from jointscope.recordings.campaign import Campaign, Channel, Nameplate, Run, Stream
from jointscope.sim.concealed.paperwork import write_case
from jointscope.sim.concealed.seal import SealError, folder_digest, write_seal

EFFECT = {
    "effect": "backlash", "location": "transmission", "law": "dead-zone", "departs": False, "listed": True,
    "main": "gap", "parameters": {"gap": 1e-4}, "values": {},
}  # fmt: skip
UNLISTED = {**EFFECT, "effect": "rattling-mass", "location": "load", "listed": False}


def truth(kind="single", effects=(EFFECT,), z_d=20.0, case="a"):
    return {
        "case": case, "kind": kind, "experiments": "H", "hard": False, "effects": list(effects),
        "strength": {"z": 50.0, "z_d": z_d, "nearest": "", "materiality": 0.02} if effects else None,
        "floor": {"r1": {"acceleration": 0.02}},
    }  # fmt: skip


def answer(verdict="effects", effects=(("backlash", "transmission"),), probability=0.9, status="answered", **more):
    diagnosis = {
        "verdict": verdict, "verdict_probability": probability,
        "effects": [
            {"effect": e, "location": place, "probability": probability,
             "parameters": {"gap": {"value": 1.1e-4, "unit": "rad", "interval95": [0.9e-4, 1.3e-4]}}}
            for e, place in effects
        ] if verdict == "effects" else [],
        "where": {"location": "transmission"},
        "held_out": {"runs": ["r1"], "base_error": 0.10, "augmented_error": 0.03, "noise_floor": 0.02},
        **more,
    }  # fmt: skip
    return Answer("a", status, 12.0, diagnosis if status == "answered" else None)


def test_a_right_answer_is_right_in_every_respect():
    """Name, place, parameter, interval and gain of a single effect."""
    judged = judge(truth(), answer())
    assert judged.exact and judged.location and judged.any_named
    assert judged.band == "medium"
    assert judged.error == pytest.approx(0.1)
    assert judged.covered is True
    assert judged.gain == pytest.approx(0.07 / 0.08)
    assert judged.worse is False


@pytest.mark.parametrize("status", ["crashed", "timed-out"])
@pytest.mark.parametrize("kind", ["null", "single", "unlisted"])
def test_crashes_and_time_outs_are_wrong(status, kind):
    """Whatever was true, no answer is no right answer."""
    effects = {"null": (), "single": (EFFECT,), "unlisted": (UNLISTED,)}[kind]
    judged = judge(truth(kind, effects), answer(status=status))
    assert not judged.exact
    assert not judged.any_named


@pytest.mark.parametrize(
    ("said", "right"),
    [("none", True), ("unknown", False), ("effects", False)],
)
def test_a_null_is_right_only_when_nothing_is_found(said, right):
    """False alarms of either kind are wrong."""
    assert judge(truth("null", ()), answer(said)).exact is right


def test_the_same_name_at_another_place_is_another_answer():
    """Name and location both have to agree."""
    effects = ({**EFFECT, "effect": "coulomb-friction", "location": "motor"},)
    judged = judge(truth("single", effects), answer(effects=(("coulomb-friction", "load"),)))
    assert not judged.exact
    assert judged.location is False


def test_what_cant_be_told_may_be_left_open():
    """Below z_d = 4 a set that holds the truth or a plain unknown is right, a wrong set is not; above it neither is."""
    asked = truth(z_d=2.0)
    assert judge(asked, answer("unknown")).exact
    assert judge(
        asked, answer("unknown", candidates=[["backlash@transmission"], ["hysteresis@transmission"]])
    ).exact
    assert not judge(asked, answer("unknown", candidates=[["hysteresis@transmission"]])).exact
    assert not judge(truth(z_d=20.0), answer("unknown")).exact


def test_unlisted_effects_have_to_be_unknown():
    """Naming something for what no catalogue lists is wrong."""
    assert judge(truth("unlisted", (UNLISTED,)), answer("unknown")).exact
    assert not judge(truth("unlisted", (UNLISTED,)), answer()).exact


def test_half_a_pair_is_worth_half_only_if_nothing_wrong_is_beside_it():
    """At least one named and none wrong."""
    both = (EFFECT, {**EFFECT, "effect": "coulomb-friction", "location": "load"})
    assert judge(truth("pair", both), answer()).any_named
    wrong = answer(effects=(("backlash", "transmission"), ("delay", "acquisition")))
    assert not judge(truth("pair", both), wrong).any_named
    all_named = answer(effects=(("coulomb-friction", "load"), ("backlash", "transmission")))
    assert judge(truth("pair", both), all_named).exact


@pytest.mark.parametrize(
    ("hits", "cases", "low", "high"), [(0, 300, 0.0, 0.01264), (3, 300, 0.00341, 0.02896), (8, 10, 0.4902, 0.9433)]
)
def test_intervals_are_wilsons(hits, cases, low, high):
    """Against tabulated values (Brown, Cai and DasGupta 2001)."""
    found = measures.wilson(hits, cases)
    assert (found.low, found.high) == (pytest.approx(low, abs=1e-4), pytest.approx(high, abs=1e-4))


def test_calibration_error_of_a_calibrated_forecaster_goes_to_zero():
    """And that of an overconfident one to its excess."""
    rng = np.random.default_rng(0)
    p = rng.uniform(0.2, 0.9, 20000)
    assert measures.calibration_error(p, rng.random(p.size) < p) < 0.02
    assert measures.calibration_error(np.full(2000, 0.9), rng.random(2000) < 0.6) == pytest.approx(0.3, abs=0.04)


def test_every_listed_effect_has_a_family():
    """The families cover the contract's table."""
    from jointscope.sim.concealed import catalogue

    assert {law.effect for law in catalogue.LISTED} == set(FAMILIES)


def _small_campaign(seed):
    samples = np.random.default_rng(seed).standard_normal((2, 64))
    common = {"location": "arm", "radius": 0.8}
    channels = (
        Channel(column="f", quantity="force", unit="N", role="input", samples=samples[0], **common),
        Channel(
            column="a", quantity="linear-acceleration", unit="m/s^2", role="output", samples=samples[1], **common
        ),
    )
    stream = Stream(file="r.npz", sampling_rate=1024.0, length=64, channels=channels)
    runs = (Run(id="r1", experiment="hammer", streams=(stream,), brake=True),)
    plate = Nameplate(topology="single-dof", motion="rotational", plane="horizontal")
    return Campaign(path=Path(), rig=plate, runs=runs)


def _draw(folder, verdicts):
    """A draw of tiny stand-in campaigns with answers already given."""
    cases, out = {}, folder.parent / "out"
    (out / diagnosing.ANSWERS).mkdir(parents=True)
    for i, (kind, effects, reply) in enumerate(verdicts):
        name = f"case{i}"
        write_case(_small_campaign(i), folder / name)
        cases[name] = {**truth(kind, effects, case=name), "digest": folder_digest(folder / name)}
        kept = {**vars(reply), "case": name}
        (out / diagnosing.ANSWERS / f"{name}.json").write_text(json.dumps(kept))
    order = {"seed": 1, "draw": "test", "kind": "mixed", "cases": len(verdicts)}
    return write_seal(folder, {"cases": cases, "order": order}), out


def test_the_whole_proof_from_kept_answers(tmp_path):
    """Table, page, pictures and the count of openings; answers that are there are not made again."""
    verdicts = [("null", (), answer("none")), ("null", (), answer()), ("single", (EFFECT,), answer())]
    seal, out = _draw(tmp_path / "draw", verdicts)
    summary = prove(tmp_path / "draw", out, workers=1, limit=10.0, first=None)
    assert summary["seal"] == seal
    rows = {row["name"]: row for row in summary["table"]}
    assert rows["false alarms on nulls: any physics named"]["value"]["hits"] == 1
    assert rows["single, name and location exact: medium"]["value"]["hits"] == 1
    assert (out / "proof.md").read_text().startswith("# The proof: effects concealed")
    assert (out / "reliability.png").stat().st_size > 1000
    assert prove(tmp_path / "draw", out, workers=1, limit=10.0, first=None)["openings"] == {"times": 2, "answers": 1}


def test_a_campaign_that_was_exchanged_is_refused(tmp_path):
    """The seal vouches for every campaign."""
    _, out = _draw(tmp_path / "draw", [("null", (), answer("none"))])
    (tmp_path / "draw" / "case0" / "campaign.toml").write_text("format = 2\n")
    with pytest.raises(SealError, match="isn't the campaign that was sealed"):
        prove(tmp_path / "draw", out, workers=1, limit=10.0, first=None)


def test_results_of_another_seal_are_not_mixed_in(tmp_path):
    """The folder of results belongs to one seal."""
    _, out = _draw(tmp_path / "draw", [("null", (), answer("none"))])
    prove(tmp_path / "draw", out, workers=1, limit=10.0, first=None)
    write_seal(tmp_path / "draw", {"cases": {}, "order": {}})
    with pytest.raises(Exception, match="the draw's seal is now"):
        prove(tmp_path / "draw", out, workers=1, limit=10.0, first=None)


def test_a_process_that_dies_or_hangs_is_a_wrong_answer(tmp_path):
    """A campaign that isn't one crashes its diagnosis and nothing else; a limit of no time runs out."""
    (tmp_path / "draw" / "x").mkdir(parents=True)
    (tmp_path / "draw" / "x" / "campaign.toml").write_text("nonsense = true\n")
    found = diagnosing.diagnose_all(tmp_path / "draw", tmp_path / "out", ["x"], workers=1, limit=60.0)
    assert found[0].status == "crashed"
    assert "exit code 2" in found[0].message
    late = diagnosing.diagnose_all(tmp_path / "draw", tmp_path / "late", ["x"], workers=1, limit=0.01)
    assert late[0].status == "timed-out"


def test_the_probe_finds_a_leak_that_is_there():
    """One telling feature among thirty is found; none is not."""
    rng = np.random.default_rng(3)
    labels = rng.random(150) < 0.6
    table = rng.standard_normal((150, 30))
    assert leak.probe(table, labels, rng, shuffles=39).p_value > 0.02
    table[:, 4] += 1.2 * labels
    found = leak.probe(table, labels, rng, shuffles=39)
    assert found.p_value <= 0.03
    assert found.score > 0.6


def test_nan_has_no_place_in_json():
    """Results without a number are null."""
    assert measures.as_json({"a": math.nan, "b": [1.0, (2.0,)]}) == {"a": None, "b": [1.0, [2.0]]}
