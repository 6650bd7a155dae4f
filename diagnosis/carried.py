"""An earlier screening read anew: its trials under another noise and beside another parent, and nothing is simulated.

What a law does to the outputs hardly depends on what else is there, as long as that is near. What is kept of a trial is
L^-1 of that less what the base's parameters do, D shrunk (``whiten``); both are undone here:

    u = s + D diag(shrink/(1 - shrink)) D's,    r = d sigma u,    then Sigma^-1/2 of the other noise

What the base's parameters do is among what the other parent's do, and goes again when the trial is scored.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.screen import Tangent, Trial, score
from jointscope.diagnosis.whiten import OutputFilter, RunWhitener

if TYPE_CHECKING:
    from jointscope.diagnosis.objective import Objective

Matrix = NDArray[np.float64]

TOGETHER = 32  # trials read at a time


def carried(trials: Sequence[Trial], then: Objective, now: Objective, parents: Tangent) -> list[Trial]:
    """The trials as they score under the noise of ``now``, beside ``parents``; those of which nothing is left are left out.

    Args:
        then: The runs and the noise with which they were taken; the same runs as those of ``now``, or their beginnings:
            what a trial does later is not known, and not counted.
    """
    slices = then.slices

    def task(some: Sequence[Trial]) -> list[Trial]:
        s = np.stack([t.direction for t in some], axis=1).astype(np.float64) * [t.size for t in some]
        parts = [
            rewhitened(was, new, s[rows])
            for was, new, rows in zip(then.whiteners, now.whiteners, slices, strict=True)
        ]
        moved = np.concatenate(parts)
        scored = (score(t.active, column, parents) for t, column in zip(some, moved.T, strict=True))
        return [trial for trial in scored if trial is not None]

    groups = [trials[k : k + TOGETHER] for k in range(0, len(trials), TOGETHER)]
    return [trial for group in now.map(task, groups) for trial in group]


def rewhitened(was: RunWhitener, new: RunWhitener, s: Matrix) -> Matrix:
    """Columns whitened by ``was`` as ``new`` whitens them, shape (n_kept of was, k) -> (n_kept of new, k)."""
    if was.shrink.size:
        back = was.shrink / np.maximum(1.0 - was.shrink, 1e-12)
        s = s + was.directions @ (back[:, None] * (was.directions.T @ s))
    edges = np.concatenate([[0], np.cumsum(was.sizes)])
    pairs = list(zip(was.filters, new.filters, strict=True))
    records = [
        _record(old, len(later.weight), s[a:b])
        for (old, later), a, b in zip(pairs, edges[:-1], edges[1:], strict=True)
    ]
    still = tuple(_as_far(old, later) for old, later in pairs)
    return replace(new, filters=still)(records)


def _record(was: OutputFilter, length: int, s: Matrix) -> Matrix:
    """What was whitened, at the samples that were scored; nought elsewhere, shape (length, k)."""
    record = np.zeros((length, s.shape[1]))
    record[was.keep] = s * (was.sigma / was.weight[was.keep])[:, None]
    return record


def _as_far(was: OutputFilter, new: OutputFilter) -> OutputFilter:
    """Of the new filter what the old one has not done: a ringing is that of the same drive."""
    return replace(new, ringing=new.ringing if was.ringing is None else None)
