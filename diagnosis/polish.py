"""Refits under the common noise: of what leads, of the base from elsewhere, of every part of the leading set."""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.base import relative_misfit
from jointscope.diagnosis.per_run import labelling_cost
from jointscope.diagnosis.refit import least_squares, with_fresh_jacobian
from jointscope.diagnosis.rivals import without
from jointscope.diagnosis.screen import resized
from jointscope.diagnosis.search import NEARLY_NOTHING, Effort, Hypothesis, fit_child, names_of

if TYPE_CHECKING:
    from jointscope.diagnosis.coordinates import Coordinates
    from jointscope.diagnosis.objective import Objective

Vector = NDArray[np.float64]

LIGHTLY = 0.1  # of the stated damping, another start
POLISHING = 40  # simulations of all runs that a refit may take
BEYOND_DOUBT = 300.0  # nats by which a hypothesis leads the base, so that nothing far behind it can matter ...
FAR_BEHIND = 0.2  # ... which is what gains less than this of what it does
ANOTHER_FORM = (
    0.1  # of what the leader gains, by which another law of the same names may be behind the best of them
)
AWAY, AFAR = 0.3, 1.5  # of the data, left by a base, and times what it left before: it has fled from them
POLISHED = 3  # leading hypotheses that are refitted under the final noise
LED_BY = 3  # leading hypotheses whose parts are kept however little they gain


def viewed(objective: Objective, hypothesis: Hypothesis) -> Hypothesis:
    """The hypothesis as it stands under the noise of ``objective``."""
    w = objective.residual(hypothesis.fit.x, hypothesis.fit.coordinates)
    fit = replace(hypothesis.fit, w=w, fresh=False)
    return replace(hypothesis, fit=fit, loss=0.5 * fit.chi2 + occam(hypothesis, len(w)))


def anew(objective: Objective, hypotheses: Sequence[Hypothesis]) -> list[Hypothesis]:
    """Those that are worth judging under the noise of ``objective``, as they stand under it; the base comes first."""
    return worth_judging([viewed(objective, h) for h in hypotheses])


def worth_judging(hypotheses: Sequence[Hypothesis]) -> list[Hypothesis]:
    """The base, which comes first, and of the rest what is not far behind a leader that is beyond doubt.

    Parts of the leading sets are kept: each set is asked what it adds to them. Of the laws of one set of names those are left
    out that are further behind its best than a form of the right law may be.
    """
    base, *others = hypotheses
    leading = sorted(others, key=lambda h: h.loss)[:LED_BY]
    most = base.loss - leading[0].loss if leading else 0.0
    if most < BEYOND_DOUBT:
        return [base, *others]
    parts = [set(h.names) for h in leading]
    best: dict[tuple[str, ...], float] = {}
    for h in others:
        best[h.names] = min(best.get(h.names, math.inf), h.loss)
    reach = max(BEYOND_DOUBT, ANOTHER_FORM * most)
    near = (h for h in others if h.loss - best[h.names] <= reach)
    kept = (h for h in near if base.loss - h.loss > FAR_BEHIND * most or any(set(h.names) <= p for p in parts))
    return [base, *kept]


def polished(objective: Objective, hypothesis: Hypothesis) -> Hypothesis:
    """The hypothesis refitted under the noise of ``objective``, from where it stands."""
    fit = least_squares(
        objective, hypothesis.fit.coordinates, hypothesis.fit.x, iterations=8, simulations=POLISHING
    )
    return replace(hypothesis, fit=fit, loss=0.5 * fit.chi2 + occam(hypothesis, len(fit.w)))


def beside_the_data(objective: Objective, before: Hypothesis, after: Hypothesis) -> Hypothesis:
    """A base refitted, or as it was where the refit fled from the data.

    Under the noise of a better model, in which hits scatter, a base that predicts next to nothing of them may cost less
    than one whose ringing goes out of step: all of it is a scatter then. It is a base of nothing all the same.
    """
    left = [
        relative_misfit(objective.prepared, objective.predictions(*h.fit.coordinates.unpack(h.fit.x)))
        for h in (before, after)
    ]
    if left[1] <= max(AWAY, AFAR * left[0]):
        return after
    return replace(before, fit=with_fresh_jacobian(objective, replace(before.fit, fresh=False)))


def leaders_polished(objective: Objective, hypotheses: Sequence[Hypothesis]) -> list[Hypothesis]:
    """The hypotheses, the base first, with it, the leading ones and the best of each of their parts refitted."""
    base, *others = hypotheses
    leading = sorted(others, key=lambda h: h.loss)[:POLISHED]
    parts: dict[tuple[str, ...], Hypothesis] = {}
    for h in sorted(others, key=lambda h: h.loss):
        if any(set(h.names) < set(lead.names) for lead in leading):
            parts.setdefault(h.names, h)
    again = {id(h) for h in (*leading, *parts.values())}
    first = beside_the_data(objective, base, polished(objective, base))
    return [first, *(polished(objective, h) if id(h) in again else h for h in others)]


def _stated(objective: Objective, where: Coordinates) -> tuple[Vector, Vector]:
    """The base parameters as the campaign states them, and the same hardly damped."""
    ringing = where.start.copy()
    ringing[[name.startswith("damping") for name in objective.problem.base.names]] *= LIGHTLY
    return where.start, ringing


def from_elsewhere(objective: Objective, base: Hypothesis, leading: Sequence[Hypothesis]) -> Hypothesis:
    """The base refitted also from where the campaign and the leading hypotheses have its parameters.

    No effect may stand on having found the base's own better optimum.
    """
    where = base.fit.coordinates
    found = [base.fit]
    starts = [h.fit.coordinates.unpack(h.fit.x)[0] for h in leading]
    if all(run.mode != "braked" for run in objective.prepared):  # hits leave one optimum, motions several
        starts.extend(_stated(objective, where))
    for start in starts:
        fit = least_squares(objective, where, where.pack(start, ()), iterations=5, tolerance=1e-2, simulations=30)
        found.append(fit)
    best = min(found, key=lambda fit: fit.chi2)
    if best is base.fit:
        return base
    return beside_the_data(objective, base, polished(objective, replace(base, fit=best)))


def parts_of(
    objective: Objective, leader: Hypothesis, known: Collection[tuple[str, ...]] = ()
) -> list[Hypothesis]:
    """Every smaller set of the leading one's effects, refitted from its numbers, but for those of ``known`` names.

    No effect may stand on having shown its companions the way to their better optimum.
    """
    found = []
    for size in range(1, len(leader.specs)):
        for dropped in itertools.combinations(range(len(leader.specs)), size):
            if names_of(spec for k, spec in enumerate(leader.specs) if k not in dropped) in known:
                continue
            fit = leader.fit
            for position in reversed(dropped):
                fit = without(objective, fit, position)
            found.append(polished(objective, Hypothesis(fit.coordinates.effects, fit, math.nan)))
    return found


def no_part_below_the_base(objective: Objective, hypotheses: Sequence[Hypothesis]) -> list[Hypothesis]:
    """The hypotheses, the base first, with every part of a set that explains something fitted anew where it lost to the base.

    The base is a part of every set, so such a fit is in a valley of its own, and anything would stand over it.
    """
    base, *others = hypotheses
    sets = [set(h.names) for h in others if h.fit.chi2 < base.fit.chi2]
    best = {h.names: h for h in sorted(others, key=lambda h: -h.fit.chi2)}
    lost = {
        id(h)
        for names, h in best.items()
        if h.fit.chi2 > base.fit.chi2 and any(set(names) < larger for larger in sets)
    }
    return [base, *(_from_the_base(objective, base, h) if id(h) in lost else h for h in others)]


def _from_the_base(objective: Objective, base: Hypothesis, lost: Hypothesis) -> Hypothesis:
    _, effects = lost.fit.coordinates.unpack(lost.fit.x)
    fit = fit_child(objective, base.fit, effects, Effort())
    if fit is None:  # it explains nothing
        theta, _ = base.fit.coordinates.unpack(base.fit.x)
        where = lost.fit.coordinates
        x = where.pack(theta, tuple(resized(e, NEARLY_NOTHING) for e in effects))
        fit = replace(lost.fit, x=x, w=objective.residual(x, where), fresh=False)
    return replace(lost, fit=fit, loss=0.5 * fit.chi2 + occam(lost, len(fit.w)))


def occam(hypothesis: Hypothesis, samples: int) -> float:
    """k/2 ln(nu) of the effects' parameters, and what the choice of their runs costs [nats]."""
    where = hypothesis.fit.coordinates
    chosen_runs = sum(labelling_cost(spec) for spec in where.effects)
    return 0.5 * (where.n - where.n_base) * math.log(max(samples, 2)) + chosen_runs
