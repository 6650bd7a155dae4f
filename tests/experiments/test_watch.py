"""The watch at the bench: what each take is called, and that files may grow and come in any order."""

import json
import math
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from jointscope.cli import main
from jointscope.errors import InputError
from jointscope.experiments.watch import lines
from jointscope.experiments.watch.session import Session, Unusable
from jointscope.experiments.watch.template import Arrived, assemble, kinds_of
from jointscope.recordings.finding import NAMES
from jointscope.recordings.reader import parse_campaign

sys.path.insert(0, str(Path(__file__).parent))
from watched_bench import (  # type: ignore[import-not-found]
    HEAD,
    RUN,
    J,
    K,
    bench_in,
    hit,
    judged,
    session,
    standing,
    write_csv,
)


@pytest.fixture
def bench(tmp_path):
    """A template campaign of one hit, and an empty folder that takes arrive in."""
    return bench_in(tmp_path)


# --- verdicts --------------------------------------------------------------------------------------------------------


def test_clean_hits_of_random_level_are_all_good_and_give_the_joint(bench):
    rng = np.random.default_rng(1)
    for number, peak in enumerate(rng.permutation([60.0, 90.0, 130.0, 190.0, 280.0, 400.0, 600.0, 800.0])):
        write_csv(bench[1] / f"hit-{number}.csv", *hit(rng, peak))
    events = session(bench).look(0.0, 0.0)
    takes = judged(events)
    assert {take.verdict for take in takes.values()} == {"good"} and len(takes) == 8
    known = {one.symbol: one for one in standing(events).known}
    assert known["K"].value == pytest.approx(K, rel=0.01) and known["J_L"].value == pytest.approx(J, rel=0.01)
    assert known["K"].missing == "" and known["K"].more_hits == 0


FAULTS = {
    "clipping": ({"clip": 30.0}, "clipping", "repeat"),
    "double hit": ({"second": 0.4}, "double-hit", "repeat"),
    "decay cut off": ({"seconds": 0.19}, "truncated-decay", "repeat"),
    "too soft": ({"peak": 0.9, "noise": 0.05}, "low-level", "repeat"),
    "reversed": ({"sign": -1.0}, "inverted-polarity", "mend"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_spoilt_take_is_named(bench, fault):
    changes, name, verdict = FAULTS[fault]
    write_csv(bench[1] / "hit.csv", *hit(np.random.default_rng(2), **{"peak": 200.0, **changes}))
    take = judged(session(bench).look(0.0, 0.0))["hit"]
    assert name in {reason.name for reason in take.reasons}
    assert take.verdict == verdict
    assert all(reason.advice for reason in take.reasons)


def test_a_dead_sensor_is_named(bench):
    force, acc = hit(np.random.default_rng(3))
    write_csv(bench[1] / "hit.csv", force, 0.0 * acc)
    take = judged(session(bench).look(0.0, 0.0))["hit"]
    assert take.verdict == "repeat" and take.reasons[0].name == "dead-channel"


def test_the_hit_that_answers_unlike_the_others_is_the_one_to_repeat(bench):
    rng = np.random.default_rng(4)
    watched = session(bench)
    for number in range(4):
        write_csv(bench[1] / f"hit-{number}.csv", *hit(rng, 200.0 + 10.0 * number))
        assert judged(watched.look(number, 0.0))[f"hit-{number}"].verdict == "good"
    write_csv(bench[1] / "loose.csv", *hit(rng, 220.0, stiffness=0.6 * K))
    take = judged(watched.look(9.0, 0.0))["loose"]
    assert take.verdict == "repeat" and take.reasons[0].name == "low-coherence"
    write_csv(bench[1] / "sound.csv", *hit(rng, 220.0))
    assert judged(watched.look(10.0, 0.0))["sound"].verdict == "good"


def test_every_finding_of_inspect_has_a_verdict():
    from jointscope.experiments.watch.judging import ADVICE

    assert set(NAMES) <= set(ADVICE)


# --- files as they arrive --------------------------------------------------------------------------------------------


def test_a_file_that_grows_is_left_alone_until_it_is_quiet(bench):
    watched, path = session(bench), bench[1] / "hit.csv"
    write_csv(path, *hit(np.random.default_rng(5)))
    whole = path.read_bytes()
    for step, share in enumerate((0.3, 0.6, 0.999)):
        path.write_bytes(whole[: int(share * len(whole))])
        os.utime(path, ns=(step, step))
        assert watched.look(float(step), 1.5) == []
    path.write_bytes(whole)
    assert watched.look(3.0, 1.5) == []
    assert judged(watched.look(5.0, 1.5))["hit"].verdict == "good"
    assert watched.look(9.0, 1.5) == []  # told once


def test_half_a_file_is_reported_only_when_it_stays_so_and_the_whole_one_is_judged(bench):
    like, folder = bench
    force, acc = hit(np.random.default_rng(6))
    np.savez(folder / "hit.npz", force=force, acc=acc)
    whole = (folder / "hit.npz").read_bytes()
    (folder / "hit.npz").write_bytes(whole[: len(whole) // 2])
    watched = Session(folder, like, within=0.01)
    assert watched.look(0.0, 1.0) == []
    assert watched.look(2.0, 1.0) == []  # quiet, but it may go on
    (event,) = watched.look(20.0, 1.0)
    assert isinstance(event, Unusable) and "hit.npz" in event.why and "\n" not in event.why
    assert watched.look(30.0, 1.0) == []
    (folder / "hit.npz").write_bytes(whole)
    watched.look(31.0, 1.0)
    assert judged(watched.look(33.0, 1.0))["hit"].verdict == "good"


def test_a_take_written_anew_replaces_the_old_one(bench):
    watched, path = session(bench), bench[1] / "hit.csv"
    write_csv(path, *hit(np.random.default_rng(7), second=0.5))
    assert standing(watched.look(0.0, 0.0)).repeats == 1
    write_csv(path, *hit(np.random.default_rng(7)))
    events = watched.look(1.0, 0.0)
    assert events[0].again and standing(events).repeats == 0 and standing(events).takes == 1


@pytest.mark.parametrize("kind", ["csv", "npz", "h5", "tdms"])
def test_the_same_take_is_judged_alike_in_every_format(bench, kind):
    like, folder = bench
    force, acc = hit(np.random.default_rng(8), second=0.4)
    prefix = "g/" if kind == "tdms" else ""
    (like / "campaign.toml").write_text(HEAD + RUN.format(id="first", file="first.csv", prefix=prefix))
    path = folder / f"hit.{kind}"
    if kind == "csv":
        write_csv(path, force, acc)
    elif kind == "npz":
        np.savez(path, force=force, acc=acc)
    elif kind == "h5":
        import h5py

        with h5py.File(path, "w") as file:
            file["force"], file["acc"] = force, acc
    else:
        from nptdms import ChannelObject, TdmsWriter

        with TdmsWriter(path) as file:
            file.write_segment([ChannelObject("g", "force", force), ChannelObject("g", "acc", acc)])
    take = judged(session(bench).look(0.0, 0.0))["hit"]
    assert take.verdict == "repeat" and take.reasons[0].name == "double-hit"


def test_other_files_and_unknown_columns_do_no_harm(bench):
    _, folder = bench
    (folder / "notes.md").write_text("cold today")
    (folder / ".hidden.csv").write_text("a\n1\n")
    (folder / "temperature.csv").write_text("degC\n" + "20\n" * 100)
    (event,) = session(bench).look(0.0, 0.0)
    assert event.file == "temperature.csv" and "degC" in event.why and "acc" in event.why


def test_runs_appended_to_a_campaign_are_judged_and_half_a_toml_waits(bench):
    like, _ = bench
    watched = Session(like, None, within=0.01)
    assert judged(watched.look(0.0, 0.0))["first"].verdict == "good"
    write_csv(like / "b.csv", *hit(np.random.default_rng(9), clip=30.0))
    text = (like / "campaign.toml").read_text() + RUN.format(id="second", file="b.csv", prefix="")
    (like / "campaign.toml").write_text(text[:-40])
    assert [e for e in watched.look(1.0, 0.5) if isinstance(e, Unusable)] == []
    (like / "campaign.toml").write_text(text)
    watched.look(2.0, 0.5)
    assert judged(watched.look(4.0, 0.5))["second"].verdict == "repeat"
    assert watched.look(9.0, 0.5) == []


def test_nothing_that_says_what_columns_mean_is_one_line(tmp_path):
    with pytest.raises(InputError, match="--like"):
        Session(tmp_path, None, within=0.01)


# --- files of two devices --------------------------------------------------------------------------------------------

TWO = """format = "jointscope-campaign/1"
[rig]
topology = "two-inertia"
motion = "rotational"
"""
_ACC = '{ column = "acc", quantity = "linear-acceleration", unit = "m/s^2", location = "arm", role = "output", radius = 1.0 }'
_TORQUE = '{ column = "torque", quantity = "torque", unit = "N m", location = "motor", role = "input" }'
_COMMAND = '{ column = "cmd", quantity = "speed-command", unit = "rad/s", location = "motor", role = "input" }'


def two_devices(tmp_path):
    text = TWO
    for name, experiment, plc in (
        ("sweep", "torque-sweep", [_TORQUE]),
        ("move", "speed-motion", [_TORQUE, _COMMAND]),
    ):
        text += f'[[run]]\nid = "{name}"\nexperiment = "{experiment}"\narm_angle = 0.0\n'
        for suffix, channels in (("", [_ACC]), ("-plc", plc)):
            text += f'[[run.stream]]\nfile = "{name}{suffix}.csv"\nsampling_rate = 500.0\nchannels = [{", ".join(channels)}]\n'
    for name in ("sweep", "sweep-plc", "move", "move-plc"):
        (tmp_path / f"{name}.csv").touch()
    (tmp_path / "campaign.toml").write_text(text)
    return kinds_of(parse_campaign(tmp_path / "campaign.toml"))


@pytest.mark.parametrize("seed", range(5))
def test_two_devices_files_are_put_together_in_whatever_order_they_come(tmp_path, seed):
    kinds = two_devices(tmp_path)
    files = {
        "sweep-7": {"acc"}, "sweep-7-plc": {"torque"}, "move-3": {"acc"}, "move-3-plc": {"torque", "cmd"},
        "move-4": {"acc"}, "move-4-plc": {"torque", "cmd"},
    }  # fmt: skip
    order = np.random.default_rng(seed).permutation(list(files))
    takes, waiting = assemble([Arrived(tmp_path / f"{n}.csv", frozenset(files[n])) for n in order], kinds)
    assert waiting == []
    found = {t.run["id"]: (t.run["experiment"], [f.path.stem for f in t.files]) for t in takes}
    assert found == {
        "sweep-7": ("torque-sweep", ["sweep-7", "sweep-7-plc"]),
        "move-3": ("speed-motion", ["move-3", "move-3-plc"]),
        "move-4": ("speed-motion", ["move-4", "move-4-plc"]),
    }


def test_one_devices_file_waits_for_the_others(tmp_path):
    kinds = two_devices(tmp_path)
    lone = Arrived(tmp_path / "x.csv", frozenset({"torque"}))
    assert assemble([lone], kinds) == ([], [lone])


# --- the command -----------------------------------------------------------------------------------------------------


def test_once_returns_one_where_a_take_must_be_repeated(bench, capsys):
    like, folder = bench
    write_csv(folder / "hit.csv", *hit(np.random.default_rng(13), clip=30.0))
    assert main(["watch", str(folder), "--like", str(like), "--once"]) == 1
    said = capsys.readouterr()
    assert "REPEAT hit" in said.out and "clipping acc" in said.out and "next:" in said.out
    assert "1 to repeat (hit)" in said.err


def test_an_empty_folder_is_not_a_pass(bench, capsys):
    like, folder = bench
    assert main(["watch", str(folder), "--like", str(like), "--once"]) == 1


def test_text_repeats_only_news(bench):
    watched, told = session(bench), []
    for number in range(2):
        write_csv(bench[1] / f"hit-{number}.csv", *hit(np.random.default_rng(20 + number)))
        event = standing(watched.look(float(number), 0.0))
        said = lines.as_lines(event, told)
        told = lines.missing_lines(event)
        if number:
            assert len(said) < len(told) and any("K " in line for line in said)


def test_it_ends_cleanly_on_interrupt(bench):
    like, folder = bench
    write_csv(folder / "hit.csv", *hit(np.random.default_rng(14)))
    words = [sys.executable, "-m", "jointscope", "watch", str(folder), "--like", str(like)]
    with subprocess.Popen(
        [*words, "--every", "0.1", "--quiet", "0.1"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # a suite in the background ignores it
    ) as process:  # fmt: skip
        try:
            said, began = "", time.monotonic()
            while "next:" not in said and time.monotonic() - began < 400.0:
                said += process.stdout.readline()
            process.send_signal(signal.SIGINT)
            _, complaint = process.communicate(timeout=200)
        finally:
            process.kill()
    assert "GOOD   hit" in said and process.returncode == 0
    assert "1 good" in complaint and "Traceback" not in complaint


def test_numbers_in_json_are_finite(bench):
    watched = session(bench)
    write_csv(bench[1] / "hit.csv", *hit(np.random.default_rng(15)))
    for event in watched.look(0.0, 0.0):
        text = json.dumps(lines.as_json(event), allow_nan=False)
        assert json.loads(text)["format"] == "jointscope-watch/1"
    assert math.isfinite(judged(watched.look(1.0, 0.0)).get("hit", next(iter(watched.takes.values()))).level)
