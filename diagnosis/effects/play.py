r"""Play in the transmission: teeth that part, flanks that wear, give way or are bridged, and how they strike.

    T_S = K dz(Delta - D_0, gap/2) + c Delta' in contact                         backlash
    T_S = K x + c x' (dx/dDelta)^fade, x the dead zone with bends for corners    play whose flanks wear or give way
    T_S = K x (1 + impact |x|') + c x'                                           the same, damped as Hunt and Crossley's contact
    T_S = K Delta - (1 - inside) K clip(Delta, +-gap/2) + c Delta'               play that a seal or grease bridges

Facts used as tests: the backbone f(A)/f_0 = sqrt(N(A)/K) with the dead zone's describing function N; the period over bent
corners is the quadrature of their potential; what speed adds to an impact is impact |T| x'.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from jointscope.diagnosis import kernel
from jointscope.diagnosis.assembly import BASE_INDEX
from jointscope.diagnosis.effects.spec import Apply, EffectSpec, ParameterSpec, Values, needs_spring, one_start

if TYPE_CHECKING:
    from jointscope.diagnosis.assembly import Assembly
    from jointscope.diagnosis.problem import Problem

SOFTEST_END = 0.5  # of half a gap, that bends which end soon may be wide: with more it is a soft region
SOFTEST = 0.7  # share of the stiffness that a soft region may lack: with more it is a gap


def _backlash(damping_inside: float, sheds: float = 0.0) -> Apply:
    def apply(assembly: Assembly, values: Values, weight: float) -> None:
        assembly.P[kernel.GAP_HALF] = 0.5 * values[0]
        assembly.P[kernel.GAP_CENTRE] = 0.5 * values[0] * values[1] if len(values) > 1 else 0.0
        assembly.P[kernel.GAP_DAMPING] = damping_inside
        assembly.P[kernel.GAP_SHEDS] = sheds

    return apply


def _rounded(assembly: Assembly, values: Values, weight: float) -> None:
    assembly.P[kernel.GAP_HALF] = 0.5 * values[0]
    assembly.P[kernel.GAP_ROUND], assembly.P[kernel.GAP_FADE], assembly.P[kernel.GAP_SHEDS] = (
        values[1],
        values[2],
        1.0,
    )


def _hyperbolic(assembly: Assembly, values: Values, weight: float) -> None:
    half = 0.5 * values[0]
    assembly.P[kernel.GAP_HALF], assembly.P[kernel.GAP_CORNER] = half, values[1] * half
    assembly.P[kernel.GAP_FADE] = values[2]


def _softplus(assembly: Assembly, values: Values, weight: float) -> None:
    _hyperbolic(assembly, values, weight)
    assembly.P[kernel.GAP_CORNER] *= -1.0


def _impact(assembly: Assembly, values: Values, weight: float) -> None:
    _hyperbolic(assembly, (*values[:2], 1.0), weight)
    assembly.P[kernel.GAP_IMPACT] = values[2]


def _cushioned(assembly: Assembly, values: Values, weight: float) -> None:
    assembly.P[kernel.K_SOFT] = (1.0 - values[1]) * assembly.P[kernel.K]
    assembly.P[kernel.SOFT_ANGLE] = 0.5 * values[0]


def _angle_sizes(problem: Problem) -> tuple[float, float, float]:
    a = problem.scales.wind_up
    return 0.01 * a, 0.08 * a, 0.4 * a


def _gap_limits(problem: Problem) -> dict[str, tuple[float, float]]:
    a = problem.scales.wind_up
    return {
        "gap": (0.0, 4.0 * a),
        "contact_depth": (1e-5 * a, 2.0 * a),
        "impact": (0.0, 100.0 * _impact_size(problem)),
    }


def _impact_size(problem: Problem) -> float:
    """Hunt and Crossley's damping [s/rad] that is the reducer's own at a third of the largest wind-up."""
    start = problem.base.start
    stiffness, damping = (float(start[BASE_INDEX[name]]) for name in ("stiffness", "damping"))
    return 3.0 * damping / (stiffness * problem.scales.wind_up)


_GAP = ParameterSpec("gap", "rad", 0.0, 1.0, null=0.0)

SPECS: tuple[EffectSpec, ...] = tuple(
    EffectSpec(
        name="backlash",
        location="transmission",
        variant=variant,
        family="stiffness",
        parameters=parameters,
        law=law,
        revealed_by=("hammer", "torque-sweep"),
        look_alikes=("stiffness-nonlinearity", "hysteresis", "coulomb-friction"),
        apply=apply,
        scale=_angle_sizes,
        decades=0 if variant in ("off-centre", "cushioned", "hyperbolic", "softplus", "impact") else 3,
        starts=starts,
        proportional=proportional,
        possible=needs_spring,
        limits=_gap_limits,
    )
    for variant, law, apply, parameters, starts, proportional in (
        (
            "free-flight",
            "K dz(Delta, gap/2), c acting in contact only",
            _backlash(0.0),
            (_GAP,),
            one_start,
            (),
        ),
        ("damped", "K dz(Delta, gap/2), c acting always", _backlash(1.0), (_GAP,), one_start, ()),
        (
            "sheds",
            "the same in contact only, where a flank does not pull",
            _backlash(0.0, 1.0),
            (_GAP,),
            one_start,
            (),
        ),
        (
            "rounded",
            "K x s^(1/2) + c x' s^fade, s = x/(x + contact_depth), at a depth x of contact, where no flank pulls",
            _rounded,
            (
                _GAP,
                ParameterSpec("contact_depth", "rad", 1e-10, 1.0, log=True),
                ParameterSpec("fade", "1", 0.0, 3.0),
            ),
            lambda problem: ((0.4 * _angle_sizes(problem)[1], 1.0),),
            (1,),
        ),
        (
            "off-centre",
            "K dz(Delta - D_0, gap/2), c acting in contact only",
            _backlash(0.0),
            (_GAP, ParameterSpec("centre", "1", -1.0, 1.0)),
            lambda problem: ((-0.7,), (0.7,)),
            (),
        ),
        (
            "hyperbolic",
            "K x + c x'^fade, x = Delta - (r_+ - r_-)/2, r_+- = ((Delta +- gap/2)^2 + (corner gap/2)^2)^(1/2)",
            _hyperbolic,
            (_GAP, ParameterSpec("corner", "1", 0.01, 1.0, log=True), ParameterSpec("fade", "1", 0.0, 3.0)),
            lambda problem: ((0.4, 1.0),),
            (),
        ),
        (
            "softplus",
            "K x + c x'^fade, x = s_+ - s_-, s_+- = w ln(1 + exp((+-Delta - gap/2)/w)), w = corner gap/2",
            _softplus,
            (
                _GAP,
                ParameterSpec("corner", "1", 0.01, SOFTEST_END, log=True),
                ParameterSpec("fade", "1", 0.0, 3.0),
            ),
            lambda problem: ((0.2, 1.0),),
            (),
        ),
        (
            "impact",
            "K x (1 + impact |x|'), x as with bends for corners, and c x'",
            _impact,
            (
                _GAP,
                ParameterSpec("corner", "1", 0.01, 1.0, log=True),
                ParameterSpec("impact", "s/rad", 0.0, 1e6),
            ),
            lambda problem: ((0.4, _impact_size(problem)),),
            (),
        ),
        (
            "cushioned",
            "K Delta - (1 - inside) K clip(Delta, +-gap/2): little of the spring is left in the gap",
            _cushioned,
            (_GAP, ParameterSpec("inside", "1", 0.0, 1.0 - SOFTEST)),
            lambda problem: ((0.05,),),
            (),
        ),
    )
)
