"""The watch at the bench: what each take is called, that files may grow, and what is said to be missing."""

import json
import math
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from scipy.signal import TransferFunction, cont2discrete, decimate, lfilter, ss2tf

from jointscope.cli import main
from jointscope.diagnosis.effects import REGISTRY
from jointscope.diagnosis.next_experiment import MENU
from jointscope.errors import InputError
from jointscope.experiments.watch import held as held_module
from jointscope.experiments.watch import lines, precision
from jointscope.experiments.watch.coverage import _ORDER, coverage
from jointscope.experiments.watch.judging import Take, judge
from jointscope.experiments.watch.session import Judged, Session, Standing, Unusable
from jointscope.experiments.watch.template import Arrived, assemble, kinds_of
from jointscope.recordings.finding import NAMES
from jointscope.recordings.reader import campaign_of, parse_campaign, read_campaign

K, J, C, RATE, FINE = 193665.0, 3.02, 61.76, 1024.0, 8
HEAD = """format = "jointscope-campaign/1"
[rig]
topology = "two-inertia"
motion = "rotational"
plane = "horizontal"
reduction_ratio = 141.0
load_damping = 2.0
"""
RUN = """
[[run]]
id = "{id}"
experiment = "hammer"
brake = true
[[run.stream]]
file = "{file}"
sampling_rate = 1024.0
channels = [
  {{ column = "{prefix}force", quantity = "force", unit = "N", location = "arm", role = "input", radius = 0.8 }},
  {{ column = "{prefix}acc", quantity = "linear-acceleration", unit = "m/s^2", location = "arm", role = "output",
     radius = 0.95, full_scale = 490.0 }},
]
"""


def hit(rng, peak=200.0, *, stiffness=K, second=0.0, seconds=2.0, noise=0.01, sign=1.0, clip=None):
    """Force [N] and tangential acceleration [m/s^2] of a braked joint: the exact response of J q'' + c q' + K q = r F."""
    rate = RATE * FINE
    n = round(seconds * rate)
    t = np.arange(n) / rate
    force = np.zeros(n)
    for start, size in ((0.1, peak), (0.16, second * peak)):
        inside = (t >= start) & (t < start + 0.008)
        force[inside] += size * np.sin(np.pi * (t[inside] - start) / 0.008)
    system = TransferFunction([0.8 / J, 0.0, 0.0], [1.0, C / J, stiffness / J]).to_ss()
    discrete = cont2discrete((system.A, system.B, system.C, system.D), 1.0 / rate, method="foh")
    numerator, denominator = ss2tf(*discrete[:4])
    acc = 0.95 * lfilter(numerator[0], denominator, force)
    force, acc = (decimate(x, FINE, ftype="fir") for x in (force, acc))
    acc = sign * acc + rng.normal(0.0, noise, acc.size)
    if clip is not None:
        acc = np.clip(acc, -clip, clip)
    return force + rng.normal(0.0, 0.1, force.size), acc


def write_csv(path, force, acc):
    path.write_text("force,acc\n" + "\n".join(f"{f:.5f},{a:.6f}" for f, a in zip(force, acc, strict=True)) + "\n")


@pytest.fixture
def bench(tmp_path):
    """A template campaign of one hit, and an empty folder that takes arrive in."""
    like, folder = tmp_path / "like", tmp_path / "today"
    like.mkdir()
    folder.mkdir()
    write_csv(like / "first.csv", *hit(np.random.default_rng(0)))
    (like / "campaign.toml").write_text(HEAD + RUN.format(id="first", file="first.csv", prefix=""))
    return like, folder


def judged(events):
    return {event.take.run.id: event.take for event in events if isinstance(event, Judged)}


def standing(events):
    return next(event for event in events if isinstance(event, Standing))


def session(bench, within=0.01):
    like, folder = bench
    return Session(folder, like, within=within)


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


# --- what is missing -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("hits", [3, 10, 40])
def test_four_times_the_hits_for_half_the_width(hits):
    assert precision._more(0.02, hits, 0.01) == 3 * hits
    assert precision._more(0.01, hits, 0.01) == 0


def test_more_hits_are_asked_for_until_the_width_is_there(bench):
    rng = np.random.default_rng(10)
    for number in range(3):
        write_csv(bench[1] / f"hit-{number}.csv", *hit(rng, 150.0, noise=0.4))
    wide = standing(session(bench, within=1e-4).look(0.0, 0.0))
    assert all(known.missing for known in wide.known)
    loose = standing(session(bench, within=0.5).look(0.0, 0.0))
    assert not any(known.missing for known in loose.known if known.symbol != "c")


def test_a_take_to_be_repeated_does_not_count(bench):
    write_csv(bench[1] / "hit.csv", *hit(np.random.default_rng(11), clip=30.0))
    found = standing(session(bench).look(0.0, 0.0))
    assert found.takes == 0 and all(known.value is None for known in found.known)
    assert "brake" in found.next_take


def test_the_menu_families_and_wordings_are_complete():
    assert set(held_module._CHECKS) <= set(MENU) and set(lines._SHORT) <= set(MENU)
    assert set(held_module.held([], read_nothing())) == set(MENU)
    assert {spec.family for spec in REGISTRY} <= set(_ORDER)


def read_nothing():
    from jointscope.recordings.campaign import Nameplate

    return Nameplate(topology="two-inertia", motion="rotational")


def hits_at(rng, levels, campaign, **changes):
    """Judged takes without files."""
    document = parse_campaign(campaign / "campaign.toml")
    takes = []
    for peak in levels:
        write_csv(campaign / "first.csv", *hit(rng, float(peak), seconds=1.0))
        run = {**document["run"][0], **changes}
        read = campaign_of({**document, "run": [run]}, campaign / "campaign.toml")
        takes.append(judge(read.runs[0], read, takes))
    return read_campaign(campaign), takes


def test_hits_alone_show_the_spring_and_not_the_motor(bench):
    campaign, takes = hits_at(np.random.default_rng(12), [100.0, 200.0], bench[0])
    found = {one.name: one for one in coverage(campaign, takes).effects}
    assert found["backlash@transmission"].shown
    assert not found["stribeck-friction@motor"].shown
    assert "motion" in found["stribeck-friction@motor"].missing
    assert not found["torque-ripple@motor"].shown and not found["drive-lag@motor"].shown


@pytest.mark.parametrize(("levels", "enough"), [
    ([50, 400, 100, 800, 60, 420, 110, 780, 55, 410, 105, 790], True),
    ([50, 55, 60, 100, 105, 110, 400, 410, 420, 780, 790, 800], False),  # sorted: a joint that warms up looks the same
    ([200, 210, 190, 220, 205, 195, 200, 215, 185, 200, 210, 190], False),  # one level
])  # fmt: skip
def test_levels_count_over_a_span_and_in_random_order(levels, enough):
    takes = [Take(run=_stub(), verdict="good", reasons=(), level=float(v), level_unit="N") for v in levels]
    assert held_module._levels(takes, None).enough is enough


def _stub():
    from jointscope.recordings.campaign import Run

    return Run(id="x", experiment="hammer", streams=(), brake=True)


@pytest.fixture(scope="module")
def simulated(tmp_path_factory):
    out = tmp_path_factory.mktemp("watch") / "c"
    words = ["--hits", "2", "--repeats", "1", "--hit-levels", "150", "--sweep-levels", "0.6", "--travels", "60"]
    assert main(["simulate", "single-joint", "--out", str(out), "--seed", "5", *words]) == 0
    return out


def test_a_whole_simulated_bench_is_good_and_shows_every_family(simulated, capsys):
    capsys.readouterr()
    assert main(["watch", str(simulated), "--once", "--json"]) == 0
    events = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert {event["verdict"] for event in events if event["event"] == "take"} == {"good"}
    last = events[-1]
    assert last["event"] == "standing" and all(
        one["can_be_shown"] for one in last["effects"] if one["family"] != "inertia"
    )
    assert last["menu"]["brake"]["so_far"] == "brake closed"
    assert last["one_more"] == ["torque-sweep", "speed-motion"]


def test_its_own_runs_taken_out_of_the_toml_are_recognised_by_their_columns(simulated, tmp_path, capsys):
    import shutil

    folder = tmp_path / "arrived"
    folder.mkdir()
    for path in simulated.glob("*.csv"):
        shutil.copyfile(path, folder / path.name)
    capsys.readouterr()
    assert main(["watch", str(folder), "--like", str(simulated), "--once", "--json"]) == 0
    takes = {
        e["run"]: e for line in capsys.readouterr().out.splitlines() if (e := json.loads(line))["event"] == "take"
    }
    own = {run.id: run for run in read_campaign(simulated).runs}
    assert {name: take["experiment"] for name, take in takes.items()} == {n: r.experiment for n, r in own.items()}
    assert all(sorted(takes[n]["files"]) == sorted(s.file for s in r.streams) for n, r in own.items())


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
