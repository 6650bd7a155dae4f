r"""Dry friction at motor or arm, friction that grows with load, and drag.

    T_f = T (1 +- asymmetry) sgn(w)                                     Coulomb
    T_f = T sgn(w) and viscous damping b (1 +- viscous_asymmetry)       Coulomb, beside an input of unknown zero
    T_f = T tanh(w/w_e)                                                 Coulomb, rounded
    dT_f/dq = (T - T_f sgn(w)) / y                                      Coulomb with presliding over y (Dahl)
    T_f = [T + (T_b - T) exp(-|w/w_s|^a)] sgn(w), a = 2 or 1            Stribeck
    T_f = [T + (T_b - T) exp(-(w/w_s)^2)] tanh(w/w_e)                   Stribeck, rounded
    dT_f/dq = (T - T_f sgn(w) / g) / y, g = 1 + (T_b/T - 1) exp(-(w/w_s)^2)   Stribeck with presliding (LuGre)
    T_f = mu |T_S| sgn(w)                                               load-dependent
    T_f = c_q w |w|                                                     quadratic

Facts used as tests: a free ring-down loses 2 T w_0 / (pi K) of amplitude per second to Coulomb friction, whatever the
amplitude, and 4 c_q w_0 A^2 / (3 pi J) to quadratic drag; the resonance is not moved.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from jointscope.diagnosis import kernel
from jointscope.diagnosis.acquisition import carries
from jointscope.diagnosis.effects.spec import (
    Apply,
    EffectSpec,
    Limits,
    Location,
    ParameterSpec,
    Possible,
    Scale,
    Starts,
    Values,
    needs_motor,
    one_start,
    share_of,
)

if TYPE_CHECKING:
    from jointscope.diagnosis.assembly import Assembly
    from jointscope.diagnosis.problem import Problem


STEEPEST = 0.7  # of the grid's rate, up to which a rounded friction may damp


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
        assembly.P[at_speed] = max(speed, _steepest(assembly, location, torque))

    return apply


def _steepest(assembly: Assembly, location: str, torque: float) -> float:
    """The rounding below which steps of the grid no longer follow [rad/s]: T/(w_e J) is then a rate of the grid's."""
    inertia = assembly.P[kernel.J_M if location == "motor" else kernel.J_L]
    return float(torque / (STEEPEST * inertia * assembly.run.grid_rate))


def _rounded_stribeck(location: str) -> Apply:
    at_torque, at_speed, at_excess, at_fall, _ = _ROUND_M if location == "motor" else _ROUND_L

    def apply(assembly: Assembly, values: Values, weight: float) -> None:
        torque, breakaway, fall, rounding = values
        steepest = _steepest(assembly, location, max(torque, breakaway))
        assembly.P[at_torque], assembly.P[at_speed] = torque, max(rounding, steepest)
        assembly.P[at_excess], assembly.P[at_fall] = max(breakaway / max(torque, 1e-12) - 1.0, -0.9), fall

    return apply


def _rounded_starts(location: str) -> Starts:
    def starts(problem: Problem) -> tuple[Values, ...]:
        roundings = _roundings(location)(problem)
        return tuple(
            (*speeds, *rounding) for speeds in _speeds(location)(problem)[1:] for rounding in roundings[:1]
        )

    return starts


def _top_speed(problem: Problem, location: str) -> float:
    s = problem.scales
    return max(s.motor_speed if location == "motor" else s.speed, 1e-6)


def _roundings(location: str) -> Starts:
    return lambda problem: tuple((share * _top_speed(problem, location),) for share in (0.004, 0.02, 0.1))


def _sided_roundings(location: str) -> Starts:
    return lambda problem: tuple((*rounding, 0.05) for rounding in _roundings(location)(problem)[:2])


def _rounding_limits(location: str) -> Limits:
    def limits(problem: Problem) -> dict[str, tuple[float, float]]:
        top = _top_speed(problem, location)
        return {**_torque_limits(problem), "rounding": (2e-5 * top, 0.5 * top)}

    return limits


def _presliding(location: str) -> Apply:
    def apply(assembly: Assembly, values: Values, weight: float) -> None:
        assembly.P[kernel.PRE_TORQUE], assembly.P[kernel.PRE_ANGLE] = values
        assembly.S[kernel.PRE_SITE] = kernel.AT_MOTOR if location == "motor" else kernel.AT_LOAD

    return apply


def _presliding_angles(problem: Problem) -> tuple[Values, ...]:
    return tuple((share * max(problem.scales.wind_up, 1e-9),) for share in (0.03, 0.15))


def _presliding_limits(problem: Problem) -> dict[str, tuple[float, float]]:
    wind_up = max(problem.scales.wind_up, 1e-9)
    return {**_torque_limits(problem), "presliding": (1e-3 * wind_up, 3.0 * wind_up)}


def _elastic_and_moving(problem: Problem) -> str | None:
    """With the motor held it is the transmission's hysteresis, and there it is looked for."""
    if not any(run.spring for run in problem.runs):
        return "the rig has no elastic transmission"
    return needs_motor(problem)


def _stribeck(location: str, exponent: float) -> Apply:
    def apply(assembly: Assembly, values: Values, weight: float) -> None:
        torque, breakaway, speed = values
        first = _dry(assembly, location, torque, torque)
        assembly.P[first + 2] = max(breakaway / max(torque, 1e-12) - 1.0, -0.9)  # a search may pass where it rises
        assembly.P[first + 3], assembly.P[first + 4] = speed, exponent

    return apply


def _bristles(location: str) -> Apply:
    def apply(assembly: Assembly, values: Values, weight: float) -> None:
        torque, breakaway, speed, angle = values
        _presliding(location)(assembly, (torque, angle), weight)
        assembly.P[kernel.PRE_EXCESS] = max(breakaway / max(torque, 1e-12) - 1.0, -0.9)
        assembly.P[kernel.PRE_SPEED] = speed

    return apply


def _bristle_starts(location: str) -> Starts:
    def starts(problem: Problem) -> tuple[Values, ...]:
        angles = _presliding_angles(problem)
        return tuple((*speeds, *angle) for speeds in _speeds(location)(problem)[:2] for angle in angles)

    return starts


def _load_dependent(location: str) -> Apply:
    def apply(assembly: Assembly, values: Values, weight: float) -> None:
        first = _dry(assembly, location, 0.0, 0.0)
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
        torque, top = _sizes(location)(problem)[1], _top_speed(problem, location)
        return tuple((1.4 * torque, share * top) for share in (0.01, 0.04, 0.15))

    return starts


def _torque_limits(problem: Problem) -> dict[str, tuple[float, float]]:
    s = problem.scales
    top = 3.0 * max(s.torque, s.motor_torque)
    speed = max(s.speed, s.motor_speed)
    return {
        "torque": (0.0, top),
        "breakaway": (1e-6 * top, 2.0 * top),
        "stribeck_velocity": (1e-4 * speed, 2.0 * speed),
    }


def _drag_sizes(problem: Problem) -> tuple[float, float, float]:
    s = problem.scales
    small, medium, large = share_of(problem, "torque", 0.003, 0.02, 0.1)
    speed = max(s.speed, 1e-9) ** 2
    return small / speed, medium / speed, large / speed


def _drag_limits(problem: Problem) -> dict[str, tuple[float, float]]:
    return {"coefficient": (0.0, 100.0 * _drag_sizes(problem)[2])}


_TORQUE = ParameterSpec("torque", "N m", 0.0, 1e9, null=0.0)
_ASYMMETRY = ParameterSpec("asymmetry", "1", -0.9, 0.9)
_VISCOUS = ParameterSpec("viscous_asymmetry", "1", -0.9, 0.9)
_STRIBECK = (
    _TORQUE,
    ParameterSpec("breakaway", "N m", 1e-9, 1e9, log=True),
    ParameterSpec("stribeck_velocity", "rad/s", 1e-9, 1e6, log=True),
)
_LAWS = {
    "plain": "T sgn(w) against the motion, sticking below T",
    "asymmetric": "T (1 +- asymmetry) sgn(w) against the motion, sticking below T",
    "rounded": "T tanh(w/w_e) against the motion: it creeps where a dry contact sticks",
    "rounded-asymmetric": "T (1 +- asymmetry) tanh(w/w_e) against the motion",
    "presliding": "dT/dq = (T_c - T sgn(w)) / y: Coulomb's force, built up elastically over the angle y",
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
        "asymmetric": ((_TORQUE, _ASYMMETRY), *sided),
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
            revealed_by=("speed-motion", "torque-sweep") if location == "motor" else ("hammer", "speed-motion"),
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


def _shaped_spec(
    location: Location, variant: Literal["rounded", "rounded-asymmetric", "presliding"]
) -> EffectSpec:
    """Coulomb's force with a shape about standstill: rounded over a speed, or built up elastically over an angle."""
    rounded = variant != "presliding"
    sided = variant == "rounded-asymmetric"
    at = _possible(location) if rounded else _elastic_and_moving
    shape = (
        ParameterSpec("rounding", "rad/s", 1e-12, 1e6, log=True)
        if rounded
        else ParameterSpec("presliding", "rad", 1e-15, 1e6, log=True)
    )
    return EffectSpec(
        name="coulomb-friction",
        location=location,
        variant=variant,
        family="dissipative",
        parameters=(_TORQUE, shape, _ASYMMETRY) if sided else (_TORQUE, shape),
        law=_LAWS[variant],
        revealed_by=("hammer", "speed-motion", "torque-sweep") if rounded else ("speed-motion", "torque-sweep"),
        look_alikes=_ALIKE,
        apply=_rounded(location) if rounded else _presliding(location),
        scale=_sizes(location),
        starts=_sided_roundings(location) if sided else _roundings(location) if rounded else _presliding_angles,
        possible=_both(at, _zero_known) if sided else at,
        limits=_rounding_limits(location) if rounded else _presliding_limits,
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
            revealed_by=("speed-motion",),
            look_alikes=("coulomb-friction", "load-dependent-friction"),
            sensible=lambda values: values[1] > values[0],
            apply=_stribeck(location, exponent),
            scale=_sizes(location),
            starts=_speeds(location),
            proportional=(1,),
            possible=_possible(location),
            limits=_torque_limits,
        )
        for variant, exponent in (("gaussian", 2.0), ("exponential", 1.0))
    )


def _bristle_spec(location: Location) -> EffectSpec:
    """Stribeck's friction built up elastically, as LuGre's bristles do."""
    return EffectSpec(
        name="stribeck-friction",
        location=location,
        variant="bristles",
        family="dissipative",
        parameters=(*_STRIBECK, ParameterSpec("presliding", "rad", 1e-15, 1e6, log=True)),
        law="dT/dq = (T_c - T sgn(w)/g) / y, g = 1 + (T_b/T_c - 1) exp(-(w/w_s)^2)",
        revealed_by=("speed-motion",),
        look_alikes=("coulomb-friction", "load-dependent-friction"),
        sensible=lambda values: values[1] > values[0],
        apply=_bristles(location),
        scale=_sizes(location),
        starts=_bristle_starts(location),
        proportional=(1,),
        possible=_elastic_and_moving,
        limits=_presliding_limits,
    )


def _rounded_stribeck_spec(location: Location) -> EffectSpec:
    """Stribeck's friction that creeps where a dry contact sticks, as most simulators have it."""
    return EffectSpec(
        name="stribeck-friction",
        location=location,
        variant="rounded",
        family="dissipative",
        parameters=(*_STRIBECK, ParameterSpec("rounding", "rad/s", 1e-12, 1e6, log=True)),
        law="[T + (T_b - T) exp(-(w/w_s)^2)] tanh(w/w_e)",
        revealed_by=("speed-motion",),
        look_alikes=("coulomb-friction", "load-dependent-friction"),
        sensible=lambda values: values[1] > values[0],
        apply=_rounded_stribeck(location),
        scale=_sizes(location),
        starts=_rounded_starts(location),
        proportional=(1,),
        possible=_possible(location),
        limits=_rounding_limits(location),
    )


def _share_sizes(problem: Problem) -> tuple[float, float, float]:
    return 0.01, 0.05, 0.15


SPECS: tuple[EffectSpec, ...] = (
    *_coulomb_specs("motor"),
    *_coulomb_specs("load"),
    _shaped_spec("motor", "rounded"),
    _shaped_spec("load", "rounded"),
    _shaped_spec("motor", "rounded-asymmetric"),
    _shaped_spec("load", "rounded-asymmetric"),
    _shaped_spec("motor", "presliding"),
    _shaped_spec("load", "presliding"),
    *_stribeck_specs("motor"),
    *_stribeck_specs("load"),
    _bristle_spec("motor"),
    _bristle_spec("load"),
    _rounded_stribeck_spec("motor"),
    _rounded_stribeck_spec("load"),
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
            ("input-side", "motor", needs_motor),
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
        revealed_by=("speed-motion", "hammer"),
        look_alikes=("coulomb-friction", "hysteresis"),
        apply=_quadratic,
        scale=_drag_sizes,
        starts=one_start,
        possible=lambda problem: None,
        limits=_drag_limits,
    ),
)
