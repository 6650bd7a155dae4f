"""The base as it foretells best: refitted under its own noise, or under what the best hypothesis leaves.

A hypothesis is weighed against the base under the noise that the best one leaves. Where that is small, the base refitted
under it bends its parameters to what it cannot explain, and foretells held-out runs far worse than the plain refit would: a
gain over that is none. So what is shown and handed on as the base, and what a named effect must beat, is the better one.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from jointscope.diagnosis.adjudicate import evidence
from jointscope.diagnosis.errors import Free, channel_errors, mean_error
from jointscope.diagnosis.polish import viewed
from jointscope.diagnosis.search import Hypothesis

if TYPE_CHECKING:
    from jointscope.diagnosis.pipeline import Diagnosis
    from jointscope.diagnosis.refit import Fit

BETTER = 0.99  # of the error that the judged base has of held-out runs, below which the plain one takes its place


def with_plain_base(diagnosis: Diagnosis, free: Free) -> Diagnosis:
    """The same with the base's plain refit in place of the judged one, where it foretells the held-out runs better."""
    judgement, decision, held = diagnosis.judgement, diagnosis.decision, diagnosis.split.held_out
    if not held:
        return diagnosis

    def error(fit: Fit) -> float:
        theta, none = fit.coordinates.unpack(fit.x)
        return mean_error(channel_errors(diagnosis.problem, free, held, theta, none, judgement.noise))

    before, plain = judgement.base, diagnosis.stage.fit
    if not error(plain) < BETTER * error(before.fit):
        return diagnosis
    objective = judgement.objective
    base = evidence(viewed(objective, Hypothesis((), plain, 0.0)), objective, judgement.held)
    judgement = replace(judgement, judged=(base, *judgement.judged[1:]))
    ranking = tuple(replace(r, judged=base) if r.judged is before else r for r in decision.ranking)
    chosen = base if decision.chosen is before else decision.chosen
    return replace(diagnosis, judgement=judgement, decision=replace(decision, ranking=ranking, chosen=chosen))
