r"""Laws of the transmission's torque beside play (``play``): nonlinear and drifting stiffness, structural damping.

    T_S = K Delta + k_3 Delta^3 (+ k_2 Delta^2)                                  cubic
    T_S = K Delta - dK clip(Delta, +-d) (+ k_3 Delta^3)                          soft at low torque (dK > 0)
    T_S = K Delta (1 - share d^2/(Delta^2 + d^2))         the same without a corner
    T_S = K Delta (1 + growth |Delta/d|^(p - 1))                              a power, d known
    T_S = K (1 + i eta) Delta, by relaxation branches or rate-independently      structural damping
    T_S = K (1 + rate t) Delta                                                   drift

Fact used as a test: the backbone f(A)/f_0 = 1 + 3 k_3 A^2/(8 K) of the cubic.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from jointscope.diagnosis import kernel
from jointscope.diagnosis.assembly import BASE_INDEX
from jointscope.diagnosis.effects import hysteresis
from jointscope.diagnosis.effects.play import SOFTEST
from jointscope.diagnosis.effects.spec import (
    EffectSpec,
    ParameterSpec,
    Values,
    Vector,
    needs_spring,
    one_start,
)

if TYPE_CHECKING:
    from jointscope.diagnosis.assembly import Assembly
    from jointscope.diagnosis.problem import Problem

KNOWN = 1e-6  # of an angle that only says what the others are counted in
_BRANCHES = kernel.MOST_BRANCHES
_SPACING = (
    4.0  # of the branches' relaxation times: loss factor flat within 7 % from a fifth to five times the resonance
)


def _cubic(assembly: Assembly, values: Values, weight: float) -> None:
    assembly.P[kernel.K_3] += values[0]
    if len(values) > 1:
        assembly.P[kernel.K_2] += values[1]


def _piecewise(assembly: Assembly, values: Values, weight: float) -> None:
    share, angle = values
    assembly.P[kernel.K_SOFT] = share * assembly.P[kernel.K]
    assembly.P[kernel.SOFT_ANGLE] = angle


def _smooth(assembly: Assembly, values: Values, weight: float) -> None:
    _piecewise(assembly, values, weight)
    assembly.P[kernel.SOFT_SMOOTH] = 1.0


def _power(assembly: Assembly, values: Values, weight: float) -> None:
    P = assembly.P
    P[kernel.POW_K], P[kernel.POW_EXPONENT], P[kernel.POW_ANGLE] = values[0] * P[kernel.K], values[1], values[2]


def _piecewise_cubic(assembly: Assembly, values: Values, weight: float) -> None:
    _piecewise(assembly, values[:2], weight)
    _cubic(assembly, values[2:], weight)


def branches(loss_factor: float, stiffness: float, omega: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Relaxation branches whose loss factor is flat about ``omega`` [rad/s].

    Returns:
        Stiffnesses [N m/rad] and times [s], shape (5,), and the storage stiffness that they add at ``omega``.
    """
    times = _SPACING ** (np.arange(_BRANCHES) - (_BRANCHES - 1) / 2.0) / omega
    x = omega * times
    loss, storage = np.sum(x / (1.0 + x * x)), np.sum(x * x / (1.0 + x * x))
    each = loss_factor * stiffness / loss
    return np.full(_BRANCHES, each), times, float(each * storage)


def _structural_branches(assembly: Assembly, values: Values, weight: float) -> None:
    P, S = assembly.P, assembly.S
    stiffness, times, storage = branches(values[0], P[kernel.K], assembly.resonance)
    P[kernel.BRANCH_0 : kernel.BRANCH_0 + 2 * _BRANCHES : 2] = stiffness
    P[kernel.BRANCH_0 + 1 : kernel.BRANCH_0 + 2 * _BRANCHES : 2] = times
    P[kernel.K] -= storage
    S[kernel.AT_BRANCH], S[kernel.N_BRANCH] = S[kernel.N_X], _BRANCHES
    S[kernel.N_X] += _BRANCHES


def _structural_reid(assembly: Assembly, values: Values, weight: float) -> None:
    # K |Delta| sgn(v) loses 2 K A^2 per cycle, a loss factor eta loses pi eta K A^2
    assembly.P[kernel.REID] = 0.5 * math.pi * values[0]
    assembly.P[kernel.REID_OMEGA] = assembly.resonance


INSTEAD = (0.4, 0.8)  # of the base's viscous damping, that a loss factor may stand for


def _for_viscous(theta: Vector) -> tuple[tuple[Vector, Values], ...]:
    """Less of c, and the loss factor c w/K that takes as much out of the joint's own resonance w."""
    stiffness, damping, inertia = (float(theta[BASE_INDEX[n]]) for n in ("stiffness", "damping", "load_inertia"))
    if not (stiffness > 0.0 and inertia > 0.0):
        return ()
    found = []
    for share in INSTEAD:
        base = theta.copy()
        base[BASE_INDEX["damping"]] = (1.0 - share) * damping
        found.append((base, (share * damping * math.sqrt(stiffness / inertia) / stiffness,)))
    return tuple(found)


def _drift(assembly: Assembly, values: Values, weight: float) -> None:
    assembly.P[kernel.DRIFT] += values[0]


def _drift_per_run(assembly: Assembly, values: Values, weight: float) -> None:
    assembly.P[kernel.K] *= max(1.0 + values[0] * weight, 0.05)


def _stiffness(problem: Problem) -> float:
    return float(problem.base.start[0])


def _cubic_sizes(problem: Problem) -> tuple[float, float, float]:
    unit = _stiffness(problem) / problem.scales.wind_up**2
    return 0.01 * unit, 0.06 * unit, 0.3 * unit


def _cubic_limits(problem: Problem) -> dict[str, tuple[float, float]]:
    unit = _stiffness(problem) / problem.scales.wind_up**2
    return {"cubic": (-0.3 * unit, 10.0 * unit), "quadratic": (-unit, unit)}


def _power_starts(problem: Problem) -> tuple[Values, ...]:
    return tuple((exponent, problem.scales.wind_up) for exponent in (1.5, 2.0))


def _power_limits(problem: Problem) -> dict[str, tuple[float, float]]:
    a = problem.scales.wind_up
    return {"growth": (-0.3, 10.0), "reference_angle": ((1.0 - KNOWN) * a, (1.0 + KNOWN) * a)}


def _soft_starts(problem: Problem) -> tuple[Values, ...]:
    a = problem.scales.wind_up
    return tuple((share * a,) for share in (0.05, 0.15, 0.4))


def _soft_limits(problem: Problem) -> dict[str, tuple[float, float]]:
    a = problem.scales.wind_up
    return {"transition_angle": (1e-3 * a, a)}


def _not_per_run(problem: Problem) -> str | None:
    reason = needs_spring(problem)
    if reason is None and len(problem.runs) < 4:
        return "fewer than four runs"
    return reason


def _is_soft(values: Values) -> bool:
    """Whether something of the spring is left inside: one that would lack more if it might is play."""
    return values[0] < 0.99 * SOFTEST


_HITS = ("hammer", "torque-sweep")
_SPRING = ("stiffness-nonlinearity", "backlash", "hysteresis")

SPECS: tuple[EffectSpec, ...] = (
    EffectSpec(
        name="stiffness-nonlinearity",
        location="transmission",
        variant="cubic",
        family="stiffness",
        parameters=(ParameterSpec("cubic", "N m/rad^3", -1e30, 1e30, null=0.0),),
        law="K Delta + k_3 Delta^3",
        revealed_by=_HITS,
        look_alikes=_SPRING[1:],
        apply=_cubic,
        scale=_cubic_sizes,
        starts=one_start,
        possible=needs_spring,
        limits=_cubic_limits,
    ),
    EffectSpec(
        name="stiffness-nonlinearity",
        location="transmission",
        variant="piecewise-cubic",
        family="stiffness",
        parameters=(
            ParameterSpec("soft_share", "1", -1.0, SOFTEST, null=0.0),
            ParameterSpec("transition_angle", "rad", 1e-9, 1.0, log=True),
            ParameterSpec("cubic", "N m/rad^3", -1e30, 1e30),
        ),
        law="K Delta + k_3 Delta^3 outside +-d, (1 - soft_share) K inside: more slopes than two",
        revealed_by=_HITS,
        look_alikes=_SPRING[1:],
        apply=_piecewise_cubic,
        scale=lambda problem: (0.02, 0.12, 0.4),
        sensible=_is_soft,
        starts=lambda problem: tuple((*angle, 0.0) for angle in _soft_starts(problem)),
        possible=needs_spring,
        limits=lambda problem: {**_soft_limits(problem), **_cubic_limits(problem)},
    ),
    EffectSpec(
        name="stiffness-nonlinearity",
        location="transmission",
        variant="power",
        family="stiffness",
        parameters=(
            ParameterSpec("growth", "1", -0.9, 1e3, null=0.0),
            ParameterSpec("exponent", "1", 1.2, 5.0),
            ParameterSpec("reference_angle", "rad", 1e-9, 10.0),
        ),
        law="K Delta (1 + growth |Delta/reference_angle|^(exponent - 1))",
        revealed_by=_HITS,
        look_alikes=_SPRING[1:],
        apply=_power,
        scale=lambda problem: (0.01, 0.06, 0.3),
        starts=_power_starts,
        possible=needs_spring,
        limits=_power_limits,
    ),
    *(
        EffectSpec(
            name="stiffness-nonlinearity",
            location="transmission",
            variant=variant,
            family="stiffness",
            parameters=(
                ParameterSpec("soft_share", "1", -1.0, SOFTEST, null=0.0),
                ParameterSpec("transition_angle", "rad", 1e-9, 1.0, log=True),
            ),
            law=law,
            revealed_by=_HITS,
            look_alikes=_SPRING[1:],
            apply=apply,
            scale=lambda problem: (0.02, 0.12, 0.4),
            sensible=_is_soft,
            starts=_soft_starts,
            possible=needs_spring,
            limits=_soft_limits,
        )
        for variant, law, apply in (
            ("piecewise", "K Delta outside +-d, (1 - soft_share) K inside", _piecewise),
            ("smooth", "K Delta (1 - soft_share d^2/(Delta^2 + d^2))", _smooth),
        )
    ),
    *hysteresis.SPECS,
    *(
        EffectSpec(
            name="structural-damping",
            location="transmission",
            variant=variant,
            family="dissipative",
            parameters=(ParameterSpec("loss_factor", "1", 0.0, 0.8, null=0.0),),
            law=law,
            revealed_by=("hammer", "torque-sweep"),
            look_alikes=("hysteresis", "load-dependent-friction"),
            apply=apply,
            scale=lambda problem: (0.005, 0.03, 0.1),
            starts=one_start,
            possible=needs_spring,
            instead=_for_viscous,
        )
        for variant, law, apply in (
            ("relaxation", "K (1 + i eta) Delta by five relaxation branches", _structural_branches),
            ("rate-independent", "K Delta + (pi eta/2) K |Delta| sgn(Delta')", _structural_reid),
        )
    ),
    EffectSpec(
        name="stiffness-drift",
        location="transmission",
        variant="in-run",
        family="stiffness",
        parameters=(ParameterSpec("rate", "1/s", -0.2, 0.2, null=0.0),),
        law="K (1 + rate t)",
        revealed_by=("hammer", "torque-sweep"),
        look_alikes=("stiffness-nonlinearity",),
        apply=_drift,
        scale=lambda problem: (0.002, 0.01, 0.05),
        starts=one_start,
        possible=needs_spring,
    ),
)

DRIFT_PER_RUN = EffectSpec(
    name="stiffness-drift",
    location="transmission",
    variant="per-run",
    family="stiffness",
    parameters=(ParameterSpec("rate", "per run", -0.2, 0.2, null=0.0),),
    law="K (1 + rate k) in the k-th run, softest first: no recording says which came first",
    revealed_by=("hammer",),
    look_alikes=("stiffness-nonlinearity", "payload"),
    apply=_drift_per_run,
    scale=lambda problem: (0.0005, 0.002, 0.01),
    starts=one_start,
    possible=_not_per_run,
)
