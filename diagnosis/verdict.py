"""From evidence to an answer: none, effects, or unknown, each with its probability."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from jointscope.diagnosis.adjudicate import Comparison, Judged, Judgement, compare, score, standing

TEMPERATURE = 3.0  # nats of score per nat of belief: laws of the right name but the wrong form cost as much
NOT_STANDING = 12.0  # nats taken off a set that fails a gate
SURE = 0.5  # probability of the leading set below which it is not named alone
NEAR = 3.0  # belief nats within which rivals are listed


@dataclass(frozen=True, eq=False)
class Ranked:
    """One set of effects, the best of its fitted laws."""

    names: tuple[str, ...]
    probability: float
    score: float
    judged: Judged
    comparison: Comparison | None


@dataclass(frozen=True, eq=False)
class Decision:
    """The answer.

    Attributes:
        chosen: The hypothesis whose model is handed on: the named set, or the base.
        probability: Of the verdict as a whole.
        candidates: Sets that the recordings can't tell apart, where that is the reason.
    """

    verdict: Literal["none", "effects", "unknown"]
    chosen: Judged
    probability: float
    ranking: tuple[Ranked, ...]
    unknown_reason: Literal["outside-catalogue", "not-identifiable"] | None
    candidates: tuple[tuple[str, ...], ...]


def rank(judgement: Judgement) -> list[Ranked]:
    """Sets by tempered score, the base among them with score 0."""
    stands = {id(j) for j in standing(judgement)}
    best: dict[tuple[str, ...], tuple[float, Judged]] = {}
    for judged in judgement.judged:
        value = score(judgement, judged) if judged.names else math.log(0.5)
        if judged.names and id(judged) not in stands:
            value = min(value, 0.0) - NOT_STANDING
        if judged.names not in best or value > best[judged.names][0]:
            best[judged.names] = (value, judged)
    values = np.array([v for v, _ in best.values()])
    weights = np.exp((values - values.max()) / TEMPERATURE)
    weights /= weights.sum()
    ranked = [
        Ranked(names, float(p), float(v), judged, compare(judgement, judgement.base, judged) if names else None)
        for (names, (v, judged)), p in zip(best.items(), weights, strict=True)
    ]
    return sorted(ranked, key=lambda r: -r.score)


def decide(judgement: Judgement) -> Decision:
    """The verdict on the evidence."""
    ranking = rank(judgement)
    top = ranking[0]
    if not top.names:
        return Decision("none", judgement.base, top.probability, tuple(ranking), None, ())
    near = [r for r in ranking if r.names and top.score - r.score < NEAR * TEMPERATURE]
    if top.probability < SURE and len(near) > 1:
        together = sum(r.probability for r in near)
        return Decision(
            "unknown", top.judged, together, tuple(ranking), "not-identifiable", tuple(r.names for r in near)
        )
    return Decision("effects", top.judged, top.probability, tuple(ranking), None, ())
