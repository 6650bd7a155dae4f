r"""The table that turns a rigid robot into an elastic one (``jointscope-arm/1``): read, checked, written.

.. code-block:: toml

    format = "jointscope-arm/1"
    title  = "what this arm is"

    [robot]
    source     = "ur10"          # a name from `jointscope arm list`, or a URDF or MJCF file beside this table
    mass_scale = 1.0             # every link's mass and inertia times this
    lock       = []              # joints welded at zero (a gripper's, for instance)

    [payload]                    # optional: a body at the last link, or on `body`
    mass = 5.0                   # kg
    com  = [0.0, 0.09, 0.0]      # m, in the frame of that body

    [posture]                    # rad; joints that are not named stand at zero
    elbow_joint = 1.9

    [[joint]]
    name            = "elbow_joint"
    stiffness       = 85000.0    # K [N m/rad], reducer
    damping         = 5.0        # c [N m s/rad], reducer
    reduction_ratio = 141.0      # n [-]
    motor_inertia   = 1.0e-3     # J_m [kg m^2], on the motor shaft; absent: the model's own armature is kept
    reducer_inertia = 3.2e-4     # J_s [kg m^2], on the motor shaft
    motor_damping   = 2.0        # b_m [N m s/rad], at the joint output; absent: the model's own damping moves there
    side            = "motor"    # where damping and friction that the model itself has go: "motor" or "load"
    drive_stiffness = 6.0e4      # position gain of its drive [N m/rad], at the joint output
    drive_damping   = 2.5e3      # speed gain of its drive [N m s/rad], at the joint output
    torque_limit    = 900.0      # of its drive [N m], at the joint output; absent: the robot's own limit
"""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, Literal

from jointscope.atomic import write_text
from jointscope.errors import InputError
from jointscope.models.parameters import ParameterError

FORMAT = "jointscope-arm/1"


@dataclass(frozen=True, kw_only=True)
class ElasticJoint:
    """One reducer and its motor; symbols as in the paper's Equations 1-4, units as in the module's docstring."""

    name: str
    stiffness: float
    damping: float
    reduction_ratio: float = 1.0
    motor_inertia: float | None = None
    reducer_inertia: float = 0.0
    motor_damping: float | None = None
    side: Literal["motor", "load"] = "motor"
    drive_stiffness: float | None = None
    drive_damping: float | None = None
    torque_limit: float | None = None

    def __post_init__(self) -> None:
        for name, positive in (
            ("stiffness", True), ("damping", False), ("reduction_ratio", True), ("motor_inertia", True),
            ("reducer_inertia", False), ("motor_damping", False), ("drive_stiffness", True), ("drive_damping", False),
            ("torque_limit", True),
        ):  # fmt: skip
            value = getattr(self, name)
            if value is None:
                continue
            if not math.isfinite(value) or value < 0.0 or (positive and value == 0.0):
                raise ParameterError(self.name, name, value, "positive" if positive else "zero or positive")

    @property
    def reflected_inertia(self) -> float | None:
        """J_M = (J_m + J_s) n^2 [kg m^2] (paper, Equation 2), or ``None`` where the model's own armature counts."""
        if self.motor_inertia is None:
            return None
        return (self.motor_inertia + self.reducer_inertia) * self.reduction_ratio * self.reduction_ratio


@dataclass(frozen=True, kw_only=True)
class Payload:
    """A compact load: mass [kg] and centre of mass [m] in the frame of ``body`` (the last link where ``None``)."""

    mass: float
    com: tuple[float, float, float] = (0.0, 0.0, 0.0)
    body: str | None = None

    @property
    def inertia(self) -> float:
        """About its own centre, of a steel ball of that mass (7850 kg/m^3) [kg m^2]."""
        radius = math.cbrt(3.0 * self.mass / (4.0 * math.pi * 7850.0))
        return 0.4 * self.mass * radius**2


@dataclass(frozen=True, kw_only=True)
class ArmTable:
    """A robot and what makes it elastic.

    Attributes:
        source: Name in the library, or a file.
        folder: Where a relative ``source`` is looked for.
        posture: Angle of each link joint [rad]; zero where absent.
        computed: How the figures were come by; free text and numbers, never read back.
    """

    source: str
    joints: tuple[ElasticJoint, ...]
    title: str = ""
    folder: Path = Path()
    mass_scale: float = 1.0
    lock: tuple[str, ...] = ()
    payload: Payload | None = None
    posture: Mapping[str, float] = field(default_factory=dict)
    computed: Mapping[str, Any] = field(default_factory=dict)

    def joint(self, name: str) -> ElasticJoint:
        """The row of that name."""
        for row in self.joints:
            if row.name == name:
                return row
        raise KeyError(f"{name!r} has no row; rows: {', '.join(row.name for row in self.joints)}")


def read_table(path: Path) -> ArmTable:
    """Read a table.

    Raises:
        InputError: The file is absent, isn't TOML, or has a wrong key or value; the message names it.
    """
    path = Path(path)
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(
            path, None, "no such file", fix="see `jointscope arm build --help` for the format"
        ) from None
    except tomllib.TOMLDecodeError as problem:
        raise InputError(path, None, f"not TOML: {problem}") from None
    if content.get("format") != FORMAT:
        raise InputError(path, "format", f"must be {FORMAT!r}", value=content.get("format"))
    _known(path, "", content, ("format", "title", "robot", "payload", "posture", "joint", "computed"))
    robot = content.get("robot", {})
    _known(path, "robot.", robot, ("source", "mass_scale", "lock"))
    if "source" not in robot:
        raise InputError(
            path, "robot.source", "is missing", fix='a robot name such as "ur10", or a URDF or MJCF file'
        )
    rows = content.get("joint", [])
    for index, row in enumerate(rows):
        _known(path, f"joint[{index}].", row, [entry.name for entry in fields(ElasticJoint)])
    payload = content.get("payload")
    if payload is not None:
        _known(path, "payload.", payload, ("mass", "com", "body"))
        payload = {**payload, "com": tuple(payload.get("com", (0.0, 0.0, 0.0)))}
    try:
        return ArmTable(
            source=robot["source"],
            folder=path.parent,
            title=content.get("title", ""),
            mass_scale=float(robot.get("mass_scale", 1.0)),
            lock=tuple(robot.get("lock", ())),
            joints=tuple(ElasticJoint(**row) for row in rows),
            payload=None if payload is None else Payload(**payload),
            posture={name: float(angle) for name, angle in content.get("posture", {}).items()},
            computed=content.get("computed", {}),
        )
    except (TypeError, ValueError, ParameterError) as problem:
        raise InputError(path, "joint", str(problem)) from None


def write_table(path: Path, table: ArmTable) -> None:
    """Write ``table`` to ``path`` atomically; ``read_table`` gives it back."""
    lines = [f"format = {json.dumps(FORMAT)}", f"title  = {json.dumps(table.title)}", "", "[robot]"]
    lines += [f"source     = {json.dumps(table.source)}", f"mass_scale = {table.mass_scale!r}"]
    lines += [f"lock       = {json.dumps(list(table.lock))}", ""]
    if table.payload is not None:
        lines += ["[payload]", f"mass = {table.payload.mass!r}  # kg", f"com  = {list(table.payload.com)!r}  # m"]
        lines += [f"body = {json.dumps(table.payload.body)}", ""] if table.payload.body else [""]
    lines += ["[posture]  # rad"] + [f"{name} = {angle!r}" for name, angle in table.posture.items()] + [""]
    for row in table.joints:
        lines.append("[[joint]]")
        for entry in fields(row):
            value = getattr(row, entry.name)
            if value is not None:
                lines.append(f"{entry.name:<15} = {json.dumps(value)}")
        lines.append("")
    if table.computed:
        lines.append("[computed]  # how these figures were found")
        lines += [f"{key} = {json.dumps(value, ensure_ascii=False)}" for key, value in table.computed.items()]
    write_text(Path(path), "\n".join(lines).rstrip() + "\n")


def _known(path: Path, place: str, found: Mapping[str, Any], known: Any) -> None:  # noqa: ANN401
    for key in found:
        if key not in known:
            raise InputError(
                path, f"{place}{key}", "unknown key", value=found[key], fix=f"known: {', '.join(known)}"
            )
