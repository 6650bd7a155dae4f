"""How far a joint's stiffness had come in each run, by the runs' own numbers: in even steps, or towards a limit.

No recording says which run came first, so runs are sorted by their stiffness. Outliers can be sorted too: steps must be
about even, or shrink by a constant factor.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]

SPREAD = 4.0  # standard deviation of the stiffnesses over their median standard error
TELLING = 6.0  # times the first quartile of the standard errors: runs that tell less are left where they are ...
CLEAR = 10.0  # ... unless they are this many of their own off: what a payload does also reads as its run's noise
FEWEST = 4  # runs
EVEN = 0.94  # correlation of sorted stiffnesses with their ranks: 0.97 and more for five drifts, 0.87 for hits with outliers
SETTLED = 0.99  # the same with steps that shrink; one wild hit among sixteen reaches 0.9, two 0.97
SHORTEST, LASTS = 1.5, 16  # runs after which steps have shrunk to 1/e, at least; how many such are tried
SAME_POSTURE = 0.2  # of the spread of runs' own numbers, left within postures, below which it is theirs


def telling(values: Vector, errors: Vector) -> NDArray[np.bool_]:
    """Runs that say about as much as the others, or say it clearly, shape of ``errors``."""
    sharp = sharp_runs(errors)
    if not sharp.any():
        return sharp
    return sharp | (np.isfinite(errors) & (np.abs(values - np.median(values[sharp])) > CLEAR * errors))


def sharp_runs(errors: Vector) -> NDArray[np.bool_]:
    """Runs whose standard error is about as small as the best quarter's, shape of ``errors``."""
    known = np.isfinite(errors)
    return known & (errors <= TELLING * np.quantile(errors[known], 0.25)) if known.any() else known


def drifting(stiffness: Vector, errors: Vector) -> Vector | None:
    """How far the stiffness had come in each run, in steps from the middle one, shape (n_runs,); else ``None``.

    Where it spreads beyond the estimates' own errors, in about even steps. In which direction time runs is not told.
    """
    known = _spread_out(stiffness, errors)
    if known is None:
        return None
    order = np.argsort(np.argsort(stiffness[known]))
    if np.corrcoef(order, stiffness[known])[0, 1] < EVEN:
        return None
    ranks = np.zeros(len(stiffness))
    ranks[known] = order - 0.5 * (known.sum() - 1)
    return ranks


def settling(stiffness: Vector, errors: Vector) -> Vector | None:
    """The same where it settles: in steps that shrink by a constant factor, which are 1 on average, shape (n_runs,).

    A joint that warms up does so towards a limit. Whether the steep end is its softest or its stiffest is not told.
    """
    known = _spread_out(stiffness, errors)
    if known is None:
        return None
    n = int(known.sum())
    order = np.argsort(np.argsort(stiffness[known]))
    sorted_values = np.sort(stiffness[known])
    nearest, shape = 0.0, np.zeros(n)
    for lasts in np.geomspace(SHORTEST, n, LASTS):
        rising = -np.exp(-np.arange(n) / lasts)
        for trial in (rising, -rising[::-1]):
            alike = float(np.corrcoef(trial, sorted_values)[0, 1])
            if alike > nearest:
                nearest, shape = alike, trial
    if nearest < SETTLED:
        return None
    shape = (shape - shape.mean()) * (n - 1) / (shape[-1] - shape[0])
    weights = np.zeros(len(stiffness))
    weights[known] = shape[order]
    return weights


def _spread_out(stiffness: Vector, errors: Vector) -> NDArray[np.bool_] | None:
    """Runs that tell, where they are enough and differ beyond their own errors."""
    known = sharp_runs(errors)
    if known.sum() < FEWEST or np.std(stiffness[known]) <= SPREAD * np.median(errors[known]):
        return None
    return known


def follows_posture(values: Vector, errors: Vector, angles: Vector) -> bool:
    """Whether runs of one arm angle agree and those of others differ: then it is the posture's doing and no drift."""
    known = sharp_runs(errors)
    v, postures = values[known], np.round(angles[known], 3)
    groups = [v[postures == angle] for angle in np.unique(postures)]
    if len(groups) < 2 or len(groups) == len(v):
        return False
    within = sum(float(np.sum(np.square(g - np.mean(g)))) for g in groups)
    return within < SAME_POSTURE * float(np.sum(np.square(v - np.mean(v))))
