r"""The transmission's torque: play, polynomial and piecewise springs natively; memory and kinematic error as laws.

Play is a fixed tendon over the reducer with a two-valued springlength (a dead band without a further coordinate);
Maxwell-slip elements are parallel tendons with springyield. Signs: x = -Delta.
"""

from __future__ import annotations

import math

import numpy as np

from jointscope.models.effects.building import Building, Parameters

SLIP_LEVELS = (0.4, 0.8, 1.2, 1.6)  # yield angles of four equal elements over the loop's own angle; they sum to 4
SPREAD_ELEMENTS = 8
BRANCHES = 5
SPACING = 4.0  # of the branches' relaxation times: within 7 % from a fifth to five times the resonance
TURNING = 0.05  # of the speed amplitude at resonance, over which the rate-independent damping turns round


def backlash(building: Building, location: str, variant: str, p: Parameters) -> str:
    """Lost motion ``gap`` in total; ``centre`` in half gaps; the damper acts in contact only, or always ("damped").

    Flanks that don't pull ("sheds"), or give way over ``contact_depth`` as well ("rounded"). With ``inside`` that share of
    the spring is left within the gap ("cushioned"); with ``corner``, in half gaps, bends are in place of its corners
    ("softplus": such as end sooner);
    with ``impact`` the damping is Hunt and Crossley's, that much per torque, beside c in contact.
    """
    if "inside" in p:
        building.soft, building.soft_angle = (1.0 - p["inside"]) * building.stiffness, 0.5 * p["gap"]
        return "tendon 'reducer low-torque spring'"
    building.gap = p["gap"]
    building.centre = 0.5 * p["gap"] * p.get("centre", 0.0)
    building.gap_damping = 1.0 if variant == "damped" else 0.0
    building.gap_sheds = variant in ("sheds", "rounded")
    building.gap_corner = 0.5 * p["gap"] * p.get("corner", 0.0) * (-1.0 if variant == "softplus" else 1.0)
    building.gap_round, building.gap_fade = p.get("contact_depth", 0.0), p.get("fade", 0.0)
    if "impact" in p:
        building.gap_impact, building.gap_fade = p["impact"], 1.0
    return "springlength of tendon 'reducer spring'"


def nonlinear_stiffness(building: Building, location: str, variant: str, p: Parameters) -> str:
    """K Delta + k_2 Delta^2 + k_3 Delta^3, a share of K missing within +-transition_angle (or not at a corner); a power."""
    if variant == "power":
        building.power = (p["growth"] * building.stiffness, p["reference_angle"], p["exponent"])
        return ""
    soft = variant.startswith("piecewise") or "soft_share" in p
    if soft:
        building.soft = p["soft_share"] * building.stiffness
        building.soft_angle = p["transition_angle"]
        building.soft_smooth = variant == "smooth"
    if not soft or "cubic" in p:
        building.cubic += p["cubic"]
        building.quadratic += p.get("quadratic", 0.0)
    if building.soft_smooth:
        return ""
    return "tendon 'reducer low-torque spring'" if soft else "stiffness polynomial of the reducer"


def hysteresis(building: Building, location: str, variant: str, p: Parameters) -> str:
    """K Delta + T z, initial slope K + stiffness; z unloaded where the run begins."""
    torque, angle = p["torque"], max(p["torque"] / p["stiffness"], 1e-15)
    if variant == "elastic-slip":
        slip = building.spec.add_tendon(name="slip")
        slip.wrap_joint("reducer", 1.0)
        slip.stiffness[0], slip.springyield = torque / angle, angle
        return "springyield of a parallel tendon"
    if variant == "bouc-wen-shaped":
        building.law("hysteresis", form=variant, torque=torque, angle=angle, shape=p["shape"])
        return ""
    if variant == "bouc-wen-linear":
        building.law("hysteresis", form="bouc-wen-shaped", torque=2.0 * torque, angle=2.0 * angle, shape=1.0)
        return ""
    if variant not in ("maxwell-slip", "slip-spread"):
        building.law("hysteresis", form="dahl" if variant == "dahl" else "bouc-wen", torque=torque, angle=angle)
        return ""
    levels = SLIP_LEVELS if variant == "maxwell-slip" else _slip_levels(p["spread"])
    for number, level in enumerate(levels, 1):
        slip = building.spec.add_tendon(name=f"slip {number}")
        slip.wrap_joint("reducer", 1.0)
        slip.stiffness[0] = torque / (len(levels) * angle)
        slip.springyield = level * angle
    return f"springyield of {len(levels)} parallel tendons"


def _slip_levels(spread: float) -> tuple[float, ...]:
    """Where each of equal springs yields over their mean: in geometric steps, the last at ``spread`` times the first."""
    steps = np.geomspace(1.0, spread, SPREAD_ELEMENTS)
    return tuple(float(level) for level in steps / steps.mean())


def structural(building: Building, location: str, variant: str, p: Parameters) -> str:
    """K (1 + i eta) about the resonance: five relaxation branches, or pi eta/2 K |Delta| sgn(Delta')."""
    omega = building.resonance
    if variant == "rate-independent":
        building.law(
            "rate-independent-damping",
            coefficient=0.5 * math.pi * p["loss_factor"] * building.stiffness,
            turning=TURNING * omega,
        )
        return ""
    times = [SPACING ** (i - (BRANCHES - 1) / 2.0) / omega for i in range(BRANCHES)]
    loss = sum(omega * t / (1.0 + (omega * t) ** 2) for t in times)
    storage = sum((omega * t) ** 2 / (1.0 + (omega * t) ** 2) for t in times)
    each = p["loss_factor"] * building.stiffness / loss
    building.stiffness -= each * storage  # the branches carry it at the resonance
    building.law("relaxation", stiffness=each, times=times)
    return "stiffness of the reducer, less what the branches store"


def drift(building: Building, location: str, variant: str, p: Parameters) -> str:
    """K (1 + rate t) within a run, or K (1 + rate k) from run to run."""
    if variant == "per-run":
        building.law("stiffness-per-run", rate=p["rate"])
    else:
        building.law("stiffness-drift", rate=p["rate"])
    return ""


def kinematic_error(building: Building, location: str, variant: str, p: Parameters) -> str:
    """Delta = q_s + a sin(order angle + phase) - q, or a sin x + h_s sin 2x + h_c cos 2x + g_s sin 3x + g_c cos 3x.

    One that does no work ("reacting") hands T_S on by dDelta/dq_s and dDelta/dq.
    """
    per_output = variant.startswith("output-order")
    for amplitude, order, phase in lines_of(p):
        building.law(
            "transmission-error",
            amplitude=amplitude,
            per_motor=0.0 if per_output else order * building.ratio,
            per_load=order if per_output else 0.0,
            phase=phase,
            **({"reacts": True} if "-reacting" in variant else {}),
        )
    return ""


def lines_of(p: Parameters) -> list[tuple[float, float, float]]:
    """(amplitude, order, phase) of an order and, where they are given, of its second and third harmonic."""
    lines = [(p["amplitude"], p["order"], p["phase"])]
    for k, name in ((2, "second"), (3, "third")):
        sine, cosine = p.get(f"{name}_sine", 0.0), p.get(f"{name}_cosine", 0.0)
        if sine or cosine:
            phase = k * p["phase"] + math.atan2(cosine, sine)
            lines.append((math.hypot(sine, cosine), k * p["order"], phase))
    return lines
