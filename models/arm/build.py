r"""A rigid robot made elastic: every joint becomes two hinges on one axis, q = q_s + e.

The model's own joint turns into the rotor, at the joint output (angle q_s): it keeps its name, its actuators and its
sensors, and carries the armature J_M = (J_m + J_s) n^2 and the motor damping b_m. A second hinge ``NAME_elastic`` in the
same body is the reducer's wind-up e = q - q_s with stiffness K and damping c, so that T_S = -K e - c e' (paper,
Equation 4). Because both hinges share body and axis, the rotor takes no link mass with it: M_ee is the rigid arm's
mass matrix and M_ss - M_ee = diag(J_M).

What the rigid model's joint had of its own goes to a stated side: ``armature`` always to the rotor; ``damping`` and
``frictionloss`` to the rotor, or with ``side = "load"`` to a fixed tendon over q_s + e, which is the link; a spring of
the joint (a gravity balancer) always to the link.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from jointscope.atomic import write_text
from jointscope.errors import InputError, JointscopeError
from jointscope.models.arm.library import find_arm
from jointscope.models.arm.table import ArmTable, ElasticJoint
from jointscope.models.parameters import STANDARD_GRAVITY

ELASTIC = "_elastic"
DRIVE = "_drive"
RATIO = "_reduction_ratio"


@dataclass(frozen=True, eq=False)
class ElasticArm:
    """An arm whose joints are rotor and reducer hinges.

    Attributes:
        spec: The MJCF; treat as read-only (``spec.copy()`` before a change).
        xml: Its text.
        rotors: Rotor hinge of each joint, base to tip: the joints' names.
        reducers: Reducer hinge of each joint, in the same order.
    """

    spec: mujoco.MjSpec
    xml: str
    rotors: tuple[str, ...]
    reducers: tuple[str, ...]

    def index(self, joint: str) -> int:
        """Place of a joint.

        Raises:
            JointscopeError: The arm has no such joint; the message lists those it has.
        """
        if joint not in self.rotors:
            raise JointscopeError(f"the arm has no joint {joint!r}; its joints: {', '.join(self.rotors)}")
        return self.rotors.index(joint)

    def reduction_ratio(self, joint: str) -> float:
        """n of that joint [-], from the model's ``<custom>`` numbers; 1 where it is silent."""
        numeric = self.spec.numeric(joint + RATIO)
        return 1.0 if numeric is None else float(numeric.data[0])


def source_file(table: ArmTable) -> Path:
    """The URDF or MJCF file behind ``table``."""
    if Path(table.source).suffix.lower() in (".urdf", ".xml", ".mjcf"):
        path = (table.folder / table.source).resolve()
        if not path.is_file():
            raise InputError(path, None, "no such robot file", fix="robot.source is looked for beside the table")
        return path
    return find_arm(table.source).urdf


def rigid_spec(path: Path, lock: tuple[str, ...] = ()) -> mujoco.MjSpec:
    """The rigid robot in a URDF or MJCF file; meshes of a URDF are left out, they carry no inertia.

    Raises:
        InputError: The file can't be read, or a locked joint isn't in it.
    """
    try:
        root = ElementTree.parse(path).getroot()
        if root.tag == "robot":
            spec = mujoco.MjSpec.from_string(_without_looks(root))
            spec.option.gravity = [0.0, 0.0, -STANDARD_GRAVITY]
        else:
            spec = mujoco.MjSpec.from_file(str(path))
    except (ElementTree.ParseError, ValueError) as problem:
        raise InputError(path, None, f"not a robot that MuJoCo can read: {problem}") from None
    for name in lock:
        joint = spec.joint(name)
        if joint is None:
            raise InputError(path, f"lock {name}", "no such joint", fix=f"joints: {_names(spec.joints)}")
        spec.delete(joint)
    return spec


def loaded_spec(table: ArmTable) -> mujoco.MjSpec:
    """The rigid robot of ``table`` with its masses scaled and its payload on, joints still rigid."""
    path = source_file(table)
    spec = rigid_spec(path, table.lock)
    spec.compile()  # gives every body its explicit inertia
    if table.mass_scale != 1.0:
        if any(geom.mass > 0.0 for geom in spec.geoms) or not all(b.explicitinertial for b in spec.bodies[1:]):
            raise InputError(path, "mass_scale", "only robots whose bodies state their <inertial> can be scaled")
        for body in spec.bodies[1:]:
            body.mass *= table.mass_scale
            body.inertia = body.inertia * table.mass_scale
            if not np.isnan(body.fullinertia[0]):
                body.fullinertia = body.fullinertia * table.mass_scale
    if table.payload is not None and table.payload.mass > 0.0:
        carrier = spec.body(table.payload.body) if table.payload.body else spec.bodies[-1]
        if carrier is None:
            raise InputError(path, f"payload.body {table.payload.body}", f"bodies: {_names(spec.bodies)}")
        load = carrier.add_body(name="payload", pos=table.payload.com)
        load.mass, load.inertia, load.ipos = table.payload.mass, [table.payload.inertia] * 3, [0.0, 0.0, 0.0]
        load.explicitinertial = True
    return spec


def build_arm(table: ArmTable) -> ElasticArm:
    """The elastic arm of ``table``.

    Raises:
        InputError: A row names a joint that the robot lacks, or leaves its rotor without inertia.
    """
    spec = loaded_spec(table)
    path = source_file(table)
    hinges = [joint for joint in spec.joints if joint.type == mujoco.mjtJoint.mjJNT_HINGE]
    known = {joint.name for joint in hinges}
    for row in table.joints:
        if row.name not in known:
            raise InputError(path, f"joint {row.name}", "no such hinge", fix=f"hinges: {_names(hinges)}")
    rows = {row.name: row for row in table.joints}
    rotors = tuple(joint.name for joint in hinges if joint.name in rows)
    for joint in hinges:
        if joint.name in rows:
            _make_elastic(spec, joint, rows[joint.name], path)
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_EULERDAMP)
    spec.compile()
    if path.suffix.lower() == ".urdf":  # read back, so that what is written is to the digit what is stepped
        xml = spec.to_xml()
        spec = mujoco.MjSpec.from_string(xml)
        spec.compile()
    else:
        xml = spec.to_xml()
    return ElasticArm(spec, xml, rotors, tuple(name + ELASTIC for name in rotors))


def read_arm(path: Path) -> ElasticArm:
    """An elastic arm from an MJCF whose reducer hinges are called ``NAME_elastic``.

    Raises:
        InputError: The file can't be read or holds no elastic joint.
    """
    try:
        spec = mujoco.MjSpec.from_file(str(path))
        spec.compile()
    except ValueError as problem:
        raise InputError(path, None, f"not an MJCF that MuJoCo can read: {problem}") from None
    names = {joint.name for joint in spec.joints}
    rotors = tuple(j.name for j in spec.joints if j.name + ELASTIC in names)
    if not rotors:
        raise InputError(
            path,
            None,
            f"has no joint pair NAME, NAME{ELASTIC}",
            fix="make one with: jointscope arm build TABLE --out FILE",
        )
    return ElasticArm(spec, path.read_text(encoding="utf-8"), rotors, tuple(name + ELASTIC for name in rotors))


def write_arm(path: Path, arm: ElasticArm) -> None:
    """Write the arm's MJCF to ``path`` atomically."""
    write_text(Path(path), arm.xml)


def with_reducers(arm: ElasticArm, stiffness: Mapping[str, float], damping: Mapping[str, float]) -> ElasticArm:
    """The arm with other K [N m/rad] and c [N m s/rad] of the joints that are named."""
    spec = arm.spec.copy()
    for values, attribute in ((stiffness, "stiffness"), (damping, "damping")):
        for name, value in values.items():
            setattr(spec.joint(arm.reducers[arm.index(name)]), attribute, [float(value), 0.0, 0.0])
    spec.compile()
    return ElasticArm(spec, spec.to_xml(), arm.rotors, arm.reducers)


def with_drive(arm: ElasticArm, joint: str, stiffness: float, damping: float) -> ElasticArm:
    """The arm with other drive gains of one joint, see :func:`add_drive`; its drive is added where it has none."""
    arm.index(joint)
    spec = arm.spec.copy()
    drive = spec.actuator(joint + DRIVE)
    if drive is not None:
        spec.delete(drive)
    add_drive(spec, joint, stiffness, damping)
    spec.compile()
    return ElasticArm(spec, spec.to_xml(), arm.rotors, arm.reducers)


def _make_elastic(spec: mujoco.MjSpec, joint: mujoco.MjsJoint, row: ElasticJoint, path: Path) -> None:
    if row.reflected_inertia is not None:
        joint.armature = row.reflected_inertia
    if joint.armature <= 0.0:
        raise InputError(
            path, f"joint {row.name}", "its rotor would have no inertia",
            fix="give motor_inertia and reduction_ratio in the table, or armature in the MJCF",
        )  # fmt: skip
    own_damping, own_friction = float(joint.damping[0]), float(joint.frictionloss)
    if own_damping > 0.0 or own_friction > 0.0 or joint.stiffness[0] > 0.0:
        link = dict(damping=[0.0, 0.0, 0.0], frictionloss=0.0, stiffness=list(joint.stiffness))
        if row.side == "load":
            link.update(damping=[own_damping, 0.0, 0.0], frictionloss=own_friction)
            joint.damping, joint.frictionloss = [0.0, 0.0, 0.0], 0.0
        if any(np.any(np.asarray(value) > 0.0) for value in link.values()):
            tendon = spec.add_tendon(name=row.name + "_link", springlength=[float(joint.springref)] * 2, **link)
            tendon.wrap_joint(joint.name, 1.0)
            tendon.wrap_joint(joint.name + ELASTIC, 1.0)
        joint.stiffness = [0.0, 0.0, 0.0]
    if row.motor_damping is not None:
        joint.damping = [row.motor_damping, 0.0, 0.0]
    joint.parent.add_joint(
        name=joint.name + ELASTIC,
        type=mujoco.mjtJoint.mjJNT_HINGE,
        pos=joint.pos,
        axis=joint.axis,
        stiffness=[row.stiffness, 0.0, 0.0],
        damping=[row.damping, 0.0, 0.0],
        armature=0.0,
        frictionloss=0.0,
        limited=mujoco.mjtLimited.mjLIMITED_FALSE,
    )
    spec.add_numeric(name=joint.name + RATIO, data=[row.reduction_ratio], size=1)
    limit = row.torque_limit or (float(joint.actfrcrange[1]) if joint.actfrclimited else None)
    joint.actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE  # the limit is the drive's; a hammer knows none
    if row.drive_stiffness is not None:
        add_drive(spec, joint.name, row.drive_stiffness, row.drive_damping or 0.0, limit)


def add_drive(
    spec: mujoco.MjSpec, joint: str, stiffness: float, damping: float, limit: float | None = None
) -> None:
    """Add ``NAME_drive``: torque = kp (u - q_s) - kv q_s' on the rotor, within +-limit [N m, at the joint output].

    Commanding u = q_cmd + (kv/kp) q_cmd' makes it a position loop around a speed loop.
    """
    drive = spec.add_actuator(name=joint + DRIVE, target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    drive.gaintype, drive.biastype = mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtBias.mjBIAS_AFFINE
    drive.gainprm[0] = stiffness
    drive.biasprm[1], drive.biasprm[2] = -stiffness, -damping
    if limit is not None:
        drive.forcelimited, drive.forcerange = mujoco.mjtLimited.mjLIMITED_TRUE, [-limit, limit]


def _without_looks(robot: ElementTree.Element) -> str:
    for link in robot.iter("link"):
        for kind in ("visual", "collision"):
            for node in link.findall(kind):
                link.remove(node)
    for kind in ("gazebo", "transmission"):
        for node in robot.findall(kind):
            robot.remove(node)
    return ElementTree.tostring(robot, encoding="unicode")


def _names(items: object) -> str:
    return ", ".join(item.name for item in items)  # type: ignore[attr-defined]
