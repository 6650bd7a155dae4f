"""Which of a model's joints are which of a campaign's: matched by structure and by name."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

import mujoco
import numpy as np

from jointscope.errors import InputError, RefusedError
from jointscope.models.arm.build import ElasticArm
from jointscope.prediction.arm_comparison import load_by_mujoco
from jointscope.prediction.arm_map import JointMap, ModelMap, read_model
from jointscope.recordings.campaign import Campaign


def guess_map(model: Path, campaign: Campaign) -> ModelMap:
    """Match the campaign's joints to the model's hinges by structure and name.

    A spring-loaded hinge (or slide, on a rig that slides) that follows another one on the same axis is a reducer and its
    rotor, and so are two joints that a fixed tendon with stiffness ties together. Names decide where the campaign has
    several joints; else the one that an actuator drives, and order. Further joints without a spring are held.

    Raises:
        InputError: The model can't be read, or has fewer joints than the campaign.
    """
    spec, compiled = read_model(model)
    pairs = _pairs(compiled, slides=campaign.rig.motion == "translational")
    wanted = campaign.joints or ("",)
    if len(pairs) < len(wanted):
        kind = "slides" if campaign.rig.motion == "translational" else "hinges"
        raise InputError(
            model,
            None,
            f"has {len(pairs)} named {kind}, the campaign needs {len(wanted)}",
            fix="name them in map.toml",
        )
    if not campaign.joints:  # a bench with one joint: the one that is driven, an elastic one first
        driven = {a.target for a in spec.actuators}
        pairs.sort(key=lambda pair: (not driven & {pair[0], pair[1]}, pair[0] is None))
    taken: list[int] = []
    joints = []
    for name in wanted:
        same = [k for k, pair in enumerate(pairs) if k not in taken and name and name in pair]
        k = same[0] if same else next(k for k in range(len(pairs)) if k not in taken)
        taken.append(k)
        rotor, link, turns = pairs[k]
        joints.append(_described(spec, compiled, campaign, name, rotor, link, turns))
    used = {n for joint in joints for n in (joint.rotor, joint.link)}
    hold = {} if campaign.joints else _held(compiled, used)
    return ModelMap(model=Path(model).resolve(), joints=tuple(joints), hold=hold)


def _held(model: mujoco.MjModel, used: set[str | None]) -> dict[str, float]:
    """Joints beside the one under test that nothing springs back, at the model's own zero."""
    straight = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
    return {
        model.joint(j).name: float(model.qpos0[model.jnt_qposadr[j]]) if model.jnt_type[j] in straight else 0.0
        for j in range(model.njnt)
        if model.joint(j).name
        and model.joint(j).name not in used
        and float(np.ravel(model.jnt_stiffness[j])[0]) == 0.0
    }


def mapped_arm(found: ModelMap) -> ElasticArm:
    """The model as an elastic arm under the campaign's joint order.

    Raises:
        RefusedError: A joint is rigid in the model.
    """
    spec, _ = read_model(found.model)
    rigid = [joint.link for joint in found.joints if joint.rotor is None]
    if rigid:
        raise RefusedError(
            f"{found.model.name}: joint {rigid[0]} is rigid; give it a reducer with: jointscope arm build TABLE --out FILE"
        )
    return ElasticArm(
        spec, found.model.read_text(encoding="utf-8"), tuple(str(j.rotor) for j in found.joints),
        tuple(j.link for j in found.joints),
    )  # fmt: skip


def _pairs(model: mujoco.MjModel, *, slides: bool = False) -> list[tuple[str | None, str, float]]:
    """(rotor or None, link, rotor turns per output turn) of every named joint of the kind, base to tip."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    kind = mujoco.mjtJoint.mjJNT_SLIDE if slides else mujoco.mjtJoint.mjJNT_HINGE
    hinges = [j for j in range(model.njnt) if model.jnt_type[j] == int(kind) and model.joint(j).name]
    rotor_of = {j: (i, turns) for i, j, turns in _tied(model, hinges)}
    for j in hinges:
        before = [
            i
            for i in hinges
            if i < j and model.jnt_bodyid[i] in (model.jnt_bodyid[j], model.body_parentid[model.jnt_bodyid[j]])
        ]
        stiff = float(np.ravel(model.jnt_stiffness[j])[0])
        for i in reversed(before):
            offset = data.xanchor[j] - data.xanchor[i]
            same_axis = abs(float(data.xaxis[i] @ data.xaxis[j])) > 1.0 - 1e-6
            on_line = slides or np.linalg.norm(np.cross(offset, data.xaxis[i])) < 1e-6
            if stiff > 0.0 and same_axis and on_line and j not in rotor_of:
                rotor_of[j] = (i, 1.0)
                break
    rotors = {i for i, _ in rotor_of.values()}
    pairs: list[tuple[str | None, str, float]] = []
    for j in hinges:
        if j in rotor_of:
            i, turns = rotor_of[j]
            pairs.append((model.joint(i).name, model.joint(j).name, turns))
        elif j not in rotors:
            pairs.append((None, model.joint(j).name, 1.0))
    return pairs


def _tied(model: mujoco.MjModel, among: Sequence[int]) -> list[tuple[int, int, float]]:
    """(rotor, link, rotor turns per link turn) of joints in separate bodies that one sprung fixed tendon ties together."""
    found = []
    for t in range(model.ntendon):
        first, count = int(model.tendon_adr[t]), int(model.tendon_num[t])
        wraps = [(int(model.wrap_objid[k]), float(model.wrap_prm[k])) for k in range(first, first + count)]
        joints_only = all(model.wrap_type[first : first + count] == int(mujoco.mjtWrap.mjWRAP_JOINT))
        if (
            count != 2
            or not joints_only
            or not model.tendon_stiffness[t] > 0.0
            or any(j not in among for j, _ in wraps)
        ):
            continue
        (rotor, fast), (link, slow) = sorted(wraps, key=lambda wrap: abs(wrap[1]))
        if model.body_parentid[model.jnt_bodyid[link]] != model.jnt_bodyid[rotor] and fast != 0.0:
            found.append((rotor, link, -slow / fast))
    return found


def _described(
    spec: mujoco.MjSpec, model: mujoco.MjModel, campaign: Campaign, name: str, rotor: str | None, link: str,
    turns: float,
) -> JointMap:  # fmt: skip
    driven = rotor or link
    actuator = next((a for a in spec.actuators if a.target == driven), None)
    n = campaign.rig.reduction_ratio or 1.0
    gear = abs(float(actuator.gear[0]) * turns) if actuator is not None else 1.0
    side: Literal["motor", "output"] = "motor" if n > 1.5 and gear > math.sqrt(n) else "output"
    below = _subtree(model, int(model.jnt_bodyid[model.joint(link).id]))
    site = next(
        (
            s.name
            for s in spec.sites
            if model.site_bodyid[model.site(s.name).id] in below and _has_sensor(spec, s.name)
        ),
        None,
    )
    found = JointMap(
        campaign=name, link=link, rotor=rotor, actuator=None if actuator is None else actuator.name, torque=side,
        sensor_site=site, rotor_ratio=turns, control=_control(model, actuator),
    )  # fmt: skip
    if name or campaign.rig.plane == "horizontal" or campaign.rig.motion == "translational":
        return found
    sign, offset = _horizontal(model, found)
    return replace(found, sign=sign, zero_offset=offset)


def _control(
    model: mujoco.MjModel, actuator: mujoco.MjsActuator | None
) -> Literal["torque", "velocity", "position"]:
    """What an actuator's control is: by its bias, -kp on the angle (a position servo) or -kv on the speed alone."""
    if actuator is None:
        return "torque"
    bias = model.actuator_biasprm[model.actuator(actuator.name).id]
    if bias[1] < 0.0:
        return "position"
    gain = float(model.actuator_gainprm[model.actuator(actuator.name).id][0])
    return "velocity" if bias[2] < 0.0 and gain == -float(bias[2]) else "torque"


def _has_sensor(spec: mujoco.MjSpec, site: str) -> bool:
    return any(s.objname == site for s in spec.sensors)


def _subtree(model: mujoco.MjModel, body: int) -> set[int]:
    inside = {body}
    for other in range(body + 1, model.nbody):
        if int(model.body_parentid[other]) in inside:
            inside.add(other)
    return inside


def _horizontal(model: mujoco.MjModel, joint: JointMap) -> tuple[int, float]:
    """Sign and zero offset with which the model's arm is horizontal at campaign angle 0 and rises with it.

    The holding torque of an arm is R cos(q_model - q_0): with sign = 1 the arm is horizontal at q_0.
    """
    hold = []
    for angle in (0.0, 0.5 * math.pi):
        _, gravity = load_by_mujoco(model, (joint,), {joint.rotor or joint.link: angle})
        hold.append(float(gravity[0]))
    if math.hypot(*hold) < 1e-9:
        return 1, 0.0
    phase = math.atan2(hold[1], hold[0])
    if abs(phase) <= 0.5 * math.pi:
        return 1, round(phase, 9) + 0.0
    return -1, round(math.remainder(phase + math.pi, 2.0 * math.pi), 9) + 0.0
