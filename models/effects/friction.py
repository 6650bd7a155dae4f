r"""Dry friction and drag: ``frictionloss`` with a stiff solver, polynomial damping; levels that change are laws.

T (1 +- a) sgn(w) = T sgn(w) + a T, at rest too: a symmetric frictionloss and a constant torque -a T, exactly
b (1 +- s) w = b w + s b |w|: the second part a table of three nodes over the speed, exactly
dT_f/dq = (T - T_f sgn(w)/g) / y: the law "bristles", which builds up over the angle y, g unlike in the two directions,
with Dahl's exponent i for 1 of 1 - T_f sgn(w)/(T g) where it has one, and
with sigma_1 w (1 - T_f sgn(w)/(T g)) beside it where the bristles are damped (LuGre), sigma_1 = bristle_time T/y
T [1 + e exp(-(w/w_s)^2)] tanh(w/w_e), T w / sqrt(w^2 + w_e^2): a table over the speed
mu |T_S| (1 - d sgn(T_S w)) tanh(w/w_e) has - mu d T_S |tanh(w/w_e)| beside it: times the torque with its sign
mu |T_S| z with bristles' z, mu |T_S| tanh(w/w_e): the same two laws, of 1 instead of a torque and times mu |T_S|
[T + (T_b - T) exp(-|w/w_s|^p)] sgn(w), mu |T_S| sgn(w): a frictionloss that the law "friction-level" renews each step
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from jointscope.models.effects.building import Building, Parameters

Nodes = NDArray[np.float64]

FASTEST = 1e3  # rad/s or m/s; beyond every speed
SATURATED, NODES = 9.0, 361  # tanh is 1 within 3e-8 there, and straight within 3e-4 between so many nodes
SLOWLY_SATURATED = 70.0  # x / sqrt(x^2 + 1) is 1 within 1e-4 there
SETTLED, MOST_NODES = 4.2, 20_001  # exp(-x^2) is 2e-8 there


def coulomb(building: Building, location: str, variant: str, p: Parameters) -> str:
    """T (1 +- asymmetry) against the motion."""
    torque, asymmetry = p["torque"], p.get("asymmetry", 0.0)
    if variant.startswith("rounded"):
        if variant.endswith("-algebraic"):
            reach = SLOWLY_SATURATED * p["rounding"]
            speed = np.linspace(-reach, reach, NODES * math.ceil(SLOWLY_SATURATED / SATURATED) | 1)
            _over_speed(building, location, speed, torque, speed / np.hypot(speed, p["rounding"]), asymmetry)
        else:
            _creeping(building, location, torque, p["rounding"], 0.0, p["rounding"], asymmetry)
        return ""
    if variant.startswith("presliding"):
        _bristles(building, location, p, 0.0, 1.0)
        return ""
    building.rub(location, torque, asymmetry * torque)
    if p.get("viscous_asymmetry", 0.0):
        one_sided = -p["viscous_asymmetry"] * float(building.spec.tendon("arm").damping[0]) * FASTEST
        building.law(
            "table", at="load", of="speed", low=-FASTEST, high=FASTEST, torque=[one_sided, 0.0, one_sided]
        )
    return f"frictionloss of {_element(location)}" + (", constant torque" if asymmetry else "")


def stribeck(building: Building, location: str, variant: str, p: Parameters) -> str:
    """Breakaway above the sliding friction, falling with speed."""
    torque = p["torque"]
    if variant.startswith("bristles"):
        excess = max(p["breakaway"] / torque - 1.0, 0.0)
        fall = 1.0 if variant.endswith("-exponential") else 2.0
        _bristles(building, location, p, excess, p["stribeck_velocity"], fall)
        return ""
    if variant.startswith("rounded"):
        excess, sided = max(p["breakaway"] / torque - 1.0, 0.0), p.get("asymmetry", 0.0)
        _creeping(building, location, torque, p["rounding"], excess, p["stribeck_velocity"], sided)
        return ""
    building.rub(location, torque)
    building.law(
        "friction-level",
        at=location,
        excess=max(p["breakaway"] - torque, 0.0),
        speed=p["stribeck_velocity"],
        exponent=1.0 if variant == "exponential" else 2.0,
        share=0.0,
    )
    return f"frictionloss of {_element(location)} for the sliding part"


def _creeping(
    building: Building, location: str, torque: float, rounding: float, excess: float, fall: float, sided: float,
    of: str = "speed",
) -> None:  # fmt: skip
    """T [1 + excess exp(-(w/fall)^2)] tanh(w/rounding), as a table that ends where nothing changes any more."""
    reach = max(SATURATED * rounding, SETTLED * fall if excess else 0.0)
    between = min(rounding, fall) if excess else rounding
    count = min(NODES * max(math.ceil(reach / (SATURATED * between)), 1), MOST_NODES) | 1
    speed = np.linspace(-reach, reach, count)
    rise = (1.0 + excess * np.exp(-np.square(speed / fall))) * np.tanh(speed / rounding)
    _over_speed(building, location, speed, torque, rise, sided, of)


def _over_speed(
    building: Building, location: str, speed: Nodes, torque: float, rise: Nodes, sided: float, of: str = "speed"
) -> None:
    """``torque`` times ``rise`` over evenly spaced speeds against the motion, unlike in the two directions."""
    force = -torque * (rise + sided * np.abs(rise))
    at = "load" if building.single else location
    building.law("table", at=at, of=of, low=float(speed[0]), high=float(speed[-1]), torque=list(force))


def _bristles(
    building: Building,
    location: str,
    p: Parameters,
    excess: float,
    speed: float,
    fall: float = 2.0,
    by_load: bool = False,
) -> None:
    at, angle, sided = "load" if building.single else location, p["presliding"], p.get("asymmetry", 0.0)
    damping = p.get("bristle_time", 0.0) * p["torque"] / angle
    building.law(
        "bristles",
        at=at,
        torque=p["torque"],
        angle=angle,
        excess=excess,
        speed=speed,
        sided=sided,
        damping=damping,
        exponent=p.get("exponent", 1.0),
        fall=fall,
        by_load=by_load,
    )


def load_dependent(building: Building, location: str, variant: str, p: Parameters) -> str:
    """mu |T_S| against the motion of one side."""
    at = "load" if variant.startswith("output-side") or building.single else "motor"
    if building.single:
        ahead = p["coefficient"] if variant.startswith("input-side") else -p["coefficient"]
        building.law("gear-friction", ahead=ahead, motor_share=building.motor_share)
    if variant.endswith(("-rounded", "-quadrants")):
        _creeping(building, at, p["coefficient"], p["rounding"], 0.0, p["rounding"], 0.0, "speed-by-load")
        if p.get("driven", 0.0):
            reach = SATURATED * p["rounding"]
            speed = np.linspace(-reach, reach, NODES)
            rise = np.abs(np.tanh(speed / p["rounding"]))
            _over_speed(building, at, speed, -p["coefficient"] * p["driven"], rise, 0.0, "speed-by-torque")
        return ""
    if variant.endswith("-presliding"):
        _bristles(building, at, {**p, "torque": p["coefficient"]}, 0.0, 1.0, by_load=True)
        return ""
    building.rub(at, 0.0)
    building.law("friction-level", at=at, excess=0.0, speed=1.0, exponent=2.0, share=p["coefficient"])
    return f"a trace of frictionloss on {_element(at)}, which the law renews"


def quadratic(building: Building, location: str, variant: str, p: Parameters) -> str:
    """c_q w |w| on the arm."""
    building.spec.tendon("arm").damping[1] += p["coefficient"]
    return "second damping coefficient of tendon arm"


def _element(location: str) -> str:
    return "joint motor" if location == "motor" else "tendon arm"
