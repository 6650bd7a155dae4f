"""When play is looked for by the first periods after each hit, and beside a bent spring."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from jointscope.diagnosis.base import Stage, worst_misfit
from jointscope.diagnosis.bent_play import bent_play
from jointscope.diagnosis.modes_apart import MUCH
from jointscope.diagnosis.ring_downs import PLAY
from jointscope.diagnosis.search import Hypothesis, name_of

if TYPE_CHECKING:
    from jointscope.diagnosis.effects import EffectSpec
    from jointscope.diagnosis.rounds import Arena

IN_PLAY = (
    0.2  # of what the leading effect gains, that play must, to be fitted by the first periods after each hit ...
)
RATTLES = 50.0  # ... and nats that it must in any case: a play that gains less has not been lost among the periods
LOST = 0.5  # of some channel of the hits, left by the leader, beyond which play needs no more than those nats
BENT, BENDS = "stiffness-nonlinearity@transmission", ("cubic", "piecewise", "smooth")


def has_some(arena: Arena, name: str, share: float = IN_PLAY) -> bool:
    """Whether an effect alone, as the search found it, has this share of what the leading effect has."""
    most = arena.base.loss - arena.hypotheses[0].loss
    needed = max(share * most, RATTLES)
    return any(h.names == (name,) and arena.base.loss - h.loss > needed for h in arena.hypotheses)


def left_of_hits(arena: Arena, best: Hypothesis) -> float:
    """Share of the worst kind of channel that a fit leaves where a held joint was hit [-]; 0 without such."""
    predictions = arena.objective.predictions(*best.fit.coordinates.unpack(best.fit.x))
    hits = [pair for pair in zip(arena.objective.prepared, predictions, strict=True) if pair[0].mode == "braked"]
    return worst_misfit(tuple(run for run, _ in hits), tuple(y for _, y in hits)) if hits else 0.0


def may_rattle(arena: Arena) -> bool:
    """Whether play has some of what the leading effect has, or a little where that leaves most of some hits' channel.

    Fitted to whole runs play may be lost among its valleys while a spring with a soft middle makes something of it.
    """
    if has_some(arena, PLAY):
        return True
    return has_some(arena, PLAY, 0.0) and left_of_hits(arena, arena.hypotheses[0]) > LOST


def beside_bent_spring(
    arena: Arena, stage: Stage, pairs: Sequence[Hypothesis], specs: Sequence[EffectSpec]
) -> list[Hypothesis]:
    """Play and a bent spring together, where each alone has some of what the leading effect has, and all sets leave much."""
    alone = {h.names: h for h in reversed(arena.hypotheses) if len(h.specs) == 1}
    if not (has_some(arena, PLAY) and has_some(arena, BENT)):
        return []
    if left_of_hits(arena, min([*arena.hypotheses, *pairs], key=lambda h: h.loss)) < MUCH:
        return []
    springs = [spec for spec in specs if name_of(spec) == BENT and spec.variant in BENDS]
    return bent_play(stage, arena.objective, arena.base.fit, alone[PLAY,], springs)
