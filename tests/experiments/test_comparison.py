"""What compare says: the laws of its intervals first, then each kind of result, then the command."""

import json
import math
import re

import numpy as np
import pytest

from jointscope.cli import main
from jointscope.errors import InputError, RefusedError
from jointscope.experiments.comparison.change import compare, difference_interval, mcnemar, paired_interval
from jointscope.experiments.comparison.kinds import READERS
from jointscope.experiments.comparison.reading import read_pair, read_results
from jointscope.experiments.comparison.report import as_json, as_page, as_text


def identification(stiffness=193642.0, half=500.0, **more):
    return {
        "format": "jointscope-identification/1",
        "method": "hits",
        "parameters": {
            "stiffness": {
                "value": stiffness,
                "unit": "N m/rad",
                "interval95": [stiffness - half, stiffness + half],
            }
        },
        "modes": [{"frequency_hz": 40.3, "frequency_interval95": [40.2, 40.4], "damping_ratio": 0.04}],
        "quality": [],
        "refused": [],
        **more,
    }


def diagnosis(verdict="none", effects=(), error=0.05, **more):
    return {
        "format": "jointscope-diagnosis/1",
        "verdict": verdict,
        "verdict_probability": 0.9,
        "effects": list(effects),
        "parameters": {"damping": {"value": 60.0, "unit": "N m s/rad", "interval95": [59.0, 61.0]}},
        "held_out": {
            "runs": ["a", "b"],
            "base_error": 0.3,
            "augmented_error": error,
            "noise_floor": None,
            "by_experiment": {"base": {"hammer": {"linear-acceleration@arm": 0.3}}, "augmented": {}},
        },
        **more,
    }


def coulomb(torque, half):
    return {
        "effect": "coulomb-friction",
        "location": "motor",
        "probability": 0.97,
        "parameters": {"torque": {"value": torque, "unit": "N m", "interval95": [torque - half, torque + half]}},
    }


def prediction(errors):
    return {
        "format": "jointscope-prediction/1",
        "runs": {
            run: {
                "experiment": "hammer",
                "closed_loop": False,
                "channels": {
                    "acc": {
                        "quantity": "linear-acceleration",
                        "error": error,
                        "bands": [{"low_hz": 10.0, "high_hz": 75.0, "median_error_db": -1.0 - error}],
                    }
                },
            }
            for run, error in errors.items()
        },
        "mean_error": {"hammer": float(np.mean(list(errors.values())))},
    }


def proof(wrong, cases=40, seal="abc"):
    share = 1 - len(wrong) / cases
    return {
        "format": "jointscope-proof/1", "seal": seal, "cases": cases, "kind": "test", "seed": 1,
        "table": [
            {"name": "named", "value": {"share": share, "low": share - 0.1, "high": share + 0.05}, "unit": "1",
             "upward": True, "reached": share > 0.8},
            {"name": "median error", "value": 0.1, "unit": "1", "upward": False, "reached": None},
        ],
        "wrong": [{"case": case} for case in wrong],
    }  # fmt: skip


def gates(status, figure):
    return {
        "format": "jointscope-gates-result/1",
        "passed": status == "PASS",
        "gates": [{"claim": "K within 1 %", "status": status, "figure": figure, "margin": 0.5}],
    }


def sensitivity(total):
    return {
        "format": "jointscope-sensitivity-result/1",
        "study": {"method": "sobol", "samples": 8, "factors": [{"name": "K", "lower": 1.0, "upper": 2.0}]},
        "indices": [
            {
                "output": "resonance",
                "factor": "K",
                "total": total,
                "total_interval": 0.01,
                "first": None,
                "first_interval": 0.0,
            }
        ],
        "quantiles": {"resonance": {"q05": 1.0, "q50": 2.0, "q95": 3.0}},
    }


def confirmation(gain):
    rows = [{"run": f"r{i}", "channel": "acc", "base_error": 0.3, "augmented_error": 0.3 - gain} for i in range(4)]
    return {
        "format": "jointscope-confirm/1",
        "confirmed": gain > 0,
        "mujoco": {"gain": gain},
        "gain_ratio": None,
        "channels": rows,
    }


EXAMPLES = {
    "identification": (identification(), identification(150000.0)),
    "diagnosis": (diagnosis(), diagnosis("effects", [coulomb(85.0, 3.0)], 0.02)),
    "prediction": (prediction({"a": 0.1}), prediction({"a": 0.2})),
    "proof": (proof([]), proof(["c1", "c2"])),
    "gates": (gates("PASS", 0.004), gates("FAIL", 0.02)),
    "sensitivity": (sensitivity(0.6), sensitivity(0.8)),
    "confirm": (confirmation(0.1), confirmation(-0.1)),
}


def written(folder, content, name="result.json"):
    folder.mkdir(exist_ok=True)
    (folder / name).write_text(json.dumps(content))
    return folder


def compared(tmp_path, old, new):
    (pair,) = read_pair(written(tmp_path / "old", old), written(tmp_path / "new", new))
    return compare(*pair)


def change(found, name):
    return next(c for c in found.changes if c.name == name)


# --- laws ------------------------------------------------------------------------------------------------------------


def test_symmetric_intervals_add_in_quadrature():
    low, high = difference_interval(10.0, (7.0, 13.0), 20.0, (16.0, 24.0))
    assert (low, high) == (pytest.approx(5.0), pytest.approx(15.0))


def test_asymmetric_intervals_count_by_the_sides_that_face_each_other():
    low, high = difference_interval(10.0, (9.0, 30.0), 20.0, (20.0, 21.0))
    assert low == pytest.approx(10.0 - 20.0)  # the old value may have been 30
    assert high == pytest.approx(10.0 + math.hypot(1.0, 1.0))


def test_two_shares_give_newcombes_interval():
    # Newcombe 1998, Statistics in Medicine 17:873, table II (a), method 10: 56/70 against 48/80
    from jointscope.experiments.prove.measures import wilson

    a, b = wilson(48, 80), wilson(56, 70)
    low, high = difference_interval(a.share, (a.low, a.high), b.share, (b.low, b.high))
    assert low == pytest.approx(0.0524, abs=5e-5) and high == pytest.approx(0.3339, abs=5e-5)


def test_the_interval_holds_the_true_difference_19_times_out_of_20():
    rng = np.random.default_rng(3)
    a, b = rng.normal(5.0, 1.0, 4000), rng.normal(5.0, 3.0, 4000)
    hits = sum(
        low <= 0.0 <= high
        for low, high in (
            difference_interval(x, (x - 1.96, x + 1.96), y, (y - 5.88, y + 5.88))
            for x, y in zip(a, b, strict=True)
        )
    )
    assert 0.937 < hits / 4000 < 0.963


def test_pairs_ignore_what_runs_have_in_common():
    rng = np.random.default_rng(4)
    common = rng.normal(0.0, 10.0, 12)
    old, new = common + rng.normal(0.0, 0.01, 12), common + 1.0 + rng.normal(0.0, 0.01, 12)
    low, high = paired_interval(list(new - old))
    assert low < 1.0 < high and high - low < 0.05


def test_mcnemar_is_symmetric_and_certain_of_nothing_without_changes():
    assert mcnemar(0, 0) == 1.0
    assert mcnemar(3, 9) == mcnemar(9, 3)
    assert mcnemar(0, 6) == pytest.approx(2 * 0.5**6)


@pytest.mark.parametrize("kind", EXAMPLES)
def test_a_result_equals_itself(kind, tmp_path):
    old, _ = EXAMPLES[kind]
    found = compared(tmp_path, old, old)
    assert {c.judgement for c in found.changes} == {"same"} and found.changes
    assert found.restated == found.came == found.went == ()


@pytest.mark.parametrize("kind", EXAMPLES)
def test_turned_round_every_difference_turns_its_sign(kind, tmp_path):
    old, new = EXAMPLES[kind]
    there, back = compared(tmp_path, old, new), compared(tmp_path, new, old)
    assert sorted(there.came) == sorted(back.went)
    for one in there.changes:
        other = change(back, one.name)
        if one.difference is None:
            assert other.difference is None
            continue
        assert other.difference == pytest.approx(-one.difference)
        assert other.judgement == one.judgement
        if one.interval is not None:
            assert other.interval == pytest.approx((-one.interval[1], -one.interval[0]))


# --- what is told ----------------------------------------------------------------------------------------------------


def test_a_parameter_that_moved_beyond_its_interval_is_significant(tmp_path):
    found = compared(tmp_path, identification(193642.0, 500.0), identification(195642.0, 500.0))
    moved = change(found, "stiffness")
    assert moved.judgement == "significant" and moved.unit == "N m/rad"
    assert moved.interval == pytest.approx((2000.0 - 500.0 * 2**0.5, 2000.0 + 500.0 * 2**0.5))
    assert moved.direction is None  # neither a larger nor a smaller stiffness is better
    assert "stiffness, +1.03 %" in as_text(found)


def test_one_that_scattered_within_it_is_not(tmp_path):
    found = compared(tmp_path, identification(193642.0, 500.0), identification(194042.0, 500.0))
    assert change(found, "stiffness").judgement == "within its interval"
    assert not found.significant


def test_verdict_effects_and_held_out_errors_are_told(tmp_path):
    found = compared(tmp_path, diagnosis(), diagnosis("effects", [coulomb(85.0, 3.0)], 0.02))
    assert ("effect", "coulomb-friction@motor") in found.came
    assert [(r.name, r.old, r.new) for r in found.restated] == [("verdict", "none", "effects")]
    assert change(found, "held-out error, with effects").direction == "better"
    assert change(found, "coulomb-friction@motor, torque").judgement == "appeared"
    assert "effects +coulomb-friction@motor" in as_text(found)


def test_an_effects_size_is_compared_against_its_interval(tmp_path):
    old, new = (diagnosis("effects", [coulomb(torque, 3.0)]) for torque in (85.0, 120.0))
    assert change(compared(tmp_path, old, new), "coulomb-friction@motor, torque").judgement == "significant"


def test_errors_on_the_same_runs_are_paired(tmp_path):
    old = {f"r{i}": 0.1 + 0.1 * i for i in range(8)}
    new = {run: 0.98 * error for run, error in old.items()}
    found = compared(tmp_path, prediction(old), prediction({**new, "other": 9.0}))
    error = change(found, "error of linear-acceleration acc, hammer")
    assert error.judgement == "significant" and error.direction == "better" and error.basis == "8 pairs"
    assert change(found, "mean error, hammer").judgement == "no interval"


def test_too_few_pairs_give_no_interval(tmp_path):
    found = compared(tmp_path, prediction({"a": 0.1, "b": 0.3}), prediction({"a": 0.2, "b": 0.2}))
    assert change(found, "error of linear-acceleration acc, hammer").interval is None


def test_cases_of_one_sealed_draw_are_paired_and_of_two_are_not(tmp_path):
    wrong = [f"c{i}" for i in range(12)]
    found = compared(tmp_path, proof(wrong), proof(wrong[:2]))
    paired = change(found, "cases answered right as a whole")
    assert paired.judgement == "significant" and "10 newly right, 0 newly wrong" in paired.basis
    other = compared(tmp_path, proof(wrong), proof(wrong[:2], seal="other"))
    assert all(c.name != "cases answered right as a whole" for c in other.changes)
    assert change(other, "named").interval is not None


def test_a_gate_that_went_red_is_told(tmp_path):
    found = compared(tmp_path, gates("PASS", 0.004), gates("FAIL", 0.02))
    assert [(r.old, r.new) for r in found.restated] == [("pass", "do not pass"), ("PASS", "FAIL")]


def test_another_unit_is_no_difference(tmp_path):
    new = identification()
    new["parameters"]["stiffness"]["unit"] = "N m/rad per A"
    found = compared(tmp_path, identification(), new)
    assert change(found, "stiffness").judgement == "other unit" and change(found, "stiffness").difference is None


# --- what is refused -------------------------------------------------------------------------------------------------


def test_two_kinds_are_refused_in_one_line(tmp_path):
    old, new = written(tmp_path / "a", identification()), written(tmp_path / "b", diagnosis())
    with pytest.raises(RefusedError, match=r"an identification result, .* holds a diagnosis result: only") as said:
        read_pair(old, new)
    assert "\n" not in str(said.value)


def test_other_json_beside_a_result_is_left_alone(tmp_path):
    folder = written(tmp_path / "a", identification())
    written(folder, {"format": "jointscope-model/1"}, "model.json")
    (folder / "broken.json").write_text("{")
    (folder / "list.json").write_text("[1]")
    assert list(read_results(folder)) == ["identification"]


@pytest.mark.parametrize("content", ["{", "[]", '{"format": ["a"]}', '{"format": "jointscope-model/1"}'])
def test_a_file_that_is_no_result_is_refused(content, tmp_path):
    file = tmp_path / "x.json"
    file.write_text(content)
    with pytest.raises(InputError):
        read_results(file)


@pytest.mark.parametrize("form", READERS)
@pytest.mark.parametrize(
    "key", ["parameters", "runs", "effects", "table", "gates", "indices", "channels", "modes"]
)
def test_a_malformed_result_is_one_line(form, key, tmp_path):
    file = tmp_path / "x.json"
    file.write_text(json.dumps({"format": form, key: [3]}))
    try:
        read_results(file)
    except InputError as problem:
        assert "\n" not in str(problem) and "x.json" in str(problem)


# --- the command -----------------------------------------------------------------------------------------------------


def test_the_command_prints_and_writes(tmp_path, capsys):
    old, new = (written(tmp_path / name, EXAMPLES["diagnosis"][i]) for i, name in enumerate(("a", "b")))
    assert main(["compare", str(old), str(new), "--out", str(tmp_path / "out"), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["format"] == "jointscope-comparison/1" and said["comparisons"][0]["kind"] == "diagnosis"
    assert json.loads((tmp_path / "out" / "compare.json").read_text()) == said
    page = (tmp_path / "out" / "compare.html").read_text()
    assert "coulomb-friction@motor" in page and not re.search(r"(src|href)=.http", page)


def test_the_command_refuses_mixed_kinds(tmp_path, capsys):
    old, new = written(tmp_path / "a", identification()), written(tmp_path / "b", gates("PASS", 1.0))
    assert main(["compare", str(old), str(new)]) == 2
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.parametrize("kind", EXAMPLES)
def test_every_kind_becomes_text_json_and_page(kind, tmp_path):
    found = compared(tmp_path, *EXAMPLES[kind])
    assert as_text(found).startswith(found.kind)
    json.dumps(as_json([found]), allow_nan=False)
    assert as_page([found]).startswith("<!doctype html>")
