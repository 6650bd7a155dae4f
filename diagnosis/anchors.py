"""The strongest effect's other laws beside each of its partners.

What a law of the right name and the wrong form leaves is always explained by something: beside a lag of the drive of the
wrong order a broad mode, a gain or a loss each gain a little, and which of them leads says nothing. Beside the right order
the right one gains by far the most. The leading pair alone can't show that, so each partner is tried beside the
next best laws of the effect that they all stand beside.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from jointscope.diagnosis.lent import same_numbers
from jointscope.diagnosis.rivals import within_reach
from jointscope.diagnosis.search import Effort, Hypothesis, fit_child, name_of, profile_loss

if TYPE_CHECKING:
    from jointscope.diagnosis.effects import ActiveEffect, EffectSpec
    from jointscope.diagnosis.objective import Objective
    from jointscope.diagnosis.refit import Fit

PARTNERS = 5  # tried, the best pair of each
LAWS = 2  # of the anchor beside the one that it has


def beside_other_laws(
    objective: Objective,
    base: Fit,
    hypotheses: Sequence[Hypothesis],
    candidates: Sequence[ActiveEffect],
    effort: Effort,
) -> list[Hypothesis]:
    """Fit the best pairs that hold the strongest effect with its next best laws in its place, from its numbers.

    Args:
        base: The base's fit.
        hypotheses: All that were fitted, best first.
        candidates: Trials of every law.
    """
    if not hypotheses or len(hypotheses[0].names) != 2:
        return []
    singles = [h for h in hypotheses if len(h.specs) == 1]
    anchor = next((h.names[0] for h in singles if h.names[0] in hypotheses[0].names), None)
    if anchor is None:
        return []
    laws = [h.specs[0] for h in singles if h.names == (anchor,)]
    pairs: dict[tuple[str, ...], Hypothesis] = {}
    for h in hypotheses:
        if len(h.specs) == 2 and len(h.names) == 2 and anchor in h.names:
            pairs.setdefault(h.names, h)
    known = {frozenset(id(s) for s in h.specs) for h in hypotheses}
    reach = within_reach(objective, base, hypotheses[0])
    found = []
    for pair in list(pairs.values())[:PARTNERS]:
        place = next(k for k, spec in enumerate(pair.specs) if name_of(spec) == anchor)
        theta, effects = pair.fit.coordinates.unpack(pair.fit.x)
        partner, effect = pair.specs[1 - place], effects[1 - place]
        for law in _others(laws, pair.specs[place]):
            trials = same_numbers([c for c in candidates if c.spec is law], effects[place])
            if not trials or frozenset((id(partner), id(law))) in known:
                continue
            fit = fit_child(objective, base, [effect, trials[0]], effort, [theta], reach)
            if fit is not None:
                found.append(Hypothesis((partner, law), fit, profile_loss(objective, fit.w)))
    return found


def _others(laws: Sequence[EffectSpec], own: EffectSpec) -> list[EffectSpec]:
    """The best laws that are not ``own``, without repeats."""
    distinct = {id(law): law for law in laws if law is not own}
    return list(distinct.values())[:LAWS]
