"""Dry friction and drag: Coulomb, Stribeck, load-dependent loss, quadratic damping.

The set-valued law is solved within the step, as a Moreau-Jean scheme does: the friction torque is whatever would stop
the mass by the end of the step, cut to the law's limits. There is no regularisation, hence no creep.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from jointscope.sim.concealed.engine import A_L, A_S, LOAD, MOTOR, T_S, W_S, H, Real, Slot, W
from jointscope.sim.concealed.law import EVERY_DRAW, OPEN_DRAWS, Kind, Law, Moment, Setting, Values

DRIVES: frozenset[Kind] = frozenset({"torque-sweep", "speed-motion"})
ANY: frozenset[Kind] = DRIVES | {"hammer"}


def set_valued(p: Real, x: Real, s: Real, f: Real) -> None:
    """Set-valued dry friction with limits p[0] + p[4] exp(-(v/p[5])^2) and p[1] + ... at J = p[2], side p[3]."""
    if p[3] < 0.5:
        a = s[A_S]
        v = s[W_S] - 0.5 * s[H] * a
    else:
        a = s[A_L]
        v = s[W] - 0.5 * s[H] * a
    rise = 0.0
    if p[4] != 0.0:
        rise = p[4] * math.exp(-((v / p[5]) ** 2))
    stop = -(p[2] * v / s[H] + p[2] * a - x[0])
    stop = max(-(p[0] + rise), min(p[1] + rise, stop))
    x[0] = stop
    if p[3] < 0.5:
        f[MOTOR] += stop
    else:
        f[LOAD] += stop


def bristles(p: Real, x: Real, s: Real, f: Real) -> None:
    """LuGre: p = T_c, T_s - T_c, v_s, stiffness, damping, side, exponent of the curve (2 Gauss, -1 Lorentz)."""
    v = s[W_S] if p[5] < 0.5 else s[W]
    if p[6] > 0.0:
        g = p[0] + p[1] * math.exp(-((abs(v) / p[2]) ** p[6]))
    else:
        g = p[0] + p[1] / (1.0 + (v / p[2]) ** 2)
    rate = p[3] * abs(v) / g
    h = s[H]
    z = (x[0] + h * v) / (1.0 + h * rate)
    torque = p[3] * z + p[4] * (z - x[0]) / h
    x[0] = z
    if p[5] < 0.5:
        f[MOTOR] -= torque
    else:
        f[LOAD] -= torque


def smooth(p: Real, x: Real, s: Real, f: Real) -> None:
    """p = T+, T-, width, side: Coulomb rounded by a hyperbolic tangent."""
    v = s[W_S] if p[3] < 0.5 else s[W]
    t = math.tanh(v / p[2])
    torque = (p[0] if t > 0.0 else p[1]) * t
    if p[3] < 0.5:
        f[MOTOR] -= torque
    else:
        f[LOAD] -= torque


def mesh_loss(p: Real, x: Real, s: Real, f: Real) -> None:
    """Loss p[0] |T_S| against the motor's speed, set-valued at J = p[1]; p[2] times that when the load drives."""
    a = s[A_S]
    v = s[W_S] - 0.5 * s[H] * a
    limit = p[0] * abs(s[T_S])
    if s[T_S] * v < 0.0:
        limit *= p[2]
    stop = -(p[1] * v / s[H] + p[1] * a - x[0])
    stop = max(-limit, min(limit, stop))
    x[0] = stop
    f[MOTOR] += stop


def mesh_loss_smooth(p: Real, x: Real, s: Real, f: Real) -> None:
    """Loss p[0] T_ref (|T_S|/T_ref)^p[2] tanh(v/p[1]), T_ref = p[3]."""
    f[MOTOR] -= p[0] * p[3] * (abs(s[T_S]) / p[3] + 1e-9) ** p[2] * math.tanh(s[W_S] / p[1])


def drag(p: Real, x: Real, s: Real, f: Real) -> None:
    """-p[0] v0^(2-p[1]) |v|^p[1] sgn v on the arm, v0 = p[2]: quadratic where p[1] = 2."""
    v = s[W]
    f[LOAD] -= p[0] * p[2] ** (2.0 - p[1]) * abs(v) ** p[1] * math.copysign(1.0, v)


def _inertia(setting: Setting, side: int) -> float:
    joint = setting.rig.joint
    return joint.load_inertia if side else joint.reflected_inertia


def _dry(setting: Setting, side: int) -> tuple[float, float]:
    """A motor-side loss is 2 to 40 % of the drive's torque, a load-side one 0.2 to 20 % of the wind-up's."""
    if side:
        return 0.002 * setting.torque, 0.2 * setting.torque
    return 0.02 * setting.drive_torque, 0.4 * setting.drive_torque


def _coulomb(side: int) -> list[Law]:
    where = "load" if side else "motor"

    def shape(setting: Setting, rng: np.random.Generator) -> dict[str, float]:
        lopsided = rng.random() < 0.4
        return {
            "torque": 0.0,
            "asymmetry": float(rng.uniform(-0.15, 0.15)) if lopsided else 0.0,
            "width": float(setting.speed * 10.0 ** rng.uniform(-3.5, -2.5)),
            "presliding": float(setting.windup * 10.0 ** rng.uniform(-2.3, -1.3)),
        }

    def limits(values: Values) -> tuple[float, float]:
        return values["torque"] * (1.0 + values["asymmetry"]), values["torque"] * (1.0 - values["asymmetry"])

    def exact(values: Values, setting: Setting, moment: Moment) -> Slot:
        return Slot(set_valued, (*limits(values), _inertia(setting, side), side, 0.0, 1.0))

    def rounded(values: Values, setting: Setting, moment: Moment) -> Slot:
        return Slot(smooth, (*limits(values), values["width"], side))

    def dahl(values: Values, setting: Setting, moment: Moment) -> Slot:
        stiffness = values["torque"] / values["presliding"]
        return Slot(bristles, (values["torque"], 0.0, 1.0, stiffness, 0.0, side, 2.0))

    def law(name: str, departs: bool, loop: Callable[[Values, Setting, Moment], Slot]) -> Law:
        return Law(
            effect="coulomb-friction", location=where, law=name, departs=departs, main="torque", strength="torque",
            span=lambda setting: _dry(setting, side), shape=shape, units={"torque": "N m", "asymmetry": "1"},
            seen_in=ANY if side else DRIVES, loop=loop,
            draws=OPEN_DRAWS if name == "dahl" else EVERY_DRAW,
        )  # fmt: skip

    return [law("set-valued", False, exact), law("tanh", False, rounded), law("dahl", True, dahl)]


def _stribeck(side: int) -> list[Law]:
    where = "load" if side else "motor"

    def shape(setting: Setting, rng: np.random.Generator) -> dict[str, float]:
        return {
            "torque": 0.0,
            "rise": float(rng.uniform(0.2, 0.8)),
            "stribeck_velocity": float(setting.speed * 10.0 ** rng.uniform(-1.5, -0.5)),
            "presliding": float(setting.windup * 10.0 ** rng.uniform(-2.0, -1.2)),
        }

    def exact(values: Values, setting: Setting, moment: Moment) -> Slot:
        torque = values["torque"]
        extra = torque * values["rise"]
        return Slot(
            set_valued, (torque, torque, _inertia(setting, side), side, extra, values["stribeck_velocity"])
        )

    def lorentz(values: Values, setting: Setting, moment: Moment) -> Slot:
        torque = values["torque"]
        stiffness = torque / values["presliding"]
        micro = 0.2 * math.sqrt(stiffness * _inertia(setting, side))
        return Slot(
            bristles,
            (torque, torque * values["rise"], values["stribeck_velocity"], stiffness, micro, side, -1.0),
        )

    def law(name: str, departs: bool, loop: Callable[[Values, Setting, Moment], Slot]) -> Law:
        return Law(
            effect="stribeck-friction", location=where, law=name, departs=departs, main="torque", strength="torque",
            span=lambda setting: _dry(setting, side), shape=shape,
            units={"torque": "N m", "stribeck_velocity": "rad/s"},
            seen_in=ANY if side else DRIVES, loop=loop,
            draws=OPEN_DRAWS if departs else EVERY_DRAW,
        )  # fmt: skip

    return [law("set-valued-gauss", False, exact), law("lugre-lorentz", True, lorentz)]


def _load_dependent() -> list[Law]:
    def shape(setting: Setting, rng: np.random.Generator) -> dict[str, float]:
        return {
            "coefficient": 0.0,
            "back": float(rng.uniform(1.0, 1.3)),
            "exponent": float(rng.uniform(0.75, 0.9)),
            "width": float(setting.speed * 10.0 ** rng.uniform(-3.0, -2.0)),
        }

    def exact(values: Values, setting: Setting, moment: Moment) -> Slot:
        return Slot(mesh_loss, (values["coefficient"], setting.rig.joint.reflected_inertia, values["back"]))

    def power(values: Values, setting: Setting, moment: Moment) -> Slot:
        return Slot(mesh_loss_smooth, (values["coefficient"], values["width"], values["exponent"], setting.torque))

    def law(name: str, departs: bool, loop: Callable[[Values, Setting, Moment], Slot]) -> Law:
        return Law(
            effect="load-dependent-friction", location="transmission", law=name, departs=departs,
            main="coefficient", strength="coefficient", span=lambda setting: (0.01, 0.25), shape=shape,
            units={"coefficient": "1"}, seen_in=DRIVES, loop=loop,
            draws=OPEN_DRAWS if departs else EVERY_DRAW,
        )  # fmt: skip

    return [law("proportional", False, exact), law("power-law", True, power)]


def _quadratic() -> list[Law]:
    def span(setting: Setting) -> tuple[float, float]:
        joint = setting.rig.joint
        own = (joint.damping + joint.load_damping) / max(setting.speed, 1e-9)
        return 0.02 * own, 2.0 * own

    def shape(setting: Setting, rng: np.random.Generator) -> dict[str, float]:
        return {"coefficient": 0.0, "exponent": float(rng.uniform(1.7, 2.4))}

    def square(values: Values, setting: Setting, moment: Moment) -> Slot:
        return Slot(drag, (values["coefficient"], 2.0, 1.0))

    def power(values: Values, setting: Setting, moment: Moment) -> Slot:
        return Slot(drag, (values["coefficient"], values["exponent"], setting.speed))

    def law(name: str, departs: bool, loop: Callable[[Values, Setting, Moment], Slot]) -> Law:
        return Law(
            effect="quadratic-damping", location="load", law=name, departs=departs, main="coefficient",
            strength="coefficient", span=span, shape=shape, units={"coefficient": "N m s^2/rad^2"}, loop=loop,
            draws=OPEN_DRAWS if departs else EVERY_DRAW,
        )  # fmt: skip

    return [law("square", False, square), law("power-law", True, power)]


LAWS: tuple[Law, ...] = (
    *_coulomb(0), *_coulomb(1), *_stribeck(0), *_stribeck(1), *_load_dependent(), *_quadratic(),
)  # fmt: skip
