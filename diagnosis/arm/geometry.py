r"""What a campaign's own robot file says of an arm: link inertias by Pinocchio, reducers, rotors and drives by joint.

A joint is elastic where the file holds a pair of hinges on one axis, the rotor's and behind it one with a spring (the
wind-up; ``NAME_elastic``, or whatever it is called), or where its only hinge has a spring that is no balancer's. Any other
hinge is rigid: its reducer has no compliance in the model that the lab believes in.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from jointscope.errors import InputError, RefusedError
from jointscope.models.arm.build import DRIVE, ELASTIC, ElasticArm, rigid_spec
from jointscope.models.arm.reference import Reference, arm_reference, mounted_reference
from jointscope.recordings.campaign import Campaign

Vector = NDArray[np.float64]

STIFF_START = 1e5  # N m/rad, where neither the file nor the campaign says anything
DAMPED_START = 0.02  # of critical, likewise
UPRIGHT = 0.7  # of a joint's axis along the vertical, from which its mount slides level and across
BALANCED_HZ = 2.0  # of a hinge on its spring: below, the spring balances weight, above, it is a reducer
DRIVE_HZ = 8.0  # closed position loop of a drive of which nothing is known


@dataclass(frozen=True, eq=False)
class ArmFacts:
    """The arm as the campaign states it; arrays over joints, at the joint output, shape (n,).

    Attributes:
        reference: Pinocchio's reading.
        mounted: The same on a mount that gives way, see :func:`mounted_reference`.
        joints: Base to tip.
        elastic: Which reducers are springs in the stated model.
        stiffness, damping: K [N m/rad], c [N m s/rad] as stated; starting values only.
        rotor_inertia: J_M [kg m^2]; 0 where nothing states it.
        rotor_damping, load_damping: b_m, b_l [N m s/rad], starting values.
        drive_stiffness, drive_damping: k_p [N m/rad], k_v [N m s/rad] of the drives, starting values; 0 where unknown.
        ratio: n [-].
        efficiency: eta of the joint under test.
        tested: Place of the joint under test, whose nameplate ``[rig]`` is.
    """

    reference: Reference
    mounted: Reference
    spec: mujoco.MjSpec
    joints: tuple[str, ...]
    elastic: NDArray[np.bool_]
    stiffness: Vector
    damping: Vector
    rotor_inertia: Vector
    rotor_damping: Vector
    load_damping: Vector
    drive_stiffness: Vector
    drive_damping: Vector
    ratio: Vector
    efficiency: float
    tested: int

    def index(self, joint: str) -> int:
        """Place of a joint.

        Raises:
            RefusedError: The robot file has no such joint.
        """
        if joint not in self.joints:
            raise RefusedError(_no_joint(joint, self.joints))
        return self.joints.index(joint)


def _robot_file(campaign: Campaign) -> Path:
    name = campaign.mjcf or campaign.urdf
    if name is None:
        raise RefusedError(
            f"{campaign.path}: an arm's campaign needs its geometry; name a file under [model] mjcf or urdf"
        )
    return Path(campaign.path) / name


def _under_test(campaign: Campaign) -> str:
    """The joint that most runs concern, driven runs before hits: the nameplate is its."""
    driven = [r.joint for r in campaign.runs if r.joint and r.experiment != "hammer"]
    named = driven or [r.joint for r in campaign.runs if r.joint]
    if not named:
        raise RefusedError(f"{campaign.path}: no run says which joint it is about; give each run its joint")
    return max(sorted(set(named)), key=named.count)


def arm_facts(campaign: Campaign) -> ArmFacts:
    """Read the robot file of ``campaign``, put the nameplate of the joint under test in its place.

    Raises:
        InputError: The file can't be read or has no hinges.
        RefusedError: The campaign names no file, or no joint.
    """
    path = _robot_file(campaign)
    if not path.is_file():
        raise InputError(
            campaign.path / "campaign.toml", "model", f"{path.name} is not in the campaign", fix="add it"
        )
    spec = rigid_spec(path)
    model = spec.compile()
    names = [joint.name for joint in spec.joints if joint.type == mujoco.mjtJoint.mjJNT_HINGE]
    if not all(names):
        raise InputError(
            path, None, "holds a hinge without a name", fix="name every joint: runs and answers go by it"
        )
    wind_ups = _wind_ups(model, names)
    joints = tuple(n for n in names if n not in wind_ups.values())
    links = tuple(wind_ups.get(n, n) for n in joints)
    if not joints:
        raise InputError(path, None, "holds no hinge", fix="give the arm as a URDF or MJCF with revolute joints")
    arm = ElasticArm(spec, spec.to_xml(), joints, links)
    reference = arm_reference(arm)
    mounted = _on_its_mount(arm, reference, campaign)
    facts = _as_filed(spec, model, reference, mounted, joints, links)
    return _with_nameplate(facts, campaign)


def _on_its_mount(arm: ElasticArm, reference: Reference, campaign: Campaign) -> Reference:
    """On a mount that turns about an axis parallel to the tested joint's and slides across it."""
    joint = _under_test(campaign)
    posture = next(run.posture for run in campaign.runs if run.joint == joint)
    if joint not in reference.joints:
        raise RefusedError(_no_joint(joint, reference.joints))
    turn = reference.axes(posture)[reference.joints.index(joint)]
    level = np.array([0.0, 0.0, 1.0]) if abs(turn[2]) < UPRIGHT else np.array([1.0, 0.0, 0.0])
    slide = np.cross(turn, level)
    return mounted_reference(arm, turn, slide / np.linalg.norm(slide))


def _no_joint(joint: str, joints: tuple[str, ...]) -> str:
    return f"the campaign's model has no joint {joint!r}; its joints: {', '.join(joints)}"


def _wind_ups(model: mujoco.MjModel, names: list[str]) -> dict[str, str]:
    """Of each joint that the file has as two hinges, the one that is the spring, by the rotor's name.

    Both turn about one axis, the spring in the rotor's body or in one that hangs on it.
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    found: dict[str, str] = {}
    for rotor, spring in itertools.permutations(names, 2):
        a, b = int(model.joint(rotor).id), int(model.joint(spring).id)
        of_rotor, of_spring = int(model.jnt_bodyid[a]), int(model.jnt_bodyid[b])
        behind = (of_rotor == of_spring and a < b) or int(model.body_parentid[of_spring]) == of_rotor
        named = spring == rotor + ELASTIC
        sprung = _spring(model)[b] > 0.0 and _spring(model)[a] <= 0.0
        if named or (behind and sprung and _one_axis(data, a, b)):
            found.setdefault(rotor, spring)
    return found


def _one_axis(data: mujoco.MjData, a: int, b: int) -> bool:
    axis, apart = data.xaxis[a], data.xanchor[b] - data.xanchor[a]
    return float(np.linalg.norm(np.cross(axis, data.xaxis[b])) + np.linalg.norm(np.cross(axis, apart))) < 1e-6


def _spring(model: mujoco.MjModel) -> Vector:
    """Stiffness of every joint [N m/rad], shape (n_joints,)."""
    return np.asarray(model.jnt_stiffness if model.jnt_stiffness.ndim == 1 else model.jnt_stiffness[:, 0])


def _as_filed(
    spec: mujoco.MjSpec,
    model: mujoco.MjModel,
    reference: Reference,
    mounted: Reference,
    joints: tuple[str, ...],
    links: tuple[str, ...],
) -> ArmFacts:
    n = len(joints)
    rotor = np.array([int(model.joint(name).id) for name in joints])
    link = np.array([int(model.joint(name).id) for name in links])
    damping = model.dof_damping if model.dof_damping.ndim == 1 else model.dof_damping[:, 0]
    stiffness = _spring(model)[link]
    paired = np.array([a != b for a, b in zip(joints, links, strict=True)])
    elastic = paired | (stiffness > reference.locked_inertia({}) * (2.0 * math.pi * BALANCED_HZ) ** 2)
    gains, ratio = np.zeros((2, n)), np.ones(n)
    for k, name in enumerate(joints):
        index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_ACTUATOR, name + DRIVE)
        if index >= 0:
            gains[:, k] = model.actuator_gainprm[index, 0], -model.actuator_biasprm[index, 2]
        numeric = spec.numeric(name + "_reduction_ratio")
        if numeric is not None:
            ratio[k] = float(numeric.data[0])
    return ArmFacts(
        reference=reference, mounted=mounted, spec=spec, joints=joints, elastic=elastic,
        stiffness=np.where(elastic, stiffness, 0.0),
        damping=np.where(elastic, damping[model.jnt_dofadr[link]], 0.0),
        rotor_inertia=np.array(model.dof_armature[model.jnt_dofadr[rotor]]),
        rotor_damping=np.array(damping[model.jnt_dofadr[rotor]]),
        load_damping=np.zeros(n), drive_stiffness=gains[0], drive_damping=gains[1], ratio=ratio, efficiency=1.0, tested=0,
    )  # fmt: skip


def _with_nameplate(facts: ArmFacts, campaign: Campaign) -> ArmFacts:
    """The nameplate's exact figures for the joint under test, and its elasticity even where the file has it rigid."""
    rig = campaign.rig
    k = facts.index(_under_test(campaign))
    ratio, inertia, elastic = facts.ratio.copy(), facts.rotor_inertia.copy(), facts.elastic.copy()
    stiffness, damping, rotor_damping = facts.stiffness.copy(), facts.damping.copy(), facts.rotor_damping.copy()
    if rig.reduction_ratio is not None:
        ratio[k] = rig.reduction_ratio
    if rig.motor_inertia is not None:
        inertia[k] = (rig.motor_inertia + (rig.reducer_inertia or 0.0)) * ratio[k] ** 2
    if rig.motor_damping is not None:
        rotor_damping[k] = rig.motor_damping
    load_damping = np.where(np.arange(len(ratio)) == k, rig.load_damping or 0.0, 0.0)
    driven = {facts.index(run.joint) for run in campaign.runs if run.joint and run.experiment != "hammer"}
    for j in {k, *driven}:  # a rotor whose torque is logged needs a reducer to act through
        elastic[j] = True
        if stiffness[j] <= 0.0:
            stiffness[j] = (rig.stiffness_reference if j == k else None) or STIFF_START
    locked = facts.reference.locked_inertia(campaign.runs[0].posture)
    floor = 2.0 * DAMPED_START * np.sqrt(np.maximum(stiffness * locked, 0.0))
    damping = np.where(elastic & (damping <= 0.0), floor, damping)
    total = inertia + locked
    omega = 2.0 * math.pi * DRIVE_HZ
    kp = np.where(facts.drive_stiffness > 0.0, facts.drive_stiffness, total * omega**2)
    kv = np.where(facts.drive_damping > 0.0, facts.drive_damping, 1.4 * total * omega)
    return replace(
        facts, ratio=ratio, rotor_inertia=inertia, rotor_damping=rotor_damping, elastic=elastic, stiffness=stiffness,
        damping=damping, load_damping=load_damping, drive_stiffness=kp, drive_damping=kv, tested=k,
        efficiency=1.0 if rig.efficiency is None else rig.efficiency,
    )  # fmt: skip
