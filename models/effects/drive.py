"""Between the logged torque and the shaft: gain by the gear, cogging by a passive motor; lag and load ripple as laws."""

from __future__ import annotations

import math

import mujoco

from jointscope.models.effects.building import Building, Parameters
from jointscope.models.effects.transmission import lines_of


def lag(building: Building, location: str, variant: str, p: Parameters) -> str:
    """tau = eta n T_e / (1 + s tau_e), of the logged torque, two or three stages of a part of it, or a second-order loop."""
    if variant in ("magnitude-optimum", "damped-loop"):
        building.law(
            "drive-lag", time_constant=p["time_constant"], damping=p.get("damping", math.sqrt(0.5)), form=variant
        )
        return ""
    stages = {"second-order": 2, "third-order": 3}.get(variant, 1)
    for _ in range(stages):
        building.law("drive-lag", time_constant=p["time_constant"] / stages)
    return ""


def gain(building: Building, location: str, variant: str, p: Parameters) -> str:
    """gain eta n T_e."""
    building.spec.actuator("motor").gear[0] *= p["gain"]
    return "gear of actuator motor"


def ripple(building: Building, location: str, variant: str, p: Parameters) -> str:
    """tau + a sin(order angle + phase), or tau (1 + share sin(...)); angle as the encoder counts it."""
    if variant == "load-proportional" or "share" in p:
        building.law("torque-ripple", share=p["share"], per_motor=p["order"] * building.ratio, phase=p["phase"])
        return ""
    names = [_cogging(building, a, order * building.ratio, phase) for a, order, phase in lines_of(p)]
    return f"cogging of actuator '{names[0]}', its phase put to each run's encoder zero"


def _cogging(building: Building, amplitude: float, per_motor: float, phase: float) -> str:
    name = f"cogging {1 + sum(law['kind'] == 'cogging' for law in building.laws)}"
    at = (mujoco.mjtTrn.mjTRN_TENDON, "arm") if building.single else (mujoco.mjtTrn.mjTRN_JOINT, "motor")
    cogging = building.spec.add_actuator(name=name, trntype=at[0], target=at[1])
    # a motor constant that is next to nothing: the control input does nothing either
    cogging.set_to_dcmotor(motorconst=[1e-9, 1e-9], resistance=1.0, cogging=[amplitude, per_motor, phase])
    building.law("cogging", actuator=name, per_motor=per_motor, phase=phase)
    return name
