"""ROS bags: joints by name, header stamps as the clock, and an effort that is never taken for a torque by itself."""

import itertools
import sys

import numpy as np
import pytest

from jointscope.cli import main
from jointscope.errors import CampaignError, InputError, MissingExtraError
from jointscope.recordings.draft.drafting import draft_campaign
from jointscope.recordings.draft.records import records_of
from jointscope.recordings.files import open_data_file
from jointscope.recordings.reader import read_campaign

needs_rosbags = pytest.mark.skipif(
    __import__("importlib.util").util.find_spec("rosbags") is None, reason="the extra [ros] is not installed"
)
JOINTS = ("shoulder", "elbow", "wrist")
RATE, COUNT, EPOCH = 500.0, 1000, 1_790_000_000


def angle(joint, t):
    return (1.0 + JOINTS.index(joint)) * np.sin(2.0 * np.pi * 0.7 * t + JOINTS.index(joint))


def stamps(offset=0.0, rate=RATE, count=COUNT):
    """Header stamps [ns], exact on a grid."""
    return EPOCH * 1_000_000_000 + np.rint((offset + np.arange(count) / rate) * 1e9).astype(np.int64)


class Bag:
    """A bag in the making, in one of the formats."""

    def __init__(self, folder, kind):
        from rosbags.rosbag1 import Writer as Writer1
        from rosbags.rosbag2 import StoragePlugin
        from rosbags.rosbag2 import Writer as Writer2
        from rosbags.typesys import Stores, get_typestore

        self.one = kind == "bag"
        self.store = get_typestore(Stores.ROS1_NOETIC if self.one else Stores.ROS2_HUMBLE)
        if self.one:
            self.path = self.folder = folder / "take.bag"
            self.writer = Writer1(self.path)
        else:
            self.folder = folder / "take"
            self.path = self.folder / f"take.{kind}"
            plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
            self.writer = Writer2(self.folder, version=9, storage_plugin=plugin)
        self.connections = {}
        self.late = itertools.count()

    def __enter__(self):
        self.writer.open()
        return self

    def __exit__(self, *problem):
        self.writer.close()

    def type(self, name):
        return self.store.types[name]

    def write(self, topic, kind, stamp, **fields):
        """One message; it arrives late, and later from message to message, as over a network."""
        if topic not in self.connections:
            self.connections[topic] = self.writer.add_connection(topic, kind, typestore=self.store)
        message = self.type(kind)(header=self.header(stamp), **fields)
        raw = (self.store.serialize_ros1 if self.one else self.store.serialize_cdr)(message, kind)
        arrival = EPOCH * 1_000_000_000 + 5_000_000_000 + 7_000_001 * next(self.late)
        self.writer.write(self.connections[topic], arrival, raw)

    def header(self, stamp):
        time = self.type("builtin_interfaces/msg/Time")(sec=int(stamp // 10**9), nanosec=int(stamp % 10**9))
        more = {"seq": 0} if self.one else {}
        return self.type("std_msgs/msg/Header")(stamp=time, frame_id="", **more)

    def joint_state(self, stamp, names, t, effort=True, topic="/joint_states"):
        self.write(
            topic, "sensor_msgs/msg/JointState", stamp,
            name=list(names), position=np.array([angle(j, t) for j in names]),
            velocity=np.array([10.0 * angle(j, t) for j in names]),
            effort=np.array([0.1 * angle(j, t) for j in names]) if effort else np.array([]),
        )  # fmt: skip

    def imu(self, stamp, acceleration, topic="/imu"):
        vector = self.type("geometry_msgs/msg/Vector3")
        self.write(
            topic, "sensor_msgs/msg/Imu", stamp,
            orientation=self.type("geometry_msgs/msg/Quaternion")(x=0.0, y=0.0, z=0.0, w=1.0),
            orientation_covariance=np.zeros(9),
            angular_velocity=vector(x=0.0, y=0.0, z=0.5 * acceleration), angular_velocity_covariance=np.zeros(9),
            linear_acceleration=vector(x=0.0, y=acceleration, z=9.81), linear_acceleration_covariance=np.zeros(9),
        )  # fmt: skip

    def wrench(self, stamp, force, topic="/ft"):
        vector = self.type("geometry_msgs/msg/Vector3")
        wrench = self.type("geometry_msgs/msg/Wrench")(
            force=vector(x=force, y=0.0, z=0.0), torque=vector(x=0.0, y=0.0, z=2.0 * force)
        )
        self.write(topic, "geometry_msgs/msg/WrenchStamped", stamp, wrench=wrench)


def joint_bag(folder, kind="mcap", *, shuffled=True, effort=True, names=JOINTS):
    rng = np.random.default_rng(1)
    with Bag(folder, kind) as bag:
        for index, stamp in enumerate(stamps()):
            order = rng.permutation(names) if shuffled else names
            bag.joint_state(stamp, [str(name) for name in order], index / RATE, effort)
    return bag


@needs_rosbags
@pytest.mark.parametrize("kind", ["mcap", "db3", "bag"])
def test_joints_are_found_by_name_whatever_their_order_in_a_message(tmp_path, kind):
    data = open_data_file(joint_bag(tmp_path, kind).path)
    t = data.columns["/joint_states/time"].read()
    np.testing.assert_allclose(t, np.arange(COUNT) / RATE, atol=1e-9)
    for joint in JOINTS:
        np.testing.assert_array_equal(
            data.columns[f"/joint_states/{joint}/position"].read(), angle(joint, np.arange(COUNT) / RATE)
        )
        assert data.columns[f"/joint_states/{joint}/effort"].joint == joint


@needs_rosbags
def test_the_clock_is_the_header_stamp_not_the_arrival(tmp_path):
    with Bag(tmp_path, "mcap") as bag:
        for index in np.random.default_rng(2).permutation(COUNT):  # messages overtake each other
            bag.imu(stamps()[index], float(index))
    data = open_data_file(bag.path)
    np.testing.assert_allclose(data.columns["/imu/time"].read(), np.arange(COUNT) / RATE, atol=1e-9)
    np.testing.assert_array_equal(data.columns["/imu/linear_acceleration_y"].read(), np.arange(COUNT, dtype=float))
    assert data.columns["/imu/linear_acceleration_y"].unit == "m/s^2"


@needs_rosbags
def test_two_publishers_on_one_topic_keep_their_own_clocks(tmp_path):
    with Bag(tmp_path, "mcap") as bag:
        for index in range(200):
            bag.joint_state(stamps()[index], ["shoulder"], index / RATE)
            if index % 2 == 0:
                bag.joint_state(stamps(0.0003)[index], ["elbow"], index / RATE + 0.0003)
    data = open_data_file(bag.path)
    elbow = data.columns["/joint_states/elbow/position"]
    assert elbow.clock != data.columns["/joint_states/shoulder/position"].clock
    t = data.columns[elbow.clock].read()
    np.testing.assert_allclose(elbow.read(), angle("elbow", t), atol=1e-9)


@needs_rosbags
def test_repeated_stamps_count_once(tmp_path):
    with Bag(tmp_path, "mcap") as bag:
        for stamp in np.repeat(stamps()[:100], 2):
            bag.wrench(stamp, 3.0)
    assert open_data_file(bag.path).columns["/ft/force_x"].length == 100


@needs_rosbags
@pytest.mark.parametrize("what", ["no stamps", "no topic"])
def test_a_bag_without_stamped_messages_is_refused_in_one_line(tmp_path, what):
    with Bag(tmp_path, "mcap") as bag:
        for _ in range(80):
            if what == "no stamps":
                bag.imu(0, 1.0)
            else:
                header = bag.header(5)
                kind = "std_msgs/msg/Header"
                connection = bag.connections.setdefault(
                    "/h", bag.connections.get("/h") or bag.writer.add_connection("/h", kind, typestore=bag.store)
                )
                bag.writer.write(connection, 5, bag.store.serialize_cdr(header, kind))
    with pytest.raises(CampaignError, match="stamp") as said:
        open_data_file(bag.path)
    assert "\n" not in str(said.value)


@needs_rosbags
def test_half_a_bag_is_one_line(tmp_path):
    path = joint_bag(tmp_path).path
    (tmp_path / "half.mcap").write_bytes(path.read_bytes()[:2000])
    with pytest.raises(CampaignError, match=r"half\.mcap"):
        open_data_file(tmp_path / "half.mcap")


# --- effort ----------------------------------------------------------------------------------------------------------


@needs_rosbags
def test_effort_is_demanded_and_the_ur_default_named(tmp_path, capsys):
    bag = joint_bag(tmp_path)
    words = ["new", str(bag.folder), "--joint", "elbow", "--yes", "--out", str(tmp_path / "c")]
    assert main(words) == 2
    said = capsys.readouterr().err
    assert (
        said.count("\n") == 1
        and "--effort torque or --effort current" in said
        and "UR driver's default is current" in said
    )
    assert not (tmp_path / "c").exists()


@needs_rosbags
@pytest.mark.parametrize(("effort", "quantity", "unit", "side"), [
    ("current", "current", "A", "motor"), ("torque", "torque", "N m", "output")
])  # fmt: skip
def test_effort_is_what_was_said(tmp_path, effort, quantity, unit, side):
    bag = joint_bag(tmp_path)
    out = tmp_path / "c"
    (tmp_path / "a.toml").write_text("[rig]\nreduction_ratio = 100.0\n")
    words = ["new", str(bag.folder), "--joint", "elbow", "--effort", effort, "--answers", str(tmp_path / "a.toml")]
    assert main([*words, "--yes", "--out", str(out)]) == 0
    (run,) = read_campaign(out).runs
    (signal,) = run.select(role="input")
    assert (signal.channel.quantity, signal.channel.unit, signal.channel.location) == (quantity, unit, "motor")
    assert signal.channel.side == side
    np.testing.assert_allclose(signal.samples, 0.1 * angle("elbow", signal.times), atol=1e-6)
    assert {s.channel.location for s in run.select(role="output")} == {"arm"}
    assert run.experiment == "torque-sweep"


@needs_rosbags
def test_a_torque_at_the_joint_asks_for_the_ratio(tmp_path, capsys):
    bag = joint_bag(tmp_path, names=("elbow",))
    assert main(["new", str(bag.folder), "--effort", "torque", "--yes", "--out", str(tmp_path / "c")]) == 2
    assert "reduction_ratio" in capsys.readouterr().err


@needs_rosbags
def test_without_effort_in_the_bag_nothing_is_demanded(tmp_path):
    bag = joint_bag(tmp_path, effort=False, names=("elbow",))
    assert main(["new", str(bag.path), "--yes", "--out", str(tmp_path / "c")]) == 0
    assert read_campaign(tmp_path / "c").runs[0].select(role="input") == ()


@needs_rosbags
def test_asked_about_an_effort_an_empty_answer_is_none(tmp_path):
    records = records_of(joint_bag(tmp_path, names=("elbow",)).path)
    names = {records[0].file: "take.mcap"}
    with pytest.raises(InputError, match="--effort"):
        draft_campaign(records, names, {}, lambda question, usual: "" if "torque (N m)" in question else usual)
    questions = []

    def ask(question, usual):
        questions.append(question)
        return "current" if "torque (N m)" in question else usual

    _, runs, _ = draft_campaign(records, names, {}, ask)
    assert any("UR driver's default is current" in question for question in questions)
    assert "current" in {channel.values["quantity"] for channel in runs[0].streams[0][1]}


@needs_rosbags
def test_several_joints_need_a_choice(tmp_path, capsys):
    bag = joint_bag(tmp_path)
    words = ["new", str(bag.folder), "--effort", "current", "--yes", "--out", str(tmp_path / "c")]
    assert main(words) == 2
    assert "elbow, shoulder, wrist" in capsys.readouterr().err
    assert main([*words, "--joint", "knee"]) == 2


# --- several topics --------------------------------------------------------------------------------------------------


@needs_rosbags
def test_topics_become_streams_of_one_run_with_their_starts_on_one_clock(tmp_path):
    with Bag(tmp_path, "mcap") as bag:
        for index, stamp in enumerate(stamps()):
            bag.joint_state(stamp, ["elbow"], index / RATE)
        for index, stamp in enumerate(stamps(0.2505, 200.0, 300)):
            bag.imu(stamp, float(np.sin(index)))
    out = tmp_path / "c"
    assert main(["new", str(bag.folder), "--effort", "current", "--yes", "--out", str(out)]) == 0
    (run,) = read_campaign(out).runs
    assert sorted((stream.sampling_rate, round(stream.start, 6)) for stream in run.streams) == [
        (200.0, 0.2505),
        (500.0, 0.0),
    ]
    assert all(stream.jitter < 1e-6 for stream in run.streams)


@needs_rosbags
def test_lost_messages_leave_gaps_not_a_stretched_clock(tmp_path):
    kept = np.delete(np.arange(COUNT), [300, 301, 700])
    with Bag(tmp_path, "mcap") as bag:
        for index in kept:
            bag.imu(stamps()[index], float(np.sin(index / 50.0)))
    assert main(["new", str(bag.path), "--yes", "--out", str(tmp_path / "c")]) == 0
    (stream,) = read_campaign(tmp_path / "c").runs[0].streams
    assert stream.sampling_rate == RATE and stream.length == COUNT
    samples = next(c for c in stream.channels if c.column.endswith("acceleration_y")).samples
    assert np.flatnonzero(np.isnan(samples)).tolist() == [300, 301, 700]
    np.testing.assert_allclose(samples[kept], np.sin(kept / 50.0), atol=1e-6)


def test_without_the_extra_the_message_is_the_command_that_installs_it(tmp_path, monkeypatch, capsys):
    for name in ("rosbags", "rosbags.highlevel", "rosbags.typesys"):
        monkeypatch.setitem(sys.modules, name, None)
    path = tmp_path / "take.mcap"
    path.write_bytes(b"\x89MCAP0\r\n")
    with pytest.raises(MissingExtraError, match=r"pip install 'jointscope\[ros\]'"):
        open_data_file(path)
    assert main(["new", str(path), "--list"]) == 2
    assert capsys.readouterr().err.count("\n") == 1
