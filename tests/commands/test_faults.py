"""A full disk, no permission, Ctrl-C, a killed worker, no display: one line, the right exit code, nothing half-written."""

import contextlib
import json
import multiprocessing
import os
import pickle
import resource
import signal
import subprocess
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from jointscope.cli import main
from jointscope.errors import CampaignError, RefusedError
from jointscope.models.parameters import ParameterError
from jointscope.sim.concealed import production

STUDY = """format = "jointscope-sensitivity/1"
method = "{method}"
samples = 256
[parameters]
stiffness = {{ relative = 0.2 }}
damping = {{ relative = 0.5 }}
"""


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    """Two hits and the model from them."""
    folder = tmp_path_factory.mktemp("bench")
    words = "simulate single-joint --experiments hammer --hits 2 --hit-levels 250".split()
    assert main([*words, "--out", str(folder / "campaign")]) == 0
    assert main(["identify", str(folder / "campaign"), "--out", str(folder / "id"), "--no-pictures"]) == 0
    (folder / "study.toml").write_text(STUDY.format(method="local"))
    return folder


@pytest.fixture(autouse=True)
def listening():
    """Python's own answer to Ctrl-C, also where the tests run in the background, which ignores it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def words_of(command, bench, out):
    campaign = str(bench / "campaign")
    return {
        "identify": ["identify", campaign, "--out", out],
        "predict": ["predict", str(bench / "id" / "model.json"), campaign, "--out", out, "--no-pictures"],
        "diagnose": ["diagnose", campaign, "--out", out],
        "sensitivity": ["sensitivity", str(bench / "study.toml"), "--out", out, "--workers", "1"],
        "simulate": ["simulate", "single-joint", "--experiments", "hammer", "--hits", "1", "--out", out],
        "conceal": [
            "conceal",
            "--seed",
            "5",
            "--cases",
            "1",
            "--draw",
            "development",
            "--workers",
            "1",
            "--out",
            out,
        ],
    }[command]


@contextlib.contextmanager
def full_disk(size):
    """No file may grow beyond ``size`` bytes: what a full disk does, by the system's own means."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def one_line(captured, command):
    """The one line that a command's refusal is."""
    lines = [line for line in captured.err.splitlines() if line.startswith(f"jointscope {command}: ")]
    assert len(lines) == 1, captured.err
    assert "Traceback" not in captured.err
    return lines[0]


def nothing_half_written(folder):
    for path in folder.rglob("*") if folder.exists() else ():
        assert ".tmp" not in path.name, path
        if path.suffix == ".json":
            json.loads(path.read_text())
        if path.suffix == ".npy":
            np.load(path)


@pytest.mark.parametrize("command", ["identify", "predict", "sensitivity", "simulate"])
def test_a_full_disk_is_said_with_the_files_name(command, bench, tmp_path, capsys):
    """Exit code 2; what is in the folder afterwards is whole. Run once before, so that compiled code is in its cache."""
    assert main(words_of(command, bench, str(tmp_path / "first"))) == 0
    capsys.readouterr()
    with full_disk(3000):
        code = main(words_of(command, bench, str(tmp_path / "out")))
    assert code == 2
    line = one_line(capsys.readouterr(), command)
    assert str(tmp_path / "out") in line and "too large" in line
    nothing_half_written(tmp_path)
    assert command != "simulate" or not (tmp_path / "out").exists()


@pytest.mark.slow
@pytest.mark.parametrize("command", ["diagnose", "conceal"])
def test_a_full_disk_is_said_by_the_slow_ones_too(command, bench, tmp_path, capsys):
    with full_disk(3000):
        assert main(words_of(command, bench, str(tmp_path / "out"))) == 2
    assert "too large" in one_line(capsys.readouterr(), command)
    nothing_half_written(tmp_path)


@pytest.mark.parametrize("command", ["identify", "predict", "sensitivity", "simulate"])
def test_no_permission_is_said_with_the_folders_name(command, bench, tmp_path, capsys):
    """A folder that can't be made is a line; a user who may write everywhere gets there by a file in the way."""
    (tmp_path / "locked").mkdir()
    if os.geteuid() == 0:
        (tmp_path / "locked" / "out").write_text("a file where a folder should be")
    else:
        (tmp_path / "locked").chmod(0o500)
    assert main(words_of(command, bench, str(tmp_path / "locked" / "out"))) == 2
    assert str(tmp_path / "locked") in one_line(capsys.readouterr(), command)


@pytest.mark.parametrize("command", ["identify", "predict", "diagnose"])
def test_a_campaign_that_may_not_be_read_is_said(command, bench, tmp_path, capsys, monkeypatch):
    """The system's own words, the file's name."""

    def refuse(path, *args, **kwargs):
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(Path, "read_text", refuse)
    assert main([*words_of(command, bench, str(tmp_path / "out"))]) == 2
    assert "ermission denied" in one_line(capsys.readouterr(), command)


INTERRUPTED = {
    "identify": "jointscope.identification.identify.identify",
    "predict": "jointscope.prediction.files.write_run",
    "diagnose": "jointscope.diagnosis.prepare.prepare",
    "sensitivity": "jointscope.experiments.sensitivity.figures.bars",
    "simulate": "jointscope.sim.single_joint.draw_hit",
    "conceal": "jointscope.sim.concealed.production.make_case",
}


@pytest.mark.parametrize("command", INTERRUPTED)
def test_an_interrupt_is_one_line_and_130(command, bench, tmp_path, capsys, monkeypatch):
    """Ctrl-C in the middle of the work, as the signal that it is."""

    def interrupt(*args, **kwargs):
        signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(INTERRUPTED[command], interrupt)
    assert main(words_of(command, bench, str(tmp_path / "out"))) == 130
    assert "interrupted" in one_line(capsys.readouterr(), command)
    nothing_half_written(tmp_path)


def test_an_interrupted_pool_drops_what_waits(monkeypatch):
    """Ctrl-C during a diagnosis does not first work off everything that was handed out."""
    from jointscope.commands.diagnose import _threads

    begun = []
    with pytest.raises(KeyboardInterrupt), _threads(1) as pool:
        for number in range(100):
            pool.submit(lambda number=number: (begun.append(number), time.sleep(0.05)))
        signal.raise_signal(signal.SIGINT)
    time.sleep(0.2)
    assert len(begun) < 20


def test_an_interrupted_study_goes_on_to_the_same_numbers(bench, tmp_path, monkeypatch):
    """Blocks that were finished are not evaluated again."""
    from jointscope.experiments.sensitivity import evaluate

    (tmp_path / "study.toml").write_text(STUDY.format(method="sobol"))
    words = ["sensitivity", str(tmp_path / "study.toml"), "--workers", "1", "--out"]
    whole, calls = evaluate.evaluate_block, []

    def third_interrupts(study, block):
        calls.append(len(block))
        if len(calls) == 3:
            signal.raise_signal(signal.SIGINT)
        return whole(study, block)

    monkeypatch.setattr(evaluate, "evaluate_block", third_interrupts)
    assert main([*words, str(tmp_path / "a")]) == 130
    assert len(list((tmp_path / "a" / "blocks").glob("*.npy"))) == 2
    assert main([*words, str(tmp_path / "a")]) == 0
    assert main([*words, str(tmp_path / "b")]) == 0
    assert len(calls) == 3 + 6 + 8
    first, second = (json.loads((tmp_path / name / "sensitivity.json").read_text()) for name in "ab")
    assert first == second


def test_errors_reach_another_process_whole():
    """A worker's refusal arrives as what it was, with its line and its attributes."""
    for problem in (
        CampaignError("a.toml", "rig.x", "missing", value=3, fix="add it"),
        ParameterError("Joint", "stiffness", -1.0, "positive"),
        RefusedError("no\nhits \x1b[31m"),
    ):
        other = pickle.loads(pickle.dumps(problem))
        assert (type(other), str(other), vars(other)) == (type(problem), str(problem), vars(problem))
        assert "\n" not in str(other) and str(other).isprintable()


def test_a_killed_worker_of_a_study_is_a_line_and_a_second_try_finishes(bench, tmp_path, capsys, monkeypatch):
    """The pool's processes die with SIGKILL, as the system's memory guard does it."""
    from jointscope.experiments.sensitivity import evaluate

    whole = evaluate.evaluate_block

    def die(study, block):
        os.kill(os.getpid(), signal.SIGKILL)

    (tmp_path / "study.toml").write_text(STUDY.format(method="sobol"))
    words = ["sensitivity", str(tmp_path / "study.toml"), "--workers", "2", "--out", str(tmp_path / "out")]
    monkeypatch.setattr(evaluate, "evaluate_block", die)
    assert main(words) == 2
    assert "killed" in one_line(capsys.readouterr(), "sensitivity")
    nothing_half_written(tmp_path)
    monkeypatch.setattr(evaluate, "evaluate_block", whole)
    words[words.index("2")] = "1"
    assert main(words) == 0


def test_a_killed_worker_of_any_pool_is_a_line(bench, capsys, monkeypatch):
    """Also where a command has no word of its own for it."""

    def run(options):
        with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
            return pool.submit(os._exit, 9).result()

    monkeypatch.setattr("jointscope.commands.inspect.run", run)
    assert main(["inspect", str(bench / "campaign")]) == 2
    assert "killed" in one_line(capsys.readouterr(), "inspect")


def test_a_case_that_can_not_be_made_is_a_line(bench, tmp_path, capsys, monkeypatch):
    """A draw names the case and keeps the others."""

    def fail(order, index, directory):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(production, "make_case", fail)
    assert main(words_of("conceal", bench, str(tmp_path / "out"))) == 2
    assert "No space left" in one_line(capsys.readouterr(), "conceal")
    nothing_half_written(tmp_path)


def test_a_full_device_behind_the_output_is_a_line(bench):
    """Output that can't be written is said once, and not again when Python ends."""
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "jointscope", "inspect", str(bench / "campaign")],
            stdout=full, stderr=subprocess.PIPE, text=True, check=False,
        )  # fmt: skip
    assert done.returncode == 2
    assert done.stderr.strip() == "jointscope inspect: No space left on device"


def test_without_a_display_or_gl_everything_still_runs(bench, tmp_path):
    """Nothing renders: neither MuJoCo's choice of GL nor a display is asked for, pictures included."""
    environment = {key: value for key, value in os.environ.items() if key not in ("DISPLAY", "WAYLAND_DISPLAY")}
    environment |= {
        "MUJOCO_GL": "egl",
        "PYOPENGL_PLATFORM": "none such",
        "MPLBACKEND": "TkAgg",
        "OMP_NUM_THREADS": "1",
    }
    for words in (["simulate", "single-joint", "--experiments", "hammer", "--hits", "1", "--hit-levels", "250"],
                  ["identify", str(bench / "campaign")]):  # fmt: skip
        done = subprocess.run(
            [sys.executable, "-m", "jointscope", *words, "--out", str(tmp_path / words[0])],
            env=environment, capture_output=True, text=True, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
    assert (tmp_path / "identify" / "report.html").exists()
