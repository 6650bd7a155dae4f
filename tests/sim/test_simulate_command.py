"""``jointscope simulate single-joint`` writes a campaign that reads back as it was simulated."""

import json

import numpy as np
import pytest

from jointscope.cli import main
from jointscope.recordings.reader import read_campaign

QUICK = ["simulate", "single-joint", "--experiments", "hammer", "--hits", "1", "--hit-levels", "150"]


def test_written_campaign_reads_back(tmp_path, capsys):
    """Every channel survives the disk, and the seed decides the samples."""
    for name, seed in (("a", "7"), ("b", "7"), ("c", "8")):
        assert main([*QUICK, "--out", str(tmp_path / name), "--seed", seed, "--json"]) == 0
    assert json.loads(capsys.readouterr().out.splitlines()[0])["runs"] == ["hammer-level1-01"]
    a, b, c = (read_campaign(tmp_path / name).runs[0] for name in "abc")
    assert a.brake and a.experiment == "hammer"
    for same, other, different in zip(a.signals, b.signals, c.signals, strict=True):
        assert np.array_equal(same.samples, other.samples)
        assert not np.array_equal(same.samples, different.samples)


def test_truth_is_not_in_the_campaign(tmp_path):
    """No file names the stiffness, damping or inertia that was simulated."""
    truth = ["--stiffness", "187654.5", "--damping", "51.2345", "--inertia", "3.23456"]
    assert main([*QUICK, *truth, "--out", str(tmp_path / "rig")]) == 0
    text = "".join(path.read_text() for path in (tmp_path / "rig").iterdir())
    assert not any(figure in text for figure in truth[1::2])


@pytest.mark.parametrize(
    ("words", "names"),
    [(["--hits", "0"], "hammer"), (["--stiffness", "-3"], "stiffness"), (["--seed", "-1"], "--seed")],
)
def test_impossible_options_are_one_line(tmp_path, capsys, words, names):
    """Exit code 2 and the option's name; nothing is written."""
    assert main([*QUICK, *words, "--out", str(tmp_path / "x")]) == 2
    error = capsys.readouterr().err
    assert names in error and error.count("\n") == 1
    assert not (tmp_path / "x").exists()


def test_an_existing_campaign_is_not_overwritten(tmp_path, capsys):
    """The error names the folder before anything is simulated."""
    (tmp_path / "x").mkdir()
    (tmp_path / "x" / "keep").write_text("mine")
    assert main([*QUICK, "--out", str(tmp_path / "x")]) == 2
    assert "exists already" in capsys.readouterr().err
