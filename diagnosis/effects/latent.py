"""A law without a name: torque as a piecewise linear function of one variable, where nothing in the catalogue fits.

In the transmission also a stiffness that depends on the arm's angle.

It locates a mismatch (at the motor, in the transmission, at the arm), serves as the black box of equal freedom, and is
the measured shape of an unknown force. It adds to the torque that accelerates the motor side or the arm, or to T_S.
It is not in ``REGISTRY``: it names nothing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from jointscope.diagnosis import kernel
from jointscope.diagnosis.assembly import BASE_INDEX
from jointscope.diagnosis.effects.spec import (
    ActiveEffect,
    Apply,
    EffectSpec,
    Location,
    ParameterSpec,
    Values,
    needs_motor,
    needs_spring,
    needs_travel,
)

if TYPE_CHECKING:
    from jointscope.diagnosis.assembly import Assembly
    from jointscope.diagnosis.problem import Problem

STIFFNESS = "stiffness-by-angle"  # the nodes are stiffnesses [N m/rad] beside K
_SITES: dict[str, int] = {
    "motor": kernel.AT_MOTOR,
    "load": kernel.AT_LOAD,
    "transmission": kernel.AT_TRANSMISSION,
}
_VARIABLES = {
    "speed": kernel.OF_SPEED,
    "angle": kernel.OF_ANGLE,
    "wind-up": kernel.OF_WIND_UP,
    "wind-up-rate": kernel.OF_WIND_UP_RATE,
    STIFFNESS: kernel.OF_TURN,
}
NODE_NAMES = tuple(f"torque_{i}" for i in range(kernel.N_NODES))


def node_range(problem: Problem, location: str, variable: str) -> tuple[float, float]:
    """First and last node of the variable in this campaign [rad or rad/s]."""
    s = problem.scales
    if variable == "speed":
        top = s.motor_speed if location == "motor" else s.speed
        return -top, top
    if variable == "wind-up-rate":
        return -s.wind_up_rate, s.wind_up_rate
    low, high = (s.wind_up_low, s.wind_up_high) if variable == "wind-up" else (s.angle_low, s.angle_high)
    return (low, high) if high > low else (low - 1e-9, low + 1e-9)


def nodes(spec: EffectSpec, problem: Problem) -> list[ActiveEffect]:
    """The table with a medium size at one node and nothing at the others, node by node."""
    size, count = spec.scale(problem)[1], len(spec.parameters)
    return [ActiveEffect(spec, tuple(size if k == node else 0.0 for k in range(count))) for node in range(count)]


def _tabled(location: str, variable: str) -> Apply:
    def apply(assembly: Assembly, values: Values, weight: float) -> None:
        low, high = node_range(assembly.problem, location, variable)
        P, S = assembly.P, assembly.S
        P[kernel.TABLE_LOW], P[kernel.TABLE_STEP] = low, (high - low) / (kernel.N_NODES - 1)
        P[kernel.TABLE_0 : kernel.TABLE_0 + kernel.N_NODES] = values
        S[kernel.TABLE_SITE], S[kernel.TABLE_OF] = _SITES[location], _VARIABLES[variable]

    return apply


def _sizes(problem: Problem) -> tuple[float, float, float]:
    t = problem.scales.torque
    return 0.003 * t, 0.02 * t, 0.1 * t


def _stiffness_sizes(problem: Problem) -> tuple[float, float, float]:
    k = float(problem.base.start[BASE_INDEX["stiffness"]])
    return 0.003 * k, 0.02 * k, 0.1 * k


def _stiffness_limits(problem: Problem) -> dict[str, tuple[float, float]]:
    k = float(problem.base.start[BASE_INDEX["stiffness"]])
    return dict.fromkeys(NODE_NAMES, (-0.5 * k, k))


def _turning(problem: Problem) -> str | None:
    return needs_spring(problem) or needs_travel(problem)


def _limits(problem: Problem) -> dict[str, tuple[float, float]]:
    top = 3.0 * max(problem.scales.torque, problem.scales.motor_torque)
    return dict.fromkeys(NODE_NAMES, (-top, top))


def _spec(location: Location, variable: str) -> EffectSpec:
    stiffness = variable == STIFFNESS
    possible = {"motor": needs_motor, "transmission": _turning if stiffness else needs_spring}
    return EffectSpec(
        name="latent-law",
        location=location,
        variant=variable,
        family="external",
        parameters=tuple(
            ParameterSpec(name, "N m/rad" if stiffness else "N m", -1e12, 1e12, null=0.0) for name in NODE_NAMES
        ),
        law=f"a {'stiffness' if stiffness else 'torque'} that depends on the {'angle' if stiffness else variable}, "
        "straight between nine nodes",
        revealed_by=("hammer", "torque-sweep", "speed-motion"),
        look_alikes=(),
        apply=_tabled(location, variable),
        scale=_stiffness_sizes if stiffness else _sizes,
        starts=lambda problem: ((0.0,) * (kernel.N_NODES - 1),),
        possible=possible.get(location, lambda problem: None),
        limits=_stiffness_limits if stiffness else _limits,
    )


LATENT: tuple[EffectSpec, ...] = (
    _spec("motor", "speed"),
    _spec("motor", "angle"),
    _spec("load", "speed"),
    _spec("load", "angle"),
    _spec("transmission", "wind-up"),
    _spec("transmission", "wind-up-rate"),
    _spec("transmission", STIFFNESS),
)
