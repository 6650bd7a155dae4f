"""Every break of the format is refused with one line that names the file, the key and the value."""

import numpy as np
import pytest

from jointscope.errors import CampaignError
from jointscope.recordings.reader import read_campaign

FORCE = '{ column = "force", quantity = "force", unit = "N", location = "arm", radius = 0.8, role = "input" }'
ACC = 'quantity = "linear-acceleration", unit = "m/s^2", location = "arm", radius = 0.95'

# what is replaced, by what, and the words the one line must hold
TOML_BREAKS = {
    "format of another version": ("campaign/1", "campaign/9", ["format", "jointscope-campaign/9"]),
    "no TOML": ("[rig]", "[rig", ["campaign.toml", "not TOML"]),
    "unknown key of the rig": (
        "reduction_ratio",
        "reduction_ration",
        ["rig.reduction_ration", "141.0", "unknown"],
    ),
    "key of the rig in a run": (
        'experiment = "hammer"',
        'experiment = "hammer"\nground_spring = true',
        ["ground_spring", "True", "it belongs to [rig]"],
    ),
    "unknown key of a channel": (
        'column = "acc",',
        'column = "acc", units = "g",',
        ["units", "'g'", "channels[acc]"],
    ),
    "topology missing": ('topology = "two-inertia"', "", ["rig.topology", "missing"]),
    "topology unheard of": ('"two-inertia"', '"three-inertia"', ["rig.topology", "three-inertia"]),
    "motion missing": ('motion = "rotational"', "", ["rig.motion", "missing"]),
    "ratio as text": ("141.0", '"141"', ["rig.reduction_ratio", "'141'"]),
    "ratio below zero": ("141.0", "-141.0", ["rig.reduction_ratio", "-141.0", "positive"]),
    "rate of zero": ("1024.0", "0.0", ["sampling_rate", "0.0", "positive"]),
    "rate not a number": ("1024.0", "nan", ["sampling_rate", "nan"]),
    "arm angle missing": ("arm_angle = 0.0", "", ["run[a].arm_angle", "missing", "horizontal"]),
    "experiment unheard of": ('"hammer"', '"hammering"', ["run[a].experiment", "hammering"]),
    "bare g": ('unit = "m/s^2"', 'unit = "g"', ["unit", "'g'", "g_n"]),
    "unit of another quantity": (
        'unit = "m/s^2"',
        'unit = "N"',
        ["channels[acc].unit", "'N'", "linear-acceleration"],
    ),
    "unit spelt otherwise": ('unit = "m/s^2"', 'unit = "m/s2"', ["unit", "'m/s2'", "'m/s^2'"]),
    "mV without sensitivity": ('unit = "m/s^2"', 'unit = "mV"', ["channels[acc].sensitivity", "mV"]),
    "force without radius": (
        ', radius = 0.8, role = "input"',
        ', role = "input"',
        ["channels[force].radius", "axis"],
    ),
    "acceleration without radius": (", radius = 0.95", "", ["channels[acc].radius"]),
    "file missing": ('"a.csv"', '"b.csv"', ["stream[0].file", "b.csv", "no such file"]),
    "file outside": ('"a.csv"', '"../a.csv"', ["stream[0].file", "../a.csv", "outside"]),
    "column missing": ('column = "acc"', 'column = "acceleration"', ["a.csv", "acceleration", "force, acc"]),
    "column twice": ('column = "acc"', 'column = "force"', ["column", "'force'", "twice"]),
    "position on a rotational rig": ('quantity = "force"', 'quantity = "position"', ["quantity", "position"]),
    "force at the motor": (
        'unit = "N", location = "arm"',
        'unit = "N", location = "motor"',
        ["location", "motor"],
    ),
    "ac without corner": ('role = "output"', 'role = "output", coupling = "ac"', ["low_cutoff", "missing"]),
    "scale beside a unit": ('unit = "N",', 'unit = "N", scale = 2.0,', ["scale", "2.0", "'1'"]),
    "brake and free": ("brake = true", 'brake = true\nhold = "free"', ["run[a].hold", "free", "brake"]),
    "too large to be true": ("141.0", "1e300", ["rig.reduction_ratio", "1e+300", "1e-30 and 1e+30"]),
    "too small to be true": ("141.0", "1e-320", ["rig.reduction_ratio", "1e-30 and 1e+30"]),
    "window outside": ("1024.0", "1024.0\nwindow = [0.0, 9.0]", ["window", "9.0", "0.125"]),
    "window backwards": ("1024.0", "1024.0\nwindow = [0.1, 0.0]", ["window", "[0.1, 0.0]"]),
    "too few samples": ("1024.0", "1024.0\nwindow = [0.0, 0.05]", ["a.csv", "51 samples", "64"]),
    "time column missing": ("1024.0", '1024.0\ntime = "t"', ["stream[0].time", "'t'"]),
    "output that drives the motor": (
        'column = "acc", ' + ACC,
        'column = "acc", quantity = "speed-command", unit = "rpm", location = "motor"',
        ["channels[acc].role", "output"],
    ),
}


@pytest.mark.parametrize("name", TOML_BREAKS)
def test_a_broken_toml_is_refused_in_one_line(small, name):
    old, new, words = TOML_BREAKS[name]
    file = small / "campaign.toml"
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new, 1))
    refused(small, words)


def refused(folder, words):
    with pytest.raises(CampaignError) as caught:
        read_campaign(folder)
    line = str(caught.value)
    assert "\n" not in line
    for word in [str(folder), *words]:
        assert word in line, line


def rewrite(folder, edit):
    lines = (folder / "a.csv").read_text().splitlines()
    edit(lines)
    (folder / "a.csv").write_text("\n".join(lines) + "\n")


DATA_BREAKS = {
    "NaN": (lambda lines: lines.__setitem__(9, "nan,1.0"), ["a.csv", "force", "nan", "sample 8", "mask"]),
    "infinite": (lambda lines: lines.__setitem__(9, "1.0,inf"), ["a.csv", "acc", "inf", "sample 8"]),
    "beyond any measurement": (
        lambda lines: lines.__setitem__(9, "1.0,-1e300"),
        ["a.csv", "acc", "sample 8", "1e+300", "unit or scale"],
    ),
    "empty cell": (lambda lines: lines.__setitem__(9, ",1.0"), ["a.csv", "force", "sample 8", "mask"]),
    "text": (lambda lines: lines.__setitem__(9, "1.0,oops"), ["a.csv", "acc", "'oops'", "line 10"]),
    "short line": (lambda lines: lines.__setitem__(9, "1.0"), ["a.csv", "line 10", "1 cells"]),
    "no header": (lambda lines: lines.pop(0), ["a.csv", "header"]),
    "header twice": (lambda lines: lines.__setitem__(0, "acc,acc"), ["a.csv", "acc", "twice"]),
}


@pytest.mark.parametrize("name", DATA_BREAKS)
def test_a_broken_data_file_is_refused_in_one_line(small, name):
    edit, words = DATA_BREAKS[name]
    rewrite(small, edit)
    refused(small, words)


def test_runs_of_one_name_are_refused(small):
    text = (small / "campaign.toml").read_text()
    run = text[text.index("[[run]]") :]
    (small / "campaign.toml").write_text(text + run)
    refused(small, ["run[1].id", "'a'"])


def test_a_campaign_without_runs_is_refused(small):
    text = (small / "campaign.toml").read_text()
    (small / "campaign.toml").write_text(text[: text.index("[[run]]")])
    refused(small, ["run", "missing"])


def test_no_campaign_at_all(tmp_path):
    refused(tmp_path / "nowhere", ["no such file"])


def test_a_binary_file_under_a_wrong_name_is_refused(small):
    (small / "a.mat").write_bytes(b"\x00\x01" * 300)
    text = (small / "campaign.toml").read_text()
    (small / "campaign.toml").write_text(text.replace('"a.csv"', '"a.mat"'))
    refused(small, ["a.mat", "not readable"])


def test_an_output_may_be_absent_only_where_that_is_allowed(small):
    rewrite(small, lambda lines: lines.__setitem__(slice(None), [line.split(",")[0] for line in lines]))
    refused(small, ["acc", "no such column"])
    run = read_campaign(small, missing_outputs="allow").runs[0]
    assert run.select("linear-acceleration") == ()
    assert run.select("linear-acceleration", recorded=False)[0].stream.length == 128
    assert run.select("force")[0].samples.size == 128


def test_an_input_may_never_be_absent(small):
    rewrite(small, lambda lines: lines.__setitem__(slice(None), [line.split(",")[1] for line in lines]))
    with pytest.raises(CampaignError, match="force"):
        read_campaign(small, missing_outputs="allow")


def test_a_file_with_nothing_but_time_says_how_long_the_stream_is(small):
    text = (small / "campaign.toml").read_text().replace('role = "input"', 'role = "output"')
    (small / "campaign.toml").write_text(text)
    (small / "a.csv").write_text("time\n" + "\n".join(repr(k / 1024) for k in range(300)) + "\n")
    stream = read_campaign(small, missing_outputs="allow").runs[0].streams[0]
    assert stream.length == 300
    assert stream.times[-1] == pytest.approx(299 / 1024)


def test_the_sound_campaign_is_read(small):
    """Negative control: what the breaks start from is accepted."""
    run = read_campaign(small / "campaign.toml").runs[0]
    assert run.brake and run.id == "a"
    assert not run.signals[0].samples.flags.writeable
    assert np.isfinite(run.signals[1].samples).all()


def test_an_inline_table_may_run_over_several_lines(small):
    """The format's own example breaks a channel's line."""
    text = (small / "campaign.toml").read_text()
    text = text.replace(
        ', radius = 0.95, role = "output" }', ',\n    radius = 0.95, # from the axis\n role = "output",\n }'
    )
    (small / "campaign.toml").write_text(text + "\n# { not a table\n")
    assert read_campaign(small).runs[0].signals[1].channel.radius == 0.95
