"""Between the logged torque and the rotor: ripple, lag, gain."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET

import numpy as np

from jointscope.sim.concealed.engine import MOTOR, Q_S, TAU, H, Real, Slot
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
from jointscope.sim.concealed.mjcf import section, words

DRIVES: frozenset[Kind] = frozenset({"torque-sweep", "speed-motion"})


def ripple(p: Real, x: Real, s: Real, f: Real) -> None:
    """(1 - p[2] + p[2] |tau|/p[1]) sum a_i sin(k_i n q_s + phi_i): p = n, scale, load share, count, ..."""
    load = 1.0 - p[2] + p[2] * abs(s[TAU]) / p[1]
    for i in range(int(p[3])):
        f[MOTOR] += load * p[4 + 3 * i] * math.sin(p[5 + 3 * i] * p[0] * s[Q_S] + p[6 + 3 * i])


def lag(p: Real, x: Real, s: Real, f: Real) -> None:
    """The rotor's torque follows the logged one by p[1] first-order stages of time constant p[0].

    Exact over a step in which a stage's input moves along a straight line.
    """
    if x[5] == 0.0:
        x[5], x[4] = 1.0, s[TAU]
        for i in range(int(p[1])):
            x[i] = s[TAU]
    keep = math.exp(-s[H] / p[0])
    before, seen = x[4], s[TAU]
    for i in range(int(p[1])):
        behind = p[0] * (seen - before) / s[H]
        then = x[i]
        x[i] = seen - behind + (then - before + behind) * keep
        before, seen = then, x[i]
    x[4] = s[TAU]
    f[MOTOR] += seen - s[TAU]


def gain(p: Real, x: Real, s: Real, f: Real) -> None:
    """The rotor's torque is p[0] (1 - p[1] (tau/p[2])^2) times the logged one."""
    f[MOTOR] += (p[0] * (1.0 - p[1] * (s[TAU] / p[2]) ** 2) - 1.0) * s[TAU]


def _ripple() -> list[Law]:
    def span(setting: Setting) -> tuple[float, float]:
        return 1e-4 * setting.drive_torque, 0.3 * setting.drive_torque

    def shape(setting: Setting, rng: np.random.Generator) -> dict[str, float]:
        return {
            "amplitude": 0.0, "order": float(rng.choice([1.0, 2.0, 6.0, 12.0])),
            "phase": float(rng.uniform(-np.pi, np.pi)), "load": float(rng.uniform(0.3, 0.9)),
            **{f"phase{i}": float(rng.uniform(-np.pi, np.pi)) for i in range(2, 10)},
        }  # fmt: skip

    def cogging(root: ET.Element, values: Values, setting: Setting, moment: Moment) -> None:
        if not moment.braked:
            ET.SubElement(
                section(root, "actuator"), "dcmotor", name="cogging", joint="motor", input="none", motorconst="0", resistance="1",
                cogging=words(
                    values["amplitude"], values["order"] * setting.rig.joint.reduction_ratio, values["phase"]
                ),
            )  # fmt: skip

    def current(values: Values, setting: Setting, moment: Moment) -> Slot:
        lines: list[float] = [values["amplitude"], values["order"], values["phase"]]
        for i in range(2, 6):
            lines += [values["amplitude"] * 0.5 / i, values["order"] * i, values[f"phase{i}"]]
        n, scale = setting.rig.joint.reduction_ratio, setting.drive_torque
        return Slot(ripple, (n, scale, values["load"], 5.0, *lines))

    def one(values: Values, setting: Setting, moment: Moment) -> Slot:
        n, scale = setting.rig.joint.reduction_ratio, setting.drive_torque
        return Slot(ripple, (n, scale, 0.0, 1.0, values["amplitude"], values["order"], values["phase"]))

    def law(name: str, departs: bool, install: Install | None, loop: InLoop | None) -> Law:
        return Law(
            effect="torque-ripple", location="motor", law=name, departs=departs, main="amplitude",
            strength="amplitude", span=span, shape=shape,
            units={"amplitude": "N m", "order": "per motor turn", "phase": "rad"},
            seen_in=frozenset({"speed-motion"}), travels=True, install=install, loop=loop,
            draws=OPEN_DRAWS if departs else EVERY_DRAW,
        )  # fmt: skip

    return [
        law("dcmotor-cogging", False, cogging, None),
        law("one-line", False, None, one),
        law("current-ripple", True, None, current),
    ]


def _lag() -> list[Law]:
    def shape(setting: Setting, rng: np.random.Generator) -> dict[str, float]:
        return {"time_constant": 0.0}

    def first(values: Values, setting: Setting, moment: Moment) -> Slot:
        return Slot(lag, (values["time_constant"], 1.0))

    def stages(values: Values, setting: Setting, moment: Moment) -> Slot:
        return Slot(lag, (values["time_constant"] / 3.0, 3.0))

    def law(name: str, departs: bool, loop: InLoop) -> Law:
        return Law(
            effect="drive-lag", location="motor", law=name, departs=departs, main="time_constant",
            strength="time_constant", span=lambda setting: (3e-5, 4e-3), shape=shape, units={"time_constant": "s"},
            seen_in=DRIVES, loop=loop, draws=OPEN_DRAWS if departs else EVERY_DRAW,
        )  # fmt: skip

    return [law("first-order", False, first), law("three-stages", True, stages)]


def _gain() -> list[Law]:
    def shape(setting: Setting, rng: np.random.Generator) -> dict[str, float]:
        return {"excess": 0.0, "sign": float(rng.choice([-1.0, 1.0])), "bend": float(rng.uniform(0.02, 0.1))}

    def reported(values: Values, setting: Setting) -> dict[str, float]:
        return {"gain": 1.0 + values["sign"] * values["excess"]}

    def flat(values: Values, setting: Setting, moment: Moment) -> Slot:
        return Slot(gain, (1.0 + values["sign"] * values["excess"], 0.0, setting.drive_torque))

    def bent(values: Values, setting: Setting, moment: Moment) -> Slot:
        return Slot(
            gain,
            (1.0 + values["sign"] * values["excess"], values["bend"] * values["excess"], setting.drive_torque),
        )

    def law(name: str, departs: bool, loop: InLoop) -> Law:
        return Law(
            effect="torque-gain", location="motor", law=name, departs=departs, main="gain", strength="excess",
            span=lambda setting: (0.003, 0.2), shape=shape, units={"gain": "1"}, report=reported, seen_in=DRIVES, loop=loop,
            draws=OPEN_DRAWS if departs else EVERY_DRAW,
        )  # fmt: skip

    return [law("constant", False, flat), law("saturating", True, bent)]


LAWS: tuple[Law, ...] = (*_ripple(), *_lag(), *_gain())
