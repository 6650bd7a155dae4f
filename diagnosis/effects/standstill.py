r"""Dry friction with a shape about standstill: rounded over a speed, or built up elastically over an angle.

    T_f = T (1 +- asymmetry) tanh(w/w_e)                                Coulomb, rounded
    T_f = T (1 +- asymmetry) w / sqrt(w^2 + w_e^2)                      the same, slower to its end
    dT_f/dq = (T - T_f sgn(w)) / y                                      Coulomb with presliding over y (Dahl)
    dT_f/dq = (1 - T_f sgn(w)/T)^i T / y                                the same with Dahl's exponent i
    T_f = (1 +- asymmetry) [T + (T_b - T) exp(-(w/w_s)^2)] tanh(w/w_e)  Stribeck, rounded
    dT_f/dq = (T - T_f sgn(w) / g) / y, g = 1 + (T_b/T - 1) exp(-(w/w_s)^2)   Stribeck with presliding (LuGre)

Each is the sharp law of ``friction`` with one parameter more; with presliding too g may have the factor 1 +- asymmetry,
or the bristles a damping of their own, which adds sigma_1 w (1 - T_f sgn(w)/(T g)), sigma_1 = sigma_0 t, sigma_0 = T/y (LuGre).
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from jointscope.diagnosis import kernel
from jointscope.diagnosis.assembly import BASE_INDEX
from jointscope.diagnosis.effects import friction
from jointscope.diagnosis.effects.friction import excess, top_speed
from jointscope.diagnosis.effects.spec import (
    Apply,
    EffectSpec,
    Limits,
    ParameterSpec,
    Possible,
    Starts,
    Values,
    needs_motor,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from jointscope.diagnosis.assembly import Assembly
    from jointscope.diagnosis.problem import Problem


SHORT = 0.02  # of the wind-up, over which friction builds up that is no hysteresis of a spring
LONG = 3.0  # the same of a joint that turns
SLIDING = 1.0  # wind-ups, over which friction that slides at all is built up
SHORT_OF_FALLING = 0.05  # the same of friction that falls with speed, as no hysteresis does
DAMPED = 0.2  # of sqrt(J/sigma_0), at which the search for sigma_1/sigma_0 begins
SLOWEST_BRISTLES = 0.02  # s: sigma_1/sigma_0; in the literature it is milliseconds
EXPONENTS = (0.05, 2.0)  # of Dahl: nearly a spring that slips at once, and a ductile one
STEEPEST = 0.7  # of the grid's rate, up to which a rounded friction may damp

_ROUND_M = (
    kernel.ROUND_M, kernel.ROUND_M_SPEED, kernel.ROUND_M_EXCESS, kernel.ROUND_M_FALL, kernel.ROUND_M_SIDED,
)  # fmt: skip
_ROUND_L = (
    kernel.ROUND_L, kernel.ROUND_L_SPEED, kernel.ROUND_L_EXCESS, kernel.ROUND_L_FALL, kernel.ROUND_L_SIDED,
)  # fmt: skip


def _rounded(location: str) -> Apply:
    at_torque, at_speed, _, _, at_sided = _ROUND_M if location == "motor" else _ROUND_L

    def apply(assembly: Assembly, values: Values, weight: float) -> None:
        torque, speed = values[:2]
        assembly.P[at_torque], assembly.P[at_sided] = torque, values[2] if len(values) > 2 else 0.0
        assembly.P[at_speed] = max(speed, steepest(assembly, location, torque))

    return apply


def _slower(even: EffectSpec) -> Apply:
    """The rounded law that reaches its end as 1 - (w_e/w)^2/2."""
    at_speed = (_ROUND_M if even.location == "motor" else _ROUND_L)[1]

    def apply(assembly: Assembly, values: Values, weight: float) -> None:
        even.apply(assembly, values, weight)
        assembly.P[at_speed] = -assembly.P[at_speed]

    return apply


def steepest(assembly: Assembly, location: str, torque: float) -> float:
    """The rounding below which steps of the grid no longer follow [rad/s]: T/(w_e J) is then a rate of the grid's."""
    inertia = assembly.P[kernel.J_M if location == "motor" else kernel.J_L]
    return float(torque / (STEEPEST * inertia * assembly.run.grid_rate))


def _rounded_stribeck(location: str) -> Apply:
    at_torque, at_speed, at_excess, at_fall, at_sided = _ROUND_M if location == "motor" else _ROUND_L

    def apply(assembly: Assembly, values: Values, weight: float) -> None:
        torque, breakaway, fall, rounding = values[:4]
        slowest = steepest(assembly, location, max(torque, breakaway))
        assembly.P[at_torque], assembly.P[at_speed] = torque, max(rounding, slowest)
        assembly.P[at_excess], assembly.P[at_fall] = excess(torque, breakaway), fall
        assembly.P[at_sided] = values[4] if len(values) > 4 else 0.0

    return apply


def roundings(location: str) -> Starts:
    return lambda problem: tuple((share * top_speed(problem, location),) for share in (0.004, 0.02, 0.1))


def _sided_roundings(location: str) -> Starts:
    return lambda problem: tuple((*rounding, 0.05) for rounding in roundings(location)(problem)[:2])


def rounding_limits(sharp: EffectSpec) -> Limits:
    def limits(problem: Problem) -> dict[str, tuple[float, float]]:
        top = top_speed(problem, sharp.location)
        return {**sharp.limits(problem), "rounding": (2e-5 * top, 0.5 * top)}

    return limits


def presliding(location: str) -> Apply:
    def apply(assembly: Assembly, values: Values, weight: float) -> None:
        assembly.P[kernel.PRE_TORQUE], assembly.P[kernel.PRE_ANGLE] = values[:2]
        assembly.P[kernel.PRE_SIDED] = values[2] if len(values) > 2 else 0.0
        assembly.S[kernel.PRE_SITE] = kernel.AT_MOTOR if location == "motor" else kernel.AT_LOAD

    return apply


def _shaped(location: str) -> Apply:
    def apply(assembly: Assembly, values: Values, weight: float) -> None:
        presliding(location)(assembly, values[:2], weight)
        assembly.P[kernel.PRE_BRITTLE] = 1.0 - values[2]

    return apply


def _bristles(location: str) -> Apply:
    def apply(assembly: Assembly, values: Values, weight: float) -> None:
        torque, breakaway, speed, *build_up = values
        presliding(location)(assembly, (torque, *build_up), weight)
        assembly.P[kernel.PRE_EXCESS] = excess(torque, breakaway)
        assembly.P[kernel.PRE_SPEED] = speed

    return apply


def _damped(even: EffectSpec) -> Apply:
    """``even`` with a last value more, the time sigma_1/sigma_0 in which its bristles follow [s]."""

    def apply(assembly: Assembly, values: Values, weight: float) -> None:
        torque, angle, time = values[0], values[-2], values[-1]
        even.apply(assembly, values[:-1], weight)
        slowest = steepest(assembly, even.location, max(torque, 1e-12))
        assembly.P[kernel.PRE_DAMPING] = min(time / angle, 1.0 / slowest)

    return apply


def presliding_angles(problem: Problem) -> tuple[Values, ...]:
    shares = (0.2 * SHORT, 0.7 * SHORT) if held(problem) else (0.03, 0.15, 0.003)
    return tuple((share * max(problem.scales.wind_up, 1e-9),) for share in shares)


def presliding_limits(sharp: EffectSpec, short: float = SHORT) -> Limits:
    """Bounds of the sharp law, and of the angle: on a held joint at most the share ``short`` of the wind-up."""

    def limits(problem: Problem) -> dict[str, tuple[float, float]]:
        wind_up = max(problem.scales.wind_up, 1e-9)
        longest = short if held(problem) else LONG
        return {**sharp.limits(problem), "presliding": (1e-3 * wind_up, longest * wind_up)}

    return limits


def slides(position: int) -> Callable[[Problem, Values], bool]:
    """Whether friction whose ``position``-th value is its presliding slides at all: built up over more, it is a soft spring."""

    def within(problem: Problem, values: Values) -> bool:
        return held(problem) or values[position] < SLIDING * max(problem.scales.wind_up, 1e-9)

    return within


def held(problem: Problem) -> bool:
    """Whether the motor never moves: friction at the arm is then parallel to the transmission's own hysteresis."""
    return all(run.mode == "braked" for run in problem.runs)


def elastic(location: str) -> Possible:
    def reason(problem: Problem) -> str | None:
        if not any(run.spring for run in problem.runs):
            return "the rig has no elastic transmission"
        return needs_motor(problem) if location == "motor" else None

    return reason


ROUNDING = ParameterSpec("rounding", "rad/s", 1e-12, 1e6, log=True)
PRESLIDING = ParameterSpec("presliding", "rad", 1e-15, 1e6, log=True)


def _rounded_coulomb(sharp: EffectSpec) -> EffectSpec:
    """Coulomb's friction that creeps where a dry contact sticks."""
    torque, *asymmetry = sharp.parameters
    return replace(
        sharp,
        variant="rounded-asymmetric" if asymmetry else "rounded",
        parameters=(torque, ROUNDING, *asymmetry),
        law="T (1 +- asymmetry) tanh(w/w_e) against the motion"
        if asymmetry
        else "T tanh(w/w_e) against the motion: it creeps where a dry contact sticks",
        revealed_by=("hammer", "speed-motion", "torque-sweep"),
        apply=_rounded(sharp.location),
        decades=0,
        starts=_sided_roundings(sharp.location) if asymmetry else roundings(sharp.location),
        limits=rounding_limits(sharp),
    )


def _algebraic(rounded: EffectSpec) -> EffectSpec:
    """Rounded friction that is slower to reach its end, as many simulators write it; fitted from the other's numbers."""
    return replace(
        rounded,
        variant="rounded-algebraic",
        law="T (1 +- asymmetry) w / sqrt(w^2 + w_e^2) against the motion: it creeps where a dry contact sticks",
        apply=_slower(rounded),
        starts=lambda problem: rounded.starts(problem)[:1],
    )


def rises_above(values: Values) -> bool:
    """Whether rounded friction is anywhere above its sliding value by more than Coulomb's form leaves open.

    A fall that is over before the friction has risen is no breakaway but another rounding.
    """
    torque, breakaway, fall, rounding = values[:4]
    w = np.geomspace(0.1 * rounding, 10.0 * max(rounding, fall), 60)
    level = (torque + (breakaway - torque) * np.exp(-np.square(w / fall))) * np.tanh(w / rounding)
    return bool(friction.LARGER * torque < np.max(level) < friction.LARGEST * torque)


def _presliding_coulomb(sharp: EffectSpec) -> EffectSpec:
    """Coulomb's friction built up elastically."""
    return replace(
        sharp,
        variant="presliding",
        parameters=(*sharp.parameters, PRESLIDING),
        law="dT/dq = (T_c - T sgn(w)) / y: Coulomb's force, built up elastically over the angle y",
        revealed_by=("speed-motion", "torque-sweep"),
        apply=presliding(sharp.location),
        decades=0,
        starts=presliding_angles,
        possible=elastic(sharp.location),
        limits=presliding_limits(sharp),
        sensible_at=slides(len(sharp.parameters)),
    )


def _stribeck_on_bristles(sharp: EffectSpec) -> EffectSpec:
    """Stribeck's friction built up elastically, as LuGre's bristles do."""
    return replace(
        sharp,
        variant="bristles",
        parameters=(*sharp.parameters, PRESLIDING),
        law="dT/dq = (T_c - T sgn(w)/g) / y, g = 1 + (T_b/T_c - 1) exp(-(w/w_s)^2)",
        apply=_bristles(sharp.location),
        starts=lambda problem: tuple(
            (*speeds, *angle) for speeds in sharp.starts(problem)[:2] for angle in presliding_angles(problem)[:2]
        ),
        possible=elastic(sharp.location),
        limits=presliding_limits(sharp, SHORT_OF_FALLING),
        sensible_at=slides(len(sharp.parameters)),
    )


def _rounded_stribeck_of(sharp: EffectSpec) -> EffectSpec:
    """Stribeck's friction that creeps where a dry contact sticks, as most simulators have it."""
    return replace(
        sharp,
        variant="rounded",
        parameters=(*sharp.parameters, ROUNDING),
        law="[T + (T_b - T) exp(-(w/w_s)^2)] tanh(w/w_e)",
        sensible=rises_above,
        apply=_rounded_stribeck(sharp.location),
        starts=lambda problem: tuple(
            (*speeds, *roundings(sharp.location)(problem)[0]) for speeds in sharp.starts(problem)[1:]
        ),
        limits=rounding_limits(sharp),
    )


def _tustin_bristles(even: EffectSpec) -> EffectSpec:
    """Bristles whose breakaway falls as Tustin's does; fitted from where the even ones were found."""

    def apply(assembly: Assembly, values: Values, weight: float) -> None:
        even.apply(assembly, values, weight)
        assembly.P[kernel.PRE_EXPONENT] = 1.0

    return replace(
        even,
        variant=f"{even.variant}-exponential",
        law="dT/dq = (T_c - T sgn(w)/g) / y, g = 1 + (T_b/T_c - 1) exp(-|w|/w_s)",
        apply=apply,
        starts=lambda problem: even.starts(problem)[:1],
    )


def _sided_bristles(even: EffectSpec) -> EffectSpec:
    """Friction with presliding that is unlike in the two directions; fitted from where the even one was found."""
    return replace(
        even,
        variant=f"{even.variant}-asymmetric",
        parameters=(*even.parameters, friction.ASYMMETRY),
        law=f"{even.law}, the end of it (1 +- asymmetry) as high",
        starts=lambda problem: tuple((*start, 0.0) for start in even.starts(problem)[:1]),
    )


def _damped_bristles(even: EffectSpec) -> EffectSpec:
    """Friction with presliding whose bristles are damped: LuGre's law whole; fitted from where the undamped was found."""

    def starts(problem: Problem) -> tuple[Values, ...]:
        inertia = problem.base.start[BASE_INDEX["motor_inertia" if even.location == "motor" else "load_inertia"]]
        torque, values = even.scale(problem)[1], even.starts(problem)[0]
        ring = math.sqrt(values[-1] / torque * float(inertia))
        return ((*values, min(DAMPED * ring, 0.5 * SLOWEST_BRISTLES)),)

    return replace(
        even,
        variant=f"{even.variant}-damped",
        parameters=(*even.parameters, ParameterSpec("bristle_time", "s", 0.0, SLOWEST_BRISTLES)),
        law=f"{even.law}, and a damping sigma_1 = bristle_time T_c/y of the bristles themselves (LuGre)",
        apply=_damped(even),
        starts=starts,
    )


def _brittle(dahl: EffectSpec) -> EffectSpec:
    """Presliding with Dahl's exponent, which is below 1 where elements of unlike strength slip one after the other."""
    return replace(
        dahl,
        variant="presliding-shaped",
        parameters=(*dahl.parameters, ParameterSpec("exponent", "1", *EXPONENTS)),
        law="dT/dq = (1 - T sgn(w)/T_c)^exponent T_c / y: Coulomb's force, built up elastically over the angle y",
        apply=_shaped(dahl.location),
        starts=lambda problem: tuple((*start, 0.5) for start in dahl.starts(problem)[:1]),
    )


def _sided(rounded: EffectSpec) -> EffectSpec:
    """The same, unlike in the two directions; fitted from where the even one was found, so one start is enough."""
    return replace(
        rounded,
        variant="rounded-asymmetric",
        parameters=(*rounded.parameters, friction.ASYMMETRY),
        law="(1 +- asymmetry) [T + (T_b - T) exp(-(w/w_s)^2)] tanh(w/w_e)",
        starts=lambda problem: tuple((*start, 0.0) for start in rounded.starts(problem)[:1]),
    )


_PLAIN, _ASYMMETRIC, _GAUSSIAN = (
    tuple(spec for spec in (*friction.COULOMB, *friction.STRIBECK) if spec.variant == variant)
    for variant in ("plain", "asymmetric", "gaussian")
)

_CREEPING = tuple(_rounded_coulomb(sharp) for sharp in (*_PLAIN, *_ASYMMETRIC))
_DAHL = tuple(_presliding_coulomb(sharp) for sharp in _PLAIN)
_BRISTLES = tuple(_stribeck_on_bristles(sharp) for sharp in _GAUSSIAN)
_ROUNDED = tuple(_rounded_stribeck_of(sharp) for sharp in _GAUSSIAN)

COULOMB: tuple[EffectSpec, ...] = (
    *_CREEPING,
    *(_algebraic(rounded) for rounded in _CREEPING if rounded.variant == "rounded-asymmetric"),
    *_DAHL,
    *(_sided_bristles(even) for even in _DAHL),
    *(_damped_bristles(even) for even in _DAHL),
    *(_brittle(dahl) for dahl in _DAHL),
)
STRIBECK: tuple[EffectSpec, ...] = (
    *_BRISTLES,
    *(_sided_bristles(even) for even in _BRISTLES),
    *(_damped_bristles(even) for even in _BRISTLES),
    *(_tustin_bristles(even) for even in _BRISTLES),
    *_ROUNDED,
    *(_sided(rounded) for rounded in _ROUNDED),
)
