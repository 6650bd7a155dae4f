"""Physics that no catalogue lists, for development and calibration draws; the test draw has other families.

The right answer to each is "unknown", at the place where it sits.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Callable

import numpy as np

from jointscope.sim.concealed.engine import LOAD, MOTOR, PICKUP, Q0, Q_S, TAU, W_S, H, Q, Real, Slot, W
from jointscope.sim.concealed.law import OPEN_DRAWS, InLoop, Install, Kind, Law, Moment, Setting, Values
from jointscope.sim.concealed.mjcf import find

HITS: frozenset[Kind] = frozenset({"hammer"})
DRIVES: frozenset[Kind] = frozenset({"torque-sweep", "speed-motion"})
ANY = HITS | DRIVES


def slipping_brake(p: Real, x: Real, s: Real, f: Real) -> None:
    """A stiff brake p[0], damped by p[1], that slips at p[2] about the angle p[3]; it holds braked runs only."""
    torque = p[0] * (s[Q_S] - p[3] - x[0]) + p[1] * s[W_S]
    if torque > p[2]:
        x[0] += (torque - p[2]) / p[0]
        torque = p[2]
    elif torque < -p[2]:
        x[0] += (torque + p[2]) / p[0]
        torque = -p[2]
    f[MOTOR] -= torque


def cable(p: Real, x: Real, s: Real, f: Real) -> None:
    """A cable loop that remembers where it was: p[0] elements in the arm's angle, stiffness and slip torque each."""
    for i in range(int(p[0])):
        k, limit = p[1 + 2 * i], p[2 + 2 * i]
        torque = k * (s[Q] - s[Q0] - x[i])
        if torque > limit:
            x[i] = s[Q] - s[Q0] - limit / k
            torque = limit
        elif torque < -limit:
            x[i] = s[Q] - s[Q0] + limit / k
            torque = -limit
        f[LOAD] -= torque


def pickup(p: Real, x: Real, s: Real, f: Real) -> None:
    """The accelerometer's cable picks up p[0] times the rate of the motor's torque, behind p[1] s of lag."""
    if x[2] == 0.0:
        x[2], x[0] = 1.0, s[TAU]
    old = x[0]
    x[0] += (s[TAU] - x[0]) * (1.0 - math.exp(-s[H] / p[1]))
    f[PICKUP] += p[0] * (x[0] - old) / s[H]


def rattle(p: Real, x: Real, s: Real, f: Real) -> None:
    """A loose mass in a box on the arm: inertia p[0], play +-p[1], contact p[2] and p[3]; x = angle, speed, started."""
    if x[2] == 0.0:
        x[2], x[0], x[1] = 1.0, s[Q], 0.0
    d, v = s[Q] - x[0], s[W] - x[1]
    torque = -p[4] * v
    if d > p[1]:
        torque -= p[2] * (d - p[1]) + p[3] * v
    elif d < -p[1]:
        torque -= p[2] * (d + p[1]) + p[3] * v
    x[1] -= s[H] * torque / p[0]
    x[0] += s[H] * x[1]
    f[LOAD] += torque


def loose_bolt(p: Real, x: Real, s: Real, f: Real) -> None:
    """An outer mass on a one-sided joint: p[0] inertia, p[1] and p[2] stiffness closed and open, p[3] damping."""
    if x[2] == 0.0:
        x[2], x[0], x[1] = 1.0, s[Q], s[W]
    d, v = x[0] - s[Q], x[1] - s[W]
    k = p[1] if d > 0.0 else p[2]
    torque = k * d + p[3] * v
    x[1] -= s[H] * torque / p[0]
    x[0] += s[H] * x[1]
    f[LOAD] += torque


def _law(
    effect: str, location: str, strength: str, unit: str, span: Callable[[Setting], tuple[float, float]],
    shape: Callable[[Setting, np.random.Generator], dict[str, float]], loop: InLoop,
    *, seen_in: frozenset[Kind] = ANY, keeps_motor: bool = False, travels: bool = False,
    install: Install | None = None,
) -> Law:  # fmt: skip
    return Law(
        effect=effect, location=location, law=effect, departs=True, main=strength, strength=strength, span=span,
        shape=shape, units={strength: unit}, seen_in=seen_in, keeps_motor=keeps_motor, travels=travels, loop=loop,
        install=install, draws=OPEN_DRAWS,
    )  # fmt: skip


def _brake_slip() -> Law:
    def span(setting: Setting) -> tuple[float, float]:
        return 1.05, 0.3

    def shape(setting: Setting, rng: np.random.Generator) -> dict[str, float]:
        return {"grip": 0.0, "stiff": float(rng.uniform(30.0, 80.0))}

    def loop(values: Values, setting: Setting, moment: Moment) -> Slot:
        rig = setting.rig
        K = values["stiff"] * rig.joint.stiffness
        c = 0.3 * math.sqrt(K * rig.joint.reflected_inertia) if moment.braked else 0.0
        grip = values["grip"] * setting.torque + abs(rig.gravity_torque(setting.angle))
        angle = setting.angle - rig.gravity_torque(setting.angle) / rig.joint.stiffness
        return Slot(slipping_brake, (K if moment.braked else 1e-9, c, grip if moment.braked else 1e-12, angle))

    return _law("brake-slip", "motor", "grip", "of the largest torque", span, shape, loop, seen_in=HITS,
                keeps_motor=True)  # fmt: skip


def _cable_drag() -> Law:
    def span(setting: Setting) -> tuple[float, float]:
        return 0.002 * setting.torque, 0.25 * setting.torque

    def shape(setting: Setting, rng: np.random.Generator) -> dict[str, float]:
        return {"torque": 0.0, "reach": float(max(setting.travel, setting.windup) * rng.uniform(0.1, 0.4))}

    def loop(values: Values, setting: Setting, moment: Moment) -> Slot:
        pairs: list[float] = []
        for share, reach in ((0.4, 0.3), (0.35, 1.0), (0.25, 3.0)):
            limit = share * values["torque"]
            pairs += [limit / (reach * values["reach"]), limit]
        return Slot(cable, (3.0, *pairs))

    return _law("cable-drag", "load", "torque", "N m", span, shape, loop)


def _pickup() -> Law:
    def span(setting: Setting) -> tuple[float, float]:
        rate = setting.drive_torque * 2.0 * math.pi * 40.0
        return 1e-4 * setting.acceleration / rate, 0.3 * setting.acceleration / rate

    def shape(setting: Setting, rng: np.random.Generator) -> dict[str, float]:
        return {"coupling": 0.0, "lag": float(rng.uniform(0.001, 0.004))}

    def loop(values: Values, setting: Setting, moment: Moment) -> Slot:
        return Slot(pickup, (values["coupling"], values["lag"]))

    return _law(
        "electrical-pickup", "acquisition", "coupling", "m/s^2 per N m/s", span, shape, loop, seen_in=DRIVES
    )


def _rattle() -> Law:
    def span(setting: Setting) -> tuple[float, float]:
        return 0.001 * setting.rig.joint.load_inertia, 0.15 * setting.rig.joint.load_inertia

    def shape(setting: Setting, rng: np.random.Generator) -> dict[str, float]:
        return {"inertia": 0.0, "play": float(setting.windup * rng.uniform(0.05, 0.5))}

    def loop(values: Values, setting: Setting, moment: Moment) -> Slot:
        J = values["inertia"]
        k = J * (2.0 * math.pi * 180.0) ** 2
        return Slot(rattle, (J, values["play"], k, 0.2 * math.sqrt(k * J), 0.02 * math.sqrt(k * J)))

    return _law("rattling-mass", "load", "inertia", "kg m^2", span, shape, loop)


def _bolt() -> Law:
    def span(setting: Setting) -> tuple[float, float]:
        return 0.003, 0.3

    def shape(setting: Setting, rng: np.random.Generator) -> dict[str, float]:
        return {
            "share": 0.0, "frequency": float(rng.uniform(1.7, 2.6) * setting.frequency),
            "open": float(rng.uniform(0.25, 0.6)),
        }  # fmt: skip

    def install(root: ET.Element, values: Values, setting: Setting, moment: Moment) -> None:
        # the outer part's inertia leaves the rigid arm; its weight stays, as the arm is level with it at rest
        inertial = find(root, "body", "arm").find("inertial")
        assert inertial is not None
        own = np.array([float(word) for word in (inertial.get("diaginertia") or "").split()])
        left = own - min(values["share"] * setting.rig.joint.load_inertia, 0.95 * own[1])
        inertial.set("diaginertia", " ".join(repr(float(max(v, 1e-6))) for v in (0.2 * left[1], left[1], left[1])))

    def loop(values: Values, setting: Setting, moment: Moment) -> Slot:
        J = min(values["share"] * setting.rig.joint.load_inertia, 0.2 * setting.rig.joint.load_inertia)
        k = J * (2.0 * math.pi * values["frequency"]) ** 2
        return Slot(loose_bolt, (J, k, values["open"] * k, 0.04 * math.sqrt(k * J)))

    return _law("loose-bolt", "load", "share", "1", span, shape, loop, install=install)


LAWS: tuple[Law, ...] = (_brake_slip(), _cable_drag(), _pickup(), _rattle(), _bolt())
