"""Where three effects lead together: the two of them that hold by themselves.

A third effect has mostly stood in for a form that is a little wrong, or for physics outside the table, so three are no
answer (``verdict.TOO_MANY``). What two of them explain is not lost by it: where they are an answer without any set of
three, and the third adds less than half of what they explain, they are named, and the third stays in the ranking.
"""

from __future__ import annotations

from dataclasses import replace

from jointscope.diagnosis.adjudicate import Judgement
from jointscope.diagnosis.outside import resembled
from jointscope.diagnosis.verdict import MORE_LEFT, TOO_MANY, Decision, decide


def answered(judgement: Judgement) -> Decision:
    """The verdict on the evidence, of three effects that lead the two that are an answer by themselves."""
    decision = decide(judgement)
    top = decision.ranking[0]
    if decision.verdict != "unknown" or len(top.names) < TOO_MANY or resembled(top.judged) is not None:
        return decision
    within = decide(replace(judgement, judged=tuple(j for j in judgement.judged if len(j.names) < TOO_MANY)))
    two = within.ranking[0]
    by_itself = within.verdict == "effects" and not within.candidates
    if not by_itself or len(two.names) != TOO_MANY - 1 or not set(two.names) < set(top.names):
        return decision
    if top.score - two.score > MORE_LEFT * two.score:
        return decision
    further = tuple(replace(r, probability=0.0) for r in decision.ranking if len(r.names) >= TOO_MANY)
    return replace(within, ranking=(*within.ranking, *further))
