"""Calibrated probabilities: the map, its range, and honesty without a map."""

import json
from dataclasses import dataclass

import numpy as np
import pytest

from jointscope.cli import main
from jointscope.diagnosis.calibration import (
    FORMAT,
    INPUTS,
    RANGES,
    SETS,
    as_known,
    calibrate,
    kind_of,
    outside,
    read_map,
)
from jointscope.errors import InputError
from jointscope.experiments.prove.calibrate import fit_logistic, learn, learn_map
from jointscope.experiments.prove.diagnosing import ANSWERS
from jointscope.experiments.prove.measures import calibration_error


def features(rng, stated):
    p = float(np.clip(stated, 1e-4, 1 - 1e-4))
    found = {name: float(rng.normal()) for name in INPUTS}
    found["stated"] = float(np.log(p / (1 - p)))
    found.update({name: float(rng.uniform(1.0, 2.0)) for name in RANGES})
    found.update(dict.fromkeys(SETS, "as drawn"))
    return found


@pytest.fixture(scope="module")
def rows():
    """An overconfident explainer: right half as often beyond even as it says."""
    rng = np.random.default_rng(3)
    found = []
    for _ in range(600):
        stated = rng.uniform(0.05, 0.99)
        found.append(("effects", features(rng, stated), bool(rng.random() < 0.3 + 0.4 * stated)))
    return found


def test_the_logistic_recovers_its_own_slopes():
    rng = np.random.default_rng(1)
    x = rng.normal(size=(20_000, 2)) * [1.0, 5.0]
    right = rng.random(20_000) < 1 / (1 + np.exp(-(0.5 + x @ [1.0, -0.2])))
    intercept, slopes = fit_logistic(x, right, ridge=100.0)
    assert intercept == pytest.approx(0.5, abs=0.06)
    assert slopes == pytest.approx([1.0, -0.2], abs=0.06)


def test_all_right_stays_finite_and_below_one():
    intercept, slopes = fit_logistic(np.zeros((20, 2)), np.ones(20, dtype=bool))
    assert 0.9 < 1 / (1 + np.exp(-intercept)) < 1.0 and np.all(np.isfinite(slopes))


def test_the_map_mends_an_overconfident_explainer(rows):
    learnt = learn(rows)
    errors = learnt["calibration_error"]
    assert errors["stated"] > 0.08
    assert errors["mapped, cross-validated"] < 0.6 * errors["stated"]
    held = read_map(json.dumps(learnt))
    said = [calibrate(found, kind, 0.5, held).probability for kind, found, _ in rows]
    assert calibration_error(np.array(said), np.array([r for *_, r in rows])) < 0.06


@pytest.mark.parametrize("less", [0.0, 0.55])
def test_outside_the_range_the_map_is_less_sure_and_not_vouched_for(rows, less):
    held = read_map(json.dumps({**learn(rows), "beyond": {"effects": -less}}))
    _, found, _ = rows[0]
    assert outside(found, held) is None
    inside = calibrate(found, "effects", 0.7, held).probability
    for changed in ({"runs": 99.0}, {"experiments": "speed-motion"}, {"snr_db": -40.0}):
        answer = calibrate({**found, **changed}, "effects", 0.7, held)
        odds = inside / (1.0 - inside) * np.exp(-less)
        assert answer.probability == pytest.approx(odds / (1.0 + odds))
        assert not answer.in_domain and next(iter(changed)) in answer.reason
    alone = calibrate(found, "not-identifiable", 0.7, held)
    assert alone.probability == 0.7 and alone.in_domain is False


@dataclass(frozen=True)
class Ranked:
    names: tuple[str, ...]
    probability: float


@dataclass(frozen=True)
class Answer:
    verdict: str
    unknown_reason: str | None
    chosen: Ranked
    ranking: tuple[Ranked, ...]


@pytest.mark.parametrize("known", [0.2, 0.7, 0.99])
@pytest.mark.parametrize(("verdict", "reason", "chosen"), [
    ("effects", None, "play"), ("none", None, "base"), ("unknown", "outside-catalogue", "base"),
    ("unknown", "not-identifiable", "base"),
])  # fmt: skip
def test_a_ranking_says_what_is_known_of_the_answer(known, verdict, reason, chosen):
    """The chosen set has the verdict's probability, the rest no more than is left; order and shares among them stay."""
    ranking = tuple(Ranked((n,), p) for n, p in (("play", 0.8), ("bend", 0.15), ("loop", 0.04), ("base", 0.01)))
    found = as_known(
        Answer(verdict, reason, Ranked((chosen,), 0.5), ranking), known
    ).ranking  # another fit of its names
    said = {r.names[0]: r.probability for r in found}
    assert [r.names for r in found] == [r.names for r in ranking]
    if reason == "not-identifiable":
        assert found == ranking
        return
    assert sum(said.values()) <= 1.0 + 1e-12
    rest = [n for n in said if verdict == "unknown" or n != chosen]
    if verdict == "unknown":
        assert sum(said.values()) == pytest.approx(min(1.0 - known, 1.0))
    else:
        assert said[chosen] == known
    before = {r.names[0]: r.probability for r in ranking}
    shares = [said[n] / before[n] for n in rest]
    assert shares == pytest.approx([shares[0]] * len(rest)) and shares[0] <= 1.0


def test_what_is_known_beyond_the_range_outlives_another_lesson(rows, tmp_path):
    proof = proof_of(tmp_path / "a", rows[:80], "calibration")
    (tmp_path / "map.json").write_text(json.dumps({"beyond": {"effects": -0.3}}))
    learn_map([proof], tmp_path / "map.json")
    assert read_map((tmp_path / "map.json").read_text()).beyond == {"effects": -0.3}


def test_without_a_map_nothing_is_vouched_for(rows):
    answer = calibrate(rows[0][1], "effects", 0.7, None)
    assert answer.probability == 0.7 and not answer.in_domain


def test_a_map_of_other_inputs_is_refused(rows):
    content = {**learn(rows), "inputs": ["mood"]}
    with pytest.raises(ValueError, match="calibrate anew"):
        read_map(json.dumps(content))
    assert json.loads(json.dumps(learn(rows)))["format"] == FORMAT


def test_kinds_of_answers():
    assert kind_of("unknown", "not-identifiable") == "not-identifiable"
    assert kind_of("effects", None) == "effects"


def proof_of(folder, rows, draw):
    """A finished proof with these answers, as ``prove`` leaves it."""
    (folder / ANSWERS).mkdir(parents=True)
    judged = []
    for k, (kind, found, right) in enumerate(rows):
        case = f"{k:04d}"
        said = {"verdict": kind, "calibration": {"features": found}}
        answer = {"case": case, "status": "answered", "seconds": 1.0, "diagnosis": said}
        (folder / ANSWERS / f"{case}.json").write_text(json.dumps(answer))
        judged.append({"case": case, "exact": right})
    (folder / "judged.json").write_text(json.dumps(judged))
    (folder / "summary.json").write_text(json.dumps({"draw": draw}))
    return folder


def test_several_proofs_are_one_lesson(rows, tmp_path):
    one, other = (
        proof_of(tmp_path / n, part, "calibration") for n, part in (("a", rows[:80]), ("b", rows[80:160]))
    )
    learn_map([one, other], tmp_path / "map.json")
    assert json.loads((tmp_path / "map.json").read_text()) == json.loads(json.dumps(learn(rows[:160])))


def test_the_command_learns_and_says_what_it_is_worth(rows, tmp_path, monkeypatch, capsys):
    """The words of the documentation write the map, of the draw and of what is beside it."""
    out, beside = (
        proof_of(tmp_path / n, part, "calibration") for n, part in (("a", rows[:80]), ("b", rows[80:160]))
    )
    summary = {"seed": 1, "seal": "s", "openings": {"times": 1}, "cases": 80, "table": []}
    monkeypatch.setattr("jointscope.experiments.prove.proof.prove", lambda *_, **__: summary)
    monkeypatch.setattr("jointscope.commands.prove._report", lambda *_: None)
    words = ["prove", str(tmp_path / "draw"), "--out", str(out), "--calibrate", str(tmp_path / "map.json")]
    assert main([*words, "--beside", str(beside)]) == 0
    assert json.loads((tmp_path / "map.json").read_text())["cases"] == 160
    assert "learnt on 160 answers" in capsys.readouterr().err


def test_nothing_is_learnt_from_test_cases(rows, tmp_path):
    with pytest.raises(InputError, match="nothing is learnt from test cases"):
        learn_map([proof_of(tmp_path / "a", rows[:40], "test")], tmp_path / "map.json")
    assert not (tmp_path / "map.json").exists()


def test_answers_given_before_a_test_draw_was_opened_teach_once_it_is_spent(rows, tmp_path):
    """It must be named as such; named twice it counts once."""
    fresh = proof_of(tmp_path / "a", rows[:40], "calibration")
    opened = proof_of(tmp_path / "b", rows[40:80], "test")
    assert learn_map([fresh], tmp_path / "map.json", spent=[opened])["cases"] == 80
    assert learn_map([opened], tmp_path / "map.json", spent=[opened])["cases"] == 40


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["real", "--data", "d", "--calibrate", "map.json"], "--calibrate"),
        (["real", "--data", "d", "--limit", "3"], "--limit"),
        (["draw", "--beside", "proof"], "--beside"),
    ],
)
def test_an_option_that_would_not_be_used_is_refused(tmp_path, monkeypatch, capsys, words, named):
    monkeypatch.chdir(tmp_path)
    assert main(["prove", *words]) != 0
    said = capsys.readouterr().err
    assert named in said and len(said.strip().splitlines()) == 1
    assert not list(tmp_path.iterdir())
