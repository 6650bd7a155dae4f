"""The overtones of a line against the turn, where what is left repeats with them.

A gear's error and a motor's ripple are seldom one sine. The search fits them with their harmonics from a few runs and within
few evaluations; where it settled on the sine alone, what that leaves repeats at twice or three times its order.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from jointscope.diagnosis.candidates import candidates_for
from jointscope.diagnosis.effects.periodic import MOTOR_ORDER
from jointscope.diagnosis.rivals import grown

if TYPE_CHECKING:
    from jointscope.diagnosis.adjudicate import Judged, Judgement
    from jointscope.diagnosis.effects import ActiveEffect, EffectSpec
    from jointscope.diagnosis.remainder import Remainder
    from jointscope.diagnosis.search import Effort, Hypothesis

OVERTONES = (2, 3)
NEAR = 0.02  # of an overtone's order


def overtones(
    judgement: Judgement,
    chosen: Judged,
    repeats: Sequence[Remainder],
    specs: Sequence[EffectSpec],
    effort: Effort,
) -> list[Hypothesis]:
    """The chosen set with the overtones of its lines, where what it leaves repeats with one in runs not fitted too.

    Args:
        repeats: What the chosen set leaves that repeats with the turn.
        specs: The laws that may be named.
    """
    objective = judgement.objective
    _, effects = chosen.fit.coordinates.unpack(chosen.fit.x)
    ratio = objective.problem.rig.reduction_ratio or 1.0
    lines = [order for active in effects if (order := _per_turn(active, ratio)) is not None]
    if not lines:
        return []
    left = [r.order for r in repeats if r.order is not None and r.stands]
    if not any(abs(found - k * line) < NEAR * k * line for found in left for line in lines for k in OVERTONES):
        return []
    names = {active.spec.name for active in effects}
    laws = [s for s in specs if s.family == "periodic" and s.name in names and s.variant.endswith("-harmonic")]
    candidates = candidates_for(objective.problem, laws)
    return [h for h in grown(objective, judgement.base.fit, chosen.hypothesis, candidates, effort) if h.sensible]


def _per_turn(active: ActiveEffect, ratio: float) -> float | None:
    """A single line's order per turn of the output."""
    if active.spec.family != "periodic" or active.spec.variant.endswith("-harmonic"):
        return None
    for parameter, value in zip(active.spec.parameters, active.values, strict=True):
        if parameter.name == "order":
            return value * ratio if parameter.unit == MOTOR_ORDER.unit else value
    return None
