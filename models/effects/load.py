"""On the arm: weight by its centre of mass, a stop by a one-sided tendon, inertia by run; and a law without a name."""

from __future__ import annotations

import cmath

from jointscope.models.effects.building import Building, Parameters
from jointscope.models.parameters import STANDARD_GRAVITY


def gravity(building: Building, location: str, variant: str, p: Parameters) -> str:
    """-M cos(q + phase); a constant force on a rig that slides."""
    building.weight += p["moment"] * cmath.exp(1j * p.get("phase", 0.0))
    return "actuator 'weight'" if building.translational else "mass and centre of mass of body arm"


def end_stop(building: Building, location: str, variant: str, p: Parameters) -> str:
    """k (q - angle)+ (1 + c_k q') on the upper or the lower side, the loss a law of replay's."""
    side = -1.0 if variant == "lower" else 1.0
    building.add_stop(side, p["angle"], p["stiffness"])
    if p.get("damping", 0.0):
        building.law("stop-loss", side=side, angle=p["angle"], damping=p["stiffness"] * p["damping"])
    return "springlength of tendon 'end-stop " + ("upper'" if side > 0.0 else "lower'")


def payload(building: Building, location: str, variant: str, p: Parameters) -> str:
    """J_L + inertia, and its weight, in the runs that carry it; the file holds the unloaded arm."""
    building.law("payload", inertia=p["inertia"])
    if "percussion_radius" in p:
        building.law("weight", moment=p["inertia"] * STANDARD_GRAVITY / p["percussion_radius"], phase=0.0)
    return ""


def tabled(building: Building, location: str, variant: str, p: Parameters) -> str:
    """A torque straight between nodes of speed, angle, wind-up or its rate, from ``low`` to ``high``; constant beyond.

    ``stiffness-by-angle``: a stiffness of the transmission instead.
    """
    count = sum(name.startswith("torque_") for name in p)
    building.law(
        "table",
        at=location,
        of=variant,
        low=p["low"],
        high=p["high"],
        torque=[p[f"torque_{i}"] for i in range(count)],
    )
    return ""
