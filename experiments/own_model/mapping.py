"""From a ``map.toml`` to the joint of a model, and every mistake in it as one line that names file, key and way out."""

from __future__ import annotations

import math
from pathlib import Path

from jointscope.errors import InputError, RefusedError
from jointscope.experiments.own_model.content import Content, read_content
from jointscope.prediction.arm_comparison import suspect
from jointscope.prediction.arm_guess import guess_map
from jointscope.prediction.arm_map import JointMap, ModelMap, read_map
from jointscope.recordings.campaign import Campaign
from jointscope.sim.own_model import OwnJoint, load_own

GAIN = (0.2, 1.3)  # torque at the output over n T_e that a reducer may have; beyond it the map is wrong


def own_joint(model: Path, map_file: Path | None, campaign: Campaign) -> OwnJoint:
    """The joint under test in the user's model.

    Args:
        model: MJCF or URDF.
        map_file: ``map.toml``; guessed where ``None``.
        campaign: Of one joint.

    Raises:
        InputError: The map names what the model lacks, or its numbers can't belong to the campaign.
        RefusedError: The campaign is of an arm.
    """
    if campaign.rig.topology == "arm":
        raise RefusedError(f"{campaign.path}: --model takes the campaign of a single joint, not topology = 'arm'")
    spec = load_own(model)
    found = guess_map(model, campaign) if map_file is None else read_map(map_file)
    if len(found.joints) != 1:
        raise InputError(map_file or model, "joint", "one is under test, no more", value=len(found.joints))
    row = found.joints[0]
    where = map_file or model
    names = sorted(j.name for j in spec.joints if j.name)
    for key, name, known, others in (
        ("joint[0].link", row.link, spec.joint(row.link) is not None, names),
        ("joint[0].rotor", row.rotor, row.rotor is None or spec.joint(row.rotor) is not None, names),
        ("joint[0].actuator", row.actuator, row.actuator is None or spec.actuator(row.actuator) is not None,
         sorted(a.name for a in spec.actuators if a.name)),
        ("joint[0].sensor_site", row.sensor_site, row.sensor_site is None or spec.site(row.sensor_site) is not None,
         sorted(s.name for s in spec.sites if s.name)),
        *((f"hold.{name}", name, spec.joint(name) is not None, names) for name in found.hold),
    ):  # fmt: skip
        if not known:
            raise InputError(
                where, key, f"is not in {model.name}", value=name, fix=f"it has: {', '.join(others) or 'none'}"
            )
    if row.rotor == row.link:
        raise InputError(
            where, "joint[0].rotor", "is the link itself", value=row.rotor, fix="leave it out for a rigid joint"
        )
    joint = as_own(row, found)
    _check_numbers(where, model, joint, campaign)
    return joint


def as_own(row: JointMap, found: ModelMap) -> OwnJoint:
    """The map's joint for stepping."""
    return OwnJoint(
        link=row.link, rotor=row.rotor, rotor_ratio=row.rotor_ratio, actuator=row.actuator, torque=row.torque,
        control=row.control, sensor_site=row.sensor_site, sign=row.sign, zero_offset=row.zero_offset, hold=found.hold,
    )  # fmt: skip


def _check_numbers(where: Path, model: Path, joint: OwnJoint, campaign: Campaign) -> None:
    two, n = campaign.rig.topology == "two-inertia", campaign.rig.reduction_ratio or 1.0
    content = read_content(load_own(model), joint, two=two, angle=campaign.runs[0].arm_angle, ratio=n)
    if two and joint.rotor is not None and not _sprung(content):
        raise InputError(
            where, "joint[0].rotor_ratio", f"no spring of {model.name} acts between rotor and link at this ratio",
            value=joint.rotor_ratio, fix="write down: " + _suggestion(model, campaign, joint),
        )  # fmt: skip
    gain = content.values["torque_gain"] / n if _torque_known(campaign) else math.nan
    if gain < 0.0:
        raise InputError(
            where, "joint[0].actuator", "a positive torque turns the joint backwards (negative gear)",
            value=joint.actuator, fix="turn the sign of its gear, or of joint[0].sign with zero_offset",
        )  # fmt: skip
    if math.isfinite(gain) and not GAIN[0] <= gain <= GAIN[1]:
        guess = suspect(gain, n)
        raise InputError(
            where, "joint[0].torque",
            f"{model.name} then gives {gain * n:.4g} N m at the output per N m of the motor; reduction_ratio is {n:g}"
            + (f" ({guess})" if guess else ""),
            value=joint.torque, fix="torque = 'output' or 'motor', or the actuator's gear",
        )  # fmt: skip


def _torque_known(campaign: Campaign) -> bool:
    """Whether the campaign says how many N m the motor gives; volts and bare amperes say nothing."""
    constant = campaign.rig.torque_constant is not None
    return any(
        s.channel.calibrated and (s.channel.quantity == "torque" or ("current" in s.channel.quantity and constant))
        for run in campaign.runs
        for s in run.select(location="motor", role="input")
    )


def _sprung(content: Content) -> bool:
    return any(c.stiffness[0] > 0.0 for c in content.at("transmission"))


def _suggestion(model: Path, campaign: Campaign, joint: OwnJoint) -> str:
    guessed = guess_map(model, campaign).joints[0]
    if guessed.rotor == joint.rotor and guessed.link == joint.link:
        return f"rotor_ratio = {guessed.rotor_ratio:g}"
    return "which joints are rotor and link"
