r"""Further modes as bodies: a part of the arm's inertia on its own spring, or a mount that turns under the joint.

J_p (q'' + p'' + 2 zeta w p' + w^2 p) = phi_h T_ext, J_p out of J_L; the sensor reads q'' + phi_s p'';
  beyond an elbow phi = kappa (r - r_e)^curve/r, curve 1 but of a bar, so the work of a force F at r_h is
  kappa (r_h - r_e)^curve F
J_L (p_r'' + 2 zeta w p_r' + w^2 p_r) = T_ext; sensor k reads shape_k q'' + sum_r s_rk p_r''
J_b (b'' + 2 zeta w b' + w^2 b) = -T_S, J_b = J_L / share; the arm turns by q + b, its encoders see q
Where the posture tells, J_b and the levers are those at the mount's own direction; replay sets each run's
"""

from __future__ import annotations

import math

import mujoco

from jointscope.models.effects.building import Building, Parameters


def link(building: Building, location: str, variant: str, p: Parameters) -> str:
    """The arm bends; hammer and accelerometer ride on the mode by their shapes."""
    if "bends" in variant:
        return bends(building, p)
    inertia = min(p["inertia"], 0.95 * building.inertia)
    share = math.sqrt(inertia / building.inertia)
    hit = p.get("hit_shape", p.get("shape", 0.0)) * share
    sensed = p.get("sensor_shape", p.get("shape", 0.0)) * share
    _on_the_arm(building, "link", inertia, p)
    elbow, curve = p.get("elbow_radius", 0.0), p.get("curve", 1.0)
    if hit != 0.0 and "elbow_radius" in p:  # replay knows how far beyond it the hammer is
        push = building.spec.add_actuator(name="bending force", trntype=mujoco.mjtTrn.mjTRN_JOINT, target="link")
        push.gear[0] = hit
    elif hit != 0.0:  # the part of the hammer's torque that works on the mode; replay drives it
        push = building.spec.add_actuator(name="link torque", trntype=mujoco.mjtTrn.mjTRN_JOINT, target="link")
        push.gear[0] = hit
    if sensed != 0.0:
        building.law("link-sensor", shape=sensed, elbow=elbow, curve=curve)
    return "body, joint" + (" and actuator" if hit else "") + " 'link'"


def bends(building: Building, p: Parameters) -> str:
    """Further modes as inertias in parallel, driven by the torque on the arm; each accelerometer reads them by its shares."""
    count = sum(key.startswith("frequency") for key in p)
    shapes = [p[key] for key in sorted(key for key in p if key.startswith("shape_"))]
    modes = []
    for r in range(1, count + 1):
        tail, name = "" if r == 1 else f"_{r}", f"bend {r}"
        body = building.spec.worldbody.add_body(name=name)
        _weigh(building, body, building.inertia)
        body.gravcomp = 1.0  # the arm's weight is the joint's affair
        _spring(
            building.add_joint(body, name),
            building.inertia,
            {"frequency": p[f"frequency{tail}"], "damping": p[f"damping{tail}"]},
        )
        push = building.spec.add_actuator(name=f"{name} torque", trntype=mujoco.mjtTrn.mjTRN_JOINT, target=name)
        push.gear[0] = 1.0
        shares = [p[f"share{tail}_of_{k}"] for k in range(1, len(shapes) + 2)]
        modes.append({"joint": name, "shares": shares})
    building.law("bend-sensors", shapes=[1.0, *shapes], modes=modes)
    return f"bodies, joints and actuators 'bend 1' to 'bend {count}'"


def neighbour(building: Building, location: str, variant: str, p: Parameters) -> str:
    """A neighbour's inertia on its own spring, which neither hammer nor accelerometer touches, or one that carries."""
    if variant.startswith("carrier"):
        return mount(building, location, variant, p)
    _on_the_arm(building, "neighbour", min(p["modal_share"], 0.95) * building.inertia, p)
    return "body and joint 'neighbour'"


def mount(building: Building, location: str, variant: str, p: Parameters) -> str:
    """What carries the joint turns under its reaction; where it slides or turns about another axis, the levers are ours.

    A point of the arm at radius r moves by turn + slide/r times what MJCF's coaxial joint moves it.
    """
    if building.spec.joint("base") is not None:
        return ""  # one thing carries the joint
    inertia = building.inertia / p["modal_share"]
    joint = building.add_joint(building.spec.body("motor"), "base")
    joint.armature = inertia
    _spring(joint, inertia, p)
    turn, slide = _levers(building, variant, p)
    if (turn, slide) == (1.0, 0.0):
        return "joint 'base'"
    for name, gear in (("mount torque", turn - 1.0), ("mount force", slide)):
        push = building.spec.add_actuator(name=name, trntype=mujoco.mjtTrn.mjTRN_JOINT, target="base")
        push.gear[0] = gear
    building.law("mount-sensor", turn=turn, slide=slide)
    if "direction" in p:
        eccentricity = p.get("eccentricity", 0.0)
        building.law(
            "mount-posture",
            direction=p["direction"],
            eccentricity=eccentricity,
            reach=p["percussion_radius"],
            share=p["modal_share"],
        )
    return "joint 'base' and actuators 'mount torque', 'mount force'"


def _levers(building: Building, variant: str, p: Parameters) -> tuple[float, float]:
    if "direction" in p:
        eccentricity = p.get("eccentricity", 0.0)
        return eccentricity / (1.0 + eccentricity), p["percussion_radius"] / (1.0 + eccentricity)
    if variant == "sliding-mount":
        return 0.0, p["percussion_radius"]
    if variant == "carrier":
        both = building.percussion + p["offset"]
        return building.percussion / both, building.percussion * p["offset"] / both
    return 1.0, 0.0


def _on_the_arm(building: Building, name: str, inertia: float, p: Parameters) -> None:
    body = building.spec.body("arm").add_body(name=name)
    _weigh(building, body, inertia)
    building.taken += inertia
    _spring(building.add_joint(body, name), inertia, p)


def _weigh(building: Building, body: mujoco.MjsBody, inertia: float) -> None:
    body.mass, body.inertia = inertia if building.translational else 1e-9, [inertia, inertia, inertia]
    body.ipos, body.explicitinertial = [0.0, 0.0, 0.0], True


def _spring(joint: mujoco.MjsJoint, inertia: float, p: Parameters) -> None:
    omega = 2.0 * math.pi * p["frequency"]
    joint.stiffness[0] = inertia * omega**2
    joint.damping[0] = 2.0 * p["damping"] * omega * inertia
