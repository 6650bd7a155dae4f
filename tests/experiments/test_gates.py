"""Gates: a bound is a bound on both sides, nothing tested is a failure, and every refusal names its key."""

import json
from xml.etree import ElementTree

import pytest

from jointscope.cli import main
from jointscope.errors import InputError
from jointscope.experiments.gates.claims import Gate, read_gates
from jointscope.experiments.gates.judge import judge, pick, run_gate, verdict
from jointscope.experiments.gates.reports import as_junit


def gate(**bound):
    return Gate(claim="a claim", measure="selfcheck", figure="x", **bound)


@pytest.mark.parametrize(
    ("bound", "inside", "outside"),
    [
        ({"target": 100.0, "within": 0.01}, 100.999, 101.1),
        ({"target": 100.0, "within": 0.01}, 99.001, 98.9),
        ({"target": -5.0, "within": 0.1}, -5.4, -4.4),
        ({"below": 2.0}, 2.0, 2.0001),
        ({"above": -1.0}, -1.0, -1.1),
        ({"equals": "none"}, "none", "effects"),
        ({"covers": 3.0}, [2.0, 3.0], [3.1, 4.0]),
    ],
)
def test_a_figure_on_the_bound_passes_and_one_beyond_fails(bound, inside, outside):
    """Bounds are closed; the margin is negative exactly where the claim is missed."""
    held, missed = judge(gate(**bound), inside), judge(gate(**bound), outside)
    assert (held.status, missed.status) == ("PASS", "FAIL")
    assert held.margin is None or held.margin >= -1e-9
    assert missed.margin is None or missed.margin < 0


@pytest.mark.parametrize("figure", [float("nan"), float("inf"), "many", True, None])
def test_a_figure_that_is_no_number_never_passes(figure, tmp_path):
    """NaN compares false with everything: it must not slip through a bound."""
    assert run_gate(gate(below=1.0), tmp_path, lambda _: {"x": figure}).status != "PASS"


def test_a_gates_file_that_tests_nothing_fails(tmp_path):
    """An empty file, or one whose optional campaigns are all absent, is red."""
    assert not verdict(())
    absent = Gate(claim="c", measure="identify", figure="x", campaign="nowhere", below=1.0, optional=True)
    outcome = run_gate(absent, tmp_path, lambda _: {"x": 0.0})
    assert outcome.status == "NOT-TESTED"
    assert not verdict((outcome,))
    assert verdict((outcome, judge(gate(below=1.0), 0.5)))


def test_a_path_that_leads_nowhere_fails_and_says_where_it_ends(tmp_path):
    """The detail lists what is there."""
    assert pick({"a": [{"b": 3}]}, "a.0.b") == 3
    outcome = run_gate(gate(below=1.0), tmp_path, lambda _: {"y": {"z": 1}})
    assert outcome.status == "FAIL"
    assert "'x'" in outcome.detail and "y" in outcome.detail


def test_junit_counts_failures_and_skips():
    """CI services read the counts from the suite's attributes."""
    text = as_junit((judge(gate(below=1.0), 0.5), judge(gate(below=1.0), 1.5)))
    suite = ElementTree.fromstring(text)
    assert (suite.get("tests"), suite.get("failures")) == ("2", "1")
    assert len(suite.findall("testcase/failure")) == 1


def test_the_command_measures_a_saved_result_and_exits_by_it(tmp_path, capsys):
    """Green then red, by the bound alone; what it wrote can be read back."""
    (tmp_path / "result.json").write_text('{"score": 0.5}')
    text = 'format = "jointscope-gates/1"\n[[gate]]\nclaim = "c"\nmeasure = "result"\nfile = "result.json"\n'
    for bound, code in (("above = 0.4", 0), ("above = 0.6", 1)):
        (tmp_path / "gates.toml").write_text(text + f'figure = "score"\n{bound}\n')
        assert main(["gate", str(tmp_path / "gates.toml"), "--out", str(tmp_path / "out")]) == code
        assert json.loads((tmp_path / "out" / "gates.json").read_text())["passed"] == (code == 0)
    assert "FAIL" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("text", "key"),
    [
        ("", "format"),
        ('format = "jointscope-gates/1"\ngates = 1', "gates"),
        ('format = "jointscope-gates/1"\n[[gate]]\nclaim = "c"\nmeasure = "guess"\nfigure = "x"', "measure"),
        ('format = "jointscope-gates/1"\n[[gate]]\nclaim = "c"\nmeasure = "identify"\nfigure = "x"', "campaign"),
        ('format = "jointscope-gates/1"\n[[gate]]\nclaim = "c"\nmeasure = "selfcheck"\nfigure = "x"', "bounds"),
        (
            'format = "jointscope-gates/1"\n[[gate]]\nclaim = "c"\nmeasure = "selfcheck"\nfigure = "x"\nbelow = "1"',
            "below",
        ),
    ],
)
def test_a_bad_gates_file_is_refused_with_its_key(tmp_path, text, key):
    """One line that names file and key."""
    path = tmp_path / "gates.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=key) as refusal:
        read_gates(path)
    assert "\n" not in str(refusal.value)
