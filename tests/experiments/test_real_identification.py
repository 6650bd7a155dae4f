"""Real recordings: the second take is described by what the first one gave. Needs the public sets in JOINTSCOPE_DATA."""

import os
from pathlib import Path

import numpy as np
import pytest

from jointscope.experiments.real_identification import predict_held_out_bench, predict_held_out_hit
from jointscope.recordings.reader import read_campaign

DATA = Path(os.environ.get("JOINTSCOPE_DATA", Path(__file__).resolve().parents[2].parent / "shared" / "data"))


def imported(name: str, files: str, folder: Path) -> Path:
    if not (DATA / name).is_dir():
        pytest.skip(f"{DATA / name} is absent: set JOINTSCOPE_DATA")
    from jointscope.cli import main

    assert main(["import", name, *map(str, sorted((DATA / name).glob(files))), "--out", str(folder)]) == 0
    return folder


def test_the_joint_fitted_to_the_first_multisine_predicts_the_second(tmp_path: Path) -> None:
    campaign = read_campaign(imported("motor-bench-flexcoupling", "*.mat", tmp_path / "bench"))
    motor, load = predict_held_out_bench(campaign)
    assert motor.own < 0.08 and motor.other < 0.07 and load.other < 0.08
    assert motor.other_median < 0.02


@pytest.mark.slow
def test_the_first_hit_predicts_the_second(tmp_path: Path) -> None:
    campaign = read_campaign(imported("hammer-lvm", "*.lvm", tmp_path / "lvm"))
    found, rows = predict_held_out_hit(campaign)
    frequency = np.array([mode.frequency.value for mode in found.modes])
    for expected, within in ((19.7, 0.2), (69, 2.0), (161, 1.5), (235, 1.5), (341, 2.0), (461, 2.0)):
        assert np.abs(frequency - expected).min() < within
    assert all(row.nrmse < 0.25 and row.frac > 0.95 for row in rows)
