r"""A user's own MJCF or URDF, unchanged: the joint under test in it, held as the bench held it, and its rest.

Nothing of the file is replaced: its step, integrator, solver, actuators and limits act as they stand. Only what the run
did to the machine is done to the model too: the brake takes the motor's joint away, joints that the bench held are held,
hammer and arm torque act as generalized forces, the drive's loop is closed where a speed was commanded.

Two linear functions of the model's coordinates x stand for the joint: the arm's angle q and the motor's q_s = motor
angle / n, both as the campaign counts them (``OwnJoint.sign``, ``zero_offset``). Speeds and accelerations are central
differences of the angles, second order in time for every integrator; an input is given to a step as its value in the
middle of the force's action, t_k for the leapfrog kind (Euler, implicit, discrete) and t_k + h/2 for RK4.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import mujoco
import numpy as np
from numpy.typing import NDArray

from jointscope.errors import InputError
from jointscope.models.rig import remove_joint
from jointscope.sim.equilibrium import EquilibriumError

Real = NDArray[np.float64]

_DIFFERENCE = 1e-7  # rad or m
_BALANCED = 1e-6  # N m or N
_PARALLEL = 1e-6


@dataclass(frozen=True, kw_only=True)
class OwnJoint:
    """Which of a model's joints play motor and load.

    Attributes:
        link: Joint of the arm or carriage; behind a spring its coordinate counts from the rotor.
        rotor: Joint of the motor side; ``None`` where the model's joint is rigid.
        rotor_ratio: Turns of the rotor's coordinate per output turn: 1 where the model is written at the output, n
            where its rotor spins at motor speed.
        actuator: What drives it; ``None``: the torque is applied to the coordinate.
        torque: The control is N m on the motor shaft ("motor"), or at the joint output, efficiency taken off ("output").
        control: What the actuator is told: the logged torque, or the commanded speed or its integral.
        sensor_site: Where the accelerometer sits.
        sign, zero_offset: Model angle = sign * campaign angle + zero_offset.
        hold: Angle at which every further joint of the model is held, by name [rad or m]; joints that neither this
            nor the map names are free.
    """

    link: str
    rotor: str | None = None
    rotor_ratio: float = 1.0
    actuator: str | None = None
    torque: Literal["motor", "output"] = "output"
    control: Literal["torque", "velocity", "position"] = "torque"
    sensor_site: str | None = None
    sign: int = 1
    zero_offset: float = 0.0
    hold: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class OwnSystem:
    """A compiled model and the joint in it.

    Attributes:
        arm, motor, sensor: dq/dx, dq_s/dx and the rotation that the accelerometer rides on, over the model's
            coordinates, shape (nv,); ``motor`` is zero with the brake on.
        zero: Model's angle at the campaign's zero [rad or m].
        held: q_s at which the brake closed, in place of ``motor`` [rad or m].
    """

    model: mujoco.MjModel
    arm: Real
    motor: Real
    sensor: Real
    zero: float
    held: float = 0.0

    @property
    def timestep(self) -> float:
        """h [s]."""
        return float(self.model.opt.timestep)

    @property
    def late(self) -> float:
        """By how much of a step after t_k an input is taken [-]."""
        return 0.5 if self.model.opt.integrator == int(mujoco.mjtIntegrator.mjINT_RK4) else 0.0


def load_own(path: Path) -> mujoco.MjSpec:
    """The file as an editable model.

    Raises:
        InputError: There is none, or MuJoCo can't read it.
    """
    if not Path(path).is_file():
        raise InputError(path, None, "no such model")
    try:
        spec = mujoco.MjSpec.from_file(str(path))
        spec.compile()
    except ValueError as problem:
        raise InputError(path, None, f"not a model that MuJoCo can read: {problem}") from None
    return spec


def own_system(spec: mujoco.MjSpec, joint: OwnJoint, *, brake: Real | None = None) -> OwnSystem:
    """Compile a copy of ``spec`` with every joint held that the bench held.

    Args:
        spec: The user's model.
        joint: Which joint is which.
        brake: All coordinates of the model without a brake [rad or m], where the motor is held at its own.

    Raises:
        InputError: A joint, actuator or site is not in the model, or is of a kind that can't play its part.
    """
    spec = spec.copy()
    _check(spec, joint)
    for name, angle in joint.hold.items():
        _hold(spec, name, angle)
    model = spec.compile()
    free = _functions(model, joint)
    if brake is None or joint.rotor is None:
        return free
    rotor = int(model.joint(joint.rotor).dofadr[0])
    along, gone = geared(model, joint.rotor), braked(model, joint.rotor)
    for equality in [e for e in spec.equalities if e.type == mujoco.mjtEq.mjEQ_JOINT
                     and {joint.rotor, *along} & {e.name1, e.name2}]:  # fmt: skip
        spec.delete(equality)
    for name in (joint.rotor, *along):
        _hold(spec, name, float(brake[int(model.joint(name).dofadr[0])]))
    held = spec.compile()
    keep = [k for k in range(model.nv) if k not in gone]
    q_s = joint.sign * (float(free.motor @ brake) * joint.sign - free.zero)
    return OwnSystem(held, free.arm[keep], np.zeros(len(keep)), free.sensor[keep],
                     free.zero - joint.sign * float(free.arm[rotor] * brake[rotor]), q_s)  # fmt: skip


def geared(model: mujoco.MjModel, joint: str) -> dict[str, float]:
    """Joints that an equality makes turn with ``joint``, as a gear does, and by how much of its coordinate each."""
    own, found = int(model.joint(joint).id), {}
    for e in range(model.neq):
        pair = [int(model.eq_obj1id[e]), int(model.eq_obj2id[e])]  # the first is a polynomial of the second
        ratio, bent = float(model.eq_data[e][1]), np.any(model.eq_data[e][2:5])
        if model.eq_type[e] != int(mujoco.mjtEq.mjEQ_JOINT) or not model.eq_active0[e] or own not in pair:
            continue
        if min(pair) >= 0 and ratio != 0.0 and not bent:
            other = pair[1 - pair.index(own)]
            found[model.joint(other).name] = ratio if other == pair[0] else 1.0 / ratio
    return found


def braked(model: mujoco.MjModel, rotor: str) -> list[int]:
    """Degrees of freedom that stand when the motor does: the rotor's, and what is geared to it."""
    return [int(model.joint(name).dofadr[0]) for name in (rotor, *geared(model, rotor))]


def _check(spec: mujoco.MjSpec, joint: OwnJoint) -> None:
    where = spec.modelname or "model"
    for kind, name, found in (
        ("link", joint.link, spec.joint(joint.link)),
        ("rotor", joint.rotor, joint.rotor is None or spec.joint(joint.rotor)),
        ("actuator", joint.actuator, joint.actuator is None or spec.actuator(joint.actuator)),
        ("sensor_site", joint.sensor_site, joint.sensor_site is None or spec.site(joint.sensor_site)),
        *(("hold", name, spec.joint(name)) for name in joint.hold),
    ):
        if not found:
            raise InputError(where, kind, "is not in the model", value=name)
    straight = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)
    for one in spec.joints:
        if one.type not in straight and one.name not in joint.hold:
            raise InputError(
                where,
                f"joint {one.name or '(unnamed)'}",
                "is neither a hinge nor a slide",
                fix="fix the robot's base",
            )


def _hold(spec: mujoco.MjSpec, name: str, angle: float) -> None:
    """Take a joint away with its body where it stands at ``angle``."""
    joint = spec.joint(name)
    body, axis = joint.parent, np.asarray(joint.axis, dtype=float)
    axis = axis / np.linalg.norm(axis)
    if joint.type == mujoco.mjtJoint.mjJNT_SLIDE:
        moved = np.zeros(3)
        mujoco.mju_rotVecQuat(moved, axis * angle, np.asarray(body.quat, dtype=float))
        body.pos = np.asarray(body.pos, dtype=float) + moved
    elif joint.type == mujoco.mjtJoint.mjJNT_HINGE and angle != 0.0:
        turn, turned = np.zeros(4), np.zeros(4)
        mujoco.mju_axisAngle2Quat(turn, axis, angle)
        mujoco.mju_mulQuat(turned, np.asarray(body.quat, dtype=float), turn)
        anchor, before, after = np.asarray(joint.pos, dtype=float), np.zeros(3), np.zeros(3)
        mujoco.mju_rotVecQuat(before, anchor, np.asarray(body.quat, dtype=float))
        mujoco.mju_rotVecQuat(after, anchor, turned)
        body.quat, body.pos = turned, np.asarray(body.pos, dtype=float) + before - after
    remove_joint(spec, name, angle)


def _functions(model: mujoco.MjModel, joint: OwnJoint) -> OwnSystem:
    """q, q_s and the accelerometer's rotation as functions of the coordinates."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    link = int(model.joint(joint.link).id)
    arm, motor = np.zeros(model.nv), np.zeros(model.nv)
    arm[model.jnt_dofadr[link]] = joint.sign
    if joint.rotor is None:
        motor = arm.copy()
    else:
        rotor = int(model.joint(joint.rotor).id)
        motor[model.jnt_dofadr[rotor]] = joint.sign / joint.rotor_ratio
        if _carries(model, rotor, link):
            along = float(data.xaxis[rotor] @ data.xaxis[link])
            if abs(abs(along) - 1.0) > _PARALLEL:
                raise InputError(
                    joint.rotor, "rotor", f"its axis is not that of joint {joint.link!r}, which it carries"
                )
            arm[model.jnt_dofadr[rotor]] = joint.sign
            arm[model.jnt_dofadr[link]] = joint.sign * np.sign(along)
    return OwnSystem(model, arm, motor, _sensor(model, data, joint, arm, link), joint.zero_offset)


def _carries(model: mujoco.MjModel, rotor: int, link: int) -> bool:
    """Whether the link's joint moves with the rotor's."""
    body = int(model.jnt_bodyid[link])
    while body > 0:
        if body == int(model.jnt_bodyid[rotor]):
            return rotor < link or body != int(model.jnt_bodyid[link])
        body = int(model.body_parentid[body])
    return False


def _sensor(model: mujoco.MjModel, data: mujoco.MjData, joint: OwnJoint, arm: Real, link: int) -> Real:
    """The rotation whose acceleration times the radius the sensor reads: the arm's, and that of any bending joint."""
    if joint.sensor_site is None or model.nv <= np.count_nonzero(arm) or model.jnt_type[link] != 3:
        return arm
    jacobian = np.zeros((3, model.nv))
    mujoco.mj_jacSite(model, data, jacobian, None, model.site(joint.sensor_site).id)
    own = jacobian[:, model.jnt_dofadr[link]]
    if float(own @ own) < 1e-12:
        return arm
    weight = own @ jacobian / float(own @ own) * arm[model.jnt_dofadr[link]]
    return np.where(arm != 0.0, arm, np.where(np.abs(weight) > 1e-9, weight, 0.0))


@dataclass(frozen=True, eq=False)
class OwnRest:
    """Coordinates at rest [rad or m], shape (nv,), and what holds them there on q_s [N m or N]."""

    x: Real
    torque: float


def own_rest(system: OwnSystem, sign: int, arm_angle: float) -> OwnRest:
    """Newton's method on the static forces, the arm at ``arm_angle``; dry friction and limits are left out.

    Raises:
        EquilibriumError: No rest was found.
    """
    model = copy.copy(system.model)
    model.dof_frictionloss[:] = 0.0
    model.tendon_frictionloss[:] = 0.0
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_LIMIT | mujoco.mjtDisableBit.mjDSBL_CONTACT)
    data = mujoco.MjData(model)
    generalized = drive_on(system)

    def imbalance(unknown: Real) -> Real:
        data.qpos[:], data.qvel[:], data.ctrl[:] = unknown[:-1], 0.0, 0.0
        mujoco.mj_forward(model, data)
        force = data.qfrc_passive + data.qfrc_actuator - data.qfrc_bias + data.qfrc_constraint
        off = float(system.arm @ unknown[:-1]) - sign * system.zero - arm_angle
        return np.append(force + generalized * unknown[-1], off * 1e6)

    unknown = np.append(system.arm / float(system.arm @ system.arm) * (arm_angle + sign * system.zero), 0.0)
    if np.any(system.motor):  # an unwound joint: the rotor where the arm is
        lead = np.flatnonzero(system.motor)[0]
        unknown[:-1] = 0.0
        unknown[lead] = (arm_angle + sign * system.zero) / system.motor[lead]
        left = arm_angle + sign * system.zero - float(system.arm @ unknown[:-1])
        rest = system.arm.copy()
        rest[lead] = 0.0
        if np.any(rest):
            unknown[:-1] += rest / float(rest @ rest) * left
    residual = imbalance(unknown)
    for _ in range(60):
        if np.abs(residual).max() < 1e-3 * _BALANCED:
            break
        columns = [
            (imbalance(unknown + step) - residual) / _DIFFERENCE for step in np.eye(unknown.size) * _DIFFERENCE
        ]
        unknown = unknown - np.linalg.lstsq(np.column_stack(columns), residual, rcond=None)[0]
        residual = imbalance(unknown)
    if not np.abs(residual).max() < _BALANCED * max(1.0, abs(unknown[-1])):
        raise EquilibriumError(
            f"arm angle {arm_angle:.4g}: no rest of this model found, {np.abs(residual).max():.3g} N m stay unbalanced"
        )
    return OwnRest(unknown[:-1], float(unknown[-1]))


def drive_on(system: OwnSystem) -> Real:
    """Generalized force of a unit torque on q_s, or on q where the motor does not move, shape (nv,)."""
    return np.where(np.any(system.motor), system.motor, system.arm)


def turning(system: OwnSystem) -> float:
    """+1 where a positive torque on the motor's coordinate is positive in the campaign's terms, else -1."""
    lead = system.motor if np.any(system.motor) else system.arm
    return float(np.sign(lead[np.flatnonzero(lead)[0]]))
