r"""Dry friction at motor or arm that sticks at standstill, friction that grows with load, and drag.

    T_f = T (1 +- asymmetry) sgn(w)                                     Coulomb
    T_f = T sgn(w) and viscous damping b (1 +- viscous_asymmetry)       Coulomb, beside an input of unknown zero
    T_f = [T + (T_b - T) exp(-|w/w_s|^a)] sgn(w), a = 2 or 1            Stribeck
    T_f = mu |T_S| sgn(w)                                               load-dependent
    T_f = c_q w |w|                                                     quadratic

Facts used as tests: a free ring-down loses 2 T w_0 / (pi K) of amplitude per second to Coulomb friction, whatever the
amplitude, and 4 c_q w_0 A^2 / (3 pi J) to quadratic drag; the resonance is not moved.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from jointscope.diagnosis import kernel
from jointscope.diagnosis.acquisition import carries
from jointscope.diagnosis.effects.spec import (
    ActiveEffect,
    Apply,
    EffectSpec,
    Location,
    ParameterSpec,
    Possible,
    Scale,
    Starts,
    Values,
    needs_drive,
    needs_motor,
    one_start,
    share_of,
)
from jointscope.diagnosis.parameters import known_inertia

if TYPE_CHECKING:
    from jointscope.diagnosis.assembly import Assembly
    from jointscope.diagnosis.problem import Problem


SLOWEST = 1e-3  # of the top speed, below which a Stribeck speed is not told from sticking
MOTOR_AT_MOST = 0.95  # share of a rigid axis's inertia that its motor's nameplate may have of it
FASTEST = 0.8  # of the top speed, beyond which friction that falls is viscous damping that is too large
LARGER = 1.08  # breakaway over sliding friction, from which it is a Stribeck friction
CLEARLY_LARGER = 1.1  # the same, of one that is sought about a Coulomb friction
SEEN = 10.0  # times the slowest Stribeck speed, likewise: what falls within that is sticking
LITTLE_LESS, MORE = 0.95, 1.3  # of a Coulomb friction, where a Stribeck friction about it begins
LARGEST = 5.0  # of the sliding friction, beyond which a breakaway is another law's


def _blocks(location: str) -> tuple[int, int]:
    if location == "motor":
        return kernel.FM_PLUS, kernel.FRICTION_M
    return kernel.FL_PLUS, kernel.FRICTION_L


def _dry(assembly: Assembly, location: str, plus: float, minus: float) -> int:
    first, switch = _blocks(location)
    assembly.P[first] += plus
    assembly.P[first + 1] += minus
    assembly.S[switch] = 1
    return first


def _coulomb(location: str) -> Apply:
    def apply(assembly: Assembly, values: Values, weight: float) -> None:
        asymmetry = values[1] if len(values) > 1 else 0.0
        _dry(assembly, location, values[0] * (1.0 + asymmetry), values[0] * (1.0 - asymmetry))

    return apply


def _one_sided(assembly: Assembly, values: Values, weight: float) -> None:
    torque, share = values
    _dry(assembly, "load", torque, torque)
    assembly.P[kernel.C_SIDED] += share * assembly.P[kernel.B_L]


def top_speed(problem: Problem, location: str) -> float:
    """Peak speed of the motor or the arm at the joint output [rad/s]."""
    s = problem.scales
    turning = location == "motor" and any(run.spring for run in problem.runs)
    return max(s.motor_speed if turning else s.speed, 1e-6)


def breaks_away(values: Values) -> bool:
    """Whether the breakaway is above the sliding friction by more than the form of Coulomb's law leaves open.

    And by no more than dry friction's is: twice in most contacts.
    """
    return LARGER * values[0] < values[1] < LARGEST * values[0]


def falling_about(active: ActiveEffect, torque: float) -> ActiveEffect:
    """A Stribeck friction about a Coulomb friction of this torque, bound to fall: T below it, T_b above it.

    Left free, the search for it ends with friction that rises from standstill, which says as much as Coulomb's law and is
    no Stribeck friction.
    """
    spec, values = active.spec, dict(zip((p.name for p in active.spec.parameters), active.values, strict=True))
    speeds = next(p for p in spec.parameters if p.name == "stribeck_velocity")
    bounds = {
        "torque": (0.0, torque),
        "breakaway": (CLEARLY_LARGER * torque, LARGEST * torque),
        "stribeck_velocity": (SEEN * speeds.lower, speeds.upper),
    }
    parameters = tuple(
        replace(p, lower=bounds[p.name][0], upper=bounds[p.name][1]) if p.name in bounds else p
        for p in spec.parameters
    )
    values |= {"torque": LITTLE_LESS * torque, "breakaway": MORE * torque}
    return ActiveEffect(replace(spec, parameters=parameters), tuple(values[p.name] for p in parameters))


def excess(torque: float, breakaway: float) -> float:
    """T_b/T - 1 [-], bounded: a search may pass where friction rises with speed."""
    return max(breakaway / max(torque, 1e-12) - 1.0, -0.9)


def _stribeck(location: str, exponent: float) -> Apply:
    def apply(assembly: Assembly, values: Values, weight: float) -> None:
        torque, breakaway, speed = values
        first = _dry(assembly, location, torque, torque)
        assembly.P[first + 2] = excess(torque, breakaway)
        assembly.P[first + 3], assembly.P[first + 4] = speed, exponent

    return apply


def where_it_rubs(assembly: Assembly, side: str, coefficient: float) -> str:
    """Side on which a gear's friction acts: of a rigid axis its one inertia, which has the motor's share of its own."""
    if assembly.run.spring:
        return side
    P = assembly.P
    J_M = known_inertia(assembly.problem.rig)
    P[kernel.GEAR_SHARE] = J_M / (P[kernel.J_L] - J_M) if J_M < MOTOR_AT_MOST * P[kernel.J_L] else 0.0
    P[kernel.PASSED] = coefficient if side == "motor" else -coefficient
    return "load"


def _load_dependent(location: str) -> Apply:
    def apply(assembly: Assembly, values: Values, weight: float) -> None:
        first = _dry(assembly, where_it_rubs(assembly, location, values[0]), 0.0, 0.0)
        assembly.P[first + 5] += values[0]

    return apply


def _quadratic(assembly: Assembly, values: Values, weight: float) -> None:
    assembly.P[kernel.C_QUADRATIC] += values[0]


def _sizes(location: str) -> Scale:
    def scale(problem: Problem) -> tuple[float, float, float]:
        s = problem.scales
        if location == "motor" and s.motor_torque > 0.0:
            return share_of(problem, "motor_torque", 0.01, 0.04, 0.15)
        return share_of(problem, "torque", 0.003, 0.02, 0.1)

    return scale


def _possible(location: str) -> Possible:
    def possible(problem: Problem) -> str | None:
        return needs_motor(problem) if location == "motor" else None

    return possible


def _both(first: Possible, further: Possible | None) -> Possible:
    return first if further is None else lambda problem: first(problem) or further(problem)


def _speeds(location: str) -> Starts:
    def starts(problem: Problem) -> tuple[Values, ...]:
        torque, top = _sizes(location)(problem)[1], top_speed(problem, location)
        return tuple((1.4 * torque, share * top) for share in (0.01, 0.04, 0.15))

    return starts


def _torque_limits(problem: Problem) -> dict[str, tuple[float, float]]:
    s = problem.scales
    top = 3.0 * max(s.torque, s.motor_torque)
    speed = max(s.speed, s.motor_speed)
    return {
        "torque": (0.0, top),
        "breakaway": (1e-6 * top, 2.0 * top),
        "stribeck_velocity": (SLOWEST * speed, FASTEST * speed),
    }


def _drag_sizes(problem: Problem) -> tuple[float, float, float]:
    s = problem.scales
    small, medium, large = share_of(problem, "torque", 0.003, 0.02, 0.1)
    speed = max(s.speed, 1e-9) ** 2
    return small / speed, medium / speed, large / speed


def _drag_limits(problem: Problem) -> dict[str, tuple[float, float]]:
    return {"coefficient": (0.0, 100.0 * _drag_sizes(problem)[2])}


_TORQUE = ParameterSpec("torque", "N m", 0.0, 1e9, null=0.0)
ASYMMETRY = ParameterSpec("asymmetry", "1", -0.9, 0.9)
_VISCOUS = ParameterSpec("viscous_asymmetry", "1", -0.9, 0.9)
_STRIBECK = (
    _TORQUE,
    ParameterSpec("breakaway", "N m", 1e-9, 1e9, log=True),
    ParameterSpec("stribeck_velocity", "rad/s", 1e-9, 1e6, log=True),
)
_LAWS = {
    "plain": "T sgn(w) against the motion, sticking below T",
    "asymmetric": "T (1 +- asymmetry) sgn(w) against the motion, sticking below T",
    "one-sided": "T sgn(w) against the motion, sticking below T, with viscous damping b (1 +- viscous_asymmetry)",
}
_ALIKE = ("stribeck-friction", "load-dependent-friction", "hysteresis", "backlash")


def _zero_known(problem: Problem) -> str | None:
    """In motion a constant force and an asymmetry are one: asymmetry can be told where the input's zero is known."""
    if any(carries(run) for run in problem.runs):
        return "the zero of the force is unknown, and an asymmetry differs from it at standstill only"
    return None


def _zero_unknown(problem: Problem) -> str | None:
    if all(carries(run) for run in problem.runs):
        return None
    return "the zero of the input is known: the plain asymmetry says as much"


def _coulomb_specs(location: Location) -> tuple[EffectSpec, ...]:
    sided = (lambda problem: ((0.05,),), _coulomb(location), _zero_known)
    common: dict[str, tuple[tuple[ParameterSpec, ...], Starts, Apply, Possible | None]] = {
        "plain": ((_TORQUE,), one_start, _coulomb(location), None),
        "asymmetric": ((_TORQUE, ASYMMETRY), *sided),
    }
    if location == "load":
        common["one-sided"] = ((_TORQUE, _VISCOUS), lambda problem: ((-0.1,), (0.1,)), _one_sided, _zero_unknown)
    return tuple(
        EffectSpec(
            name="coulomb-friction",
            location=location,
            variant=variant,
            family="dissipative",
            parameters=parameters,
            law=_LAWS[variant],
            revealed_by=("hammer", "torque-sweep", "speed-motion")[1 if location == "motor" else 0 :],
            look_alikes=_ALIKE,
            apply=apply,
            scale=_sizes(location),
            decades=2 if variant == "plain" else 0,
            starts=starts,
            possible=_both(_possible(location), further),
            limits=_torque_limits,
        )
        for variant, (parameters, starts, apply, further) in common.items()
    )


def _stribeck_specs(location: Location) -> tuple[EffectSpec, ...]:
    return tuple(
        EffectSpec(
            name="stribeck-friction",
            location=location,
            variant=variant,
            family="dissipative",
            parameters=_STRIBECK,
            law="[T + (T_b - T) exp(-|w/w_s|^a)] sgn(w)",
            revealed_by=("torque-sweep", "speed-motion"),
            look_alikes=("coulomb-friction", "load-dependent-friction"),
            sensible=breaks_away,
            apply=_stribeck(location, exponent),
            scale=_sizes(location),
            starts=_speeds(location),
            proportional=(1,),
            possible=_possible(location),
            limits=_torque_limits,
        )
        for variant, exponent in (("gaussian", 2.0), ("exponential", 1.0))
    )


def _share_sizes(problem: Problem) -> tuple[float, float, float]:
    return 0.01, 0.05, 0.15


COULOMB: tuple[EffectSpec, ...] = (*_coulomb_specs("motor"), *_coulomb_specs("load"))
STRIBECK: tuple[EffectSpec, ...] = (*_stribeck_specs("motor"), *_stribeck_specs("load"))
LOAD_AND_DRAG: tuple[EffectSpec, ...] = (
    *(
        EffectSpec(
            name="load-dependent-friction",
            location="transmission",
            variant=variant,
            family="dissipative",
            parameters=(ParameterSpec("coefficient", "1", 0.0, 0.9, null=0.0),),
            law="mu |T_S| sgn(w) against the motion of the " + side,
            revealed_by=("speed-motion", "torque-sweep", "hammer"),
            look_alikes=("coulomb-friction", "torque-gain", "structural-damping"),
            apply=_load_dependent(side),
            scale=_share_sizes,
            starts=one_start,
            possible=possible,
        )
        for variant, side, possible in (
            ("input-side", "motor", needs_drive),
            ("output-side", "load", lambda problem: None),
        )
    ),
    EffectSpec(
        name="quadratic-damping",
        location="load",
        variant="drag",
        family="dissipative",
        parameters=(ParameterSpec("coefficient", "N m s^2/rad^2", 0.0, 1e12, null=0.0),),
        law="c_q w |w|",
        revealed_by=("hammer", "torque-sweep", "speed-motion"),
        look_alikes=("coulomb-friction", "hysteresis"),
        apply=_quadratic,
        scale=_drag_sizes,
        starts=one_start,
        possible=lambda problem: None,
        limits=_drag_limits,
    ),
)
