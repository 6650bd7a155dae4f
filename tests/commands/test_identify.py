"""identify writes what it promises, prints machine-readable JSON, and refuses wrong options in one line."""

import json
from pathlib import Path

import numpy as np
import pytest

from jointscope.cli import main
from jointscope.experiments.recovery_truth import Bench, draw_pulses, record
from jointscope.identification.model_file import read_model
from jointscope.recordings.campaign import Campaign, Channel, Nameplate, Run, Stream
from jointscope.recordings.writer import write_campaign


@pytest.fixture(scope="module")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Path:
    rng, bench, runs = np.random.default_rng(0), Bench(), []
    for number, pulse in enumerate(draw_pulses(rng, 8)):
        force, acc = record(bench, pulse)
        channels = (
            Channel(column="f", quantity="force", unit="N", location="arm", role="input", radius=bench.hammer_radius,
                    samples=force + 0.005 * force.max() * rng.standard_normal(force.size)),
            Channel(column="a", quantity="linear-acceleration", unit="m/s^2", location="arm", role="output",
                    radius=bench.accelerometer_radius,
                    samples=acc + 0.01 * np.abs(acc).max() * rng.standard_normal(acc.size)),
        )  # fmt: skip
        stream = Stream(file=f"h{number}.npz", sampling_rate=bench.rate, length=force.size, channels=channels)
        runs.append(Run(id=f"h{number}", experiment="hammer", brake=True, streams=(stream,)))
    rig = Nameplate(topology="two-inertia", motion="rotational", load_damping=2.0)
    path = tmp_path_factory.mktemp("identify") / "bench"
    return write_campaign(Campaign(path=path, rig=rig, runs=tuple(runs)), path, file_format="npz") or path


def test_it_writes_json_model_and_page(campaign: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["identify", str(campaign), "--out", str(tmp_path / "out"), "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed == json.loads((tmp_path / "out" / "identification.json").read_text())
    assert printed["parameters"]["stiffness"]["value"] == pytest.approx(193_665, rel=0.01)
    assert read_model(tmp_path / "out" / "model.json").joint["load_inertia"] == pytest.approx(3.02, rel=0.01)
    page = (tmp_path / "out" / "report.html").read_text()
    assert "stiffness" in page and "<svg" in page


def test_a_band_that_is_none_is_refused(
    campaign: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["identify", str(campaign), "--out", str(tmp_path / "out"), "--band", "50", "2"]) == 2
    assert "--band" in capsys.readouterr().err
