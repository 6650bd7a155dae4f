"""Whether the numbers of a model and of a campaign's nameplate can belong together, and what mistake they look like."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from jointscope.errors import InputError, RefusedError
from jointscope.models.arm.build import ElasticArm
from jointscope.models.arm.reference import Reference, arm_reference
from jointscope.models.parameters import STANDARD_GRAVITY
from jointscope.prediction.arm_map import Comparison, JointMap, ModelMap, read_model
from jointscope.recordings.campaign import Campaign, Nameplate, Run

Real = NDArray[np.float64]

_CLOSE = 0.03  # relative: nearer to one than this is agreement, nearer to a factor than this names it
_ROUGH = 0.35  # relative: within this of one no mistake of unit or side is suspected


def compare(found: ModelMap, campaign: Campaign) -> tuple[Comparison, ...]:
    """Inertia, gravity torque, reflected armature and stiffness of each joint: both engines beside the nameplate."""
    spec, compiled = read_model(found.model)
    arm = ElasticArm(
        spec, found.model.read_text(encoding="utf-8"), tuple(j.rotor or j.link for j in found.joints),
        tuple(j.link for j in found.joints),
    )  # fmt: skip
    reference: Reference | None = None
    if all(
        joint.rotor_ratio == 1.0 for joint in found.joints
    ):  # Pinocchio takes one tree, so no rotor beside the link
        try:
            reference = arm_reference(arm)
        except (RefusedError, InputError, ValueError, RuntimeError):
            reference = None
    rows: list[Comparison] = []
    for k, joint in enumerate(found.joints):
        own = next((r for r in campaign.runs if not joint.campaign or r.joint == joint.campaign), None)
        ours = own is not None
        run = own if own is not None else next(iter(campaign.runs), None)
        posture = model_posture(found, run) if run is not None else {}
        inertia, gravity = load_by_mujoco(compiled, found.joints, posture)
        by_pin = (
            None if reference is None else (reference.locked_inertia(posture)[k], reference.gravity(posture)[k])
        )
        plate = campaign.rig if ours else Nameplate(topology=campaign.rig.topology, motion=campaign.rig.motion)
        rows += _rows(joint, compiled, plate, run, float(inertia[k]), float(gravity[k]), by_pin)
    return tuple(rows)


def model_posture(found: ModelMap, run: Run) -> dict[str, float]:
    """Angles of the run's posture under the model's rotor (or joint) names [rad]."""
    posture = {}
    for joint in found.joints:
        name = joint.rotor or joint.link
        if joint.campaign in run.posture:
            posture[name] = joint.model_angle(run.posture[joint.campaign])
        elif len(found.joints) == 1:
            posture[name] = joint.model_angle(run.arm_angle)
    return posture


def suspect(ratio: float, n: float | None) -> str:
    """What mistake a ratio model/campaign looks like; empty where it is near one, or like nothing known."""
    if not math.isfinite(ratio) or ratio == 0.0 or abs(ratio - 1.0) <= _CLOSE:
        return ""
    sign = "the sign is turned round; " if ratio < 0.0 else ""
    size = abs(ratio)
    if abs(size - 1.0) <= _CLOSE:
        return "factor -1: the sign is turned round (axis, sign, or zero_offset by half a turn)"
    factors: list[tuple[float, str]] = [
        (2.0 * math.pi, "2 pi: turns for radians"), (180.0 / math.pi, "180/pi: degrees for radians"),
        (math.sqrt(2.0), "sqrt 2: rms for peak"),
    ]  # fmt: skip
    if n is not None and n > 1.0:
        factors = [(n, f"n = {n:g}: one side of the reducer for the other"),
                   (n * n, f"n^2 = {n * n:g}: inertia on the other side of the reducer"), *factors]  # fmt: skip
    for factor, meaning in factors:
        for candidate, name in ((factor, meaning), (1.0 / factor, "1 over " + meaning)):
            if abs(size / candidate - 1.0) <= _CLOSE:
                return f"{sign}factor {name}"
    return (
        f"{sign}differs by a factor {size:.3g}, none of the usual ones" if sign or abs(size - 1.0) > _ROUGH else ""
    )


def load_by_mujoco(
    model: mujoco.MjModel, joints: Sequence[JointMap], posture: Mapping[str, float]
) -> tuple[Real, Real]:
    """Load inertia about each joint, the others locked [kg m^2], and holding torque [N m], links at ``posture``."""
    data = mujoco.MjData(model)
    for joint in joints:
        address = model.jnt_qposadr[model.joint(joint.link).id]
        data.qpos[address] = posture.get(joint.rotor or joint.link, 0.0)
    mujoco.mj_forward(model, data)
    full = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, full)
    dofs = np.array([int(model.joint(joint.link).dofadr[0]) for joint in joints])
    return np.diag(full)[dofs] - model.dof_armature[dofs], data.qfrc_bias[dofs].copy()


def _rows(
    joint: JointMap, model: mujoco.MjModel, rig: Nameplate, run: Run | None, inertia: float, gravity: float,
    by_pin: tuple[float, float] | None,
) -> list[Comparison]:  # fmt: skip
    n = rig.reduction_ratio
    reflected = None
    if rig.motor_inertia is not None and n is not None:
        reflected = (rig.motor_inertia + (rig.reducer_inertia or 0.0)) * n * n
    moment = None
    if rig.arm_mass is not None and rig.arm_com_radius is not None and run is not None:
        moment = rig.arm_mass * STANDARD_GRAVITY * rig.arm_com_radius * math.cos(run.arm_angle) * joint.sign
        moment = moment if rig.plane == "vertical" else 0.0
    dof = int(model.joint(joint.rotor or joint.link).dofadr[0])
    armature = float(model.dof_armature[dof]) * joint.rotor_ratio**2
    mass, force, spring = ("kg", "N", "N/m") if rig.motion == "translational" else ("kg m^2", "N m", "N m/rad")
    by_pin_inertia, by_pin_gravity = (None, None) if by_pin is None else (float(by_pin[0]), float(by_pin[1]))
    rows = [
        _row(joint, "load inertia", mass, inertia, by_pin_inertia, rig.inertia_reference, n),
        _row(joint, "holding torque", force, gravity, by_pin_gravity, moment, n),
        _row(joint, "reflected armature", mass, armature, None, reflected, n),
    ]
    if joint.rotor is not None:
        stiffness = float(np.ravel(model.jnt_stiffness[model.joint(joint.link).id])[0])
        if joint.rotor_ratio == 1.0:  # else a tendon's
            rows.append(_row(joint, "stiffness", spring, stiffness, None, rig.stiffness_reference, n))
    return rows


def _row(
    joint: JointMap, figure: str, unit: str, mujoco_: float, pinocchio: float | None, nameplate: float | None,
    n: float | None,
) -> Comparison:  # fmt: skip
    verdict = ""
    if nameplate is not None and abs(nameplate) > 1e-9:
        verdict = suspect(mujoco_ / nameplate, n)
    if pinocchio is not None and abs(pinocchio - mujoco_) > 1e-5 * max(abs(mujoco_), 1e-6):
        verdict = (verdict + "; " if verdict else "") + "MuJoCo and Pinocchio read this model differently"
    return Comparison(
        joint=joint.campaign, figure=figure, unit=unit, mujoco=mujoco_, pinocchio=pinocchio, nameplate=nameplate,
        verdict=verdict,
    )  # fmt: skip
