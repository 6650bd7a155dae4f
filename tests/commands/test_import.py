"""The public sets become campaigns that can be read, and the faults known of them are found."""

import json
import os
from pathlib import Path

import pytest

from jointscope.cli import main
from jointscope.recordings.reader import read_campaign

DATA = Path(os.environ.get("JOINTSCOPE_DATA", Path(__file__).parents[2].parent / "shared" / "data"))


def imported(name, tmp_path, *words):
    if not (DATA / name).is_dir():
        pytest.skip(f"the public data set {name} is not in {DATA}; set JOINTSCOPE_DATA")
    out = tmp_path / name
    assert main(["import", name, str(DATA / name), "--out", str(out), *words]) == 0
    return out


def quality(campaign, capsys):
    capsys.readouterr()
    assert main(["inspect", str(campaign), "--json"]) == 0
    return {(q["finding"], q["run"], q["channel"]) for q in json.loads(capsys.readouterr().out)["quality"]}


def test_the_inverted_load_channel_of_the_motor_bench_is_found(tmp_path, capsys):
    out = imported("motor-bench-flexcoupling", tmp_path)
    faults = {"inverted-polarity": ("theta_my", "omega_may"), "lagging-speed": ("omega_max", "omega_may")}
    expected = {
        (fault, f"multisine-{run}", column)
        for fault, columns in faults.items()
        for column in columns
        for run in "AB"
    }
    assert quality(out, capsys) == expected
    assert [run.role for run in read_campaign(out).runs] == ["estimate", "validate"]
    assert read_campaign(out).runs[0].streams[0].length == 19 * 2500


def test_the_four_faults_of_the_hammer_record_are_found(tmp_path, capsys):
    found = quality(imported("hammer-lvm", tmp_path), capsys)
    for number in (1, 2):
        run = f"hit-{number}"
        force, sensors = f"{number}/F", [f"{number}/m_1", f"{number}/m_2"]
        for fault in ("offset", "suspicious-unit", "undersampled-pulse", "inverted-polarity"):
            assert (fault, run, force) in found
        assert {("offset", run, sensor) for sensor in sensors} <= found
    assert len(found) == 12


def test_emps_is_clean_and_its_force_is_in_newtons(tmp_path, capsys):
    out = imported("emps", tmp_path)
    assert quality(out, capsys) == set()
    campaign = read_campaign(out)
    force = campaign.runs[0].select("force")[0]
    assert force.channel.scale == pytest.approx(35.1507, abs=1e-4)
    assert campaign.rig.ground_spring is False


@pytest.mark.parametrize("axis", [1, 2, 3])
def test_every_axis_of_the_robot_is_clean_but_for_speeds_a_cycle_late(tmp_path, capsys, axis):
    out = imported("kr300-weigand2021", tmp_path, "--axis", str(axis))
    late = {("lagging-speed", f"trajectory-{run}", f"rec.act_vel_mot_deg_per_s[{axis - 1}]") for run in "ABC"}
    assert quality(out, capsys) == late
    run = read_campaign(out).runs[0]
    motor, arm = run.select("angle", location="motor")[0], run.select("angle", location="arm")[0]
    ratio = motor.samples.std() / arm.samples.std()
    assert ratio == pytest.approx(read_campaign(out).rig.reduction_ratio, rel=0.01)


def test_importers_write_no_effect_and_no_friction(tmp_path):
    """Only rig keys that a nameplate holds, and no damping among them."""
    for name in ("emps", "hammer-lvm", "motor-bench-flexcoupling", "kr300-weigand2021"):
        text = (imported(name, tmp_path) / "campaign.toml").read_text()
        assert not any(word in text for word in ("friction", "damping", "coulomb", "backlash"))


def test_an_unknown_set_a_missing_file_and_a_wrong_axis_are_refused_in_one_line(tmp_path, capsys):
    (tmp_path / "x.mat").write_bytes(b"")
    for words, named in (
        (["nosuch", str(tmp_path)], ["nosuch", "emps"]),
        (["emps", str(tmp_path / "x.mat")], ["DATA_EMPS.mat", "not among"]),
        (["emps", str(tmp_path), "--axis", "2"], ["axis", "2"]),
    ):
        assert main(["import", *words, "--out", str(tmp_path / "out")]) == 2
        line = capsys.readouterr().err.strip()
        assert "\n" not in line
        assert all(word in line for word in named)
    assert not (tmp_path / "out").exists()
