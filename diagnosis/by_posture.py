"""A stiffness that varies with the arm's angle, started from every run's own stiffness.

Hits and sweeps in several postures each have one angle, and so one stiffness, K (1 + s sin(order q + phase)). A hundredth
of it has a ring-down out of step before it is over, so that no trial is near by chance; but each run's own stiffness is
found by itself, and over the angles a line of each order is fitted to them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.drifts import telling
from jointscope.diagnosis.effects import ActiveEffect
from jointscope.diagnosis.effects.strangers import TURNS
from jointscope.diagnosis.per_run import run_steps

if TYPE_CHECKING:
    from jointscope.diagnosis.base import Stage
    from jointscope.diagnosis.effects import EffectSpec

Vector = NDArray[np.float64]

KEPT = 2  # orders, the best
NUMBERS = 3  # of a line: a mean, a sine and a cosine


@lru_cache(maxsize=1)  # all laws by posture ask the same
def own_stiffness(stage: Stage) -> tuple[Vector, Vector, Vector]:
    """Angle [rad], own relative departure of K [-] and its standard error of the hits and sweeps that tell, shape (n,) each."""
    runs = stage.objective.problem.runs
    steps, errors = run_steps(stage, "stiffness")
    still = np.array([r.run.experiment != "speed-motion" and r.spring for r in runs])
    known = telling(steps, np.where(still, errors, np.inf))
    return np.array([r.initial_angle for r in runs])[known], steps[known], errors[known]


def by_posture(stage: Stage, specs: Sequence[EffectSpec]) -> list[ActiveEffect]:
    """Trials of what varies with every turn of the output among ``specs``; none where too few runs tell."""
    problem = stage.objective.problem
    turning = [s for s in specs if s.name == "stiffness-by-turn" and s.variant == "output-order"]
    turning = [s for s in turning if s.possible(problem) is None]
    if not turning:
        return []
    angles, values, _ = own_stiffness(stage)
    if len(np.unique(np.round(angles, 3))) <= NUMBERS:
        return []
    found = []
    for order in TURNS:
        columns = np.stack([np.ones_like(angles), np.sin(order * angles), np.cos(order * angles)], axis=1)
        (mean, sine, cosine), *_ = np.linalg.lstsq(columns, values, rcond=None)
        left = float(np.sum(np.square(values - columns @ (mean, sine, cosine))))
        found.append((left, math.hypot(sine, cosine) / (1.0 + mean), order, math.atan2(cosine, sine)))
    return [ActiveEffect(spec, tuple(line)) for spec in turning for _, *line in sorted(found)[:KEPT]]
