"""What the reducer may do beside K and c: play, a bent characteristic, loops, loss without viscosity, drift, error."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET

import numpy as np

from jointscope.sim.concealed.engine import (
    Q_S,
    SESSION,
    TRANSMISSION,
    W_S,
    WINDUP,
    WINDUP_RATE,
    H,
    Q,
    Real,
    Slot,
    T,
    W,
)
from jointscope.sim.concealed.law import EVERY_DRAW, OPEN_DRAWS, InLoop, Install, Law, Moment, Setting, Values
from jointscope.sim.concealed.mjcf import find, section, words


def dead_zone(p: Real, x: Real, s: Real, f: Real) -> None:
    """A spring with play: p = K, c, half the gap, stiffness left inside it; damping acts in contact only."""
    d, v = s[WINDUP], s[WINDUP_RATE]
    if d > p[2]:
        f[TRANSMISSION] += p[0] * (d - p[2]) + p[3] * p[2] + p[1] * v
    elif d < -p[2]:
        f[TRANSMISSION] += p[0] * (d + p[2]) - p[3] * p[2] + p[1] * v
    else:
        f[TRANSMISSION] += p[3] * d + 0.1 * p[1] * v


def two_slopes(p: Real, x: Real, s: Real, f: Real) -> None:
    """Added to K: p[0] of the slope is missing within +-p[1], the corner rounded over p[2]."""
    d = s[WINDUP]
    f[TRANSMISSION] -= (
        p[0] * p[2] * 0.5 * (math.log(math.cosh((d + p[1]) / p[2])) - math.log(math.cosh((d - p[1]) / p[2])))
    )


def bouc_wen(p: Real, x: Real, s: Real, f: Real) -> None:
    """T_h z, z' = (v/D)(1 - (b + g sgn(v z))|z|^n): p = T_h, D, b, n; b + g = 1."""
    v, h = s[WINDUP_RATE], s[H]
    z = x[0]
    sign = 1.0 if v * z > 0.0 else -1.0
    z += h * v / p[1] * (1.0 - (p[2] * sign + 1.0 - p[2]) * abs(z) ** p[3])
    x[0] = max(-1.0, min(1.0, z))
    f[TRANSMISSION] += p[0] * x[0]


def slip_elements(p: Real, x: Real, s: Real, f: Real) -> None:
    """p[0] elements: stiffness p[2+2i], slip torque p[3+2i]; beyond slip each attracts its torque at rate p[1]."""
    d = s[WINDUP]
    for i in range(int(p[0])):
        k, limit = p[2 + 2 * i], p[3 + 2 * i]
        torque = k * (d - x[i])
        if torque > limit:
            x[i] = d - limit / k
            torque = limit * (1.0 + p[1] * math.tanh(s[WINDUP_RATE]))
        elif torque < -limit:
            x[i] = d + limit / k
            torque = -limit * (1.0 - p[1] * math.tanh(s[WINDUP_RATE]))
        f[TRANSMISSION] += torque


def relaxation(p: Real, x: Real, s: Real, f: Real) -> None:
    """p[0] Maxwell elements: stiffness p[1+2i], relaxation time p[2+2i]; x holds each spring's stretch."""
    h, v = s[H], s[WINDUP_RATE]
    for i in range(int(p[0])):
        fade = math.exp(-h / p[2 + 2 * i])
        x[i] = x[i] * fade + v * p[2 + 2 * i] * (1.0 - fade)
        f[TRANSMISSION] += p[1 + 2 * i] * x[i]


def drifting(p: Real, x: Real, s: Real, f: Real) -> None:
    """K p[0] (p[1] t + p[2] (1 - exp(-session/p[3])) + p[4]) added to the spring."""
    share = p[1] * max(s[T], 0.0) + p[4]
    if p[2] != 0.0:
        share += p[2] * (1.0 - math.exp(-max(s[SESSION], 0.0) / p[3]))
    f[TRANSMISSION] += p[0] * share * s[WINDUP]


def kinematic_error(p: Real, x: Real, s: Real, f: Real) -> None:
    """K e + c e', e = sum a_i sin(k_i angle + phi_i): p = K, c, turns per rad, from the output (1) or not, count, ..."""
    if p[3] > 0.5:
        angle, speed = s[Q], s[W]
    else:
        angle, speed = s[Q_S], s[W_S]
    e, rate = 0.0, 0.0
    for i in range(int(p[4])):
        a, k, phase = p[5 + 3 * i], p[6 + 3 * i] * p[2], p[7 + 3 * i]
        e += a * math.sin(k * angle + phase)
        rate += a * k * speed * math.cos(k * angle + phase)
    f[TRANSMISSION] += p[0] * e + p[1] * rate


def without_spring(root: ET.Element, values: Values, setting: Setting, moment: Moment) -> None:
    """The law in the loop is the whole transmission."""
    reducer = find(root, "joint", "reducer")
    reducer.set("stiffness", "0")
    reducer.set("damping", "0")


def _backlash() -> list[Law]:
    def span(setting: Setting) -> tuple[float, float]:
        return 0.01 * setting.windup, 0.8 * setting.windup

    def shape(setting: Setting, rng: np.random.Generator) -> dict[str, float]:
        return {"gap": 0.0, "inside": float(rng.uniform(0.02, 0.08))}

    def hard(values: Values, setting: Setting, moment: Moment) -> Slot:
        joint = setting.rig.joint
        return Slot(dead_zone, (joint.stiffness, joint.damping, 0.5 * values["gap"], 0.0))

    def dragging(values: Values, setting: Setting, moment: Moment) -> Slot:
        joint = setting.rig.joint
        return Slot(
            dead_zone, (joint.stiffness, joint.damping, 0.5 * values["gap"], values["inside"] * joint.stiffness)
        )

    def tendon(root: ET.Element, values: Values, setting: Setting, moment: Moment) -> None:
        find(root, "joint", "reducer").set("stiffness", "0")
        half = 0.5 * values["gap"]
        mesh = ET.SubElement(
            section(root, "tendon"), "fixed", name="mesh", stiffness=repr(setting.rig.joint.stiffness),
            springlength=words(-half, half),
        )  # fmt: skip
        ET.SubElement(mesh, "joint", joint="reducer", coef="1")

    def law(name: str, departs: bool, install: Install, loop: InLoop | None) -> Law:
        return Law(
            effect="backlash", location="transmission", law=name, departs=departs, main="gap", strength="gap",
            span=span, shape=shape, units={"gap": "rad"}, install=install, loop=loop,
            draws=OPEN_DRAWS if departs else EVERY_DRAW,
        )  # fmt: skip

    return [
        law("dead-band-tendon", False, tendon, None),
        law("dead-zone", False, without_spring, hard),
        law("dragging-gap", True, without_spring, dragging),
    ]


def _stiffness() -> list[Law]:
    def cubic_shape(setting: Setting, rng: np.random.Generator) -> dict[str, float]:
        return {"share": 0.0, "sign": float(rng.choice([1.0, 1.0, -1.0]))}

    def cubic(root: ET.Element, values: Values, setting: Setting, moment: Moment) -> None:
        K = setting.rig.joint.stiffness
        k3 = values["sign"] * values["share"] * K / setting.windup**2
        find(root, "joint", "reducer").set("stiffness", words(K, 0.0, k3))

    def reported(values: Values, setting: Setting) -> dict[str, float]:
        return {"cubic": values["sign"] * values["share"] * setting.rig.joint.stiffness / setting.windup**2}

    def soft_shape(setting: Setting, rng: np.random.Generator) -> dict[str, float]:
        knee = float(setting.windup * rng.uniform(0.15, 0.6))
        return {"share": 0.0, "knee": knee, "round": knee * float(rng.uniform(0.1, 0.4))}

    def soft(values: Values, setting: Setting, moment: Moment) -> Slot:
        return Slot(two_slopes, (values["share"] * setting.rig.joint.stiffness, values["knee"], values["round"]))

    return [
        Law(
            effect="stiffness-nonlinearity", location="transmission",
            law="cubic", departs=False, main="cubic", strength="share", units={"cubic": "N m/rad^3"}, report=reported,
            span=lambda setting: (0.002, 0.25), shape=cubic_shape, install=cubic,
        ),
        Law(
            effect="stiffness-nonlinearity", location="transmission",
            law="soft-below-knee", departs=True, main="share", strength="share",
            units={"share": "1", "knee": "rad"}, span=lambda setting: (0.01, 0.6), shape=soft_shape, loop=soft,
            draws=OPEN_DRAWS,
        ),
    ]  # fmt: skip


def _hysteresis() -> list[Law]:
    def span(setting: Setting) -> tuple[float, float]:
        return 0.002 * setting.torque, 0.15 * setting.torque

    def shape(setting: Setting, rng: np.random.Generator) -> dict[str, float]:
        return {
            "torque": 0.0,
            "yield": float(setting.windup * 10.0 ** rng.uniform(-1.2, -0.3)),
            "shape": float(rng.uniform(0.4, 0.7)),
            "exponent": float(rng.uniform(1.0, 2.0)),
            "rate": float(rng.uniform(0.0, 0.1)),
        }

    def smooth(values: Values, setting: Setting, moment: Moment) -> Slot:
        return Slot(bouc_wen, (values["torque"], values["yield"], values["shape"], values["exponent"]))

    def tendons(root: ET.Element, values: Values, setting: Setting, moment: Moment) -> None:
        for i, (share, reach) in enumerate(((0.5, 0.5), (0.3, 1.0), (0.2, 2.0))):
            limit = values["yield"] * reach
            element = ET.SubElement(
                section(root, "tendon"), "fixed", name=f"slip {i}", stiffness=repr(share * values["torque"] / limit),
                springlength="0", springyield=repr(limit),
            )  # fmt: skip
            ET.SubElement(element, "joint", joint="reducer", coef="1")

    def generalised(values: Values, setting: Setting, moment: Moment) -> Slot:
        reaches = np.geomspace(0.2, 4.0, 6)
        shares = np.exp(-0.5 * np.log(reaches) ** 2)
        shares /= shares.sum()
        pairs: list[float] = []
        for share, reach in zip(shares, reaches, strict=True):
            pairs += [share * values["torque"] / (reach * values["yield"]), share * values["torque"]]
        return Slot(slip_elements, (6.0, values["rate"], *pairs))

    def law(name: str, departs: bool, install: Install | None, loop: InLoop | None) -> Law:
        return Law(
            effect="hysteresis", location="transmission", law=name, departs=departs, main="torque", strength="torque",
            span=span, shape=shape, units={"torque": "N m"}, install=install, loop=loop,
            draws=OPEN_DRAWS if departs else EVERY_DRAW,
        )  # fmt: skip

    return [
        law("bouc-wen", False, None, smooth),
        law("springyield-tendons", False, tendons, None),
        law("generalised-maxwell-slip", True, None, generalised),
    ]


def maxwell_ladder(loss: float, stiffness: float, slope: float, centre: float) -> tuple[float, ...]:
    """Elements whose joint loss modulus is ``loss * stiffness * (f/centre)^slope`` from 1 to 600 Hz.

    Returns:
        Count, then stiffness [N m/rad] and relaxation time [s] of each.
    """
    frequencies = np.geomspace(0.05, 12000.0, 16)
    step = np.log(frequencies[1] / frequencies[0])
    k = loss * stiffness * (2.0 / np.pi) * step * (frequencies / centre) ** slope * np.cos(0.5 * np.pi * slope)
    pairs: list[float] = []
    for stiff, frequency in zip(k, frequencies, strict=True):
        pairs += [float(stiff), float(1.0 / (2.0 * np.pi * frequency))]
    return (float(frequencies.size), *pairs)


def _structural() -> list[Law]:
    def shape(setting: Setting, rng: np.random.Generator) -> dict[str, float]:
        return {"loss_factor": 0.0, "slope": float(rng.choice([-1.0, 1.0]) * rng.uniform(0.1, 0.25))}

    def install(root: ET.Element, values: Values, setting: Setting, moment: Moment) -> None:
        joint = setting.rig.joint
        at = 2.0 * math.pi * setting.frequency
        left = max(joint.damping - values["loss_factor"] * joint.stiffness / at, 0.02 * joint.damping)
        find(root, "joint", "reducer").set("damping", words(left))

    def flat(values: Values, setting: Setting, moment: Moment) -> Slot:
        ladder = maxwell_ladder(values["loss_factor"], setting.rig.joint.stiffness, 0.0, setting.frequency)
        return Slot(relaxation, ladder)

    def sloped(values: Values, setting: Setting, moment: Moment) -> Slot:
        ladder = maxwell_ladder(
            values["loss_factor"], setting.rig.joint.stiffness, values["slope"], setting.frequency
        )
        return Slot(relaxation, ladder)

    def law(name: str, departs: bool, loop: InLoop) -> Law:
        return Law(
            effect="structural-damping", location="transmission", law=name, departs=departs, main="loss_factor",
            strength="loss_factor", span=lambda setting: (0.004, 0.12), shape=shape, units={"loss_factor": "1"},
            install=install, loop=loop, draws=OPEN_DRAWS if departs else EVERY_DRAW,
        )  # fmt: skip

    return [law("constant-loss", False, flat), law("sloping-loss", True, sloped)]


def _drift() -> list[Law]:
    def shape(setting: Setting, rng: np.random.Generator) -> dict[str, float]:
        return {"rate": 0.0, "sign": float(rng.choice([-1.0, -1.0, 1.0])), "warm": float(rng.uniform(0.3, 1.0))}

    def per_run(values: Values, setting: Setting, moment: Moment) -> Slot:
        share = values["sign"] * values["rate"] * moment.index
        return Slot(drifting, (setting.rig.joint.stiffness, 0.0, 0.0, 1.0, share))

    def per_second(values: Values, setting: Setting, moment: Moment) -> Slot:
        return Slot(drifting, (setting.rig.joint.stiffness, values["sign"] * values["rate"], 0.0, 1.0, 0.0))

    def warming(values: Values, setting: Setting, moment: Moment) -> Slot:
        whole = values["sign"] * values["rate"] * setting.runs
        session = setting.runs * 30.0 * values["warm"]
        return Slot(drifting, (setting.rig.joint.stiffness, 0.0, whole, session, 0.0))

    def reported(values: Values, setting: Setting) -> dict[str, float]:
        return {"rate": values["sign"] * values["rate"]}

    def law(name: str, departs: bool, loop: InLoop, unit: str, span: tuple[float, float]) -> Law:
        return Law(
            effect="stiffness-drift", location="transmission", law=name, departs=departs, main="rate",
            strength="rate", span=lambda setting: span, shape=shape, units={"rate": unit}, report=reported, loop=loop,
            draws=OPEN_DRAWS if departs else EVERY_DRAW,
        )  # fmt: skip

    return [
        law("linear-per-run", False, per_run, "per run", (2e-5, 6e-3)),
        law("linear-in-run", False, per_second, "per s", (2e-4, 6e-2)),
        law("warming", True, warming, "per run", (4e-5, 8e-3)),
    ]


def _error() -> list[Law]:
    def shape(setting: Setting, rng: np.random.Generator) -> dict[str, float]:
        output = rng.random() < 0.4
        order = float(rng.choice([39.0, 40.0, 78.0])) if output else float(rng.choice([1.0, 2.0]))
        return {
            "amplitude": 0.0, "order": order, "phase": float(rng.uniform(-np.pi, np.pi)), "per_output": float(output),
            **{f"phase{i}": float(rng.uniform(-np.pi, np.pi)) for i in range(2, 10)},
        }  # fmt: skip

    def pack(values: Values, setting: Setting, lines: list[tuple[float, float, float]]) -> Slot:
        joint = setting.rig.joint
        turns = 1.0 if values["per_output"] else joint.reduction_ratio
        flat = [number for line in lines for number in line]
        return Slot(
            kinematic_error,
            (joint.stiffness, joint.damping, turns, values["per_output"], float(len(lines)), *flat),
        )

    def one(values: Values, setting: Setting, moment: Moment) -> Slot:
        return pack(values, setting, [(values["amplitude"], values["order"], values["phase"])])

    def nine(values: Values, setting: Setting, moment: Moment) -> Slot:
        lines = [(values["amplitude"], values["order"], values["phase"])]
        lines += [(values["amplitude"] * 0.6 / i, values["order"] * i, values[f"phase{i}"]) for i in range(2, 10)]
        return pack(values, setting, lines)

    def law(name: str, departs: bool, loop: InLoop) -> Law:
        return Law(
            effect="transmission-error", location="transmission", law=name, departs=departs, main="amplitude",
            strength="amplitude", span=lambda setting: (1e-7, 3e-4), shape=shape,
            units={"amplitude": "rad", "order": "per turn", "phase": "rad"}, seen_in=frozenset({"speed-motion"}),
            travels=True, loop=loop, draws=OPEN_DRAWS if departs else EVERY_DRAW,
        )  # fmt: skip

    return [law("one-line", False, one), law("nine-harmonics", True, nine)]


LAWS: tuple[Law, ...] = (
    *_backlash(), *_stiffness(), *_hysteresis(), *_structural(), *_drift(), *_error(),
)  # fmt: skip
