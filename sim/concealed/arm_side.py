"""On the arm: gravity the model lacks, a payload that comes and goes, a stop that is touched."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET

import numpy as np

from jointscope.sim.concealed.engine import LOAD, Q, Real, Slot, W
from jointscope.sim.concealed.law import (
    EVERY_DRAW,
    OPEN_DRAWS,
    InLoop,
    Install,
    Kind,
    Law,
    Moment,
    Setting,
    Values,
)
from jointscope.sim.concealed.mjcf import find, words


def weight(p: Real, x: Real, s: Real, f: Real) -> None:
    """-p[0] cos(q + p[1]) - p[2] sin(q/2): an offset weight, and a balancer's spring."""
    f[LOAD] -= p[0] * math.cos(s[Q] + p[1]) + p[2] * math.sin(0.5 * s[Q])


def stop(p: Real, x: Real, s: Real, f: Real) -> None:
    """One-sided contact k d^e (1 + a d') beyond p[0] on side p[1]: p[2] k, p[3] e, p[4] a."""
    depth = (s[Q] - p[0]) * p[1]
    if depth > 0.0:
        push = p[2] * depth ** p[3] * (1.0 + p[4] * s[W] * p[1])
        if push > 0.0:
            f[LOAD] -= push * p[1]


def _gravity() -> list[Law]:
    def span(setting: Setting) -> tuple[float, float]:
        rig = setting.rig
        whole = rig.arm_mass * 9.81 * rig.arm_com_radius
        return 0.003 * whole, 0.3 * whole

    def shape(setting: Setting, rng: np.random.Generator) -> dict[str, float]:
        return {
            "moment": 0.0,
            "sign": float(rng.choice([-1.0, 1.0])),
            "turn": float(rng.uniform(0.1, 0.4) * rng.choice([-1.0, 1.0])),
            "balancer": float(rng.uniform(0.1, 0.4)),
        }

    def reported(values: Values, setting: Setting) -> dict[str, float]:
        return {"moment": values["sign"] * values["moment"]}

    def plain(values: Values, setting: Setting, moment: Moment) -> Slot:
        return Slot(weight, (values["sign"] * values["moment"], 0.0, 0.0))

    def turned(values: Values, setting: Setting, moment: Moment) -> Slot:
        size = values["sign"] * values["moment"]
        return Slot(weight, (size, values["turn"], size * values["balancer"]))

    def law(name: str, departs: bool, loop: InLoop) -> Law:
        return Law(
            effect="gravity", location="load", law=name, departs=departs, main="moment", strength="moment",
            span=span, shape=shape, units={"moment": "N m"}, report=reported, seen_in=frozenset({"torque-sweep", "speed-motion"}),
            loop=loop, draws=OPEN_DRAWS if departs else EVERY_DRAW,
        )  # fmt: skip

    return [law("cosine", False, plain), law("offset-with-balancer", True, turned)]


def _payload() -> list[Law]:
    def span(setting: Setting) -> tuple[float, float]:
        return 0.001 * setting.rig.joint.load_inertia, 0.4 * setting.rig.joint.load_inertia

    def shape(setting: Setting, rng: np.random.Generator) -> dict[str, float]:
        return {
            "inertia": 0.0,
            "pattern": float(rng.integers(1, 2**30)),
            "place": float(rng.uniform(0.7, 1.0)),
            "mount": float(rng.uniform(120.0, 220.0)),
        }

    def loaded(values: Values, moment: Moment) -> bool:
        if moment.index < 2:  # both states are seen, whatever the pattern
            return bool(moment.index ^ (int(values["pattern"]) & 1))
        return bool(int(values["pattern"]) >> (moment.index % 29) & 1)

    def add(root: ET.Element, values: Values, setting: Setting, moment: Moment, *, soft: bool) -> None:
        if not loaded(values, moment):
            return
        radius = values["place"] * setting.rig.accelerometer_radius
        mass = values["inertia"] / radius**2
        body = ET.SubElement(find(root, "body", "arm"), "body", name="payload", pos=words(radius, 0.0, 0.0))
        tiny = words(*(3 * [1e-6 * values["inertia"]]))
        ET.SubElement(body, "inertial", pos="0 0 0", mass=repr(mass), diaginertia=tiny)
        if soft:
            w = 2.0 * math.pi * values["mount"]
            ET.SubElement(
                body, "joint", name="payload mount", type="slide", axis="0 0 1", stiffness=repr(mass * w**2),
                damping=repr(0.04 * mass * w),
            )  # fmt: skip

    def rigid(root: ET.Element, values: Values, setting: Setting, moment: Moment) -> None:
        add(root, values, setting, moment, soft=False)

    def springy(root: ET.Element, values: Values, setting: Setting, moment: Moment) -> None:
        add(root, values, setting, moment, soft=True)

    def law(name: str, departs: bool, install: Install) -> Law:
        return Law(
            effect="payload", location="load", law=name, departs=departs, main="inertia", strength="inertia",
            span=span, shape=shape, units={"inertia": "kg m^2"}, install=install,
            draws=OPEN_DRAWS if departs else EVERY_DRAW,
        )  # fmt: skip

    return [law("rigid", False, rigid), law("springy", True, springy)]


def _end_stop() -> list[Law]:
    still: frozenset[Kind] = frozenset({"hammer", "torque-sweep"})

    def span(setting: Setting) -> tuple[float, float]:
        return 0.002 * setting.rig.joint.stiffness, 1.0 * setting.rig.joint.stiffness

    def shape(setting: Setting, rng: np.random.Generator) -> dict[str, float]:
        if setting.moves:  # at the far end of the travel
            return {"angle": setting.travel * float(rng.uniform(0.96, 0.995)), "side": 1.0,
                    "stiffness": 0.0, "absorb": float(rng.uniform(0.5, 3.0))}  # fmt: skip
        side = float(rng.choice([-1.0, 1.0]))
        reach = setting.windup * float(rng.uniform(0.1, 0.6))
        return {"angle": setting.angle + side * reach, "side": side, "stiffness": 0.0,
                "absorb": float(rng.uniform(0.5, 3.0))}  # fmt: skip

    def linear(values: Values, setting: Setting, moment: Moment) -> Slot:
        return Slot(stop, (values["angle"], values["side"], values["stiffness"], 1.0, 0.0))

    def hertz(values: Values, setting: Setting, moment: Moment) -> Slot:
        depth = setting.windup if not setting.moves else 0.01 * setting.travel
        k = values["stiffness"] / math.sqrt(depth)
        return Slot(stop, (values["angle"], values["side"], k, 1.5, values["absorb"]))

    def law(name: str, departs: bool, loop: InLoop) -> Law:
        return Law(
            effect="end-stop", location="load", law=name, departs=departs, main="angle", strength="stiffness",
            span=span, shape=shape, units={"angle": "rad", "stiffness": "N m/rad"}, loop=loop,
            seen_in=still | {"speed-motion"}, draws=OPEN_DRAWS if departs else EVERY_DRAW,
        )  # fmt: skip

    return [law("linear", False, linear), law("hunt-crossley", True, hertz)]


LAWS: tuple[Law, ...] = (*_gravity(), *_payload(), *_end_stop())
