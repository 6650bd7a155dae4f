r"""Further modes: the arm bends, the mount moves, a neighbour's elasticity couples in.

Each is one modal coordinate p in units of the joint's angle. Arm and neighbour (modal inertia J_p out of J_L):

    J_p (q'' + p'' + 2 zeta w p' + w^2 p) = phi_h T_ext,    sensor: q'' + phi_s p''

A neighbour carries neither hammer nor sensor (phi = 0); on a bending arm both ride on it, phi = shape sqrt(J_p/J_L), so
that the mode vanishes with J_p. The mount turns by beta: beta'' + 2 zeta w beta' + w^2 beta = -(share/J_L) T_S, the
arm's acceleration is q'' + beta'', its encoders see q alone.

Facts used as tests: two resonances and one antiresonance in a driving-point response, at the frequencies of the
two-mass eigenproblem; with share 0 the base; the mount's mode is invisible to an encoder's wind-up at standstill.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from jointscope.diagnosis import kernel
from jointscope.diagnosis.assembly import BASE_INDEX
from jointscope.diagnosis.effects.lines import Residuals, response_peaks, spectral_peaks
from jointscope.diagnosis.effects.spec import (
    EffectSpec,
    Location,
    ParameterSpec,
    ResidualStarts,
    Starts,
    Values,
    frequencies,
)

if TYPE_CHECKING:
    from jointscope.diagnosis.assembly import Assembly
    from jointscope.diagnosis.problem import Problem

_DAMPING = 0.02  # start; narrow enough to be a mode, wide enough for a grid of frequencies to hit it
_GRID = 1.15


def _two_states(assembly: Assembly, switch: int) -> None:
    assembly.S[switch] = assembly.S[kernel.N_X]
    assembly.S[kernel.N_X] += 2


def _link(assembly: Assembly, values: Values, weight: float) -> None:
    P = assembly.P
    frequency, inertia, damping, hit = values[:4]
    sensed = values[4] if len(values) > 4 else hit
    inertia = min(max(inertia, 1e-12 * P[kernel.J_L]), 0.95 * P[kernel.J_L])
    share = math.sqrt(inertia / P[kernel.J_L])
    P[kernel.LINK_J], P[kernel.LINK_OMEGA], P[kernel.LINK_ZETA] = inertia, 2.0 * math.pi * frequency, damping
    P[kernel.LINK_HIT], P[kernel.LINK_SENSE] = hit * share, sensed * share
    _two_states(assembly, kernel.AT_LINK)


def _neighbour(assembly: Assembly, values: Values, weight: float) -> None:
    P = assembly.P
    frequency, share, damping = values
    P[kernel.NEAR_J] = min(share, 0.95) * P[kernel.J_L]
    P[kernel.NEAR_OMEGA], P[kernel.NEAR_ZETA] = 2.0 * math.pi * frequency, damping
    _two_states(assembly, kernel.AT_NEAR)


def _base(assembly: Assembly, values: Values, weight: float) -> None:
    P = assembly.P
    P[kernel.BASE_OMEGA], P[kernel.BASE_SHARE], P[kernel.BASE_ZETA] = (
        2.0 * math.pi * values[0],
        values[1],
        values[2],
    )
    _two_states(assembly, kernel.AT_BASE)


def _band(problem: Problem, low: float, high: float) -> tuple[float, float]:
    """Band [Hz] around the resonance, inside what the recordings hold."""
    rate = max((o.rate for run in problem.runs for o in run.outputs), default=1000.0)
    f0 = problem.scales.frequency if any(run.spring for run in problem.runs) else 20.0
    return max(low * f0, 1.0), min(high * f0, 0.42 * rate)


def _grid(low: float, high: float, *tail: float) -> Starts:
    def starts(problem: Problem) -> tuple[Values, ...]:
        return tuple((f, _DAMPING, *tail) for f in frequencies(*_band(problem, low, high), _GRID))

    return starts


def _peaks(low: float, high: float, *tail: float) -> ResidualStarts:
    def starts(problem: Problem, residuals: Residuals) -> tuple[Values, ...]:
        band = _band(problem, low, high)
        found = [
            *response_peaks(problem, residuals, *band, 5),
            *spectral_peaks(problem, residuals, *band, 3, narrow=False),
        ]
        return tuple((f, damping, *tail) for f in found for damping in (0.01, 0.03))

    return starts


def _limits(problem: Problem) -> dict[str, tuple[float, float]]:
    inertia = float(problem.base.start[BASE_INDEX["load_inertia"]])
    low, high = _band(problem, 0.1, 12.0)
    return {"frequency": (low, high), "inertia": (0.0, 0.9 * inertia)}


def _anything(problem: Problem) -> str | None:
    if any("acceleration" in o.quantity for run in problem.runs for o in run.outputs):
        return None
    if any(run.spring for run in problem.runs):
        return None
    return "neither an acceleration nor an elastic transmission to show a further mode"


def _on_the_arm(problem: Problem) -> str | None:
    if any("acceleration" in o.quantity and o.location != "motor" for run in problem.runs for o in run.outputs):
        return None
    return "no acceleration of the arm was recorded"


def _hit(problem: Problem) -> str | None:
    reason = _on_the_arm(problem)
    if reason is None and all(run.load is None for run in problem.runs):
        return "nothing acts on the arm from outside"
    return reason


def _inertia_sizes(problem: Problem) -> tuple[float, float, float]:
    inertia = float(problem.base.start[BASE_INDEX["load_inertia"]])
    return 0.003 * inertia, 0.03 * inertia, 0.15 * inertia


def _share_sizes(problem: Problem) -> tuple[float, float, float]:
    return 0.003, 0.03, 0.15


_FREQUENCY = ParameterSpec("frequency", "Hz", 0.5, 5e3, log=True)
_ZETA = ParameterSpec("damping", "1", 5e-4, 0.5, log=True)
_INERTIA = ParameterSpec("inertia", "kg m^2", 0.0, 1e9, null=0.0)
_MODES = ("link-flexibility", "base-compliance", "neighbour-flexibility", "sensor-resonance")


def _shape(name: str) -> ParameterSpec:
    return ParameterSpec(name, "1", -8.0, 8.0)


_NEAR: tuple[tuple[str, Location], ...] = (
    ("neighbour-flexibility", "neighbour"),
    ("base-compliance", "base"),
)

SPECS: tuple[EffectSpec, ...] = (
    EffectSpec(
        name="link-flexibility",
        location="load",
        variant="one-shape",
        family="mode",
        parameters=(_FREQUENCY, _INERTIA, _ZETA, _shape("shape")),
        law="bending mode; hammer and sensor ride on it alike",
        revealed_by=("hammer", "torque-sweep"),
        look_alikes=_MODES[1:],
        apply=_link,
        scale=_inertia_sizes,
        starts=_grid(0.6, 8.0, 2.0),
        possible=_on_the_arm,
        limits=_limits,
        residual_starts=_peaks(0.6, 10.0, 2.0),
    ),
    EffectSpec(
        name="link-flexibility",
        location="load",
        variant="two-shapes",
        family="mode",
        parameters=(_FREQUENCY, _INERTIA, _ZETA, _shape("hit_shape"), _shape("sensor_shape")),
        law="bending mode; hammer and sensor see it differently",
        revealed_by=("hammer", "torque-sweep"),
        look_alikes=_MODES[1:],
        apply=_link,
        scale=_inertia_sizes,
        starts=_grid(0.6, 8.0, 2.0, -2.0),
        possible=_hit,
        limits=_limits,
        residual_starts=_peaks(0.6, 10.0, 2.0, -2.0),
    ),
    *(
        EffectSpec(
            name=name,
            location=location,
            variant=variant,
            family="mode",
            parameters=(_FREQUENCY, ParameterSpec("modal_share", "1", 0.0, upper, null=0.0), _ZETA),
            law=law,
            revealed_by=("hammer", "torque-sweep"),
            look_alikes=tuple(other for other in _MODES if other != name),
            apply=apply,
            scale=_share_sizes,
            starts=_grid(0.15, 5.0),
            possible=_anything,
            limits=_limits,
            residual_starts=_peaks(0.15, 6.0),
        )
        for (name, location), variant, upper, law, apply in zip(
            _NEAR,
            ("absorber", "turning-mount"),
            (0.9, 5.0),
            ("a neighbour's inertia on its own spring", "the mount turns under the joint's reaction"),
            (_neighbour, _base),
            strict=True,
        )
    ),
)
