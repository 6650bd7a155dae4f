"""The run's MJCF: the base rig's, braked or not, edited by the concealed effects, compiled for the loop."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence

import mujoco
import numpy as np

from jointscope.models.parameters import Rig
from jointscope.models.rig import brake, rig_spec
from jointscope.sim.concealed.engine import TIMESTEP, Plant
from jointscope.sim.concealed.law import Effect, Moment, Setting


def base_tree(rig: Rig, *, braked: bool, angle: float, keep_motor: bool = False) -> tuple[ET.Element, float]:
    """MJCF of the rig with nothing missing, and the angle at which the brake holds the motor [rad].

    Args:
        rig: The true rig.
        braked: Whether the motor is held.
        angle: The arm's angle at the start [rad].
        keep_motor: Leave the motor joint in place although the motor is held (a law does the holding).
    """
    spec = rig_spec(rig)
    held = angle - rig.gravity_torque(angle) / rig.joint.stiffness
    if braked and not keep_motor:
        spec = brake(spec, held)
    spec.compile()
    return ET.fromstring(spec.to_xml()), held


def find(root: ET.Element, kind: str, name: str) -> ET.Element:
    """The element ``kind`` called ``name``."""
    for element in root.iter(kind):
        if element.get("name") == name:
            return element
    raise LookupError(f"the model has no {kind} named {name!r}")


def section(root: ET.Element, name: str) -> ET.Element:
    """The top-level section ``name``, made where it is absent."""
    found = root.find(name)
    return ET.SubElement(root, name) if found is None else found


def number(text: str | None, default: float = 0.0) -> float:
    """The first number of an attribute."""
    return float(text.split()[0]) if text else default


def words(*values: float) -> str:
    """Numbers as MJCF writes them, in full precision."""
    return " ".join(repr(float(value)) for value in values)


def compile_plant(
    rig: Rig,
    effects: Sequence[Effect],
    setting: Setting,
    moment: Moment,
    angle: float,
    timestep: float = TIMESTEP,
) -> Plant:
    """The model of one run, effects put in, ready for the loop.

    Args:
        rig: The true rig.
        effects: The concealed effects.
        setting: The case's scales.
        moment: Which run this is.
        angle: The arm's angle at the start [rad].
        timestep: [s].
    """
    keep_motor = any(effect.law.keeps_motor for effect in effects)
    root, held = base_tree(rig, braked=moment.braked, angle=angle, keep_motor=keep_motor)
    option = section(root, "option")
    for effect in effects:
        if effect.law.install is not None:
            effect.law.install(root, effect.values, setting, moment)
    option.set("timestep", repr(timestep))
    option.set("integrator", "Euler")
    constrained = any(float(e.get("frictionloss", "0")) > 0.0 for e in root.iter()) or "yes" in {
        e.get("limited") for e in root.iter("joint")
    }
    flag = option.find("flag")
    if flag is None:
        flag = ET.SubElement(option, "flag")
    flag.set("eulerdamp", "disable")
    flag.set("contact", "disable")
    if not constrained:
        flag.set("constraint", "disable")
    for name in ("motor angle", "motor speed", "arm angle", "arm speed"):
        _drop_sensor(root, name)
    _centre_damping(root, timestep)
    model = mujoco.MjModel.from_xml_string(ET.tostring(root, encoding="unicode"))
    return Plant(
        model=model,
        held=held,
        ratio=rig.joint.efficiency * rig.joint.reduction_ratio,
        hammer_radius=rig.hammer_radius,
        stiffness=rig.joint.stiffness,
    )


def _drop_sensor(root: ET.Element, name: str) -> None:
    sensors = section(root, "sensor")
    for sensor in list(sensors):
        if sensor.get("name") == name:
            sensors.remove(sensor)


def _centre_damping(root: ET.Element, timestep: float) -> None:
    """Add h/2 times the linear damping to the inertia of the same coordinate: the damping then acts at the step itself."""
    for element in (*root.iter("joint"), *root.iter("fixed")):
        damping = number(element.get("damping"))
        if damping > 0.0 and element.get("joint") is None:
            armature = number(element.get("armature"))
            element.set("armature", repr(armature + 0.5 * timestep * damping))


def settle_time(effects: Sequence[Effect]) -> float:
    """Time to come to rest [s]; slow modes need more."""
    slow = [effect.values["frequency"] for effect in effects if effect.values.get("frequency", 100.0) < 20.0]
    return float(np.clip(8.0 / min(slow), 0.6, 1.5)) if slow else 0.6
