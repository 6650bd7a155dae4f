"""Killing a worker or the driver loses at most the case in flight; what is resumed agrees with what was never stopped."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from jointscope.experiments.prove import diagnosing
from jointscope.experiments.prove.diagnosing import ANSWERS, diagnose_all

CASES = 5
posix = pytest.mark.skipif(os.name != "posix", reason="signals are sent")

# stands in for 'jointscope diagnose': answers with what it read, and says where it is at work
FAKE = """
import hashlib, json, os, sys, time
from pathlib import Path
campaign, out = Path(sys.argv[1]), Path(sys.argv[3])
log = Path(os.environ["FAKE_LOG"])
text = (campaign / "campaign.toml").read_text()
with log.open("a") as file:
    file.write(f"{os.getpid()} {text.strip()}\\n")
time.sleep(float(os.environ["FAKE_SECONDS"]))
out.mkdir(parents=True)
answer = {"verdict": "none", "effects": [], "verdict_probability": 0.5, "seen": hashlib.sha256(text.encode()).hexdigest()}
(out / "diagnosis.json").write_text(json.dumps(answer))
"""

# a driver of its own, to be killed
DRIVER = """
import sys
from pathlib import Path
from jointscope.experiments.prove import diagnosing
diagnosing.COMMAND = (sys.executable, "-S", sys.argv[1])
folder = Path(sys.argv[2])
diagnosing.diagnose_all(folder, Path(sys.argv[3]), diagnosing.cases_of(folder), workers=2, limit=60.0)
"""


@pytest.fixture
def stage(tmp_path, monkeypatch):
    """Stand-in campaigns, the fake explainer, and its log."""
    for i in range(CASES):
        (tmp_path / "draw" / f"case{i}").mkdir(parents=True)
        (tmp_path / "draw" / f"case{i}" / "campaign.toml").write_text(f"case = {i}\n")
    (tmp_path / "fake.py").write_text(FAKE)
    (tmp_path / "driver.py").write_text(DRIVER)
    monkeypatch.setattr(diagnosing, "COMMAND", (sys.executable, "-S", str(tmp_path / "fake.py")))
    monkeypatch.setenv("FAKE_LOG", str(tmp_path / "log"))
    monkeypatch.setenv("FAKE_SECONDS", "0")
    return tmp_path


def started(stage: Path) -> list[tuple[int, str]]:
    log = stage / "log"
    lines = log.read_text().splitlines() if log.exists() else []
    return [
        (int(line.split()[0]), line.split(maxsplit=1)[1]) for line in lines if line.endswith(tuple("0123456789"))
    ]


def until(condition, seconds: float = 120.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.02)


def said(answers) -> list[tuple[str, str, object]]:
    return [(a.case, a.status, a.diagnosis) for a in answers]


def names(stage: Path) -> list[str]:
    return diagnosing.cases_of(stage / "draw")


@posix
def test_a_killed_driver_is_resumed_to_the_same_result(stage, monkeypatch):
    """SIGKILL in the middle: finished cases are not diagnosed again, and the answers are those of one go."""
    whole = said(diagnose_all(stage / "draw", stage / "whole", names(stage), workers=2, limit=60.0))
    (stage / "log").unlink()
    monkeypatch.setenv("FAKE_SECONDS", "0.4")
    words = [
        sys.executable,
        str(stage / "driver.py"),
        str(stage / "fake.py"),
        str(stage / "draw"),
        str(stage / "out"),
    ]
    driver = subprocess.Popen(words, start_new_session=True)
    kept = stage / "out" / ANSWERS
    until(lambda: kept.is_dir() and len(list(kept.glob("*.json"))) >= 2)
    os.killpg(driver.pid, signal.SIGKILL)
    driver.wait()
    finished = {file.stem for file in kept.glob("*.json")}
    assert 2 <= len(finished) < CASES
    (stage / "log").unlink()
    monkeypatch.setenv("FAKE_SECONDS", "0")
    assert said(diagnose_all(stage / "draw", stage / "out", names(stage), workers=1, limit=60.0)) == whole
    again = {f"case{line.split()[-1]}" for _, line in started(stage)}
    assert not again & finished


@posix
def test_a_killed_worker_costs_its_own_case_a_second_try_and_nothing_else(stage, monkeypatch):
    """SIGKILL to one explainer: its case is diagnosed once more, every answer is as if nothing had happened."""
    whole = said(diagnose_all(stage / "draw", stage / "whole", names(stage), workers=2, limit=60.0))
    (stage / "log").unlink()
    monkeypatch.setenv("FAKE_SECONDS", "0.4")
    words = [
        sys.executable,
        str(stage / "driver.py"),
        str(stage / "fake.py"),
        str(stage / "draw"),
        str(stage / "out"),
    ]
    driver = subprocess.Popen(words)
    until(lambda: len(started(stage)) >= 1)
    pid, case = started(stage)[0]
    os.kill(pid, signal.SIGKILL)
    assert driver.wait(timeout=120.0) == 0
    answers = [diagnosing.load(stage / "out", name) for name in names(stage)]
    assert said(answers) == whole
    assert [line for _, line in started(stage)].count(case) == 2


@posix
def test_an_explainer_that_always_dies_is_a_wrong_answer(stage):
    """Killed twice is a crash."""
    (stage / "fake.py").write_text("import os, signal\nos.kill(os.getpid(), signal.SIGKILL)\n")
    answers = diagnose_all(stage / "draw", stage / "out", ["case0"], workers=1, limit=60.0)
    assert (answers[0].status, answers[0].diagnosis) == ("crashed", None)
    assert "exit code -9" in answers[0].message


def test_half_an_answer_is_no_answer(stage):
    """A file that another process left behind half-written under another name is not taken for an answer."""
    kept = stage / "out" / ANSWERS
    kept.mkdir(parents=True)
    (kept / ".case0.json.part").write_text('{"case": "case0", ')
    answers = diagnose_all(stage / "draw", stage / "out", ["case0"], workers=1, limit=60.0)
    assert answers[0].status == "answered"


@pytest.mark.filterwarnings("ignore")
def test_a_cluster_gives_the_same_answers(stage):
    """Through a Dask scheduler on the loopback address: the same answers as from local processes."""
    distributed = pytest.importorskip("distributed")
    whole = said(diagnose_all(stage / "draw", stage / "whole", names(stage), workers=2, limit=60.0))
    cluster = distributed.LocalCluster(
        n_workers=2,
        threads_per_worker=1,
        processes=False,
        protocol="tcp://",
        host="127.0.0.1",
        dashboard_address=None,
    )
    with cluster:
        found = diagnose_all(
            stage / "draw",
            stage / "cluster",
            names(stage),
            workers=1,
            limit=60.0,
            scheduler=cluster.scheduler_address,
        )
    assert said(found) == whole
    assert json.loads((stage / "cluster" / ANSWERS / "case3.json").read_text())["case"] == "case3"
