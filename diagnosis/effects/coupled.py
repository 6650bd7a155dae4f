r"""A bending arm whose bend lies so near the joint's own resonance that it moves that resonance.

The base, refitted without the bend, has taken stiffness and inertia to where they reproduce what was recorded: lambda =
K_0/J_0 and the response there, 1/J_0. With an outer part J_p on its own spring (w, clamped at the inner part), which hammer
and sensor follow by the shares h and s, the joint resonates at the same lambda and responds as much where

    r = lambda/(w^2 - lambda)                                   the outer part's bend over the joint's motion
    J_L = J_0 (1 + h r)(1 + s r) - J_p ((1 + r)^2 - 1)          modal inertia J_L - J_p + J_p (1 + r)^2
    K = lambda (J_L + J_p r)                                    the held joint's equation of motion

So the law is put on with K_0 and J_0 for the base's stiffness and inertia. A search that starts from the base then follows the
valley in which the resonance stays where it is; in K and J_L themselves that valley is curved and narrower than a
resonance is wide. What was found is written with K and J_L and without the law's own coordinates (``uncoupled``).

Facts used as tests: with J_p = 0 nothing changes; the held joint resonates at lambda for any w above it, and a hit answers
there as the base does.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from jointscope.diagnosis import kernel
from jointscope.diagnosis.assembly import BASE_INDEX
from jointscope.diagnosis.effects.modes import SPECS as MODES
from jointscope.diagnosis.effects.spec import ActiveEffect, EffectSpec, ParameterSpec, Values, needs_spring

if TYPE_CHECKING:
    from jointscope.diagnosis.assembly import Assembly
    from jointscope.diagnosis.problem import Problem

STARTS = (1.3, 1.8, 2.6, 3.6)  # times the joint's resonance; beyond, a bend moves it by less than it is wide
FRACTION = 0.05  # of the outer part's motion that hammer and sensor follow, where a search begins
NEAREST = 0.05  # of w^2, by which the bend is kept above the joint's resonance
LIGHTEST = 0.2  # of the base's inertia
SMALLEST, MOST = 2e-3, 0.9  # the same, of the outer part

PLAIN = next(spec for spec in MODES if spec.variant == "two-shapes")


def beside_bend(
    stiffness: float, inertia: float, frequency: float, outer: float, hit: float, sensed: float
) -> tuple[float, float]:
    """K [N m/rad] and J_L [kg m^2] with which the joint beside the bend answers as one of ``stiffness`` and ``inertia``.

    Args:
        stiffness, inertia: Of the base, K_0 and J_0.
        frequency: Of the outer part on the clamped inner one [Hz].
        outer: Its inertia J_p, which J_L holds [kg m^2].
        hit, sensed: Shares of its motion that hammer and sensor follow [-].
    """
    square, own = stiffness / inertia, (2.0 * math.pi * frequency) ** 2
    bend = square / max(own - square, NEAREST * own)
    whole = inertia * (1.0 + hit * bend) * (1.0 + sensed * bend) - outer * ((1.0 + bend) ** 2 - 1.0)
    whole = max(whole, LIGHTEST * inertia, outer / MOST)
    return square * (whole + outer * bend), whole


def uncoupled(
    stiffness: float, inertia: float, values: Values, plain: EffectSpec
) -> tuple[float, float, ActiveEffect]:
    """K, J_L and the law of two shapes that say the same as the coupled law with ``values`` beside K_0 and J_0."""
    frequency, outer, damping, hit, sensed = values
    k, whole = beside_bend(stiffness, inertia, frequency, outer, hit, sensed)
    share = math.sqrt(outer / whole)
    return k, whole, ActiveEffect(plain, (frequency, outer, damping, hit / share, sensed / share))


def _coupled(assembly: Assembly, values: Values, weight: float) -> None:
    P = assembly.P
    P[kernel.K], P[kernel.J_L], bend = uncoupled(P[kernel.K], P[kernel.J_L], values, PLAIN)
    PLAIN.apply(assembly, bend.values, weight)


def _starts(problem: Problem) -> tuple[Values, ...]:
    return tuple((factor * problem.scales.frequency, 0.02, FRACTION, FRACTION) for factor in STARTS)


def _limits(problem: Problem) -> dict[str, tuple[float, float]]:
    """A part of next to no inertia would be thrown to infinity by the share of a hit that it gets."""
    inertia = float(problem.base.start[BASE_INDEX["load_inertia"]])
    return {**PLAIN.limits(problem), "inertia": (SMALLEST * inertia, MOST * inertia)}


def _possible(problem: Problem) -> str | None:
    return needs_spring(problem) or PLAIN.possible(problem)


COUPLED: EffectSpec = replace(
    PLAIN,
    variant="coupled",
    parameters=(
        *PLAIN.parameters[:3],
        ParameterSpec("hit_fraction", "1", -2.0, 2.0),
        ParameterSpec("sensor_fraction", "1", -2.0, 2.0),
    ),
    law="bending mode beside which the joint resonates as the base does",
    apply=_coupled,
    starts=_starts,
    possible=_possible,
    limits=_limits,
    residual_starts=None,
)
