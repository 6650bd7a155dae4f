"""How physics outside the contract's table is weighed against what the table holds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from jointscope.diagnosis.effects import STRANGERS

if TYPE_CHECKING:
    from jointscope.diagnosis.adjudicate import Judged
    from jointscope.diagnosis.effects import EffectSpec
    from jointscope.diagnosis.verdict import Decision

STRANGE = 15.0  # nats by which physics outside the table must lead what the table holds
OF_LISTED = 0.02  # or this share of its score, as a law of the right name may have another form; not so one of more numbers
FAR, BY_FAR = 200.0, 0.05  # nats by which it leads far, and this share of its score


def resembled(judged: Judged) -> EffectSpec | None:
    """The law outside the contract's table that a hypothesis consists of, or ``None``."""
    names = {name.partition("@")[0] for name in judged.names}
    if not names & {spec.name for spec in STRANGERS}:
        return None
    return next(spec for spec in judged.hypothesis.specs if any(spec.name == s.name for s in STRANGERS))


def lead_asked(value: float, stranger: Judged, listed: Sequence[tuple[float, Judged]]) -> float:
    """Nats by which ``stranger`` of the score ``value`` must lead.

    Args:
        listed: What the table holds, with its scores.
    """
    _, best = max(listed, key=lambda each: each[0])
    freer = _numbers(best) > _numbers(stranger)
    return STRANGE if freer else max(STRANGE, OF_LISTED * value)


def _numbers(judged: Judged) -> int:
    return sum(len(spec.parameters) for spec in judged.hypothesis.specs) if judged.names else 0


def far_ahead(decision: Decision) -> bool:
    """Whether physics outside the table leads so far that nothing of the table, sought once more, overtakes it."""
    top, *others = decision.ranking
    if decision.verdict != "unknown" or resembled(top.judged) is None:
        return False
    listed = [r.score for r in others if resembled(r.judged) is None]
    return top.score - max(listed, default=0.0) > max(FAR, BY_FAR * top.score)
