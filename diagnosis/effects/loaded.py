r"""Friction in proportion to the transmitted torque that creeps, or is built up elastically, as dry friction does.

    T_f = mu |T_S| tanh(w/w_e)                                          rounded over the speed w_e
    T_f = mu |T_S| (1 - driven sgn(T_S w)) tanh(w/w_e)                  unlike where the gear drives and is driven back
    T_f = mu |T_S| z, dz/dq = (1 - z sgn(w)) / y                        with presliding over the angle y

Each is mu |T_S| sgn(w) of ``friction`` with one parameter more, and tends to it as that goes to zero.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from jointscope.diagnosis import kernel
from jointscope.diagnosis.effects import friction
from jointscope.diagnosis.effects.spec import Apply, EffectSpec, Location, ParameterSpec, Values, needs_motor
from jointscope.diagnosis.effects.standstill import (
    PRESLIDING,
    ROUNDING,
    elastic,
    presliding,
    presliding_angles,
    presliding_limits,
    rounding_limits,
    roundings,
    steepest,
)

if TYPE_CHECKING:
    from jointscope.diagnosis.assembly import Assembly


DRIVEN = ParameterSpec("driven", "1", -0.9, 0.9)


def _rounded_by_load(side: str) -> Apply:
    def apply(assembly: Assembly, values: Values, weight: float) -> None:
        coefficient, speed, *driven = values
        at = friction.where_it_rubs(assembly, side, coefficient)
        at_load, at_speed, at_quadrant = (
            (kernel.ROUND_M_LOAD, kernel.ROUND_M_SPEED, kernel.ROUND_M_QUADRANT)
            if at == "motor"
            else (kernel.ROUND_L_LOAD, kernel.ROUND_L_SPEED, kernel.ROUND_L_QUADRANT)
        )
        assembly.P[at_load] = coefficient
        assembly.P[at_quadrant] = driven[0] if driven else 0.0
        assembly.P[at_speed] = max(speed, steepest(assembly, at, coefficient * largest_load(assembly)))

    return apply


def largest_load(assembly: Assembly) -> float:
    """An upper bound of |T_S| [N m]: weight and what moves."""
    P = assembly.P
    return float(
        assembly.problem.scales.torque + math.hypot(P[kernel.G_COS], P[kernel.G_SIN]) + abs(P[kernel.G_CONST])
    )


def _presliding_by_load(side: str) -> Apply:
    def apply(assembly: Assembly, values: Values, weight: float) -> None:
        friction.where_it_rubs(assembly, side, values[0])
        presliding(side)(assembly, (0.0, values[1]), weight)
        assembly.P[kernel.PRE_LOAD] = values[0]

    return apply


def _by_load(sharp: EffectSpec) -> tuple[EffectSpec, ...]:
    """Friction in proportion to the transmitted torque that creeps, or is built up elastically."""
    side: Location = "motor" if sharp.variant == "input-side" else "load"
    at_side = replace(sharp, location=side)  # where its speed and its bounds are taken
    against = f"against the motion of the {side}"
    rounded = roundings(side)
    creeping = f"mu |T_S| tanh(w/w_e) {against}"
    bending = f"mu |T_S| z {against}, dz/dq = (1 - z sgn(w)) / y"
    return tuple(
        replace(
            sharp,
            variant=f"{sharp.variant}-{form}",
            parameters=(*sharp.parameters, *further),
            law=law,
            apply=apply,
            starts=starts,
            limits=limits(at_side),
            possible=possible,
        )
        for form, further, law, apply, starts, limits, possible in (
            ("rounded", (ROUNDING,), creeping, _rounded_by_load(side), rounded, rounding_limits, sharp.possible),
            ("quadrants", (ROUNDING, DRIVEN), f"{creeping}, times 1 - driven sgn(T_S w)", _rounded_by_load(side),
             lambda problem: tuple((*start, 0.0) for start in rounded(problem)[:1]), rounding_limits,
             needs_motor if side == "motor" else sharp.possible),
            ("presliding", (PRESLIDING,), bending, _presliding_by_load(side), presliding_angles, presliding_limits,
             elastic(side)),
        )
    )  # fmt: skip


SPECS: tuple[EffectSpec, ...] = tuple(
    spec for sharp in friction.LOAD_AND_DRAG if sharp.name == "load-dependent-friction" for spec in _by_load(sharp)
)
