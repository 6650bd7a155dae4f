"""Between the logged torque and the shaft: gain by the gear, cogging by a passive motor; lag and load ripple as laws."""

from __future__ import annotations

import mujoco

from jointscope.models.effects.building import Building, Parameters


def lag(building: Building, location: str, variant: str, p: Parameters) -> str:
    """tau = eta n T_e / (1 + s tau_e), from the logged torque, or two such stages of half the time."""
    stages = 2 if variant == "second-order" else 1
    for _ in range(stages):
        building.law("drive-lag", time_constant=p["time_constant"] / stages)
    return ""


def gain(building: Building, location: str, variant: str, p: Parameters) -> str:
    """gain eta n T_e."""
    building.spec.actuator("motor").gear[0] *= p["gain"]
    return "gear of actuator motor"


def ripple(building: Building, location: str, variant: str, p: Parameters) -> str:
    """tau + a sin(order angle + phase), or tau (1 + share sin(...)); angle as the encoder counts it."""
    per_motor = p["order"] * building.ratio
    if variant == "load-proportional" or "share" in p:
        building.law("torque-ripple", share=p["share"], per_motor=per_motor, phase=p["phase"])
        return ""
    name = f"cogging {1 + sum(law['kind'] == 'cogging' for law in building.laws)}"
    cogging = building.spec.add_actuator(name=name, trntype=mujoco.mjtTrn.mjTRN_JOINT, target="motor")
    # a motor constant that is next to nothing: the control input does nothing either
    cogging.set_to_dcmotor(
        motorconst=[1e-9, 1e-9], resistance=1.0, cogging=[p["amplitude"], per_motor, p["phase"]]
    )
    building.law("cogging", actuator=name, per_motor=per_motor, phase=p["phase"])
    return f"cogging of actuator '{name}', its phase put to each run's encoder zero"
