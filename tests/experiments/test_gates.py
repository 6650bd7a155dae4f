"""Gates: a bound is a bound on both sides, nothing tested is a failure, and every refusal names its key."""

import json
from pathlib import Path
from xml.etree import ElementTree

import pytest

from jointscope.cli import main
from jointscope.errors import InputError, RefusedError
from jointscope.experiments.gates import mutations
from jointscope.experiments.gates.claims import Gate, GatesFile, Make, read_gates
from jointscope.experiments.gates.judge import judge, judge_all, run_gate, select, verdict
from jointscope.experiments.gates.reports import as_json, as_junit, as_markdown

ROOT = Path(__file__).resolve().parents[2]
HEAD = 'format = "jointscope-gates/1"\n'
RESULT = '[[gate]]\nclaim = "c"\nmeasure = "result"\nfile = "result.json"\n'


def gate(**bound):
    return Gate(**({"claim": "a claim", "measure": "selfcheck", "figure": "x"} | bound))


def measured(one, document, folder=Path(), unmade=None):
    file = GatesFile(folder=folder, places={}, makes=(), gates=(one,))
    return run_gate(one, file, folder / "made", lambda _: (document, 0.0), unmade)


@pytest.mark.parametrize(
    ("bound", "inside", "outside"),
    [
        ({"target": 100.0, "within": 0.01}, 100.999, 101.1),
        ({"target": 100.0, "within": 0.01}, 99.001, 98.9),
        ({"target": -5.0, "within": 0.1}, -5.4, -4.4),
        ({"below": 2.0}, 2.0, 2.0001),
        ({"below": 0}, 0, 1),
        ({"above": -1.0}, -1.0, -1.1),
        ({"equals": "none"}, "none", "effects"),
        ({"equals": True}, True, 1),
        ({"covers": 3.0}, [2.0, 3.0], [3.1, 4.0]),
    ],
)
def test_a_figure_on_the_bound_passes_and_one_beyond_fails(bound, inside, outside):
    """Bounds are closed; the margin is negative exactly where the claim is missed."""
    held, missed = judge(gate(**bound), inside), judge(gate(**bound), outside)
    assert (held.status, missed.status) == ("PASS", "FAIL")
    assert held.margin is None or held.margin >= -1e-9
    assert missed.margin is None or missed.margin < 0


@pytest.mark.parametrize("figure", [float("nan"), float("inf"), "many", True, None, [1.0], {}])
def test_a_figure_that_is_no_number_never_passes(figure):
    """NaN compares false with everything: it must not slip through a bound."""
    assert measured(gate(below=1.0), {"x": figure}).status != "PASS"
    assert measured(gate(covers=1.0), {"x": [0.0, figure]}).status != "PASS"


def test_of_several_figures_each_must_keep_the_bound():
    """One that misses is enough, wherever it stands; the outcome shows the worst."""
    rows = {"runs": {"a": {"kind": "s", "v": [1.0, 2.0]}, "b": {"kind": "m", "v": [9.0]}}}
    held = measured(gate(figure="runs.[kind=s].v.*", below=2.0), rows)
    missed = measured(gate(figure="runs.*.v.*", below=2.0), rows)
    assert (held.status, held.figure) == ("PASS", 2.0)
    assert (missed.status, missed.figure) == ("FAIL", 9.0)
    assert "the worst of 3" in missed.detail and "1 beyond" in missed.detail
    assert judge_all(gate(below=2.0), [float("nan"), 1.0]).status == "FAIL"
    assert (
        measured(gate(figure="runs.*.v.*", below=2.0), {"runs": {"a": {"v": [1.0, None]}}}).status == "NOT-TESTED"
    )


def test_a_path_selects_by_key_position_value_and_count():
    """Numbers in a selection are compared as numbers, names may hold dots and commas."""
    document = {"table": [{"name": "a, b. c", "low": 10.0, "v": 1}, {"name": "d", "low": 4, "v": 2}], "acc.x": 3}
    assert select(document, Gate(claim="", measure="result", figure="table.[name=a, b. c].v").parts) == ([1], True)
    assert select(document, ("table", "[low=10]", "v")) == ([1], True)
    assert select(document, ("table", "-1", "v")) == ([2], False)
    assert select(document, ("table", "#")) == ([2], False)
    assert select(document, ("acc.x",)) == ([3], False)


@pytest.mark.parametrize("path", ["y", "runs.[kind=t].v", "runs.a.v.7", "runs.a.kind.*", "none.*"])
def test_a_path_that_leads_nowhere_fails_and_says_where_it_ends(path):
    """A selection of nothing tests nothing: it fails, whatever the bound."""
    outcome = measured(gate(figure=path, below=1e9), {"runs": {"a": {"kind": "s", "v": [1.0]}}, "none": []})
    assert outcome.status == "FAIL"
    assert any(part in outcome.detail for part in ("'y'", "[kind=t]", "'7'", "a str", "none"))


def test_a_gates_file_that_tests_nothing_fails(tmp_path):
    """An empty file, or one whose optional campaigns are all absent, is red in the verdict and in the XML."""
    absent = Gate(claim="c", measure="identify", figure="x", campaign="nowhere", below=1.0, optional=True)
    outcome = measured(absent, {"x": 0.0}, tmp_path)
    assert (outcome.status, outcome.red) == ("NOT-TESTED", False)
    for nothing in ((), (outcome,)):
        assert not verdict(nothing)
        assert ElementTree.fromstring(as_junit(nothing)).get("failures") == "1"
        assert "Nothing was tested" in as_markdown(nothing)
    assert verdict((outcome, judge(gate(below=1.0), 0.5)))


def test_only_absent_material_excuses_an_optional_gate(tmp_path):
    """A figure that is null although the recording is there, or what failed to be made, is red."""
    (tmp_path / "there").mkdir()
    there = Gate(claim="c", measure="identify", figure="x", campaign="there", below=1.0, optional=True)
    null = measured(there, {"x": None}, tmp_path)
    assert null.status == "NOT-TESTED" and null.red
    made = Gate(claim="c", measure="identify", figure="x", campaign="{made}/a", below=1.0, optional=True)
    assert measured(made, {"x": 0.0}, tmp_path, {"a": "disk full"}).status == "FAIL"
    excused = measured(made, {"x": 0.0}, tmp_path, {"a": None})
    assert excused.status == "NOT-TESTED" and not excused.red


def test_a_measure_that_crashes_is_red_and_says_how():
    """Neither a refusal nor a bug ends the run of the other gates."""
    file = GatesFile(folder=Path(), places={}, makes=(), gates=())

    def refuse(_):
        raise RefusedError("no hits")

    def crash(_):
        return {}["lost"][0]

    assert run_gate(gate(below=1.0), file, Path(), refuse).detail == "no hits"
    assert run_gate(gate(below=1.0), file, Path(), crash).status == "FAIL"
    assert "ZeroDivisionError" in run_gate(gate(below=1.0), file, Path(), lambda _: 1 // 0).detail


def test_junit_has_the_structure_that_ci_services_read():
    """Counts on suites and suite agree with the cases; a case holds at most one outcome; no character breaks it."""
    odd = Gate(claim='a < b & "c" \x00 \x1b', measure="result", figure="x", file="f", below=1.0, group="g")
    absent = Gate(claim="c", measure="identify", figure="x", campaign="no", below=1.0, optional=True)
    outcomes = (judge(odd, 0.5), judge(odd, 1.5), measured(absent, {}))
    root = ElementTree.fromstring(as_junit(outcomes).split("\n", 1)[1])
    assert root.tag == "testsuites" and [suite.tag for suite in root] == ["testsuite"]
    suite = root[0]
    cases = suite.findall("testcase")
    assert len(cases) == len(list(suite)) == 3
    for key, value in {"tests": "3", "failures": "1", "errors": "0"}.items():
        assert root.get(key) == suite.get(key) == value
    assert suite.get("skipped") == "1"
    assert float(suite.get("time")) >= 0.0
    for case in cases:
        assert {"classname", "name", "time"} == set(case.attrib)
        assert len(case) == 1 and case[0].tag in ("failure", "skipped", "system-out")
    assert cases[1][0].get("message").startswith("1.5 against <= 1")


def test_json_is_strict_and_markdown_keeps_its_table():
    """NaN is no JSON, and a bar in a claim is no column."""
    outcome = judge(Gate(claim="a | b", measure="selfcheck", figure="x", below=1.0), float("nan"))
    row = json.loads(as_json((outcome,)), parse_constant=pytest.fail)["gates"][0]
    assert (row["figure"], row["status"]) == ("nan", "FAIL")
    table = [line for line in as_markdown((outcome,)).splitlines() if line.startswith("|")]
    assert len({line.replace("\\|", "").count("|") for line in table}) == 1


def test_the_command_measures_a_saved_result_and_exits_by_it(tmp_path, capsys):
    """Green then red, by the bound alone; what it wrote can be read back."""
    (tmp_path / "result.json").write_text('{"score": 0.5}')
    for bound, code in (("above = 0.4", 0), ("above = 0.6", 1)):
        (tmp_path / "gates.toml").write_text(HEAD + RESULT + f'figure = "score"\n{bound}\n')
        assert main(["gate", str(tmp_path / "gates.toml"), "--out", str(tmp_path / "out")]) == code
        assert json.loads((tmp_path / "out" / "gates.json").read_text())["passed"] == (code == 0)
    assert "FAIL" in capsys.readouterr().out
    (tmp_path / "result.json").write_text("[")
    assert main(["gate", str(tmp_path / "gates.toml"), "--out", str(tmp_path / "out")]) == 1
    assert "not a JSON table" in capsys.readouterr().out


def test_what_is_made_is_made_anew_in_order_and_only_where_needed(tmp_path):
    """A claim on a made bench measures it; a make that can't be is red; an unneeded one is not made."""
    text = HEAD + (
        '[places]\ndata = { environment = "NO_SUCH_VARIABLE", folder = "nowhere" }\n'
        '[[make]]\nname = "bench"\ncommand = "simulate single-joint --experiments hammer --hits 1 --hit-levels 200 '
        '--out {made}/bench"\n'
        '[[make]]\nname = "bad"\ncommand = "identify {made}/bench/nowhere --out {made}/bad"\n'
        '[[make]]\nname = "absent"\ncommand = "import emps {data}/x --out {made}/absent"\nneeds = "{data}/x"\n'
        '[[gate]]\nclaim = "one run"\nmeasure = "inspect"\ncampaign = "{made}/bench"\nfigure = "runs.#"\nequals = 1\n'
        '[[gate]]\nclaim = "bad"\nmeasure = "result"\nfile = "{made}/bad/identification.json"\nfigure = "x"\nbelow = 1\n'
        'optional = true\ngroup = "bad"\n'
        '[[gate]]\nclaim = "absent"\nmeasure = "identify"\ncampaign = "{made}/absent"\nfigure = "x"\nbelow = 1\n'
        "optional = true\n"
    )
    (tmp_path / "gates.toml").write_text(text)
    out = tmp_path / "out"
    stale = out / "made" / "bench"
    stale.mkdir(parents=True)
    (stale / "left-over").write_text("of an earlier call")
    assert main(["gate", str(tmp_path / "gates.toml"), "--out", str(out)]) == 1
    rows = json.loads((out / "gates.json").read_text())["gates"]
    assert [row["status"] for row in rows] == ["PASS", "FAIL", "NOT-TESTED"]
    assert "nowhere" in rows[1]["detail"] and rows[2]["excused"]
    assert not (stale / "left-over").exists()
    file = read_gates(tmp_path / "gates.toml")
    assert [make.name for make in file.needed(file.gates[:1])] == ["bench"]
    assert [make.name for make in file.needed(file.gates[1:2])] == ["bench", "bad"]


def test_several_processes_judge_alike_and_none_is_refused(tmp_path, capsys):
    """The same rows by one process as by two, but for the time; no process at all is one line."""
    (tmp_path / "result.json").write_text('{"score": 0.5, "other": 2.0}')
    more = RESULT.replace('"c"', '"d"') + 'figure = "other"\nbelow = 1.0\n'
    (tmp_path / "gates.toml").write_text(HEAD + RESULT + 'figure = "score"\nabove = 0.4\n' + more)
    rows = []
    for workers in ("1", "2"):
        command = ["gate", str(tmp_path / "gates.toml"), "--out", str(tmp_path / workers), "--workers", workers]
        assert main(command) == 1
        found = json.loads((tmp_path / workers / "gates.json").read_text())["gates"]
        rows.append([{key: row[key] for key in row if key != "seconds"} for row in found])
    assert rows[0] == rows[1] and [row["status"] for row in rows[0]] == ["PASS", "FAIL"]
    assert main([*command[:-1], "0"]) == 2
    assert "--workers" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "key"),
    [
        ("", "format"),
        (HEAD + "gates = 1", "gates"),
        (HEAD + "gate = 1", "gate"),
        (HEAD + '[[gate]]\nclaim = "c"\nmeasure = "guess"\nfigure = "x"', "measure"),
        (HEAD + '[[gate]]\nclaim = "c"\nmeasure = "identify"\nfigure = "x"', "campaign"),
        (HEAD + '[[gate]]\nclaim = "c"\nmeasure = "selfcheck"\nfigure = "x"', "bounds"),
        (HEAD + '[[gate]]\nclaim = "c"\nmeasure = "selfcheck"\nfigure = 1\nbelow = 1', "figure"),
        (HEAD + '[[gate]]\nclaim = "c"\nmeasure = "selfcheck"\nfigure = "x"\nbelow = "1"', "below"),
        (HEAD + RESULT + 'figure = "x"\nbelow = 1\nband = [1, 2]', "band"),
        (HEAD + RESULT + 'figure = "x"\nbelow = 1\noptional = 1', "optional"),
        (HEAD + RESULT.replace("result.json", "{made}/b/r.json") + 'figure = "x"\nbelow = 1', "nothing makes it"),
        (HEAD + RESULT.replace("result.json", "{data}/r.json") + 'figure = "x"\nbelow = 1', "no such place"),
        (HEAD + '[places]\ndata = "x"', "places.data"),
        (HEAD + '[[make]]\nname = "../x"\ncommand = "a"', "name"),
        (HEAD + '[[make]]\nname = "x"\ncommand = "simulate --out y"', "does not write"),
        (HEAD + '[[make]]\nname = "x"\ncommand = "predict {made}/y --out {made}/x"', "reorder"),
    ],
)
def test_a_bad_gates_file_is_refused_with_its_key(tmp_path, text, key):
    """One line that names file and key."""
    path = tmp_path / "gates.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=key) as refusal:
        read_gates(path)
    assert "gates.toml" in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_the_projects_own_gates_are_sound():
    """They parse, every claim has its own words, and those on what may be absent are optional."""
    file = read_gates(ROOT / "gates.toml")
    assert len({one.claim for one in file.gates}) == len(file.gates) >= 25
    away = {make.name for make in file.makes if make.needs}
    for one in file.gates:
        reads = " ".join(str(value) for value in (one.campaign, one.file, one.model))
        assert one.optional == (any(f"{{made}}/{name}" in reads for name in away) or "docs/proof" in reads)
    assert {one.group for one in file.gates} >= set(mutations.GROUPS)
    assert Make(name="a", command=("b",)).needs is None


def test_every_mutation_still_applies(tmp_path):
    """Each breaks exactly one place of the present source, and there are at least twelve."""
    root = mutations.copy_package(tmp_path)
    texts = {one.what: mutations.broken(root, one) for one in mutations.MUTATIONS}
    assert len(texts) == len(mutations.MUTATIONS) >= 12
    for one in mutations.MUTATIONS:
        assert texts[one.what] != (root / one.file).read_text()
        compile(texts[one.what], one.file, "exec")
    with pytest.raises(InputError, match="0 times"):
        mutations.broken(
            root, mutations.Mutation(what="stale", file="cli.py", old="no such code", new="", group="arm")
        )


@pytest.mark.slow
def test_every_mutation_turns_a_gate_red(tmp_path):
    """And the unbroken source none. About ten minutes."""
    assert mutations.main([str(ROOT / "gates.toml"), "--out", str(tmp_path)]) == 0
