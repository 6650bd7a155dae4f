r"""Your own MJCF beside a campaign: which joint is which (``map.toml``).

.. code-block:: toml

    format = "jointscope-map/1"
    model  = "robot.xml"              # MJCF, beside this file

    [[joint]]
    campaign    = "elbow_joint"       # the joint's name in the campaign; "" for a single-joint rig
    link        = "elbow_elastic"     # hinge behind the spring; of a rigid joint, the joint itself
    rotor       = "elbow_joint"       # hinge before the spring; absent for a rigid joint
    actuator    = "elbow_motor"       # absent where nothing drives it
    torque      = "motor"             # the actuator's control is N m on the motor shaft; "output": at the joint output
    sensor_site = "imu"               # absent where there is none
    rotor_ratio = 1.0                 # turns of the rotor's coordinate per output turn; n where it spins at motor speed
    control     = "torque"            # what the actuator is told: torque, or the commanded velocity or position
    sign        = 1                   # model angle = sign * campaign angle + zero_offset; torques turn likewise
    zero_offset = 0.0                 # rad

    [hold]                            # every further joint of the model that the bench held still, and where [rad or m]
    wrist_joint = 0.0
"""

from __future__ import annotations

import json
import os
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Literal

import mujoco

from jointscope.atomic import write_text
from jointscope.errors import InputError

FORMAT = "jointscope-map/1"


@dataclass(frozen=True, kw_only=True)
class JointMap:
    """One joint of the campaign and what stands for it in the model; fields as in the module's docstring."""

    campaign: str
    link: str
    rotor: str | None = None
    actuator: str | None = None
    torque: Literal["motor", "output"] = "output"
    sensor_site: str | None = None
    rotor_ratio: float = 1.0
    control: Literal["torque", "velocity", "position"] = "torque"
    sign: int = 1
    zero_offset: float = 0.0

    def model_angle(self, angle: float) -> float:
        """The model's angle [rad] for the campaign's."""
        return self.sign * angle + self.zero_offset


@dataclass(frozen=True, kw_only=True)
class ModelMap:
    """A model and its joints.

    Attributes:
        model: The file.
        joints: In the campaign's order.
        hold: Angle at which each further joint was held, by name [rad or m].
        file: The map it was read from, for messages; ``None`` where it was guessed.
    """

    model: Path
    joints: tuple[JointMap, ...]
    hold: Mapping[str, float] = field(default_factory=dict)
    file: Path | None = None


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """One figure of one joint.

    Attributes:
        joint: The campaign's name.
        figure: What is compared.
        unit: Of all three.
        mujoco, pinocchio: The model's value by either engine; ``None`` where only one can say.
        nameplate: The campaign's, ``None`` where it is silent.
        verdict: Empty where they agree or nothing can be said; else the likely mistake in words.
    """

    joint: str
    figure: str
    unit: str
    mujoco: float
    pinocchio: float | None
    nameplate: float | None
    verdict: str


def read_map(path: Path) -> ModelMap:
    """Read a ``map.toml``.

    Raises:
        InputError: The file is absent or breaks the format; the message names the key.
    """
    path = Path(path)
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(
            path, None, "no such file", fix="write one with: jointscope model map robot.xml CAMPAIGN"
        ) from None
    except tomllib.TOMLDecodeError as problem:
        raise InputError(path, None, f"not TOML: {problem}") from None
    if content.get("format") != FORMAT:
        raise InputError(path, "format", f"must be {FORMAT!r}", value=content.get("format"))
    known = {entry.name for entry in fields(JointMap)}
    for index, row in enumerate(content.get("joint", [])):
        for key in row:
            if key not in known:
                raise InputError(path, f"joint[{index}].{key}", "unknown key", value=row[key])
        for key in ("campaign", "link"):
            if key not in row:
                raise InputError(path, f"joint[{index}].{key}", "is missing")
        if row.get("sign", 1) not in (1, -1):
            raise InputError(path, f"joint[{index}].sign", "must be 1 or -1", value=row["sign"])
        if row.get("torque", "output") not in ("motor", "output"):
            raise InputError(path, f"joint[{index}].torque", "must be motor or output", value=row["torque"])
        if row.get("control", "torque") not in ("torque", "velocity", "position"):
            raise InputError(
                path, f"joint[{index}].control", "must be torque, velocity or position", value=row["control"]
            )
        for key in ("rotor_ratio", "zero_offset"):
            if not isinstance(row.get(key, 1.0), (int, float)) or (
                key == "rotor_ratio" and row.get(key, 1.0) == 0
            ):
                raise InputError(path, f"joint[{index}].{key}", "must be a number other than 0", value=row[key])
    for name, angle in content.get("hold", {}).items():
        if not isinstance(angle, (int, float)):
            raise InputError(path, f"hold.{name}", "must be an angle in rad", value=angle)
    if "model" not in content or not content.get("joint"):
        raise InputError(path, "model" if "model" not in content else "joint", "is missing")
    return ModelMap(
        model=(path.parent / content["model"]).resolve(), joints=tuple(JointMap(**row) for row in content["joint"]),
        hold={name: float(angle) for name, angle in content.get("hold", {}).items()}, file=path,
    )  # fmt: skip


def write_map(path: Path, found: ModelMap, comparisons: Sequence[Comparison]) -> None:
    """Write ``found`` to ``path`` with what each line means and what the comparison found."""
    path = Path(path)
    model = os.path.relpath(found.model.resolve(), path.resolve().parent)
    lines = [f"format = {json.dumps(FORMAT)}", f"model  = {json.dumps(model)}  # MJCF, beside this file"]
    notes = {
        "campaign": "the joint's name in the campaign", "link": "hinge behind the spring (a rigid joint: itself)",
        "rotor": "hinge before the spring", "actuator": "what drives it",
        "torque": "its control is N m on the motor shaft (motor) or at the joint output (output)",
        "sensor_site": "accelerometer", "rotor_ratio": "turns of the rotor's coordinate per output turn",
        "control": "what the actuator is told: torque, velocity or position",
        "sign": "model angle = sign * campaign angle + zero_offset", "zero_offset": "rad",
    }  # fmt: skip
    for joint in found.joints:
        lines += ["", "[[joint]]"]
        for name, note in notes.items():
            value = getattr(joint, name)
            if value is not None:
                lines.append(f"{name:<11} = {json.dumps(value)}  # {note}")
        for c in comparisons:
            if c.joint == joint.campaign:
                given = "silent" if c.nameplate is None else f"{c.nameplate:.6g}"
                lines.append(
                    f"# {c.figure}: model {c.mujoco:.6g}, campaign {given} {c.unit}. {c.verdict}".rstrip()
                )
    if found.hold:
        lines += ["", "[hold]  # joints that the bench held still; take out those that may move"]
        lines += [f"{json.dumps(name)} = {angle!r}  # rad or m" for name, angle in found.hold.items()]
    write_text(path, "\n".join(lines) + "\n")


def read_model(path: Path) -> tuple[mujoco.MjSpec, mujoco.MjModel]:
    """The MJCF at ``path`` and its compiled model.

    Raises:
        InputError: It is absent, or MuJoCo can't read it.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(path, None, "no such model")
    try:
        spec = mujoco.MjSpec.from_file(str(path))
        return spec, spec.compile()
    except ValueError as problem:
        raise InputError(path, None, f"not an MJCF that MuJoCo can read: {problem}") from None
