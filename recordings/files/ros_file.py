"""ROS bags (ROS 1 ``.bag``; ROS 2 ``.mcap`` and ``.db3``): joints by name, header stamps as the clock.

    /joint_states/elbow/position|velocity|effort     sensor_msgs/JointState, each joint by its name
    /ft/force_x ... /ft/torque_z                     geometry_msgs/WrenchStamped
    /imu/linear_acceleration_x ... angular_velocity_z   sensor_msgs/Imu
    /joint_states/time                               the messages' header stamps [s] after the file's first one

A JointState's order of joints may change from message to message, and a message may hold some of them only. The time a
bag was written at is when a message arrived, not when it was measured: it is never used. ``effort`` has no unit by
itself: drivers put a torque or a current into it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from jointscope.errors import CampaignError, MissingExtraError
from jointscope.recordings.files.columns import Column, DataFile

EFFORT: Final = "effort: a torque or a current, by driver"
_OUTPUT = "a JointState is of the joint, behind its reducer"
_MEANING: Final[Mapping[str, Mapping[str, tuple[str, str]]]] = {
    "position": {"quantity": ("angle", "a JointState's position"), "location": ("arm", _OUTPUT)},
    "velocity": {"quantity": ("angular-velocity", "a JointState's velocity"), "location": ("arm", _OUTPUT)},
    "effort": {"location": ("motor", "the drive's own reading")},
    "linear_acceleration": {"quantity": ("linear-acceleration", "an Imu message"), "location": ("arm", "its usual place")},
    "angular_velocity": {"quantity": ("angular-velocity", "an Imu message"), "location": ("arm", "its usual place")},
    "force": {"quantity": ("force", "a WrenchStamped message")},
    "torque": {"quantity": ("torque", "a WrenchStamped message"), "location": ("arm", "an external torque")},
}  # fmt: skip
_UNITS: Final = {"linear_acceleration": "m/s^2", "angular_velocity": "rad/s", "force": "N", "torque": "N m"}
_VECTORS: Final = {
    "sensor_msgs/msg/Imu": (("", ("linear_acceleration", "angular_velocity")),),
    "geometry_msgs/msg/WrenchStamped": (("wrench", ("force", "torque")),),
}
_JOINT_STATE: Final = "sensor_msgs/msg/JointState"
_FIELDS: Final = ("position", "velocity", "effort")


@dataclass
class _Series:
    """One column in the making: header stamps [ns] and values, in the order they were found."""

    stamps: list[int] = field(default_factory=list)
    values: list[float] = field(default_factory=list)


def open_file(path: Path) -> DataFile:
    """Open ``path`` and read every message of the three kinds.

    Raises:
        MissingExtraError: rosbags is not installed.
        CampaignError: No message of a known kind, or none that carries a header stamp.
    """
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise MissingExtraError(f"{path.name}: reading a ROS bag", "ros") from None
    series: dict[str, dict[str, _Series]] = {}
    held = []
    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        held = sorted({f"{c.topic} ({c.msgtype})" for c in reader.connections})
        known = [c for c in reader.connections if c.msgtype in (_JOINT_STATE, *_VECTORS)]
        for connection, _, raw in reader.messages(connections=known) if known else ():
            message = reader.deserialize(raw, connection.msgtype)
            _add(series.setdefault(connection.topic, {}), connection.topic, connection.msgtype, message)
    stamped = {t: {n: s for n, s in columns.items() if any(s.stamps)} for t, columns in series.items()}
    if not any(stamped.values()):
        why = "its messages carry no header stamps" if series else f"it holds {', '.join(held[:8]) or 'nothing'}"
        raise CampaignError(
            path, None, f"no stamped JointState, WrenchStamped or Imu message: {why}",
            fix="record such a topic with header stamps",
        )  # fmt: skip
    return _data_file(path, stamped)


def _add(columns: dict[str, _Series], topic: str, kind: str, message: Any) -> None:  # noqa: ANN401  # typed by the bag
    stamp = int(message.header.stamp.sec) * 1_000_000_000 + int(message.header.stamp.nanosec)
    for name, value in _values(topic, kind, message):
        one = columns.setdefault(name, _Series())
        one.stamps.append(stamp)
        one.values.append(value)


def _values(topic: str, kind: str, message: Any) -> Iterator[tuple[str, float]]:  # noqa: ANN401
    if kind == _JOINT_STATE:
        for what in _FIELDS:
            numbers = getattr(message, what)
            if len(numbers) != len(message.name):  # fields that a driver doesn't fill are empty
                continue
            for joint, value in zip(message.name, numbers, strict=True):
                yield f"{topic}/{joint}/{what}", float(value)
        return
    for inside, fields in _VECTORS[kind]:
        part = getattr(message, inside) if inside else message
        for what in fields:
            vector = getattr(part, what)
            for axis in "xyz":
                yield f"{topic}/{what}_{axis}", float(getattr(vector, axis))


def _data_file(path: Path, series: Mapping[str, Mapping[str, _Series]]) -> DataFile:
    origin = min(s.stamps[0] for columns in series.values() for s in columns.values())
    origin = min(origin, *(min(s.stamps) for columns in series.values() for s in columns.values()))
    found: dict[str, Column] = {}
    for topic, columns in series.items():
        clocks: dict[tuple[int, ...], str] = {}
        for name, one in columns.items():
            stamps, values = _in_order(one)
            key = tuple(stamps.tolist())
            if key not in clocks:
                # joints of one topic that are in different messages have clocks of their own
                clock = f"{topic}/time" if not clocks else f"{name.rsplit('/', 1)[0]}/time"
                while clock in found:
                    clock += "_"
                clocks[key] = clock
                found[clock] = _column(clock, np.asarray((stamps - origin) * 1e-9, dtype=np.float64), clock)
            found[name] = _column(name, values, clocks[key])
    return DataFile(path=path, columns=found, simultaneous=True)


def _in_order(one: _Series) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """By header stamp; of messages that repeat a stamp the first."""
    stamps, first = np.unique(np.array(one.stamps, dtype=np.int64), return_index=True)
    return stamps, np.array(one.values, dtype=np.float64)[first]


def _column(name: str, values: NDArray[np.float64], clock: str) -> Column:
    last = name.rsplit("/", 1)[-1]
    what = last[:-2] if last[-2:] in ("_x", "_y", "_z") else last
    return Column(
        name=name,
        length=values.size,
        read=lambda: values,
        unit=_UNITS.get(what),
        clock=clock,
        meaning=_MEANING.get(what, {}),
        label=EFFORT if what == "effort" else "",
        joint=name.rsplit("/", 2)[-2] if last in _FIELDS else None,
    )
