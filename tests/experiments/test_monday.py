"""docs/monday.md, word for word: its files and commands, on generated recordings with three mistakes planted in them."""

import importlib.util
import json
import re
import shlex
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from jointscope.cli import main
from jointscope.recordings.reader import read_campaign

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "monday.md").read_text(encoding="utf-8")
COMMANDS = re.findall(r"```sh\n(.*?)\n```", PAGE, re.DOTALL)
FILES = {name: text for name, text in re.findall(r"```toml (\S+)\n(.*?)```", PAGE, re.DOTALL)}
RATIO = 141.0
PLANTED = {
    ("suspicious-unit", "motor_angle"): 'unit = "deg"',
    ("inverted-polarity", "acceleration"): "scale = -1.0",
    ("suspicious-unit", "torque"): 'side = "output"',
}
BENCH = ["--hit-levels", "100", "400", "--tip", "soft", "--sweep-levels", "0.6", "--travels", "60", "--seed", "7"]


def simulate(out, *words):
    assert main(["simulate", "single-joint", "--out", str(out), *BENCH, *words]) == 0
    return read_campaign(out)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    return simulate(tmp_path_factory.mktemp("monday") / "truth", "--hits", "3", "--repeats", "2")


def columns_of(run, *, wrong):
    """Per device (rate [Hz], {column: values}) as the bench wrote them, the three mistakes in them where ``wrong``."""
    factor = {"motor_angle": np.rad2deg(1.0), "acceleration": -1.0, "torque": RATIO} if wrong else {}
    return [
        (stream.sampling_rate, {c.column: factor.get(c.column, 1.0) * c.samples for c in stream.channels})
        for stream in run.streams
    ]


def write_csv(path, columns):
    rows = np.column_stack(list(columns.values()))
    np.savetxt(path, rows, delimiter=",", header=",".join(columns), comments="", fmt="%.9g")


def write_tdms(path, records):
    from nptdms import ChannelObject, TdmsWriter

    with TdmsWriter(path) as file:
        for name, (rate, columns) in records.items():
            for column, values in columns.items():
                file.write_segment([ChannelObject(name, column, values, properties={"wf_increment": 1.0 / rate})])


def write_uff(path, rate, columns):
    import pyuff

    records = [
        {
            "type": 58, "binary": 0, "id1": column, "id2": "", "id3": "", "id4": "", "id5": "", "func_type": 1,
            "ver_num": 0, "load_case_id": 0, "rsp_ent_name": "ARM", "rsp_node": number, "rsp_dir": 3,
            "ref_ent_name": "NONE", "ref_node": 0, "ref_dir": 0, "ord_data_type": 4, "num_pts": values.size,
            "abscissa_spacing": 1, "abscissa_min": 0.0, "abscissa_inc": 1.0 / rate, "z_axis_value": 0.0,
            "abscissa_spec_data_type": 17, "ordinate_spec_data_type": 0, "ordinate_axis_units_lab": "NONE",
            "orddenom_spec_data_type": 0, "data": values.astype(float), "x": np.arange(values.size) / rate,
        }
        for number, (column, values) in enumerate(columns.items(), start=1)
    ]  # fmt: skip
    pyuff.UFF(str(path)).write_sets(records, mode="overwrite")


def write_bag(folder, rate, columns):
    """Force and acceleration of a hit as a WrenchStamped and an Imu topic, header stamps on the DAQ's grid."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    types = {name.rsplit("/", 1)[-1]: kind for name, kind in store.types.items()}
    vector, still = types["Vector3"], types["Vector3"](x=0.0, y=0.0, z=0.0)
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        kinds = ("geometry_msgs/msg/WrenchStamped", "sensor_msgs/msg/Imu")
        hammer, imu = (
            bag.add_connection(t, k, typestore=store) for t, k in zip(("/hammer", "/imu"), kinds, strict=True)
        )
        for index, (force, acc) in enumerate(zip(columns["force"], columns["acceleration"], strict=True)):
            stamp = round(index * 1e9 / rate) + 1_790_000_000_000_000_000
            time = types["Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
            header = types["Header"](stamp=time, frame_id="")
            wrench = types["Wrench"](force=vector(x=float(force), y=0.0, z=0.0), torque=still)
            bag.write(
                hammer, stamp, store.serialize_cdr(types["WrenchStamped"](header=header, wrench=wrench), kinds[0])
            )
            message = types["Imu"](
                header=header, orientation=types["Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0),
                orientation_covariance=np.zeros(9), angular_velocity=still, angular_velocity_covariance=np.zeros(9),
                linear_acceleration=vector(x=0.0, y=float(acc), z=0.0), linear_acceleration_covariance=np.zeros(9),
            )  # fmt: skip
            bag.write(imu, stamp, store.serialize_cdr(message, kinds[1]))


def lab_folder(campaign, folder, *, wrong=True, hits="tdms"):
    """The folder ``lab`` as the page describes it; hits in one of the formats."""
    lab = folder / "lab"
    lab.mkdir()
    records, count = {}, {}
    for run in campaign.runs:
        devices = columns_of(run, wrong=wrong)
        if run.experiment == "hammer":
            records[f"hit-{len(records) + 1:02d}"] = devices[0]
            continue
        name = {"torque-sweep": "sweep", "speed-motion": "motion"}[run.experiment]
        count[name] = count.get(name, 0) + 1
        for suffix, (_, columns) in zip(("", "-drive"), devices, strict=True):
            write_csv(lab / f"{name}-{count[name]}{suffix}.csv", columns)
    if hits == "tdms":
        write_tdms(lab / "hits.tdms", records)
    for name, (rate, columns) in records.items():
        if hits == "csv":
            write_csv(lab / f"{name}.csv", {"time": np.arange(len(columns["force"])) / rate, **columns})
        elif hits == "uff":
            write_uff(lab / f"{name}.uff", rate, columns)
        elif hits == "bag":
            write_bag(lab / name, rate, columns)
    return lab


def write_page_files(folder, hits="tdms"):
    for name, text in FILES.items():
        if hits == "uff":  # a universal file numbers its records
            text = text.replace("[columns.force]", "[columns.1]").replace(
                "[columns.acceleration]\n", "[columns.2]\n" + ACC
            )
        if hits == "bag" and name == "bench.toml":  # a vector has three axes, of which the bench used one
            silent = [f"force_{a}" for a in "yz"] + [f"linear_acceleration_{a}" for a in "xz"]
            silent += [f"{kind}_{a}" for kind in ("torque", "angular_velocity") for a in "xyz"]
            text = text.replace("[columns.force]", "[columns.force_x]")
            text = text.replace("[columns.acceleration]\n", "[columns.linear_acceleration_y]\n" + ACC)
            text += "".join(f"\n[columns.{column}]\nignore = true\n" for column in silent)
        (folder / name).write_text(text)
    shutil.copyfile(ROOT / "docs" / "examples" / "gate-your-simulator" / "robot.xml", folder / "robot.xml")
    robot = (folder / "robot.xml").read_text()
    off = robot.replace('stiffness="193665" damping="61.8"', 'stiffness="166500" damping="31"')
    off = off.replace('diaginertia="0.001 0.02 0.02"', 'diaginertia="0.001 0.22 0.22"')
    assert off != robot
    (folder / "robot.xml").write_text(off)


ACC = """quantity   = "linear-acceleration"
unit       = "m/s^2"
location   = "arm"
radius     = 0.95
coupling   = "ac"
low_cutoff = 0.5

[columns.acceleration]
"""


def run(command, folder, monkeypatch):
    """One command of the page, in ``folder``, as a shell would run it."""
    monkeypatch.chdir(folder)
    words = shlex.split(command)
    if words[0] != "jointscope":
        return subprocess.run(command, shell=True, cwd=folder, check=False).returncode
    expanded = [str(p) for w in words[1:] for p in (sorted(folder.glob(w)) if "*" in w else [w])]
    return main(expanded)


def quality(folder, capsys):
    capsys.readouterr()
    assert main(["inspect", str(folder / "bench"), "--json"]) == 0
    return json.loads(capsys.readouterr().out)["quality"]


def paste(campaign, findings):
    """What the page asks for: the lines that inspect printed in place of those of the same columns, run by run."""
    file = campaign / "campaign.toml"
    lines, current = file.read_text().splitlines(), ""
    for number, line in enumerate(lines):
        if line.startswith("id = "):
            current = json.loads(line.partition("#")[0].removeprefix("id = "))
        for finding in findings:
            column = f"column = {json.dumps(finding['channel'])}"
            if finding["toml"] and finding["run"] == current and column in line and line.lstrip().startswith("{"):
                lines[number] = f"  {finding['toml']},"
    file.write_text("\n".join(lines) + "\n")


def test_the_page_needs_at_most_six_commands():
    assert len(COMMANDS) <= 6 and all("\n" not in command for command in COMMANDS)
    assert set(FILES) == {"bench.toml", "gates.toml"}


@pytest.mark.parametrize("hits", [
    "tdms", "uff", "csv",
    pytest.param("bag", marks=pytest.mark.skipif(
        importlib.util.find_spec("rosbags") is None, reason="the extra [ros] is not installed")),
])  # fmt: skip
def test_the_three_mistakes_are_named_before_any_physics_and_pasting_mends_them(
    recorded, tmp_path, monkeypatch, capsys, hits
):
    lab_folder(recorded, tmp_path, hits=hits)
    write_page_files(tmp_path, hits)
    assert run(COMMANDS[0], tmp_path, monkeypatch) == 0
    made = read_campaign(tmp_path / "bench")
    assert len(made.runs) == len(recorded.runs)
    shape = {(r.experiment, 2 if hits == "bag" else len(r.streams)) for r in recorded.runs}  # a topic is a stream
    assert {(r.experiment, len(r.streams)) for r in made.runs} == shape
    found = quality(tmp_path, capsys)
    acc = {"uff": "2", "bag": "/imu/linear_acceleration_y"}.get(hits, "acceleration")
    for (name, channel), line in PLANTED.items():
        columns = {channel, acc if channel == "acceleration" else channel}
        if hits == "tdms" and channel == "acceleration":
            columns |= {f"hit-{number:02d}/acceleration" for number in range(1, 99)}
        named = [f for f in found if f["finding"] == name and f["channel"] in columns]
        assert named and all(line in f["toml"] for f in named), (name, channel, found)
    paste(tmp_path / "bench", found)
    assert quality(tmp_path, capsys) == []


def test_a_folder_without_mistakes_has_no_findings(recorded, tmp_path, monkeypatch, capsys):
    lab_folder(recorded, tmp_path, wrong=False)
    write_page_files(tmp_path)
    assert run(COMMANDS[0], tmp_path, monkeypatch) == 0
    assert quality(tmp_path, capsys) == []


@pytest.mark.slow
def test_the_six_commands_lead_from_the_folder_to_a_patch_and_a_green_gate(tmp_path, monkeypatch, capsys):
    campaign = simulate(tmp_path / "truth", "--hits", "4", "--repeats", "2")
    lab_folder(campaign, tmp_path)
    write_page_files(tmp_path)
    before = (tmp_path / "robot.xml").read_text()
    make, look, mapped, diagnose, patch, gate = COMMANDS
    assert run(make, tmp_path, monkeypatch) == 0
    assert run(look, tmp_path, monkeypatch) == 0
    paste(tmp_path / "bench", quality(tmp_path, capsys))
    assert run(mapped, tmp_path, monkeypatch) in (0, 1)  # 1: the map's figures differ from the nameplate's
    assert run(gate, tmp_path, monkeypatch) == 1  # red before
    assert run(diagnose, tmp_path, monkeypatch) == 0
    answer = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert answer["verdict"] == "none"
    assert (tmp_path / "out" / "patch" / "changes.csv").is_file()
    assert run(patch, tmp_path, monkeypatch) == 0
    after = (tmp_path / "robot.xml").read_text()
    stiffness = float(re.search(r'stiffness="([^" ]+)', after)[1])
    assert after != before and stiffness == pytest.approx(193665.0, rel=0.01)
    assert run(gate, tmp_path, monkeypatch) == 0
