"""The example of a user's own repository: its workflow's steps, run as the service would, are green, and red when broken."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

ROOT = Path(__file__).resolve().parents[2]
EXAMPLE = ROOT / "docs" / "examples" / "gate-your-simulator"
WORKFLOW = ".github/workflows/simulator-gates.yml"
CAMPAIGN = "jointscope simulate single-joint"


def steps(text):
    """(name, command, whether it runs after a failure) of every ``run`` step; the file is flat enough to be read so."""
    found = []
    for step in re.split(r"\n\s*\n", text[text.index("steps:") :]):
        run = re.search(r"^\s+run: (.+)$", step, re.MULTILINE)
        name = re.search(r"^\s+- name: (.+)$", step, re.MULTILINE)
        if run and name:
            found.append((name[1], run[1], "if: always()" in step))
    return found


def run_job(folder):
    """The job as a service runs it: each step in ``bash -e``; after a failure only those marked ``always()``."""
    summary = folder / "step-summary.md"
    environment = {
        **os.environ, "GITHUB_STEP_SUMMARY": str(summary), "OMP_NUM_THREADS": "1",
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
    }  # fmt: skip
    failed = None
    for name, command, always in steps((folder / WORKFLOW).read_text()):
        if name.startswith("Install") or (failed and not always):
            continue
        done = subprocess.run(
            ["bash", "-e", "-o", "pipefail", "-c", command],
            cwd=folder,
            env=environment,
            capture_output=True,
            text=True,
        )
        assert "Traceback" not in done.stderr, done.stderr
        if done.returncode and failed is None:
            failed = name
    return failed, summary.read_text() if summary.exists() else ""


@pytest.fixture(scope="module")
def repository(tmp_path_factory):
    """The example with the campaign that its README makes."""
    folder = tmp_path_factory.mktemp("user") / "repository"
    shutil.copytree(EXAMPLE, folder)
    command = next(line.strip() for line in (folder / "README.md").read_text().splitlines() if CAMPAIGN in line)
    done = subprocess.run(
        [sys.executable, "-m", "jointscope", *command.split()[1:]],
        cwd=folder, env={**os.environ, "OMP_NUM_THREADS": "1"}, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return folder


def gates(folder):
    return json.loads((folder / "gates" / "gates.json").read_text())


def test_the_workflow_installs_then_checks_then_gates():
    """The one step that is not run here does nothing but install."""
    found = steps((EXAMPLE / WORKFLOW).read_text())
    assert next(name for name, _, _ in found) == "Install jointscope"
    assert found[0][1].startswith("python -m pip install ")
    assert len(found) == 4 and found[-1][2]


def test_the_job_is_green_on_the_robot_as_it_is(repository):
    """Every claim passes; the summary and the XML say the same."""
    failed, summary = run_job(repository)
    assert failed is None, summary
    result = gates(repository)
    assert result["passed"] and {row["status"] for row in result["gates"]} == {"PASS"}
    suite = ElementTree.parse(repository / "gates" / "junit.xml").getroot()
    assert (suite.get("tests"), suite.get("failures")) == (str(len(result["gates"])), "0")
    assert f"{len(result['gates'])} PASS, 0 FAIL" in summary


@pytest.mark.parametrize(
    ("old", "new", "step", "claims"),
    [
        ('stiffness="193665"', 'stiffness="203348"', "Gates", ("within 1 dB", "FRAC")),
        ('armature="9.105498"', 'armature="9.105498" frictionloss="3"', "Gates", ("left out",)),
        ('armature="9.105498"', 'armature="0.000458"', "Model and nameplate belong together", ()),
    ],
    ids=["stiffness 5 % high", "friction nobody predicts", "armature on the shaft"],
)
def test_the_job_is_red_on_a_broken_robot(repository, tmp_path, old, new, step, claims):
    """The broken step is the one that sees it, the summary is written all the same."""
    folder = tmp_path / "repository"
    shutil.copytree(repository, folder, ignore=shutil.ignore_patterns("gates", "step-summary.md"))
    text = (folder / "robot.xml").read_text()
    assert text.count(old) == 1
    (folder / "robot.xml").write_text(text.replace(old, new))
    failed, summary = run_job(folder)
    assert failed == step
    red = [row["claim"] for row in gates(folder)["gates"] if row["status"] != "PASS"] if claims else []
    for words in claims:
        assert any(words in claim for claim in red), summary
    assert not claims or "**FAIL**" in summary


@pytest.mark.parametrize(("old", "new"), [('gear="98.7"', 'gear="-98.7"'), ('damping="61.8"', 'damping="30"')])
@pytest.mark.slow
def test_the_job_is_red_on_more_breakages(repository, tmp_path, old, new):
    """A reversed actuator, a damping that is half."""
    test_the_job_is_red_on_a_broken_robot(repository, tmp_path, old, new, "Gates", ("within 1 dB",))


def test_the_job_is_red_without_the_recording(repository, tmp_path):
    """What was not tested is not passed."""
    folder = tmp_path / "repository"
    shutil.copytree(repository, folder, ignore=shutil.ignore_patterns("gates", "campaigns"))
    assert run_job(folder)[0] == "Model and nameplate belong together"
    done = subprocess.run(
        [sys.executable, "-m", "jointscope", "gate", "gates.toml", "--out", "gates"],
        cwd=folder, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 1 and "Nothing was tested" in done.stdout
