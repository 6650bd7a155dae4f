"""Modes so heavy that the base beside them is lost: begun where the data as they stand say, fitted under noise of their own.

A neighbour that carries the joint couples into it differently in each posture, so that no joint rings as the hits of all
postures do. What the base then leaves is as large as they are, and under that noise no trial is nearer than another. Each kind
of channel weighed by its own size tells them apart; the joint itself may be about what the base has made of it.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.afresh import under_noise_of_its_own
from jointscope.diagnosis.assembly import BASE_INDEX
from jointscope.diagnosis.base import Stage, representative, worst_misfit
from jointscope.diagnosis.coordinates import coordinates
from jointscope.diagnosis.heavy_modes import (
    FREQUENCIES,
    SHARES,
    TURNED,
    groups,
    heavy_laws,
    moved,
    posed,
    rung,
)
from jointscope.diagnosis.noise import white
from jointscope.diagnosis.objective import whitened
from jointscope.diagnosis.refit import with_fresh_jacobian
from jointscope.diagnosis.search import Hypothesis, profile_loss

if TYPE_CHECKING:
    from jointscope.diagnosis.effects import ActiveEffect
    from jointscope.diagnosis.objective import Objective
    from jointscope.diagnosis.refit import Fit

Vector = NDArray[np.float64]
Start = tuple[Vector, tuple["ActiveEffect", ...]]

LOST = 0.3  # of the data's rms, left by the base in its worst kind of channel
HITS, OTHERS = 9, 1  # runs of a kind over which starts are compared: hits of every posture
NEARER = 0.6  # of what the base leaves there, white, that the nearest start may leave
TRIED = 3  # starts fitted


def far_modes(
    stage: Stage, objective: Objective, parent: Fit, candidates: Sequence[ActiveEffect]
) -> list[Hypothesis]:
    """The laws of a heavy mode that come nearest to the data, fitted; none where the base is near, or no start much nearer.

    Args:
        objective: Under whose noise the fits are compared with others.
        parent: The base, fitted to the runs of ``objective``.
        candidates: Trials of every law.
    """
    problem = stage.objective.problem
    theta, effects = parent.coordinates.unpack(parent.x)
    lost = worst_misfit(objective.prepared, objective.predictions(theta, effects)) > LOST
    if not lost or theta[BASE_INDEX["stiffness"]] <= 0.0:
        return []
    noise = white(stage.objective.prepared)
    own = whitened(stage.objective, noise, None)
    few = own.restricted(tuple(own.runs.index(i) for i in representative(problem, own.runs, HITS, OTHERS)))
    found = []
    for trial in heavy_laws(candidates, ()):
        peaks = rung(problem)
        laid = [*groups(theta, problem.base.start, peaks, trial), *_as_it_is(theta, trial)]
        for starts in filter(None, laid):
            trials: list[Start] = [(base, (active,)) for base, active in starts]
            nearest = trials[few.nearest(trials)]
            found.append((few.misfit(*nearest), nearest))
    found = [pair for pair in sorted(found, key=lambda pair: pair[0]) if pair[0] < NEARER * few.misfit(theta, ())]
    fitted = []
    for _, (base, active) in found[:TRIED]:
        where = coordinates(problem, tuple(a.spec for a in active))
        fit = with_fresh_jacobian(objective, under_noise_of_its_own(own, noise, where, where.pack(base, active)))
        if fit.chi2 < parent.chi2:
            fitted.append(Hypothesis(where.effects, fit, profile_loss(objective, fit.w)))
    return fitted


def _as_it_is(theta: Vector, trial: ActiveEffect) -> Iterator[list[tuple[Vector, ActiveEffect]]]:
    """Starts beside the joint as the base has it, where the mode lies differently in each posture."""
    if trial.spec.variant not in TURNED:
        return
    squared = float(theta[BASE_INDEX["stiffness"]] / theta[BASE_INDEX["load_inertia"]])
    load = float(theta[BASE_INDEX["load_inertia"]])
    for ways in posed(trial):
        yield [
            (theta, moved(way, squared * factor**2, share, load))
            for way in ways
            for factor, share in itertools.product(FREQUENCIES, SHARES)
        ]
