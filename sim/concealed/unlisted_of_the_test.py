"""Physics that no catalogue lists, for the test draw alone; the open draws have other families."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from jointscope.sim.concealed.engine import (
    LOAD,
    MOTOR,
    Q_S,
    TAU,
    TRANSMISSION,
    W_S,
    WINDUP,
    WINDUP_RATE,
    H,
    Q,
    Real,
    Slot,
)  # fmt: skip
from jointscope.sim.concealed.law import TEST_DRAW, InLoop, Kind, Law, Moment, Setting, Values

DRIVES: frozenset[Kind] = frozenset({"torque-sweep", "speed-motion"})
MOVES: frozenset[Kind] = frozenset({"speed-motion"})
ANY: frozenset[Kind] = DRIVES | {"hammer"}


def turning_stiffness(p: Real, x: Real, s: Real, f: Real) -> None:
    """K p[1] sin(p[2] q_s + p[3]) added to the spring: stiffness that depends on where the motor stands."""
    f[TRANSMISSION] += p[0] * p[1] * math.sin(p[2] * s[Q_S] + p[3]) * s[WINDUP]


def heating_motor(p: Real, x: Real, s: Real, f: Real) -> None:
    """Torque constant that falls with heat: -p[0] x tau, x' = (tau/p[1])^2 - x/p[2]."""
    x[0] += s[H] * ((s[TAU] / p[1]) ** 2 - x[0] / p[2])
    f[MOTOR] -= p[0] * x[0] * s[TAU]


def churning_grease(p: Real, x: Real, s: Real, f: Real) -> None:
    """Drag p[0] (1 + p[1] x) w of grease that thins when stirred: x' = (1 - x)/p[2] - x |w|/p[3]; x = 1 at rest."""
    if x[1] == 0.0:
        x[0], x[1] = 1.0, 1.0
    x[0] += s[H] * ((1.0 - x[0]) / p[2] - x[0] * abs(s[W_S]) / p[3])
    f[MOTOR] -= p[0] * x[0] * s[W_S]


def detent(p: Real, x: Real, s: Real, f: Real) -> None:
    """A stray magnet: torque -p[0] u exp(0.5 - u^2/2), u = (q - p[1])/p[2], which peaks at p[0]."""
    u = (s[Q] - p[1]) / p[2]
    f[LOAD] -= p[0] * u * math.exp(0.5 - 0.5 * u * u)


def fretting(p: Real, x: Real, s: Real, f: Real) -> None:
    """Damping that grows with wind-up: p[0] |Delta|/p[1] Delta'."""
    f[TRANSMISSION] += p[0] * abs(s[WINDUP]) / p[1] * s[WINDUP_RATE]


def _law(
    effect: str, location: str, strength: str, unit: str, span: Callable[[Setting], tuple[float, float]],
    shape: Callable[[Setting, np.random.Generator], dict[str, float]], loop: InLoop, seen_in: frozenset[Kind],
) -> Law:  # fmt: skip
    return Law(
        effect=effect, location=location, law=effect, departs=True, main=strength, strength=strength, span=span,
        shape=shape, units={strength: unit}, seen_in=seen_in, loop=loop, draws=TEST_DRAW,
    )  # fmt: skip


def _turning() -> Law:
    def shape(s: Setting, rng: np.random.Generator) -> dict[str, float]:
        return {"share": 0.0, "order": float(rng.choice([1.0, 2.0])), "phase": float(rng.uniform(-np.pi, np.pi))}

    def loop(v: Values, s: Setting, m: Moment) -> Slot:
        j = s.rig.joint
        return Slot(turning_stiffness, (j.stiffness, v["share"], v["order"] * j.reduction_ratio, v["phase"]))

    return _law("turning-stiffness", "transmission", "share", "1", lambda s: (0.003, 0.3), shape, loop, MOVES)


def _heating() -> Law:
    def shape(s: Setting, rng: np.random.Generator) -> dict[str, float]:
        return {"fall": 0.0, "memory": float(rng.uniform(1.0, 6.0))}

    def loop(v: Values, s: Setting, m: Moment) -> Slot:
        return Slot(heating_motor, (v["fall"], s.drive_torque, v["memory"]))

    return _law("heating-motor", "motor", "fall", "1/s", lambda s: (0.005, 2.0), shape, loop, DRIVES)


def _grease() -> Law:
    def span(s: Setting) -> tuple[float, float]:
        whole = s.drive_torque / max(s.speed, 1e-6)
        return 0.01 * whole, 1.0 * whole

    def shape(s: Setting, rng: np.random.Generator) -> dict[str, float]:
        return {
            "drag": 0.0,
            "rest": float(rng.uniform(0.5, 3.0)),
            "stir": float(s.travel * rng.uniform(0.05, 0.3)),
        }

    def loop(v: Values, s: Setting, m: Moment) -> Slot:
        return Slot(churning_grease, (v["drag"], 1.0, v["rest"], v["stir"]))

    return _law("churning-grease", "motor", "drag", "N m s/rad", span, shape, loop, DRIVES)


def _magnet() -> Law:
    def span(s: Setting) -> tuple[float, float]:
        return 0.005 * s.torque, 0.5 * s.torque

    def shape(s: Setting, rng: np.random.Generator) -> dict[str, float]:
        return {"torque": 0.0, "place": float(s.travel * rng.uniform(0.25, 0.75)),
                "width": float(s.travel * rng.uniform(0.01, 0.04))}  # fmt: skip

    def loop(v: Values, s: Setting, m: Moment) -> Slot:
        return Slot(detent, (v["torque"], v["place"], v["width"]))

    return _law("stray-magnet", "load", "torque", "N m", span, shape, loop, MOVES)


def _fretting() -> Law:
    def span(s: Setting) -> tuple[float, float]:
        return 0.03 * s.rig.joint.damping, 5.0 * s.rig.joint.damping

    def shape(s: Setting, rng: np.random.Generator) -> dict[str, float]:
        return {"damping": 0.0}

    def loop(v: Values, s: Setting, m: Moment) -> Slot:
        return Slot(fretting, (v["damping"], s.windup))

    return _law("fretting", "transmission", "damping", "N m s/rad", span, shape, loop, ANY)


LAWS: tuple[Law, ...] = (_turning(), _heating(), _grease(), _magnet(), _fretting())
