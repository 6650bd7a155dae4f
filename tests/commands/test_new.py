"""From a lab's files to a campaign: what is known is stated, what isn't is asked or marked as guessed."""

import json
from itertools import pairwise

import numpy as np
import pytest
from nptdms import ChannelObject, TdmsWriter

from jointscope.cli import main
from jointscope.recordings.draft.drafting import draft_campaign
from jointscope.recordings.draft.records import records_of
from jointscope.recordings.draft.runs import hit_windows
from jointscope.recordings.reader import read_campaign

RATE = 1000.0


def hits(rng, times, heights, length=8.0):
    """A continuous record of hammer hits and the ringing after each."""
    t = np.arange(round(length * RATE)) / RATE
    force, acceleration = np.zeros(t.size), np.zeros(t.size)
    for at, height in zip(times, heights, strict=True):
        phase = (t - at) / 0.006
        force += np.where((phase > 0) & (phase < 1), height * np.sin(np.pi * np.clip(phase, 0, 1)), 0.0)
        late = np.clip(t - at, 0, None)
        acceleration += 0.1 * height * np.exp(-8 * late) * np.sin(2 * np.pi * 40 * late)
    return t, force + 0.05 * rng.standard_normal(t.size), acceleration + 0.01 * rng.standard_normal(t.size)


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def write_csv(path, **columns):
    rows = np.column_stack(list(columns.values()))
    np.savetxt(path, rows, delimiter=",", header=",".join(columns), comments="", fmt="%.10g")


def test_one_continuous_record_becomes_one_run_per_hit(tmp_path, rng):
    times = [0.5, 2.25, 4.0, 6.1]
    t, force, acc = hits(rng, times, [100.0, 30.0, 250.0, 120.0])
    write_csv(tmp_path / "take.csv", time=t, hammer=force, acc=acc)
    assert main(["new", str(tmp_path / "take.csv"), "--yes", "--out", str(tmp_path / "c")]) == 0
    campaign = read_campaign(tmp_path / "c")
    assert [run.experiment for run in campaign.runs] == ["hammer"] * 4
    assert len({run.repeat_of for run in campaign.runs}) == 1
    for run, at in zip(campaign.runs, times, strict=True):
        found = run.select("force")[0].samples
        assert np.argmax(found) / RATE == pytest.approx(0.103, abs=0.003)
        assert run.streams[0].window[0] == pytest.approx(at - 0.1, abs=0.003)
        assert np.sum(found > 10.0) < 12


def test_every_guess_is_marked_and_answers_are_not(tmp_path, rng):
    t, force, acc = hits(rng, [0.5], [100.0], length=3.0)
    write_csv(tmp_path / "take.csv", ch1=force, ch2=acc, temperature=20.0 + 0 * t)
    (tmp_path / "answers.toml").write_text(
        'title = "our bench"\n[rig]\ntopology = "two-inertia"\nmotion = "rotational"\nplane = "vertical"\n'
        "reduction_ratio = 100.0\n[run]\narm_angle = 0.2\nbrake = true\nexperiment = 'hammer'\n"
        '[files."take.csv"]\nsampling_rate = 1000.0\n'
        '[columns.ch1]\nquantity = "force"\nunit = "lbf"\nlocation = "arm"\nrole = "input"\nradius = 0.8\n'
        '[columns.ch2]\nquantity = "linear-acceleration"\nunit = "g_n"\nlocation = "arm"\nrole = "output"\n'
        "radius = 0.95\ncoupling = 'ac'\nlow_cutoff = 1.0\n[columns.temperature]\nignore = true\n"
    )
    words = ["new", str(tmp_path / "take.csv"), "--answers", str(tmp_path / "answers.toml"), "--yes"]
    assert main([*words, "--out", str(tmp_path / "c")]) == 0
    text = (tmp_path / "c" / "campaign.toml").read_text()
    assert "GUESSED" not in text.split("format =", 1)[1]
    campaign = read_campaign(tmp_path / "c")
    assert campaign.title == "our bench"
    assert campaign.runs[0].select("force")[0].samples.max() == pytest.approx(100.0 * 4.448, rel=0.01)


def test_without_answers_each_assumption_has_its_reason(tmp_path, rng):
    t, force, acc = hits(rng, [0.5], [100.0], length=3.0)
    write_csv(tmp_path / "take.csv", time=t, hammer=force, acc=acc, humidity=0 * t + rng.standard_normal(t.size))
    assert main(["new", str(tmp_path / "take.csv"), "--yes", "--out", str(tmp_path / "c")]) == 0
    text = (tmp_path / "c" / "campaign.toml").read_text()
    for key in ("topology", "motion", "plane", "experiment", "brake", "arm_angle"):
        (line,) = [row for row in text.splitlines() if row.startswith(f"{key} = ")]
        assert "# GUESSED: " in line
    assert text.count("# GUESSED: radius = 1.0") == 2
    assert "sampling_rate = 1000.0\n" in text
    assert "#   take.csv: humidity" in text


def test_a_file_without_a_rate_is_refused_until_someone_says_it(tmp_path, rng, capsys):
    _, force, acc = hits(rng, [0.5], [100.0], length=3.0)
    write_csv(tmp_path / "take.csv", hammer=force, acc=acc)
    words = ["new", str(tmp_path / "take.csv"), "--yes", "--out", str(tmp_path / "c")]
    assert main(words) == 2
    line = capsys.readouterr().err.strip()
    assert "\n" not in line and "sampling_rate" in line and "--rate" in line
    assert main([*words, "--rate", "1000"]) == 0


def test_groups_rates_and_units_of_a_tdms_file_are_listed_and_used(tmp_path, rng, capsys):
    properties = {"wf_increment": 1 / RATE}
    with TdmsWriter(tmp_path / "a.tdms") as writer:
        for group in ("take1", "take2"):
            _, force, acc = hits(rng, [0.5], [100.0], length=3.0)
            for name, unit, values in (("hammer", "N", force), ("acc", "m/s^2", acc)):
                more = {**properties, "unit_string": unit}
                writer.write_segment([ChannelObject(group, name, values, properties=more)])
    assert main(["new", str(tmp_path / "a.tdms"), "--list", "--json"]) == 0
    listed = json.loads(capsys.readouterr().out)["files"]
    assert [record["record"] for record in listed] == ["take1", "take2"]
    assert {record["sampling_rate_hz"] for record in listed} == {1000.0}
    assert [column["unit"] for column in listed[0]["columns"]] == ["N", "m/s^2"]
    assert main(["new", str(tmp_path / "a.tdms"), "--yes", "--out", str(tmp_path / "c")]) == 0
    assert len(read_campaign(tmp_path / "c").runs) == 2


def test_devices_of_one_run_are_kept_together_when_told(tmp_path, rng):
    t, force, acc = hits(rng, [0.5], [100.0], length=3.0)
    write_csv(tmp_path / "daq.csv", time=t, acc=acc)
    write_csv(tmp_path / "plc.csv", time=t[::2], torque=force[::2])
    (tmp_path / "answers.toml").write_text("[run]\ntogether = true\nexperiment = 'free'\n")
    words = [
        "new",
        str(tmp_path / "daq.csv"),
        str(tmp_path / "plc.csv"),
        "--answers",
        str(tmp_path / "answers.toml"),
    ]
    assert main([*words, "--yes", "--out", str(tmp_path / "c")]) == 0
    (run,) = read_campaign(tmp_path / "c").runs
    assert [stream.sampling_rate for stream in run.streams] == [1000.0, 500.0]


def test_an_unknown_answer_is_refused(tmp_path, rng, capsys):
    t, force, acc = hits(rng, [0.5], [100.0], length=3.0)
    write_csv(tmp_path / "take.csv", time=t, hammer=force, acc=acc)
    (tmp_path / "answers.toml").write_text("[columns.hammer]\nquantitty = 'force'\n")
    words = [
        "new",
        str(tmp_path / "take.csv"),
        "--answers",
        str(tmp_path / "answers.toml"),
        "--out",
        str(tmp_path / "c"),
    ]
    assert main(words) == 2
    line = capsys.readouterr().err
    assert "columns.hammer.quantitty" in line and "'force'" in line


def test_windows_hold_one_hit_each_and_never_overlap(rng):
    _, force, _ = hits(rng, [0.3, 1.0, 2.5, 2.53, 5.0], [100.0, 80.0, 120.0, 20.0, 60.0])
    windows = hit_windows(force, RATE)
    assert len(windows) == 4  # the bounce at 2.53 s stays with its hit
    assert all(a[1] <= b[0] + 1e-9 for a, b in pairwise(windows))
    assert hit_windows(0.05 * rng.standard_normal(3000), RATE) == []


def test_only_what_the_files_do_not_say_is_asked_and_an_answer_is_no_guess(tmp_path, rng):
    _, force, acc = hits(rng, [0.5], [100.0], length=3.0)
    write_csv(tmp_path / "take.csv", hammer=force, acc=acc, ch3=acc)
    answers = {"sampling rate": "1000", "gravity": "horizontal", "ch3": "angular-velocity", "distance": "0.8"}
    asked = []

    def ask(question, usual):
        asked.append(question)
        return next((answer for word, answer in answers.items() if word in question), usual)

    rig, runs, unplaced = draft_campaign(
        records_of(tmp_path / "take.csv"), {tmp_path / "take.csv": "a.csv"}, {}, ask
    )
    assert rig.guessed == {} and rig.values["plane"] == "horizontal"
    assert not any("arm angle" in question for question in asked)
    assert len([question for question in asked if "sampling rate" in question]) == 1
    assert unplaced == []
    stream, channels = runs[0].streams[0]
    assert stream.values["sampling_rate"] == 1000.0
    assert [channel.values["quantity"] for channel in channels] == [
        "force",
        "linear-acceleration",
        "angular-velocity",
    ]
    assert "radius" not in channels[0].guessed and channels[0].values["radius"] == 0.8


def test_a_column_without_a_number_is_left_out_and_a_gap_is_masked(tmp_path, capsys):
    """Drivers name joints' positions that they don't measure; a line that was lost is no reason to refuse the rest."""
    t = np.arange(2000) / RATE
    speed = np.sin(2 * np.pi * 2.0 * t)
    speed[700:705] = np.nan
    write_csv(tmp_path / "take.csv", time=t, current=np.cos(2 * np.pi * 2.0 * t), speed=speed, angle=np.nan * t)
    words = ["new", str(tmp_path / "take.csv"), "--rate", "1000", "--yes", "--out", str(tmp_path / "c")]
    assert main(words) == 0
    assert "take.csv: angle holds no number" in capsys.readouterr().out
    run = read_campaign(tmp_path / "c").runs[0]
    assert [channel.quantity for channel in run.streams[0].channels] == ["current", "angular-velocity"]
    assert (
        'gaps = "mask"  # GUESSED: values of speed are missing' in (tmp_path / "c" / "campaign.toml").read_text()
    )


def test_an_error_in_the_making_names_the_users_file(tmp_path, capsys):
    t = np.arange(2000) / RATE
    current = np.cos(2 * np.pi * 2.0 * t)
    current[700] = np.inf
    write_csv(tmp_path / "take.csv", time=t, current=current)
    words = ["new", str(tmp_path / "take.csv"), "--rate", "1000", "--yes", "--out", str(tmp_path / "c")]
    assert main(words) != 0
    said = capsys.readouterr().err
    assert str(tmp_path / "take.csv") in said
    assert ".tmp" not in said
    assert not (tmp_path / "c").exists()
