"""``predict`` from a user's own MJCF and its map, wherever it takes a ``model.json``.

An arm of several joints is stepped as it is (``arm``); a single-joint rig is read into the base model, so that it is
predicted, scored and bounded exactly as an identified one.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np

from jointscope.errors import RefusedError
from jointscope.identification.model_file import BaseModel
from jointscope.models.arm.linear import joint_values
from jointscope.models.arm.reference import arm_reference
from jointscope.models.parameters import STANDARD_GRAVITY
from jointscope.prediction.arm import predict_arm
from jointscope.prediction.arm_comparison import model_posture
from jointscope.prediction.arm_guess import guess_map, mapped_arm
from jointscope.prediction.arm_map import ModelMap, read_map
from jointscope.prediction.base_model import ChannelPrediction, RunPrediction, predict_campaign
from jointscope.recordings.campaign import Campaign, Run


def predict_mapped(
    model: Path, map_file: Path | None, campaign: Campaign, *, declared: bool = False
) -> Iterator[RunPrediction]:
    """Predict every run of ``campaign`` from the MJCF ``model``.

    Args:
        model: The user's MJCF.
        map_file: Its ``map.toml``; guessed where ``None``.
        campaign: Inputs only are read.
        declared: Also predict channels that aren't recorded.

    Raises:
        RefusedError: The model lacks a reducer, or a run lacks what moves it.
    """
    found = (
        guess_map(model, campaign)
        if map_file is None
        else replace(read_map(map_file), model=Path(model).resolve())
    )
    if campaign.rig.topology != "arm":
        left_out = not_read(found)
        for prediction in predict_campaign(mapped_base_model(found, campaign), campaign, declared=declared):
            yield replace(prediction, notes=(*prediction.notes, *left_out))
        return
    arm = mapped_arm(found)
    names = {joint.campaign: joint for joint in found.joints}
    for run in campaign.runs:
        if run.joint is None:
            raise RefusedError(
                f"run {run.id}: says no joint; the arm's model needs to know which one moves or is hit"
            )
        own = names[run.joint]
        renamed = replace(
            run,
            joint=own.rotor,
            posture=model_posture(found, run),
            hold={str(names[name].rotor) if name else "": kind for name, kind in run.hold.items()},
            streams=_renamed(run, {name: str(joint.rotor) for name, joint in names.items()}),
        )
        made = predict_arm(arm, campaign.rig, renamed, torque_sign=float(own.sign))
        wanted = zip(
            run.select(role="output", recorded=False), renamed.select(role="output", recorded=False), strict=True
        )
        original = {id(after.channel): before for before, after in wanted}
        channels = tuple(
            ChannelPrediction(original[id(c.signal.channel)], c.times, c.values)
            for c in made.channels
            if declared or c.signal.channel.samples is not None
        )
        rates = [c.signal.sampling_rate for c in channels]
        yield RunPrediction(
            run=run, channels=channels, closed_loop=made.torque is not None,
            legitimate=(1.0 if made.torque is not None else 0.0, 0.46 * min(rates, default=0.0)), notes=made.notes,
        )  # fmt: skip


def mapped_base_model(found: ModelMap, campaign: Campaign) -> BaseModel:
    """The two-inertia base model that a user's single-joint MJCF is.

    Raises:
        RefusedError: The model's joint is rigid, or the campaign has no reduction ratio.
    """
    arm, joint = mapped_arm(found), found.joints[0]
    rig = campaign.rig
    n = rig.reduction_ratio
    if n is None:
        raise RefusedError(
            "the campaign's rig.reduction_ratio is needed to put the model's armature on the motor shaft"
        )
    values, reference = joint_values(arm), arm_reference(arm)
    posture = model_posture(found, campaign.runs[0])
    shaft = float(values.rotor_inertia[0]) / n**2
    reducer = min(rig.reducer_inertia or 0.0, shaft)
    figures = {
        "stiffness": float(values.stiffness[0]), "damping": float(values.damping[0]),
        "load_inertia": float(reference.locked_inertia(posture)[0]), "motor_inertia": shaft - reducer,
        "reducer_inertia": reducer, "reduction_ratio": n, "motor_damping": float(values.rotor_damping[0]),
        "load_damping": _link_damping(arm.spec, joint.link),
        "efficiency": _efficiency(arm.spec, joint.actuator, rig.efficiency, n),
    }  # fmt: skip
    level = {joint.rotor or joint.link: joint.zero_offset}
    moment = abs(float(reference.gravity(level)[0]))
    mass = float(arm.spec.compile().body_subtreemass[0])
    return BaseModel(
        rig=replace(rig, arm_mass=mass, arm_com_radius=moment / (mass * STANDARD_GRAVITY)), joint=figures
    )


def not_read(found: ModelMap) -> tuple[str, ...]:
    """What a single-joint MJCF holds that the two-inertia reading of it leaves out, a line each."""
    model = mapped_arm(found).spec.compile()
    joint = found.joints[0]
    lines = []
    for name in (joint.rotor, joint.link):
        if name is None:
            continue
        at = model.joint(name)
        dof, own = int(at.dofadr[0]), int(at.id)
        if model.dof_frictionloss[dof] > 0.0:
            lines.append(f"{name}: frictionloss {model.dof_frictionloss[dof]:g} N m")
        for what, values in (("stiffness", model.jnt_stiffness[own]), ("damping", model.dof_damping[dof])):
            further = np.ravel(values)[1:]
            if np.any(further != 0.0):
                lines.append(f"{name}: {what} beyond the linear term, {', '.join(f'{v:g}' for v in further)}")
        if model.jnt_limited[own]:
            lines.append(f"{name}: range")
    if model.neq:
        lines.append(f"{model.neq} equality constraint(s)")
    friction = model.tendon_frictionloss[model.tendon_frictionloss > 0.0]
    lines += [f"tendon frictionloss {value:g}" for value in friction]
    return tuple(
        f"{found.model.name}: not in this prediction, which reads inertia, stiffness, damping and gear: {line}"
        for line in lines
    )


def _link_damping(spec: mujoco.MjSpec, link: str) -> float:
    """b_l [N m s/rad]: of a fixed tendon that adds rotor and reducer to the link's angle."""
    model = spec.compile()
    total = 0.0
    for tendon in range(model.ntendon):
        first, count = int(model.tendon_adr[tendon]), int(model.tendon_num[tendon])
        joints = [model.joint(int(j)).name for j in model.wrap_objid[first : first + count]]
        if link in joints and count == 2 and np.allclose(np.abs(model.wrap_prm[first : first + count]), 1.0):
            total += float(np.ravel(model.tendon_damping[tendon])[0])
    return total


def _efficiency(spec: mujoco.MjSpec, actuator: str | None, nameplate: float | None, n: float) -> float:
    """eta: the actuator's gear over n where it takes shaft torque, else the nameplate's."""
    if actuator is not None:
        gear = float(spec.actuator(actuator).gear[0])
        if gear < 0.0:
            raise RefusedError(
                f"{spec.modelname or 'the model'}: actuator {actuator} has gear {gear:g}: a positive torque turns its joint "
                "backwards; turn the gear, or the axis and the map's sign"
            )
        ratio = gear / n
        if 0.3 < ratio <= 1.0 and not math.isclose(ratio, 1.0 / n):
            return ratio
    return 1.0 if nameplate is None else nameplate


def _renamed(run: Run, names: dict[str, str]) -> tuple:  # type: ignore[type-arg]
    return tuple(
        replace(
            stream,
            channels=tuple(
                channel
                if channel.joint is None
                else replace(channel, joint=names.get(channel.joint, channel.joint))
                for channel in stream.channels
            ),
        )
        for stream in run.streams
    )
