r"""An arm that bends at an elbow: each accelerometer and each hit at its own place along the outer part.

Beyond the radius r_e the arm turns by a further angle psi, so a point at r moves by r q + (r - r_e)+ psi, where x+ is x
above nought and nought below. With c = int r (r - r_e) dm and m = int (r - r_e)^2 dm over the outer part,

    m psi'' + c q'' + ... = (r_h - r_e)+ F,    p = psi m/c,    J_p = c^2/m,    kappa = c/m
    J_p (q'' + p'' + 2 zeta w p' + w^2 p) = kappa (1 - r_e/r_h)+ T_ext,    sensor at r: q'' + kappa (1 - r_e/r)+ p''

which is the bend of ``modes`` with its two shapes read at every radius instead of one for all. As there kappa =
shape sqrt(J_p/J_L), so that the bend vanishes with J_p.

A bar that is clamped there and bends along its length moves by a power of (r - r_e)+ instead, lengths in metres:
((r_h - r_e)+)^curve / r_h and ((r - r_e)+)^curve / r.

Facts used as tests: what lies inboard of the elbow reads and drives none of the mode; sensors at one radius and hits at
one radius see the law of two shapes.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

from jointscope.diagnosis import kernel
from jointscope.diagnosis.assembly import beyond
from jointscope.diagnosis.effects.lines import Residuals
from jointscope.diagnosis.effects.modes import SPECS as MODES
from jointscope.diagnosis.effects.modes import hammer_radius
from jointscope.diagnosis.effects.one_sensor import accelerometer_radii
from jointscope.diagnosis.effects.spec import EffectSpec, ParameterSpec, Values

if TYPE_CHECKING:
    from jointscope.diagnosis.assembly import Assembly
    from jointscope.diagnosis.problem import Problem

PLAIN = next(spec for spec in MODES if spec.variant == "one-shape")
SHAPE = 5.0  # where a search begins: a bar of a fifth of the arm's inertia is lighter outside and longer inside
INNERMOST = 0.5  # of the smallest radius, one elbow to begin with


def _radii(problem: Problem) -> tuple[set[float], set[float]]:
    """Radii [m] of the accelerometers on the arm, and of the hits."""
    tangential = (o for run in problem.runs for o in run.outputs if o.direction == "tangential")
    hit = {float(f"{r:.4g}") for r in map(hammer_radius, problem.runs) if math.isfinite(r)}
    return set(accelerometer_radii(tangential)), hit


def _elbows(problem: Problem) -> list[float]:
    seen, hit = _radii(problem)
    places = sorted(seen | hit)
    return [INNERMOST * places[0], *(0.5 * (a + b) for a, b in pairwise(places))]


def _possible(problem: Problem) -> str | None:
    if problem.rig.motion == "translational":
        return "a carriage has no elbow"
    seen, hit = _radii(problem)
    if not seen or len(seen) + len(hit) < 3:
        return "an elbow shows between accelerometers or hits at several radii"
    return PLAIN.possible(problem)


def _apply(assembly: Assembly, values: Values, weight: float) -> None:
    elbow, curve = (*values[4:], 1.0)[:2]
    PLAIN.apply(assembly, values[:4], weight)
    assembly.elbow, assembly.curve = elbow, curve
    assembly.P[kernel.LINK_HIT] *= beyond(hammer_radius(assembly.run), elbow, curve)


def _starts(problem: Problem) -> tuple[Values, ...]:
    plain = PLAIN.starts(problem)
    return tuple((*values[:-1], SHAPE, elbow) for values in plain for elbow in _elbows(problem))


def _residual_starts(problem: Problem, residuals: Residuals) -> tuple[Values, ...]:
    shown = PLAIN.residual_starts(problem, residuals) if PLAIN.residual_starts else ()
    return tuple((*values[:-1], SHAPE, elbow) for values in shown for elbow in _elbows(problem))


def _limits(problem: Problem) -> dict[str, tuple[float, float]]:
    seen, hit = _radii(problem)
    return {**PLAIN.limits(problem), "elbow_radius": (0.0, 0.98 * max(seen | hit, default=1.0))}


ELBOW: EffectSpec = replace(
    PLAIN,
    variant="elbow",
    parameters=(
        *PLAIN.parameters[:3],
        ParameterSpec("shape", "1", -40.0, 40.0, scales_size=True),
        ParameterSpec("elbow_radius", "m", 0.0, 1e3, scales_size=True),
    ),
    law="the arm bends at an elbow; hammer and sensors follow by how far beyond it they are",
    apply=_apply,
    starts=_starts,
    possible=_possible,
    limits=_limits,
    residual_starts=_residual_starts,
)


def _straight(problem: Problem) -> tuple[Values, ...]:
    """One start, an elbow's: it is found from one, see ``freer.FREER``."""
    return tuple((*values, 1.0) for values in _starts(problem)[:1])


CANTILEVER: EffectSpec = replace(
    ELBOW,
    variant="cantilever",
    parameters=(*ELBOW.parameters, ParameterSpec("curve", "1", 0.3, 5.0)),
    law="the arm bends along its length; hammer and sensors follow by a power of how far beyond the clamp they are",
    starts=_straight,
    residual_starts=None,
)
