"""The command on a simulated bench: quiet on a clean one, and the mistakes planted in it named before any fit."""

import json
import math

import pytest

from jointscope.cli import main


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    out = tmp_path_factory.mktemp("bench") / "c"
    words = ["--hits", "3", "--repeats", "1", "--hit-levels", "150", "--sweep-levels", "0.6", "--travels", "60"]
    assert main(["simulate", "single-joint", "--out", str(out), "--seed", "3", *words]) == 0
    return out


def altered(bench, folder, edit):
    """A copy of the campaign with every channel's line passed through ``edit``."""
    import shutil

    shutil.copytree(bench, folder)
    file = folder / "campaign.toml"
    file.write_text("\n".join(edit(line) for line in file.read_text().splitlines()) + "\n")
    return folder


def inspected(campaign, capsys):
    capsys.readouterr()
    assert main(["inspect", str(campaign), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_a_clean_simulated_bench_has_no_findings(bench, capsys):
    answer = inspected(bench, capsys)
    assert answer["quality"] == []
    assert answer["format"] == "jointscope-inspection/1"
    channel = answer["runs"][0]["channels"][0]
    assert channel["quantity"] == "force" and channel["peak"] > 50.0 and channel["unit"] == "N"


PLANTED = {
    # a drive logs permille of its rated 1.3 N m, and the channel is declared in N m
    "torque in permille": ('quantity = "torque", unit = "N m"', 1000.0 / 1.3, "suspicious-unit", "torque"),
    "accelerometer reversed": ('unit = "m/s^2"', -1.0, "inverted-polarity", "linear-acceleration"),
    "degrees for radians": ('quantity = "angle", unit = "rad"', 180.0 / math.pi, "suspicious-unit", "angle"),
}


@pytest.mark.parametrize("mistake", PLANTED)
def test_a_planted_mistake_is_named_in_every_run_it_is_in(bench, tmp_path, capsys, mistake):
    text, factor, finding, quantity = PLANTED[mistake]
    wrong = text.split("unit")[0] + f'unit = "1", scale = {factor!r}'
    campaign = altered(bench, tmp_path / "c", lambda line: line.replace(text, wrong))
    answer = inspected(campaign, capsys)
    has = {
        (finding, run["id"], channel["column"])
        for run in answer["runs"]
        for channel in run["channels"]
        if channel["quantity"] == quantity
    }
    assert {(q["finding"], q["run"], q["channel"]) for q in answer["quality"]} == has
    assert all(set(q) >= {"finding", "run", "channel", "detail", "toml"} for q in answer["quality"])


def test_the_plain_text_groups_findings_and_gives_the_line_to_paste(bench, tmp_path, capsys):
    text, factor, *_ = PLANTED["accelerometer reversed"]
    campaign = altered(bench, tmp_path / "c", lambda line: line.replace(text, f'unit = "1", scale = {factor!r}'))
    assert main(["inspect", str(campaign)]) == 0
    out = capsys.readouterr().out
    assert "1 finding:" in out
    assert "inverted-polarity acceleration" in out
    assert 'paste: { column = "acceleration", quantity = "linear-acceleration", unit = "m/s^2"' in out


def test_outputs_may_be_absent(bench, tmp_path, capsys):
    campaign = altered(bench, tmp_path / "c", lambda line: line.replace('"motor_angle"', '"motor_angle_2"'))
    answer = inspected(campaign, capsys)
    absent = [c for run in answer["runs"] for c in run["channels"] if not c["recorded"]]
    assert absent and all("peak" not in channel for channel in absent)


def test_no_campaign_is_one_line(tmp_path, capsys):
    assert main(["inspect", str(tmp_path)]) == 2
    assert "campaign.toml" in capsys.readouterr().err
