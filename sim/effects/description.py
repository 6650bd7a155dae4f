"""The entries of ``effects.json`` sorted by where they act, for each run."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import mujoco
import numpy as np

from jointscope.errors import InputError
from jointscope.recordings.campaign import Run, gearing
from jointscope.sim.effects.instruments import INSTRUMENTS, instruments
from jointscope.sim.effects.joint_law import MECHANICS, Frame, joint_law
from jointscope.sim.physics import Physics
from jointscope.sim.replay_inputs import LoggedLoop

Law = Mapping[str, Any]

EDITS = ("payload", "stiffness-per-run", "cogging", "mount-posture")
_FELT_AT_LEAST = 0.05  # share of a mount's own direction below which it is next to invisible
_SPRING_TENDONS = ("reducer spring",)


def physics_of(description: Mapping[str, Any]) -> Callable[[Run], Physics]:
    """What each run holds beyond ``augmented.xml``.

    Args:
        description: Content of ``effects.json`` (format ``jointscope-effects/1``).

    Returns:
        A function of a run, for :func:`jointscope.sim.replay.replay`.

    Raises:
        InputError: The description holds a law of an unknown kind.
    """
    laws: list[Law] = list(description.get("laws", []))
    for law in laws:
        if law["kind"] not in (*EDITS, *INSTRUMENTS, *MECHANICS):
            raise InputError("effects.json", "laws", "is of an unknown kind", value=law["kind"])
    rig, spring = description["rig"], description["spring"]
    offset = float(description.get("torque_offset", 0.0))

    def of(run: Run) -> Physics:
        edits = [law for law in laws if law["kind"] in EDITS]
        factor = 1.0 + sum(law["rate"] * weight(law, run) for law in edits if law["kind"] == "stiffness-per-run")
        frame = Frame(
            arm_angle=run.arm_angle,
            origin=min((stream.start for stream in run.streams), default=0.0),
            motor_zero=motor_zero(run, rig["reduction_ratio"]),
            run=run.id,
        )
        mechanical = [_carried(law, run) for law in laws if law["kind"] in MECHANICS]
        law, actuation = joint_law(mechanical, {**spring, "stiffness": spring["stiffness"] * factor}, frame)

        def edit(spec: mujoco.MjSpec) -> None:
            for entry in edits:
                _edit(spec, entry, run, frame)

        return Physics(
            edit=edit,
            law=law,
            actuation=actuation,
            acquisition=instruments(
                [_posed(law, edits, run) for law in laws if law["kind"] in INSTRUMENTS], run, rig, offset
            ),
        )

    return of


def loop_of(numbers: Mapping[str, Any] | None) -> LoggedLoop | None:
    """The drive's loop from the ``drive`` of a description."""
    if numbers is None:
        return None
    limit = numbers["torque_limit"]
    return LoggedLoop(**{**numbers, "torque_limit": float("inf") if limit is None else limit})


def weight(law: Law, run: Run) -> float:
    """By how much an effect that differs between runs acts in this one; 0 in a run it does not name."""
    return float(law.get("runs", {}).get(run.id, 0.0))


def motor_zero(run: Run, ratio: float) -> float:
    """What the encoder counted at the start, at the output, less the run's arm angle [rad]; 0 without an encoder."""
    for quantity in ("angle", "position"):
        for signal in run.select(quantity, location="motor"):
            samples = signal.samples[np.isfinite(signal.samples)]
            if samples.size:
                return float(np.median(samples[:8])) / gearing(quantity, "motor", ratio) - run.arm_angle
    return 0.0


def _carried(law: Law, run: Run) -> Law:
    """The law as it is in the run: a payload's weight is there where the payload is."""
    return (
        {**law, "moment": law["moment"] * weight(law, run)} if law["kind"] == "weight" and "runs" in law else law
    )


def _edit(spec: mujoco.MjSpec, law: Law, run: Run, frame: Frame) -> None:
    if law["kind"] == "cogging":
        actuator = spec.actuator(law["actuator"])
        if actuator is not None:  # its phase counts from the encoder's zero, the model's from the horizontal
            actuator.biasprm[2] = law["phase"] + law["per_motor"] * frame.motor_zero
    elif law["kind"] == "mount-posture":
        felt, turn, slide = _felt(law, run)
        mount = spec.joint("base")
        factor = ((1.0 + law["eccentricity"]) / felt) ** 2
        across = math.sin(run.arm_angle - law["direction"]) / (1.0 + law["eccentricity"])
        mount.armature *= factor * (1.0 + law.get("share", 0.0) * across**2)
        mount.stiffness[0] *= factor
        mount.damping[0] *= factor
        for name, gear in (("mount torque", turn - 1.0), ("mount force", slide)):
            spec.actuator(name).gear[0] = gear
    elif law["kind"] == "payload":
        _load(spec, law["inertia"] * weight(law, run))
    else:
        factor = max(1.0 + law["rate"] * weight(law, run), 0.05)
        elements = [spec.joint("reducer"), *(spec.tendon(name) for name in _SPRING_TENDONS)]
        for element in elements:
            if element is not None:
                element.stiffness[0] *= factor


def _felt(law: Law, run: Run) -> tuple[float, float, float]:
    """kappa + cos(q - q_e) in the run's posture, and the levers a [-] and b [m] with which the arm rides on the mount."""
    cosine, eccentricity = math.cos(run.arm_angle - law["direction"]), float(law["eccentricity"])
    felt = eccentricity + cosine
    if abs(felt) < _FELT_AT_LEAST:
        felt = math.copysign(_FELT_AT_LEAST, felt)
    return felt, eccentricity / felt, law["reach"] * cosine / felt


def _posed(law: Law, edits: list[Law], run: Run) -> Law:
    """The law as it is in the run's posture."""
    for entry in edits:
        if entry["kind"] == "mount-posture" and law["kind"] == "mount-sensor":
            _, turn, slide = _felt(entry, run)
            return {**law, "turn": turn, "slide": slide}
    return law


def _load(spec: mujoco.MjSpec, inertia: float) -> None:
    """Inertia [kg m^2 or kg] without weight on the arm, whatever its frame: a body of its own; less of it off the arm's."""
    joint = spec.joint("reducer")
    arm, slides = joint.parent, joint.type == mujoco.mjtJoint.mjJNT_SLIDE
    if inertia > 0.0:
        load = arm.add_body(gravcomp=1.0)
        load.explicitinertial, load.ipos = True, np.asarray(joint.pos, dtype=float)
        load.mass, load.inertia = (inertia, [1e-6 * inertia] * 3) if slides else (1e-9, [inertia] * 3)
    elif slides:
        arm.mass = max(arm.mass + inertia, 1e-9)
    else:
        arm.inertia = np.maximum(np.array(arm.inertia) + np.array([0.1, 1.0, 1.0]) * inertia, 1e-12)
