r"""A mount or a neighbour that carries the joint, where hits or sweeps were made in several postures.

What carries the joint feels the arm by C(q) = (kappa + cos(q - q_e))/(1 + kappa): kappa = 0 where it slides along the
tangent at q = q_e, kappa = X/d where it turns about a parallel axis at the distance d in that direction, X = J_L/(m l) the
radius of the centre of percussion. So the modal share is share C^2, and a point of the arm at radius r moves by a + b/r
times what it moves at the joint (see ``modes``),

    a = kappa/(kappa + cos(q - q_e)),    b = X cos(q - q_e)/(kappa + cos(q - q_e)).

It also carries the arm's mass, less of it the more the arm gives way about its own joint: with M_12 what couples the two
(J_L + m l d cos(q - q_e), or m l cos(q - q_e) where it slides), its inertia against a free joint is M_22 - M_12^2/J_L,

    M(q)/M(q_e) = 1 + share sin^2(q - q_e)/(1 + kappa)^2,

by which its frequency squared, its share and twice its damping ratio times its frequency fall. q is the run's arm angle:
vibrations are small beside it, and in motions a carrier's mode is faint.

Facts used as tests: at a right angle to a sliding mount's direction nothing is seen of it; at q = q_e it is the mount of
``modes``; half a turn away a mount that slides is the same; the frequencies are those of two rigid bodies on their springs.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from jointscope.diagnosis.effects.modes import SPECS as MODES
from jointscope.diagnosis.effects.modes import carried, levered
from jointscope.diagnosis.effects.spec import EffectSpec, ParameterSpec, Values
from jointscope.diagnosis.effects.witnesses import contradicted

if TYPE_CHECKING:
    from jointscope.diagnosis.assembly import Assembly
    from jointscope.diagnosis.effects.lines import Residuals
    from jointscope.diagnosis.effects.spec import Possible, ResidualStarts, Starts
    from jointscope.diagnosis.problem import Problem

APART = 0.2  # rad between two postures that tell
NEXT_TO_NOTHING = 0.05  # of kappa + cos below which the levers would grow without bound
ON_AXIS = 15.0  # kappa of an axis beside the joint's own, which moves the arm alike in every posture: as the laws of one do
_DIRECTIONS = (0.0, math.pi / 3.0, -math.pi / 3.0)


def _turned(assembly: Assembly, values: Values, weight: float) -> None:
    frequency, share, damping, percussion, direction = values[:5]
    kappa = values[5] if len(values) > 5 else 0.0
    cosine = math.cos(assembly.run.initial_angle - direction)
    felt = kappa + cosine
    if abs(felt) < NEXT_TO_NOTHING:
        felt = math.copysign(NEXT_TO_NOTHING, felt)
    heavier = 1.0 + share * (1.0 - cosine**2) / (1.0 + kappa) ** 2
    share *= (felt / (1.0 + kappa)) ** 2 / heavier
    slower = math.sqrt(heavier)
    carried(assembly, (frequency / slower, share, damping / slower), kappa / felt, percussion * cosine / felt)


def _postures(possible: Possible) -> Possible:
    def turned(problem: Problem) -> str | None:
        angles = [run.initial_angle for run in problem.runs if run.spring and run.run.experiment != "speed-motion"]
        if problem.rig.motion != "rotational" or not angles or max(angles) - min(angles) < APART:
            return "hits and sweeps were made in one posture"
        return possible(problem)

    return turned


def _in_each(starts: Starts, tail: Values) -> Starts:
    return lambda problem: tuple((*start, way, *tail) for way in _DIRECTIONS for start in starts(problem))


def _peaks_in_each(peaks: ResidualStarts, tail: Values) -> ResidualStarts:
    def starts(problem: Problem, residuals: Residuals) -> tuple[Values, ...]:
        found = peaks(problem, residuals)[::2]  # one width of each
        return tuple((*start, way, *tail) for start in found for way in _DIRECTIONS)

    return starts


def _specs() -> tuple[EffectSpec, ...]:
    sliding = next(spec for spec in MODES if spec.variant == "sliding-mount")
    assert sliding.residual_starts is not None
    direction = ParameterSpec("direction", "rad", -math.pi, math.pi)
    kappa = ParameterSpec("eccentricity", "1", -0.9, 50.0)
    mount = replace(
        sliding,
        variant="sliding-mount-turned",
        parameters=(*sliding.parameters, direction),
        law="the mount slides along one direction, which the arm's posture meets more or less",
        apply=_turned,
        starts=_in_each(sliding.starts, ()),
        possible=_postures(sliding.possible),
        residual_starts=_peaks_in_each(sliding.residual_starts, ()),
    )
    carrier = replace(
        mount,
        name="neighbour-flexibility",
        location="neighbour",
        variant="carrier-turned",
        parameters=(*mount.parameters, kappa),
        law="a neighbour that carries the joint turns about a parallel axis, which lies differently in each posture",
        look_alikes=("link-flexibility", "base-compliance", "sensor-resonance", "structural-damping"),
        possible=_postures(lambda problem: levered(problem) or contradicted(problem, "neighbour")),
        starts=lambda problem: tuple(
            (*start, kappa) for kappa in (0.5, ON_AXIS) for start in mount.starts(problem)[::7]
        ),
        residual_starts=None,
    )
    return mount, carrier


SPECS: tuple[EffectSpec, ...] = _specs()
