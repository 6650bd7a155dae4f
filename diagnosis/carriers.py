r"""A mount or a neighbour that carries the joint, started from every posture's own stiffness.

What carries the joint gives way beneath it, in posture q by C(q)^2, C = (kappa + cos(q - q_e))/(1 + kappa) (see
``effects.postures``). At the joint's own resonance w, below the carrier's w_c, the joint seems as much softer as

    1/K(q) = 1/K + B (kappa + cos(q - q_e))^2,    B = share/((1 + kappa)^2 J_L w_c^2 (1 - w^2/w_c^2)).

The base, refitted without the carrier, has the stiffness of one posture; in another one its ring-down is out of step
before it is over, and no trial that begins at that stiffness is near. But each run's own stiffness is found by itself, and
over the postures 1/K and B are found by least squares for every kappa and q_e; any w_c has a share that says the same.

Fact used as test: K and B are found again from stiffnesses that were made by them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.assembly import BASE_INDEX
from jointscope.diagnosis.by_posture import own_stiffness
from jointscope.diagnosis.coordinates import coordinates
from jointscope.diagnosis.effects import ActiveEffect
from jointscope.diagnosis.effects.modes import percussion
from jointscope.diagnosis.refit import least_squares
from jointscope.diagnosis.search import Hypothesis, profile_loss

if TYPE_CHECKING:
    from jointscope.diagnosis.base import Stage
    from jointscope.diagnosis.effects import EffectSpec
    from jointscope.diagnosis.objective import Objective

Vector = NDArray[np.float64]

POSTURES = 3  # of hits or sweeps, from which on they are asked
SEEN = 6.0  # standard errors by which their stiffnesses differ
DIRECTIONS = np.linspace(-math.pi, math.pi, 25)[:-1]  # rad
ECCENTRICITIES = {"sliding-mount-turned": (0.0,), "carrier-turned": (0.4, 0.8, 1.6, 3.0, 6.0)}  # kappa, by law
KEPT = 3  # lines over the postures of each law, the nearest
ABOVE = (1.5, 2.0, 2.7, 3.6, 5.0)  # times the joint's resonance, where a carrier's may lie
DAMPING = 0.03
FITTED = 2  # starts of each law that are fitted, those nearest to the data ...
STEPS, SIMULATIONS = 20, 160  # ... and how far


@dataclass(frozen=True)
class Softening:
    """How the joint gives way by posture.

    Attributes:
        left: Sum of squares over the postures' variances [-].
        stiffness: K [N m/rad].
        compliance: B [rad/(N m)].
        eccentricity, direction: kappa [-] and q_e [rad].
    """

    left: float
    stiffness: float
    compliance: float
    eccentricity: float
    direction: float


def softenings(
    angles: Vector, stiffness: Vector, errors: Vector, eccentricities: Sequence[float]
) -> list[Softening]:
    """The lines over postures that come nearest, of each direction the best, nearest first.

    Args:
        angles: Of the runs [rad], shape (n,).
        stiffness, errors: Their own, and its standard error [N m/rad], same shape.
    """
    weight = stiffness**2 / np.maximum(errors, 1e-9 * stiffness)
    found = []
    for direction in DIRECTIONS:
        lines = []
        for kappa in eccentricities:
            felt = np.square(kappa + np.cos(angles - direction))
            columns = np.stack([weight, weight * felt], axis=1)
            (stiff, soft), *_ = np.linalg.lstsq(columns, weight / stiffness, rcond=None)
            if stiff > 0.0 and soft > 0.0:
                left = float(np.sum(np.square(columns @ (stiff, soft) - weight / stiffness)))
                lines.append(Softening(left, 1.0 / float(stiff), float(soft), kappa, float(direction)))
        found.extend(sorted(lines, key=lambda line: line.left)[:1])
    return sorted(found, key=lambda line: line.left)


def carriers(stage: Stage, objective: Objective, specs: Sequence[EffectSpec]) -> list[Hypothesis]:
    """The best fit of every law by posture among ``specs``, from where the postures' stiffnesses put it.

    Args:
        stage: The refitted base.
        objective: What they are fitted to.
    """
    problem, theta = stage.objective.problem, stage.fit.coordinates.unpack(stage.fit.x)[0]
    laws = [s for s in specs if s.variant in ECCENTRICITIES and s.possible(problem) is None]
    if not laws or BASE_INDEX["stiffness"] not in stage.fit.coordinates.free:
        return []
    angles, steps, errors = own_stiffness(stage)
    if len(np.unique(np.round(angles, 1))) < POSTURES or np.ptp(steps) < SEEN * float(np.median(errors)):
        return []
    own = theta[BASE_INDEX["stiffness"]] * np.maximum(1.0 + steps, 0.1)
    found = []
    for spec in laws:
        lines = softenings(angles, own, errors * theta[BASE_INDEX["stiffness"]], ECCENTRICITIES[spec.variant])
        where = coordinates(problem, (spec,))
        starts = [where.pack(*start) for line in lines[:KEPT] for start in _starts(spec, line, theta, stage)]
        costs = [profile_loss(objective, objective.residual(x, where)) for x in starts]
        fits = [
            least_squares(objective, where, starts[k], iterations=STEPS, tolerance=2e-3, simulations=SIMULATIONS)
            for k in np.argsort(costs)[:FITTED]
        ]
        fitted = [Hypothesis((spec,), fit, profile_loss(objective, fit.w)) for fit in fits]
        found.extend(sorted(fitted, key=lambda h: h.loss)[:1])
    return found


def _starts(
    spec: EffectSpec, line: Softening, theta: Vector, stage: Stage
) -> Iterator[tuple[Vector, tuple[ActiveEffect, ...]]]:
    """Base and effect for each frequency that the carrier may have."""
    problem, base = stage.objective.problem, theta.copy()
    inertia = float(theta[BASE_INDEX["load_inertia"]])
    base[BASE_INDEX["stiffness"]] = line.stiffness
    w = math.sqrt(line.stiffness / inertia)
    most = next(p.upper for p in spec.parameters if p.name == "modal_share")
    for above in ABOVE:
        square = (above * w) ** 2
        share = line.compliance * (1.0 + line.eccentricity) ** 2 * inertia * square * (1.0 - above**-2)
        if share < most:
            values = (
                above * w / math.tau, share, DAMPING, percussion(problem, inertia), line.direction, line.eccentricity,
            )  # fmt: skip
            yield base, (ActiveEffect(spec, values[: len(spec.parameters)]),)
