r"""Hysteresis of the transmission: a loop in torque over wind-up beside the spring, the same at any rate.

    T_S = K Delta + T z,  z' = (v/D)(1 - [sgn(v z)/2 + 1/2]|z|^nu),  D = T/stiffness   Bouc-Wen (nu = 2), Dahl (nu = 1)
    z' = (v/D)(1 - |z| (sgn(v z)/2 + 1/2))                                       Bouc-Wen, nu = 1
    z' = (v/D)(1 - |z| (sgn(v z) + shape))                                       Bouc-Wen with its shape free
    z = mean of clip(Delta/D + slip, +-y_i), mean of y_i = 1                     equal springs that slip (Maxwell-slip)

Facts used as tests: a loop closes and its area does not depend on the rate; a spring of k/8 that slips at Y loses
4 (k/8) Y (A - Y) a turn, and nothing below.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from jointscope.diagnosis import kernel
from jointscope.diagnosis.effects.spec import (
    Apply,
    EffectSpec,
    ParameterSpec,
    Starts,
    Values,
    needs_spring,
)
from jointscope.diagnosis.effects.standstill import SHORT, held

if TYPE_CHECKING:
    from jointscope.diagnosis.assembly import Assembly
    from jointscope.diagnosis.problem import Problem

STIFFEST = (
    3.0  # of K: what gives less by the angle than the joint itself is friction at rest, not a spring's hysteresis
)
WIDEST_SPREAD = 300.0  # of the last slip over the first; beyond, the first elements only add to the spring or to c
EVEN_LEVELS = tuple(0.4 * (1 + i // 2) for i in range(kernel.SLIP_ELEMENTS))  # four in even steps, each twice


def _loop(kind: int) -> Apply:
    def apply(assembly: Assembly, values: Values, weight: float) -> None:
        torque, stiffness = values[:2]
        assembly.P[kernel.HYST_TORQUE] = torque
        assembly.P[kernel.HYST_ANGLE] = max(torque / stiffness, 1e-15)
        assembly.S[kernel.HYST_KIND] = kind

    return apply


def _shaped_loop(assembly: Assembly, values: Values, weight: float) -> None:
    _loop(kernel.BOUC_WEN_SHAPED)(assembly, values, weight)
    assembly.P[kernel.HYST_SHAPE] = values[2]


def _linear_loop(assembly: Assembly, values: Values, weight: float) -> None:
    """u = z/2 over twice the torque: u' = (v/2D)(1 - |u| (sgn(v u) + 1))."""
    _shaped_loop(assembly, (2.0 * values[0], values[1], 1.0), weight)


def slip_levels(spread: float) -> tuple[float, ...]:
    """Slip limits of equal springs side by side, in geometric steps over the ratio ``spread``; their mean is 1."""
    last = kernel.SLIP_ELEMENTS - 1
    levels = [spread ** (i / last - 0.5) for i in range(kernel.SLIP_ELEMENTS)]
    mean = sum(levels) / len(levels)
    return tuple(level / mean for level in levels)


def _slips(assembly: Assembly, values: Values, weight: float) -> None:
    """Springs that slip in even steps, or over the ratio that is the third value."""
    _loop(kernel.MAXWELL_SLIP)(assembly, values, weight)
    levels = slip_levels(values[2]) if len(values) > 2 else EVEN_LEVELS
    assembly.P[kernel.HYST_LEVEL_0 : kernel.HYST_LEVEL_0 + kernel.SLIP_ELEMENTS] = levels


def _loop_sizes(problem: Problem) -> tuple[float, float, float]:
    t = problem.scales.torque
    return 0.005 * t, 0.03 * t, 0.12 * t


def _loop_starts(problem: Problem) -> tuple[Values, ...]:
    torque, a = _loop_sizes(problem)[1], problem.scales.wind_up
    stiffest = _loop_limits(problem)["stiffness"][1]
    return tuple((min(torque / (share * a), stiffest),) for share in (0.01, 0.04, 0.12, 0.35, 1.0))


def _of_the_spring(problem: Problem, values: Values) -> bool:
    """Whether it yields over more of the wind-up than dry friction at the arm builds up, which is parallel to a held joint."""
    return not held(problem) or values[0] >= SHORT * problem.scales.wind_up * values[1]


def _loop_limits(problem: Problem) -> dict[str, tuple[float, float]]:
    t, a = problem.scales.torque, problem.scales.wind_up
    return {"torque": (0.0, 2.0 * t), "stiffness": (1e-4 * t / a, STIFFEST * t / a)}


def _spread_starts(problem: Problem) -> tuple[Values, ...]:
    return tuple((*loop, 10.0) for loop in _loop_starts(problem)[1:4])


def _shaped_starts(problem: Problem) -> tuple[Values, ...]:
    return tuple((*loop, -1.4) for loop in _loop_starts(problem))


_PLAIN = "K Delta + T z(Delta), initial slope K + stiffness"
_LAWS: tuple[tuple[str, str, Apply, tuple[ParameterSpec, ...], Starts, int], ...] = (
    ("bouc-wen", _PLAIN, _loop(kernel.BOUC_WEN), (), _loop_starts, 2),
    ("bouc-wen-linear", _PLAIN, _linear_loop, (), _loop_starts, 2),
    ("maxwell-slip", _PLAIN, _slips, (), _loop_starts, 0),
    ("dahl", _PLAIN, _loop(kernel.DAHL), (), _loop_starts, 2),
    ("elastic-slip", _PLAIN, _loop(kernel.ELASTIC_SLIP), (), _loop_starts, 0),
    (
        "bouc-wen-shaped",
        "K Delta + T z(Delta), z' = 1 - |z| (sgn(z Delta') + shape): loops that stiffen (below -1) or yield",
        _shaped_loop,
        (ParameterSpec("shape", "1", -2.0, 1.0),),
        _shaped_starts,
        0,
    ),
    (
        "slip-spread",
        "K Delta + T z(Delta): eight equal springs that slip one after the other, the last at spread times the first",
        _slips,
        (ParameterSpec("spread", "1", 1.0, WIDEST_SPREAD, log=True),),
        _spread_starts,
        0,
    ),
)

SPECS: tuple[EffectSpec, ...] = tuple(
    EffectSpec(
        name="hysteresis",
        location="transmission",
        variant=variant,
        family="hysteretic",
        parameters=(
            ParameterSpec("torque", "N m", 0.0, 1e9, null=0.0),
            ParameterSpec("stiffness", "N m/rad", 1e-6, 1e15, log=True),
            *further,
        ),
        law=law,
        revealed_by=("hammer", "torque-sweep"),
        look_alikes=("coulomb-friction", "structural-damping", "stiffness-nonlinearity"),
        apply=apply,
        scale=_loop_sizes,
        starts=starts,
        possible=needs_spring,
        limits=_loop_limits,
        sensible_at=_of_the_spring,
        decades=decades,
        proportional=(1,),
    )
    for variant, law, apply, further, starts, decades in _LAWS
)
