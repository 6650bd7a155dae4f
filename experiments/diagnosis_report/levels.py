"""Which runs were driven alike: levels of excitation, from the excitation itself."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

MOST = 4
_APART = 1.3  # neighbouring levels differ by at least this factor


def level_groups(levels: NDArray[np.float64]) -> list[NDArray[np.int64]]:
    """Positions of the runs of each level, weakest first; at most four groups, cut at the widest steps.

    Args:
        levels: How hard each run was driven, shape (n,); any unit.
    """
    order = np.argsort(levels, kind="stable")
    rising = np.maximum(levels[order], 1e-300)
    steps = rising[1:] / rising[:-1]
    wide = np.flatnonzero(steps > _APART)
    cuts = sorted(wide[np.argsort(-steps[wide], kind="stable")][: MOST - 1] + 1)
    return [np.asarray(part, dtype=np.int64) for part in np.split(order, cuts)]
