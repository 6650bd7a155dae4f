"""Further modes, as bodies of the model: a bending arm, a mount that gives, a neighbouring joint; and a shaken floor."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET

import numpy as np

from jointscope.sim.concealed.engine import SHAKE, Real, Slot, T
from jointscope.sim.concealed.law import EVERY_DRAW, OPEN_DRAWS, InLoop, Install, Law, Moment, Setting, Values
from jointscope.sim.concealed.mjcf import find, number, words


def shaken(p: Real, x: Real, s: Real, f: Real) -> None:
    """Upward acceleration of the floor p[0] sin(2 pi p[1] t + p[2]), beating with depth p[3] at p[4] Hz, and a second line."""
    t = s[T]
    beat = 1.0 + p[3] * math.sin(2.0 * math.pi * p[4] * t)
    f[SHAKE] += p[0] * beat * math.sin(2.0 * math.pi * p[1] * t + p[2])
    f[SHAKE] += p[5] * math.sin(4.0 * math.pi * p[1] * t + 2.3 * p[2])


def split_arm(root: ET.Element, setting: Setting, share: float, hinges: list[tuple[float, float, float]]) -> None:
    """Give a ``share`` of the arm's mass and inertia to an outer body on hinges; hammer and sensor stay on the inner one.

    Args:
        root: The run's MJCF.
        setting: For the arm's numbers.
        share: Of the arm's inertia about the joint.
        hinges: Radius [m], stiffness [N m/rad] and damping [N m s/rad] of each hinge, innermost first.
    """
    arm = find(root, "body", "arm")
    inertial = arm.find("inertial")
    assert inertial is not None
    mass = number(inertial.get("mass"))
    centre = setting.rig.arm_com_radius
    own = np.array([float(word) for word in (inertial.get("diaginertia") or "").split()])
    inertial.set("mass", repr((1.0 - share) * mass))
    inertial.set("diaginertia", words(*((1.0 - share) * own)))
    parent, before = arm, 0.0
    for i, (radius, stiffness, damping) in enumerate(hinges):
        parent = ET.SubElement(parent, "body", name=f"link {i}", pos=words(radius - before, 0.0, 0.0))
        part = share / len(hinges)
        ET.SubElement(
            parent, "inertial", pos=words(centre - radius, 0.0, 0.0), mass=repr(part * mass),
            diaginertia=words(*(part * own)),
        )  # fmt: skip
        ET.SubElement(
            parent, "joint", name=f"link {i}", type="hinge", axis="0 -1 0", stiffness=repr(stiffness),
            damping=repr(damping),
        )  # fmt: skip
        before = radius


def under_the_rig(root: ET.Element, name: str, mass: float, inertia: float, joint: dict[str, str]) -> None:
    """Put a body with one joint between the rig and what it stands on."""
    motor = find(root, "body", "motor")
    ground = next(e for e in root.iter() if motor in list(e))  # the world, or another mount
    ground.remove(motor)
    body = ET.SubElement(ground, "body", name=name)
    ET.SubElement(body, "inertial", pos="0 0 0", mass=repr(mass), diaginertia=words(inertia, inertia, inertia))
    body.insert(0, ET.Element("joint", {"name": name, **joint}))
    body.append(motor)


def _link() -> list[Law]:
    def shape(setting: Setting, rng: np.random.Generator) -> dict[str, float]:
        low, high = max(55.0, 1.5 * setting.frequency), min(250.0, 0.35 * setting.daq_rate)
        return {
            "frequency": float(rng.uniform(low, high)),
            "share": 0.0,
            "damping": float(rng.uniform(0.005, 0.03)),
            "place": float(rng.uniform(0.15, 0.5)),
        }

    def numbers(values: Values, setting: Setting) -> tuple[float, float]:
        J = setting.rig.joint.load_inertia * values["share"]
        w = 2.0 * math.pi * values["frequency"]
        k = J * (1.0 - values["share"]) * w**2  # the two parts against each other
        return k, 2.0 * values["damping"] * k / w

    def coaxial(root: ET.Element, values: Values, setting: Setting, moment: Moment) -> None:
        split_arm(root, setting, values["share"], [(0.0, *numbers(values, setting))])

    def outboard(root: ET.Element, values: Values, setting: Setting, moment: Moment) -> None:
        k, c = numbers(values, setting)
        centre = setting.rig.arm_com_radius
        at = values["place"] * centre
        lever = ((centre - at) / centre) ** 2  # the outer part turns about its own hinge
        split_arm(root, setting, values["share"], [(at, k * lever, c * lever)])

    def law(name: str, departs: bool, install: Install) -> Law:
        return Law(
            effect="link-flexibility", location="load", law=name, departs=departs, main="frequency",
            strength="share", span=lambda setting: (0.003, 0.4), shape=shape,
            units={"frequency": "Hz", "share": "1"}, install=install, draws=OPEN_DRAWS if departs else EVERY_DRAW,
        )  # fmt: skip

    return [law("two-masses", False, coaxial), law("outboard-hinge", True, outboard)]


def _mount(values: Values, setting: Setting) -> tuple[float, float, float]:
    """Mass, stiffness and damping of a mount that slides across the arm, from its frequency and modal share."""
    rig = setting.rig
    moved = (rig.arm_mass * rig.arm_com_radius) ** 2 / (rig.joint.load_inertia * values["share"])
    mass = max(moved - rig.arm_mass, 0.05 * rig.arm_mass)
    w = 2.0 * math.pi * values["frequency"]
    return mass, (mass + rig.arm_mass) * w**2, 2.0 * values["damping"] * (mass + rig.arm_mass) * w


def _base() -> list[Law]:
    def shape(setting: Setting, rng: np.random.Generator) -> dict[str, float]:
        while True:
            frequency = float(rng.uniform(9.0, 65.0))
            if abs(frequency / setting.frequency - 1.0) > 0.15:
                break
        return {
            "frequency": frequency, "share": 0.0, "damping": float(rng.uniform(0.01, 0.05)),
            "depth": float(rng.uniform(0.3, 0.8)),
        }  # fmt: skip

    def slide(root: ET.Element, values: Values, setting: Setting, moment: Moment) -> None:
        mass, k, c = _mount(values, setting)
        sag = -setting.rig.gravity * (mass + setting.rig.arm_mass) / k
        joint = {
            "type": "slide",
            "axis": "0 0 1",
            "stiffness": repr(k),
            "damping": repr(c),
            "springref": repr(-sag),
        }
        under_the_rig(root, "mount", mass, 1e-3, joint)

    def rock(root: ET.Element, values: Values, setting: Setting, moment: Moment) -> None:
        rig = setting.rig
        J = rig.joint.load_inertia / values["share"] * 0.5
        w = 2.0 * math.pi * values["frequency"]
        turn = rig.gravity_torque(moment_angle(setting)) / (J * w**2)
        joint = {
            "type": "hinge", "axis": "0 -1 0", "pos": words(-values["depth"], 0.0, -values["depth"]),
            "stiffness": repr(J * w**2), "damping": repr(2.0 * values["damping"] * J * w), "springref": repr(-turn),
        }  # fmt: skip
        under_the_rig(root, "mount", J / (2.0 * values["depth"] ** 2), 1e-3, joint)

    def law(name: str, departs: bool, install: Install) -> Law:
        return Law(
            effect="base-compliance", location="base", law=name, departs=departs, main="frequency", strength="share",
            span=lambda setting: (5e-4, 0.3), shape=shape, units={"frequency": "Hz", "share": "1"}, install=install,
            draws=OPEN_DRAWS if departs else EVERY_DRAW,
        )  # fmt: skip

    return [law("sliding", False, slide), law("rocking", True, rock)]


def moment_angle(setting: Setting) -> float:
    """The posture in which the rest position of a mount is set [rad]."""
    return setting.angle


def _neighbour() -> list[Law]:
    def shape(setting: Setting, rng: np.random.Generator) -> dict[str, float]:
        while True:
            frequency = float(rng.uniform(14.0, 62.0))
            if abs(frequency / setting.frequency - 1.0) > 0.15:
                break
        return {
            "frequency": frequency, "share": 0.0, "damping": float(rng.uniform(0.015, 0.05)),
            "distance": float(rng.uniform(0.3, 1.0)), "slip": float(rng.uniform(0.0, 1.0)),
        }  # fmt: skip

    def install(root: ET.Element, values: Values, setting: Setting, moment: Moment) -> None:
        rig = setting.rig
        d, mr = values["distance"], rig.arm_mass * rig.arm_com_radius
        coupling = rig.joint.load_inertia + d * mr  # J_12 with the neighbour's axis behind the joint
        J = coupling**2 / (rig.joint.load_inertia * values["share"])
        w = 2.0 * math.pi * values["frequency"]
        turn = rig.gravity * (mr + rig.arm_mass * d) / (J * w**2)
        joint = {
            "type": "hinge", "axis": "0 -1 0", "pos": words(-d, 0.0, 0.0), "stiffness": repr(J * w**2),
            "damping": repr(2.0 * values["damping"] * J * w), "springref": repr(turn),
        }  # fmt: skip
        own = max(J - rig.joint.load_inertia - 2.0 * d * mr - rig.arm_mass * d**2, 0.05 * J)
        under_the_rig(root, "neighbour", own / d**2, 1e-3, joint)

    return [
        Law(
            effect="neighbour-flexibility", location="neighbour", law="parallel-axis", departs=False,
            main="frequency", strength="share", span=lambda setting: (1e-3, 0.4), shape=shape,
            units={"frequency": "Hz", "share": "1"}, install=install,
        )
    ]  # fmt: skip


def _vibration() -> list[Law]:
    def span(setting: Setting) -> tuple[float, float]:
        return 1e-4 * setting.acceleration, 0.05 * setting.acceleration

    def shape(setting: Setting, rng: np.random.Generator) -> dict[str, float]:
        return {
            "frequency": float(rng.choice([rng.uniform(23.0, 31.0), 50.0, rng.uniform(8.0, 90.0)])),
            "amplitude": 0.0, "seed": float(rng.integers(1, 10**6)), "depth": float(rng.uniform(0.2, 0.6)),
            "beat": float(rng.uniform(0.5, 2.0)), "second": float(rng.uniform(0.1, 0.4)),
        }  # fmt: skip

    def phase(values: Values, moment: Moment) -> float:
        return float(np.random.default_rng([int(values["seed"]), moment.index]).uniform(-np.pi, np.pi))

    def steady(values: Values, setting: Setting, moment: Moment) -> Slot:
        return Slot(shaken, (values["amplitude"], values["frequency"], phase(values, moment), 0.0, 1.0, 0.0))

    def beating(values: Values, setting: Setting, moment: Moment) -> Slot:
        return Slot(
            shaken,
            (values["amplitude"], values["frequency"], phase(values, moment), values["depth"], values["beat"],
             values["amplitude"] * values["second"]),
        )  # fmt: skip

    def law(name: str, departs: bool, loop: InLoop) -> Law:
        return Law(
            effect="external-vibration", location="base", law=name, departs=departs, main="frequency",
            strength="amplitude", span=span, shape=shape, units={"frequency": "Hz", "amplitude": "m/s^2"}, loop=loop,
            draws=OPEN_DRAWS if departs else EVERY_DRAW,
        )  # fmt: skip

    return [law("one-line", False, steady), law("beating", True, beating)]


LAWS: tuple[Law, ...] = (*_link(), *_base(), *_neighbour(), *_vibration())
