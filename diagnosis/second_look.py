"""What else explains something under the noise that the decided model leaves, over all fitted runs.

The search weighs every sample alike: there the slow part of an angle, or a ring-down that no law follows yet, hides what is
a hundred nats under coloured noise. Above all it hides effects that undo each other, a late log and a late torque, each of
which is nothing alone. So every law is scored once more on top of what was decided, and the leading ones are fitted. What
a trial does was simulated by the search; only lines and modes start anew, from what is left, and far from the base a few
sizes of every law.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.adjudicate import Judged, Judgement, compare, evidence
from jointscope.diagnosis.base import Stage
from jointscope.diagnosis.candidates import candidates_for, residuals_of, where_shown
from jointscope.diagnosis.carried import carried
from jointscope.diagnosis.extensions import AFAR, some_of_each
from jointscope.diagnosis.gates import LOST_UNREACHED, REAL_FURTHER, REAL_UNREACHED
from jointscope.diagnosis.per_run import per_run_specs
from jointscope.diagnosis.polish import polished
from jointscope.diagnosis.refit import unspent, with_fresh_jacobian
from jointscope.diagnosis.rivals import grown, laws_of
from jointscope.diagnosis.screen import screen, tangent
from jointscope.diagnosis.search import (
    CONTAINED,
    Effort,
    Hypothesis,
    Screening,
    fit_leading,
    leaders,
    name_of,
    nested,
    over_all_runs,
)

if TYPE_CHECKING:
    from jointscope.diagnosis.effects import EffectSpec
    from jointscope.diagnosis.objective import Objective

FITTED = 3  # of the leading candidates
AHEAD = 40.0  # of w'w, by which a law that contains another one must explain more


def second_look(
    judgement: Judgement, chosen: Judged, before: Screening, specs: Sequence[EffectSpec], effort: Effort
) -> list[Hypothesis]:
    """The chosen set with one effect more, wherever that is real and carries over to the held-out runs.

    Args:
        before: The screening on top of the base; near that, a trial need not be simulated again.
        specs: The laws that may be named.
    """
    objective, parent = judgement.objective, chosen.hypothesis
    if len(parent.names) >= effort.size:
        return []
    left = residuals_of(objective, chosen.predictions)
    as_decided = Stage(objective, parent.fit, judgement.noise, chosen.predictions)
    # the base's own sorting of the runs is among those that were tried
    by_runs = per_run_specs(as_decided, objective.problem) if parent.names else ()
    taken = parent.names
    free = [s for s in (*specs, *by_runs) if name_of(s) not in taken and not nested(name_of(s), taken)]
    fit = with_fresh_jacobian(objective, replace(parent.fit, fresh=False))
    few, rows = _runs_of(before, objective)
    parents = tangent(fit.w[rows], unspent(fit)[rows])
    known = {id(spec) for spec in free}
    tried = [t for t in before.trials if id(t.spec) in known]
    seen = [s for s in free if s.possible(objective.problem) is None]
    anew = [*where_shown(objective.problem, seen, left, (0, 1), 1), *candidates_for(objective.problem, by_runs)]
    if parent.names and compare(judgement, judgement.base, chosen).gain > AFAR:
        anew.extend(some_of_each(tried))
    scored = [*carried(tried, before.objective, few, parents), *screen(few, fit, parents, fit.w[rows], anew)]
    leading, _ = over_all_runs(objective, fit, scored, effort)
    trials = leaders(leading, FITTED, 2.0 * REAL_FURTHER, taken)
    found = []
    for trial in trials:
        for child in fit_leading(objective, fit, parent.specs, [trial], effort):
            judged = evidence(polished(objective, child), objective, judgement.held)
            against = compare(judgement, chosen, judged)
            much = against.gain > REAL_UNREACHED and against.lost < LOST_UNREACHED  # by noise that is full of it
            if against.gain > REAL_FURTHER and (against.carries_over or much):
                found.append(judged.hypothesis)
    return [*found, *_wider(judgement, parent, specs, effort)]


def _wider(
    judgement: Judgement, parent: Hypothesis, specs: Sequence[EffectSpec], effort: Effort
) -> list[Hypothesis]:
    """The law that contains a single effect's, begun from that effect's own numbers, where it explains more.

    Which of its forms an effect has may turn out late; the wider law's fits were begun beside another one then, and what
    holds the narrower law explains at least as much.
    """
    if len(parent.specs) != 1:
        return []
    (narrow,), objective = parent.specs, judgement.objective
    wider = [s for s in specs if (narrow.name, s.name) in CONTAINED and s.location == narrow.location]
    if not wider:
        return []
    most = parent.fit.chi2 - AHEAD
    known = {laws_of(j.hypothesis.specs) for j in judgement.judged if j.fit.chi2 < most}
    found = grown(objective, judgement.base.fit, parent, candidates_for(objective.problem, wider), effort, known)
    return [h for h in found if h.fit.chi2 < most]


def _runs_of(before: Screening, objective: Objective) -> tuple[Objective, NDArray[np.intp]]:
    """The runs of the screening within those of ``objective``, and their rows."""
    positions = [objective.runs.index(run) for run in before.objective.runs]
    return objective.restricted(positions), objective.rows(positions)
