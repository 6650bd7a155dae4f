"""The single-joint rig in MJCF: a readable template, filled from a :class:`Rig` through MjSpec, and its braked variant.

Names in the model, which the simulation and every augmented model keep: joints ``motor`` (q_s) and ``reducer``
(q - q_s), fixed tendon ``arm`` (q), actuators ``motor`` (T_e) and ``hammer`` (force), site ``accelerometer``.
"""

from __future__ import annotations

from importlib.resources import as_file, files
from pathlib import Path

import mujoco
import numpy as np

from jointscope.atomic import write_text
from jointscope.errors import InputError
from jointscope.models.parameters import Rig

TEMPLATE = "single_joint.xml"


def rig_spec(rig: Rig) -> mujoco.MjSpec:
    """The rig's MJCF as an editable MjSpec; its motor is free to turn (see :func:`brake`)."""
    with as_file(files("jointscope.models") / TEMPLATE) as path:
        spec = mujoco.MjSpec.from_file(str(path))
    joint = rig.joint
    spec.option.gravity = [0.0, 0.0, -rig.gravity]

    motor = spec.joint("motor")
    motor.armature = joint.reflected_inertia
    motor.damping[0] = joint.motor_damping
    reducer = spec.joint("reducer")
    reducer.stiffness[0] = joint.stiffness
    reducer.damping[0] = joint.damping
    spec.tendon("arm").damping[0] = joint.load_damping
    spec.actuator("motor").gear[0] = joint.efficiency * joint.reduction_ratio

    arm = spec.body("arm")
    own = joint.load_inertia - rig.arm_mass * rig.arm_com_radius**2  # about the centre of mass
    arm.mass = rig.arm_mass
    arm.ipos = [rig.arm_com_radius, 0.0, 0.0]
    arm.inertia = [0.1 * own, own, own]  # a slender arm; only the middle value turns
    spec.site("hammer").pos = [rig.hammer_radius, 0.0, 0.0]
    spec.site("accelerometer").pos = [rig.accelerometer_radius, 0.0, 0.0]
    return spec


def brake(spec: mujoco.MjSpec, angle: float) -> mujoco.MjSpec:
    """A copy of ``spec`` with the motor held at ``angle`` [rad]: its joint, actuator and sensors are removed.

    A removed joint is an ideal brake; every equality, damping or armature that imitates one costs accuracy
    (docs/decisions/2026-11-21-integrator.md).

    Args:
        spec: A model with the names of the single-joint rig.
        angle: q_s at which the brake closed [rad].
    """
    held = spec.copy()
    joint = held.joint("motor")
    if joint is None:
        raise InputError(held.modelname or "model", "joint", "has no joint named 'motor' to brake")
    _turn_children(joint.parent, joint, angle)
    remove_joint(held, "motor", angle)
    held.comment = f"the motor is braked at {angle!r} rad"
    return held


def remove_joint(spec: mujoco.MjSpec, name: str, angle: float) -> None:
    """Take the joint ``name``, which stands at ``angle`` [rad], out of ``spec`` with its actuators and sensors.

    Fixed tendons over it go on over their other joints; no body is turned.
    """
    for tendon in [t for t in spec.tendons if any(_wraps(wrap, name) for wrap in t.path)]:
        _rewrap(spec, tendon, angle, name)
    for sensor in [s for s in spec.sensors if s.objname == name and s.objtype in _LOST_WITH_THE_MOTOR]:
        spec.delete(sensor)
    for actuator in [a for a in spec.actuators if a.target == name and a.trntype == mujoco.mjtTrn.mjTRN_JOINT]:
        spec.delete(actuator)
    spec.delete(spec.joint(name))


def _turn_children(body: mujoco.MjsBody, joint: mujoco.MjsJoint, angle: float) -> None:
    """Turn what ``body`` carries about ``joint``; not the body itself, whose pose Pinocchio drops once it is fixed."""
    turn = np.zeros(4)
    mujoco.mju_axisAngle2Quat(turn, np.asarray(joint.axis, dtype=float), angle)
    anchor = np.asarray(joint.pos, dtype=float)
    for child in body.bodies:
        if child.parent is not body and child.parent.name != body.name:
            continue  # deeper in the tree
        turned, moved = np.zeros(4), np.zeros(3)
        mujoco.mju_mulQuat(turned, turn, np.asarray(child.quat, dtype=float))
        mujoco.mju_rotVecQuat(moved, np.asarray(child.pos, dtype=float) - anchor, turn)
        child.quat, child.pos = turned, moved + anchor


_LOST_WITH_THE_MOTOR = (mujoco.mjtObj.mjOBJ_JOINT, mujoco.mjtObj.mjOBJ_ACTUATOR)
_TENDON_VECTORS = ("stiffness", "damping", "springlength", "range", "solref_friction", "solimp_friction",
                   "solref_limit", "solimp_limit")  # fmt: skip
_TENDON_SCALARS = ("frictionloss", "armature", "springyield", "limited", "margin")


def _wraps(wrap: mujoco.MjsWrap, joint: str) -> bool:
    return bool(wrap.type == mujoco.mjtWrap.mjWRAP_JOINT and wrap.target.name == joint)


def _rewrap(spec: mujoco.MjSpec, old: mujoco.MjsTendon, angle: float, motor: str) -> None:
    """Replace a fixed tendon by one that no longer runs over the motor joint, which stands at ``angle`` [rad]."""
    name = old.name
    lost = sum(wrap.coef for wrap in old.path if _wraps(wrap, motor)) * angle
    vectors = {key: np.array(getattr(old, key)) for key in _TENDON_VECTORS}
    scalars = {key: getattr(old, key) for key in _TENDON_SCALARS}
    kept = [(wrap.target.name, wrap.coef) for wrap in old.path if not _wraps(wrap, motor)]
    for key in ("springlength", "range"):
        if not np.all(vectors[key] == (-1.0 if key == "springlength" else 0.0)):  # else left to the compiler
            vectors[key] = vectors[key] - lost
    spec.delete(old)
    new = spec.add_tendon(name=name)
    for key, value in vectors.items():
        setattr(new, key, value)
    for key, scalar in scalars.items():
        setattr(new, key, scalar)
    for joint, coefficient in kept:
        new.wrap_joint(joint, coefficient)


def write_mjcf(spec: mujoco.MjSpec, path: Path) -> Path:
    """Write ``spec`` as MJCF, whole or not at all; ``spec`` is compiled first, as MjSpec asks."""
    spec.compile()
    write_text(path, spec.to_xml())
    return path
