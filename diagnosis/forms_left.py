"""What the first effect's form may still be off by, told by its own laws: where the best of them explain alike, by little.

A further effect is not believed for what a wrong form of the first one leaves. Of the first one every law of the catalogue
was fitted. Where they differ by hundreds of nats another might differ by as much again; where the best three differ by a
few, the form is found as far as these recordings tell forms apart, and what is then explained by many times that is no form.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from jointscope.diagnosis.gates import ALIKE, FORMS, Comparison
from jointscope.diagnosis.search import name_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jointscope.diagnosis.adjudicate import Judged

LAWS = 3  # the best of a name, whose spread is what forms matter here


def beyond_forms(judged: Sequence[Judged], parent: Judged, against: Comparison) -> bool:
    """Whether what a child adds to ``parent`` is many times what the best laws of the parent's names differ by.

    ``False`` where fewer than three of them were fitted: one of two may hold the other, and nothing is known of further forms.

    Args:
        against: The child against the parent.
    """
    if not against.witnessed:
        return False
    spread = spread_of_forms(judged, parent.names)
    return spread is not None and against.gain + against.held_gain > FORMS * max(spread, ALIKE)


def spread_of_forms(judged: Sequence[Judged], names: tuple[str, ...]) -> float | None:
    """Nats between the best and the third best law of ``names``; ``None`` where there are fewer."""
    losses: dict[tuple[tuple[str, str], ...], float] = {}
    for j in judged:
        if j.names != names:
            continue
        laws = tuple(sorted((name_of(spec), spec.variant) for spec in j.hypothesis.specs))
        loss = 0.5 * (j.chi2 + float(np.sum(j.held_out))) + j.occam + j.occam_held
        losses[laws] = min(losses.get(laws, loss), loss)
    best = sorted(losses.values())
    return best[LAWS - 1] - best[0] if len(best) >= LAWS else None
