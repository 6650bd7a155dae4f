"""Scores of the proof: right is right, failures are wrong, intervals are Wilson's, seals can't be swapped."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from jointscope.experiments.prove import diagnosing, failures, leak, measures, table
from jointscope.experiments.prove.diagnosing import Answer
from jointscope.experiments.prove.judging import FAMILIES, judge
from jointscope.experiments.prove.proof import prove, publish, saved
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


@pytest.mark.parametrize(("unit", "error", "covered"), [("per run", 0.1, True), ("1/s", 2.1, False)])
def test_which_way_a_joint_drifts_from_run_to_run_is_nobodys_to_know(unit, error, covered):
    """No recording says which run came first; within a run time does."""
    drift = {**EFFECT, "effect": "stiffness-drift", "main": "rate", "parameters": {"rate": -0.002}}
    said = answer(effects=(("stiffness-drift", "transmission"),))
    said.diagnosis["effects"][0]["parameters"] = {
        "rate": {"value": 0.0022, "unit": unit, "interval95": [0.0018, 0.0026]}
    }
    judged = judge(truth(effects=(drift,)), said)
    assert judged.exact and judged.error == pytest.approx(error) and judged.covered is covered


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


@pytest.mark.parametrize("cases", [40, 60, 250])
def test_so_few_true_probabilities_scatter_by_what_is_said(cases):
    rng = np.random.default_rng(5)
    p = rng.uniform(0.4, 0.95, cases)
    found = np.mean([measures.calibration_error(p, rng.random(cases) < p) for _ in range(400)])
    assert measures.calibration_by_chance(p) == pytest.approx(found, rel=0.05)


def test_below_visibility_none_is_right_too():
    """z < 4: an effect that nothing could see counts as none."""
    asked = truth(z_d=2.0)
    assert not judge(asked, answer("none")).exact
    asked["strength"]["z"] = 3.0
    assert judge(asked, answer("none")).exact
    assert not judge(asked, answer(effects=(("hysteresis", "transmission"),))).exact


def test_what_was_made_to_be_undecidable_counts_by_its_band():
    """An undecidable case that can be told after all has to be told."""
    assert not judge(truth("undecidable", z_d=20.0), answer("unknown")).exact
    assert judge(truth("undecidable", z_d=2.0), answer("unknown")).exact
    judged = [judge(truth("undecidable", z_d=20.0), answer())]
    assert measures.singles(judged, "medium") == judged


@pytest.mark.parametrize(
    ("true", "covered"), [(1.25e-4, True), (1.28e-4, False), (0.95e-4, True), (0.92e-4, False)]
)
def test_intervals_are_judged_as_90_percent_intervals(true, covered):
    """1.1 [0.9, 1.3] at 95 % is 1.1 [0.932, 1.268] at 90 %."""
    effect = {**EFFECT, "parameters": {"gap": true}}
    assert judge(truth("single", (effect,)), answer()).covered is covered


def test_gain_towards_the_true_structure_comes_from_the_ranking():
    """Where the ranking states what the true structure reaches, the gain is relative to that."""
    ranking = [{"effects": ["backlash@transmission"], "probability": 0.2, "held_out_error": 0.025}]
    judged = judge(truth(), answer(effects=(("hysteresis", "transmission"),), ranking=ranking))
    assert judged.gain_fitted == pytest.approx(0.07 / 0.075)
    assert math.isnan(judge(truth(), answer()).gain_fitted)


TWO = (EFFECT, {**EFFECT, "effect": "coulomb-friction", "location": "load"})
BACKLASH = ("backlash", "transmission")


@pytest.mark.parametrize(
    ("known", "said", "kind"),
    [
        (truth(), answer(status="timed-out"), "crashed or timed out"),
        (truth("null", ()), answer(), "false alarm"),
        (truth("null", ()), answer("unknown"), "a mismatch seen in a null"),
        (truth(), answer("none"), "missed"),
        (truth("unlisted", (UNLISTED,)), answer(), "unlisted, given a listed name"),
        (truth(), answer("unknown", candidates=[["backlash@transmission"]]), "left open, the truth in the set"),
        (truth(), answer("unknown", candidates=[["delay@acquisition"]]), "left open, the truth not in the set"),
        (truth(), answer("unknown"), "taken for something unlisted"),
        (truth(z_d=2.0), answer(effects=(("hysteresis", "transmission"),)), "named though it can't be told"),
        (truth(), answer(effects=(BACKLASH, ("delay", "acquisition"))), "something named beside the truth"),
        (truth("pair", TWO), answer(), "one of two"),
        (truth("pair", TWO), answer(effects=(BACKLASH, ("delay", "acquisition"))), "one of two, with a wrong one"),
        (truth("single", (TWO[1],)), answer(effects=(("coulomb-friction", "motor"),)), "right name, wrong place"),
        (truth(), answer(effects=(("hysteresis", "transmission"),)), "taken for a look-alike"),
        (truth(), answer(effects=(("transmission-error", "transmission"),)), "wrong name, right place"),
        (truth(), answer(effects=(("delay", "acquisition"),)), "something else named"),
        (truth(), answer(), None),
    ],
)  # fmt: skip
def test_wrong_answers_fall_into_classes(known, said, kind):
    """Every class is met by the answer that it is for, and every class is explained."""
    assert failures.failure(judge(known, said), said.diagnosis) == kind
    assert kind is None or kind in failures.CLASSES


def test_the_example_of_a_class_is_its_surest_answer():
    """The one that would have misled most, with what the truth says about why."""
    known = {name: truth(case=name) for name in ("a", "b")}
    said = {"a": answer("none", probability=0.6), "b": answer("none", probability=0.95)}
    judged = [judge(known[name], said[name]) for name in ("a", "b")]
    found = failures.failures(judged, {name: a.diagnosis for name, a in said.items()}, known)
    assert [kind["class"] for kind in found] == ["missed"]
    assert found[0]["cases"] == 2
    assert found[0]["example"]["case"] == "b"
    assert "20.0 standard deviations" in failures.why(judge({**known["b"], "strength": {**known["b"]["strength"],
        "nearest": "hysteresis@transmission"}}, said["b"]), [], known["b"])  # fmt: skip
    assert set(failures.TELLS) == set(FAMILIES)


def test_the_gap_has_newcombes_interval():
    """Newcombe (1998), table II: 56/70 against 48/80 gives 0.20 [0.0524, 0.3339] (method 10)."""
    near = [judge(truth(), answer("effects" if i < 56 else "none")) for i in range(70)]
    odd = truth("single", ({**EFFECT, "departs": True},))
    far = [judge(odd, answer("effects" if i < 48 else "none")) for i in range(80)]
    gap = measures.law_gap([*near, *far])["medium"]
    assert gap["gap"] == pytest.approx(20.0)
    assert (gap["low"], gap["high"]) == (pytest.approx(5.24, abs=0.01), pytest.approx(33.39, abs=0.01))


def test_bootstrap_intervals_hold_their_value():
    """Of a median over many cases; shares keep Wilson's."""
    judged = [judge(truth(), replace(answer(), seconds=20.0 + i % 7)) for i in range(40)]
    row = next(row for row in table.table(judged, draws=60) if row.name == "wall time per campaign: median")
    assert row.interval is not None
    assert row.interval[0] <= row.number <= row.interval[1]
    assert row.interval[1] - row.interval[0] < 5.0


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
    assert saved(tmp_path / "draw", out) == json.loads((out / "summary.json").read_text())
    publish(summary, tmp_path / "docs" / "proof.md")
    assert "](proof/power.png)" in (tmp_path / "docs" / "proof.md").read_text()
    assert (tmp_path / "docs" / "proof" / "summary.json").stat().st_size < 150_000
    assert prove(tmp_path / "draw", out, workers=1, limit=10.0, first=None)["openings"] == {
        "times": 2,
        "answers": 1,
    }


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
    found = diagnosing.diagnose_all(tmp_path / "draw", tmp_path / "out", ["x"], workers=1, limit=900.0)
    assert found[0].status == "crashed"
    assert "exit code 2" in found[0].message
    late = diagnosing.diagnose_all(tmp_path / "draw", tmp_path / "late", ["x"], workers=1, limit=0.01)
    assert late[0].status == "timed-out"


@pytest.mark.parametrize("classifier", leak.CLASSIFIERS.values(), ids=leak.CLASSIFIERS)
def test_the_probe_finds_a_leak_that_is_there(classifier):
    """One telling feature among thirty is found; none is not."""
    rng = np.random.default_rng(3)
    labels = rng.random(150) < 0.6
    x = rng.standard_normal((150, 30))
    assert leak.probe(x, labels, rng, shuffles=39, classifier=classifier).p_value > 0.02
    x[:, 4] += 1.2 * labels
    found = leak.probe(x, labels, rng, shuffles=39, classifier=classifier)
    assert found.p_value <= 0.03
    assert found.score > 0.6


def test_boosting_finds_what_a_line_cant():
    """A label that depends on whether a size is near its middle."""
    rng = np.random.default_rng(4)
    x = rng.standard_normal((200, 20))
    labels = (np.abs(x[:, 7]) < 0.67) ^ (rng.random(200) < 0.1)
    assert leak.probe(x, labels, rng, shuffles=39, classifier=leak.boosted).p_value <= 0.03
    assert leak.probe(x, labels, rng, shuffles=39, classifier=leak.logistic).score < 0.62


@pytest.mark.parametrize(
    "change",
    [
        lambda text: text.replace("0.8", "0.80000000000000004"),
        lambda text: text + "\n# backlash\n",
        lambda text: text.replace("1024.0", "1025.0"),
    ],
)
def test_the_probe_sees_every_trace_in_the_paperwork(tmp_path, change):
    """Formatting of numbers, a comment, a rate: each moves the features."""
    for name in ("plain", "changed"):
        write_case(_small_campaign(0), tmp_path / "a" / name)
    file = tmp_path / "a" / "changed" / "campaign.toml"
    text = file.read_text()
    assert change(text) != text
    file.write_text(change(text))
    (tmp_path / "b").mkdir()
    (tmp_path / "a" / "changed").rename(tmp_path / "b" / "plain")
    first, second = leak.features(tmp_path / "a" / "plain"), leak.features(tmp_path / "b" / "plain")
    size = [i for i in range(first.size) if i not in (1,)]
    assert np.any(first[size] != second[size])


def test_nan_has_no_place_in_json():
    """Results without a number are null."""
    assert measures.as_json({"a": math.nan, "b": [1.0, (2.0,)]}) == {"a": None, "b": [1.0, [2.0]]}
