r"""An elastic arm with each joint held in its own way, ready to be stepped.

brake
    The rotor stands still: its hinge is removed, and the reducer's spring is referred to where the rotor stands.
locked
    Rotor and reducer are one piece with the link before: both hinges are removed at the posture.
drive
    The rotor is held, or moved, by its drive (``NAME_drive``).
free
    The rotor turns freely.

The rotor of the joint under test may carry ``NAME_torque`` [N m at the output] besides. Explicit damping seen half a
step late would cost c h/2 of inertia; that much armature is added to each damped hinge, which brings the discrete
response within 0.1 % and 0.1 degree of the continuous one up to 100 Hz at h = 0.1 ms.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import mujoco
import numpy as np
from numpy.typing import NDArray

from jointscope.errors import JointscopeError
from jointscope.models.arm.build import DRIVE, ElasticArm
from jointscope.models.arm.table import Payload

Real = NDArray[np.float64]
HoldKind = Literal["brake", "drive", "locked", "free"]

TORQUE = "_torque"
HAMMER = "hammer"


@dataclass(frozen=True, kw_only=True)
class Probe:
    """A point on a body and a direction there: where an arm is hit, or an accelerometer sits.

    Attributes:
        name: Of the site.
        body: The body that carries it; ``world`` for the base.
        point: In the body's frame [m].
        axis: Positive direction, in the body's frame; any length.
    """

    name: str
    body: str
    point: tuple[float, float, float]
    axis: tuple[float, float, float]

    @property
    def direction(self) -> Real:
        """Unit vector along ``axis``, shape (3,)."""
        axis = np.asarray(self.axis, dtype=np.float64)
        length = float(np.linalg.norm(axis))
        if length == 0.0:
            raise JointscopeError(f"{self.name}: axis = {self.axis} has no direction")
        return axis / length


@dataclass(frozen=True, kw_only=True, eq=False)
class HeldArm:
    """A compiled arm, each joint held as stated.

    Attributes:
        model: What is stepped.
        rotor: Degree of freedom of each joint's rotor, -1 where it is removed, shape (n_joints,).
        reducer: Degree of freedom of each joint's reducer, -1 where it is removed, shape (n_joints,).
        hold: Per joint.
        rest: The full elastic arm, every hinge there, from which equilibria are taken.
        rotor_full, reducer_full: Degrees of freedom in ``rest``, shape (n_joints,).
    """

    arm: ElasticArm
    model: mujoco.MjModel
    rotor: NDArray[np.int_]
    reducer: NDArray[np.int_]
    hold: Mapping[str, HoldKind]
    posture: Mapping[str, float]
    rest: mujoco.MjModel = field(repr=False)

    def sensor(self, name: str) -> slice:
        """Where a sensor's values lie in ``sensordata``."""
        found = self.model.sensor(name)
        return slice(int(found.adr[0]), int(found.adr[0] + found.dim[0]))

    def actuator(self, name: str) -> int:
        """Column of an actuator's command."""
        return int(self.model.actuator(name).id)


@dataclass(frozen=True, kw_only=True, eq=False)
class Rest:
    """Static equilibrium with the links at a given posture.

    Attributes:
        link: Link angles [rad], shape (n_joints,).
        rotor: Rotor angles at the joint output [rad], shape (n_joints,).
        torque: That each reducer carries and each rotor needs to stand still [N m], shape (n_joints,).
        qpos: State of the held model, shape (nq,).
    """

    link: Real
    rotor: Real
    torque: Real
    qpos: Real


def hold_arm(
    arm: ElasticArm,
    hold: Mapping[str, HoldKind],
    posture: Mapping[str, float],
    *,
    timestep: float = 1e-4,
    driven: Sequence[str] = (),
    probes: Sequence[Probe] = (),
    hammer: Probe | None = None,
    payload: Payload | None = None,
) -> HeldArm:
    """Compile ``arm`` with each joint held as ``hold`` says (``brake`` where it is silent).

    Args:
        arm: The elastic arm.
        hold: Per joint.
        posture: Link angles [rad] at which locked joints stand; joints that are absent stand at zero.
        timestep: h [s].
        driven: Joints whose rotor gets a torque input ``NAME_torque`` [N m at the output].
        probes: Accelerometers; each gives a sensor of its name whose third component is along the probe's axis.
        hammer: Where a force input ``hammer`` [N] acts, along its axis.
        payload: Added to the arm's own.

    Raises:
        JointscopeError: A joint, body or drive that is named doesn't exist.
    """
    for name in (*hold, *driven):
        arm.index(name)
    spec = arm.spec.copy()
    if payload is not None and payload.mass > 0.0:
        _add_payload(spec, payload)
    rest = spec.copy()
    spec.option.timestep = timestep
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_EULERDAMP | mujoco.mjtDisableBit.mjDSBL_CONTACT)
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_EULER
    held = {name: hold.get(name, "brake") for name in arm.rotors}
    _remove_foreign(spec, arm, posture)
    for name, reducer in zip(arm.rotors, arm.reducers, strict=True):
        _hold_joint(spec, name, reducer, held[name], float(posture.get(name, 0.0)), name in driven)
    for probe in probes:
        _add_site(spec, probe)
        spec.add_sensor(
            name=probe.name, type=mujoco.mjtSensor.mjSENS_ACCELEROMETER,
            objtype=mujoco.mjtObj.mjOBJ_SITE, objname=probe.name,
        )  # fmt: skip
    if hammer is not None:
        _add_hammer(spec, hammer)
    model = spec.compile()
    rotor, reducer_dof = _dofs(model, arm.rotors), _dofs(model, arm.reducers)
    model.dof_armature += 0.5 * timestep * damping_of_dofs(model)
    return HeldArm(
        arm=arm, model=model, rotor=rotor, reducer=reducer_dof, hold=held, posture=dict(posture), rest=rest.compile()
    )  # fmt: skip


def equilibrium(held: HeldArm, posture: Mapping[str, float]) -> Rest:
    """Where everything stands with the links at ``posture`` [rad], and refer the braked springs to it.

    The spring reference of ``held.model`` is set here, so call it before stepping from another posture.
    """
    arm, rest = held.arm, held.rest
    data = mujoco.MjData(rest)
    for joint in range(rest.njnt):
        name = rest.joint(joint).name
        if name not in arm.reducers:
            data.qpos[rest.jnt_qposadr[joint]] = posture.get(name, 0.0)  # links at q with every reducer unwound
    mujoco.mj_forward(rest, data)
    rotor_full, reducer_full = _dofs(rest, arm.rotors), _dofs(rest, arm.reducers)
    torque = (data.qfrc_bias - data.qfrc_passive)[rotor_full]
    stiffness = rest.jnt_stiffness[rest.dof_jntid[reducer_full]]
    link = np.array([float(posture.get(name, 0.0)) for name in arm.rotors])
    rotor = link + torque / stiffness
    model = held.model
    qpos = model.qpos0.copy()
    for k in range(len(arm.rotors)):
        if held.reducer[k] < 0:
            continue
        address = model.jnt_qposadr[model.dof_jntid[held.reducer[k]]]
        if held.rotor[k] < 0:
            model.qpos_spring[address] = rotor[k]
            qpos[address] = link[k]
        else:
            model.qpos_spring[address] = 0.0
            qpos[address] = link[k] - rotor[k]
            qpos[model.jnt_qposadr[model.dof_jntid[held.rotor[k]]]] = rotor[k]
    return Rest(link=link, rotor=rotor, torque=torque, qpos=qpos)


def drive_command(held: HeldArm, joint: str, angle: Real, speed: Real, torque: Real | float) -> Real:
    """What to command a drive so that its rotor follows ``angle`` [rad] and ``speed`` [rad/s] while it gives ``torque``.

    Args:
        held: The arm; the joint must be held by its drive.
        joint: Whose drive.
        angle: Wanted rotor angle at the output, shape (n,).
        speed: Its rate, shape (n,).
        torque: Fed forward [N m], scalar or shape (n,).

    Returns:
        Command of ``NAME_drive``, shape (n,).
    """
    model = held.model
    index = held.actuator(joint + DRIVE)
    kp, kv = float(model.actuator_gainprm[index, 0]), -float(model.actuator_biasprm[index, 2])
    return angle + (kv * speed + torque) / kp


def _hold_joint(spec: mujoco.MjSpec, name: str, reducer: str, hold: HoldKind, angle: float, driven: bool) -> None:
    rotor = spec.joint(name)
    drive = spec.actuator(name + DRIVE)
    if hold == "drive":
        if drive is None:
            raise JointscopeError(
                f"joint {name} has no drive; give drive_stiffness and drive_damping in its table row"
            )
        _report_force(spec, name + DRIVE)
    if hold != "drive" and drive is not None:
        spec.delete(drive)
    if driven:
        if hold in ("brake", "locked"):
            raise JointscopeError(f"joint {name} can't be driven while its hold is {hold!r}")
        motor = spec.add_actuator(name=name + TORQUE, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        motor.gainprm[0] = 1.0
        _report_force(spec, name + TORQUE)
    if hold in ("brake", "locked"):
        tendon = spec.tendon(name + "_link")
        if tendon is not None:
            spec.delete(tendon)  # a load-side element then acts on the one hinge that is left
            if hold == "brake":
                left = spec.joint(reducer)
                left.damping = [float(left.damping[0]) + float(tendon.damping[0]), 0.0, 0.0]
                left.frictionloss = float(tendon.frictionloss)
        if hold == "locked":
            _weld(rotor, angle)
            spec.delete(spec.joint(reducer))
        for actuator in [a for a in spec.actuators if a.target == name]:
            spec.delete(actuator)
        for sensor in [s for s in spec.sensors if s.objname == name]:
            spec.delete(sensor)
        spec.delete(rotor)


def _weld(joint: mujoco.MjsJoint, angle: float) -> None:
    """Turn the joint's body by ``angle`` about the joint, so that it stands there once the joint is gone."""
    body = joint.parent
    axis = np.asarray(joint.axis, dtype=np.float64)
    turn, moved, quat = np.zeros(4), np.zeros(3), np.zeros(4)
    mujoco.mju_axisAngle2Quat(turn, axis / np.linalg.norm(axis), angle)
    mujoco.mju_rotVecQuat(moved, np.asarray(joint.pos, dtype=np.float64), turn)
    shift = np.zeros(3)
    mujoco.mju_rotVecQuat(shift, np.asarray(joint.pos) - moved, np.asarray(body.quat, dtype=np.float64))
    mujoco.mju_mulQuat(quat, np.asarray(body.quat, dtype=np.float64), turn)
    body.pos, body.quat = body.pos + shift, quat


def _remove_foreign(spec: mujoco.MjSpec, arm: ElasticArm, posture: Mapping[str, float]) -> None:
    """Weld hinges that are not elastic at the posture."""
    own = {*arm.rotors, *arm.reducers}
    for joint in [j for j in spec.joints if j.name not in own and j.type == mujoco.mjtJoint.mjJNT_HINGE]:
        _weld(joint, float(posture.get(joint.name, 0.0)))
        for actuator in [a for a in spec.actuators if a.target == joint.name]:
            spec.delete(actuator)
        spec.delete(joint)


def _add_site(spec: mujoco.MjSpec, probe: Probe) -> None:
    body = spec.worldbody if probe.body == "world" else spec.body(probe.body)
    if body is None:
        names = ", ".join(b.name for b in spec.bodies)
        raise JointscopeError(f"{probe.name}: the arm has no body {probe.body!r}; bodies: {names}")
    quat = np.zeros(4)
    mujoco.mju_quatZ2Vec(quat, probe.direction)
    body.add_site(name=probe.name, pos=probe.point, quat=quat)


def _add_hammer(spec: mujoco.MjSpec, hammer: Probe) -> None:
    _add_site(spec, hammer)
    actuator = spec.add_actuator(name=HAMMER, target=hammer.name, trntype=mujoco.mjtTrn.mjTRN_SITE)
    actuator.gear = [0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
    actuator.gainprm[0] = 1.0


def _add_payload(spec: mujoco.MjSpec, payload: Payload) -> None:
    carrier = spec.body(payload.body) if payload.body else spec.bodies[-1]
    if carrier is None:
        raise JointscopeError(f"payload: the arm has no body {payload.body!r}")
    load = carrier.add_body(name="run_payload", pos=payload.com)
    load.mass, load.inertia, load.ipos = payload.mass, [payload.inertia] * 3, [0.0, 0.0, 0.0]
    load.explicitinertial = True


def _report_force(spec: mujoco.MjSpec, actuator: str) -> None:
    spec.add_sensor(
        name=actuator, type=mujoco.mjtSensor.mjSENS_ACTUATORFRC,
        objtype=mujoco.mjtObj.mjOBJ_ACTUATOR, objname=actuator,
    )  # fmt: skip


def _dofs(model: mujoco.MjModel, names: Sequence[str]) -> NDArray[np.int_]:
    ids = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name) for name in names]
    return np.array([-1 if joint < 0 else int(model.jnt_dofadr[joint]) for joint in ids])


def damping_of_dofs(model: mujoco.MjModel) -> Real:
    """What the hinges and the drives' speed gains damp each degree of freedom with [N m s/rad], shape (nv,)."""
    damping = model.dof_damping[:, 0] if model.dof_damping.ndim == 2 else model.dof_damping
    total = np.array(damping, dtype=np.float64)
    for actuator in range(model.nu):
        if model.actuator_trntype[actuator] == int(mujoco.mjtTrn.mjTRN_JOINT):
            dof = model.jnt_dofadr[model.actuator_trnid[actuator, 0]]
            total[dof] -= model.actuator_biasprm[actuator, 2]
    return total
