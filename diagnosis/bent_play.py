"""Play and a spring that is not straight, together: fitted to the first periods after each hit, then to more of them.

Both make the joint's frequency follow the level, play at the smallest levels and the spring at the largest. Alone each
stands in for the other, over a whole ring-down in a valley of its own; and from there the other is not found. Over the
first two periods a grid of both is searched, as play alone is (``ring_downs``).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from jointscope.diagnosis.assembly import BASE_INDEX
from jointscope.diagnosis.coordinates import coordinates
from jointscope.diagnosis.effects import ActiveEffect
from jointscope.diagnosis.ring_downs import FIRST, coarse, over_first, over_whole, struck_on_the_brake, within
from jointscope.diagnosis.screen import one_sided, trial_effects

if TYPE_CHECKING:
    from jointscope.diagnosis.base import Stage
    from jointscope.diagnosis.effects import EffectSpec
    from jointscope.diagnosis.objective import Objective
    from jointscope.diagnosis.refit import Fit
    from jointscope.diagnosis.search import Hypothesis

STIFFER = (0.85, 0.92, 1.0, 1.08, 1.16, 1.25)  # times the stiffness beside play alone
GAPS = (0.5, 1.0, 2.0)  # times the gap found alone
TRIED = 3  # starts of each law that are fitted to the first window
LAWS = 2  # of the spring, that are fitted to whole runs


def bent_play(
    stage: Stage, objective: Objective, base: Fit, play: Hypothesis, springs: Sequence[EffectSpec]
) -> list[Hypothesis]:
    """``play`` with each of ``springs`` beside it, fitted so; none where no held joint was hit.

    Args:
        stage: All runs that are fitted, and the noise beside the base.
        objective: The runs of the search, to which whole runs are fitted.
        base: What the base leaves of them.
        play: A law of play alone, fitted.
    """
    hits = struck_on_the_brake(stage)
    if not hits:
        return []
    hit, noise = replace(stage.objective, runs=hits, whiteners=()), stage.noise
    near = within(hit, noise, FIRST[0])
    begun = []
    for spec in springs:
        trials = list(_trials(near, play, spec))
        costs = near.map(lambda trial: near.misfit(*trial), trials)
        where = coarse(coordinates(near.problem, (*play.specs, spec)))
        starts = [where.pack(*trials[k]) for k in np.argsort(costs, kind="stable")[:TRIED]]
        begun.append(over_first(hit, noise, near, where, starts))
    return over_whole(hit, noise, objective, base, sorted(begun, key=lambda fit: fit.chi2)[:LAWS])


def _trials(
    near: Objective, play: Hypothesis, spec: EffectSpec
) -> Iterator[tuple[np.ndarray, tuple[ActiveEffect, ActiveEffect]]]:
    """Base parameters and the two effects, over a grid."""
    theta, (gap,) = play.fit.coordinates.unpack(play.fit.x)
    bent = trial_effects(spec, near.problem, (0, 1, 2))
    if not one_sided(spec):  # one that softens is as likely as one that stiffens
        bent += [
            ActiveEffect(spec, tuple(-v if k == spec.amplitude else v for k, v in enumerate(a.values)))
            for a in bent
        ]
    for factor in STIFFER:
        base = theta.copy()
        base[BASE_INDEX["stiffness"]] *= factor
        for wider in GAPS:
            there = ActiveEffect(gap.spec, (wider * gap.values[0], *gap.values[1:]))
            for spring in bent:
                yield base, (there, spring)
