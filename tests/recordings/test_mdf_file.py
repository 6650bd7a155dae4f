"""MDF files: each group on its own clock, units and invalid samples as the file says."""

import importlib.util
import sys

import numpy as np
import pytest

from jointscope.cli import main
from jointscope.errors import CampaignError, MissingExtraError
from jointscope.recordings.files import open_data_file
from jointscope.recordings.reader import read_campaign

needs_asammdf = pytest.mark.skipif(
    importlib.util.find_spec("asammdf") is None, reason="the extra [mdf] is not installed"
)


def write(path, groups):
    """groups: (name, rate [Hz], start [s], {channel: (values, unit)})."""
    from asammdf import MDF, Signal

    with MDF(version="4.10" if path.suffix == ".mf4" else "3.30") as mdf:
        for name, rate, start, channels in groups:
            signals = [
                Signal(
                    samples=values, timestamps=start + np.arange(len(values)) / rate, name=channel, unit=unit,
                    encoding="utf-8" if values.dtype.kind == "S" else None,
                )
                for channel, (values, unit) in channels.items()
            ]  # fmt: skip
            mdf.append(signals, acq_name=name, common_timebase=True)
        mdf.save(path, overwrite=True)
    return path


def bench():
    t, rng = np.arange(2000) / 1000.0, np.random.default_rng(1)
    drive = {
        "motor_torque": (np.sin(2 * np.pi * 5 * t), "Nm"),
        "motor_angle": (0.1 * np.cos(2 * np.pi * 5 * t), "deg"),
    }
    sensor = {"arm_acc": (rng.normal(size=900), "m/s^2"), "state": (np.array(["on"] * 900, dtype="S2"), "")}
    return [("drive", 1000.0, 0.0, drive), ("daq", 500.0, 0.125, sensor)]


@needs_asammdf
@pytest.mark.parametrize("suffix", ["mf4", "mdf"])
def test_channels_come_back_with_their_units_and_clocks(tmp_path, suffix):
    groups = bench()
    data = open_data_file(write(tmp_path / f"take.{suffix}", groups))
    names = [name.split("/")[0] for name in data.columns]
    first, second = dict.fromkeys(names)
    torque = data.columns[f"{first}/motor_torque"]
    assert torque.unit == "Nm" and torque.clock == f"{first}/time" and torque.length == 2000
    np.testing.assert_allclose(torque.read(), groups[0][3]["motor_torque"][0])
    np.testing.assert_allclose(data.columns[f"{second}/time"].read(), 0.125 + np.arange(900) / 500.0)
    assert f"{second}/state" not in data.columns  # text is no signal


@needs_asammdf
def test_groups_become_streams_of_one_run(tmp_path):
    path = write(tmp_path / "take.mf4", bench())
    assert main(["new", str(path), "--yes", "--out", str(tmp_path / "c")]) == 0
    (run,) = read_campaign(tmp_path / "c").runs
    assert run.experiment == "torque-sweep"
    assert sorted((s.sampling_rate, round(s.start, 6)) for s in run.streams) == [(500.0, 0.125), (1000.0, 0.0)]
    (angle,) = run.select("angle")
    assert angle.channel.unit == "deg" and np.abs(angle.samples).max() == pytest.approx(np.deg2rad(0.1))


@needs_asammdf
def test_invalid_samples_are_missing_ones(tmp_path):
    from asammdf import MDF, Signal

    values, invalid = np.arange(100.0), np.zeros(100, dtype=bool)
    invalid[[3, 50]] = True
    t = np.arange(100) / 100.0
    with MDF(version="4.10") as mdf:
        mdf.append([Signal(samples=values, timestamps=t, name="acc", unit="m/s^2", invalidation_bits=invalid)])
        mdf.save(tmp_path / "x.mf4")
    (column,) = (c for c in open_data_file(tmp_path / "x.mf4").columns.values() if c.name.endswith("/acc"))
    assert column.length == 100
    assert np.flatnonzero(np.isnan(column.read())).tolist() == [3, 50]


@needs_asammdf
def test_what_is_no_mdf_is_one_line(tmp_path):
    (tmp_path / "x.mf4").write_bytes(b"not a measurement" * 20)
    with pytest.raises(CampaignError, match=r"x\.mf4"):
        open_data_file(tmp_path / "x.mf4")


def test_without_the_extra_the_message_is_the_command_that_installs_it(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "asammdf", None)
    (tmp_path / "x.mf4").write_bytes(b"MDF     ")
    with pytest.raises(MissingExtraError, match=r"pip install 'jointscope\[mdf\]'"):
        open_data_file(tmp_path / "x.mf4")
