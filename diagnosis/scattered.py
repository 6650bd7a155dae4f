"""A residual less what scatters from hit to hit, w - D (shrink * D'w): compiled, as all residuals pass through it.

D is read twice per residual and is larger than the nearest caches, so it is kept in single precision and row by row;
sums are in double precision, and a residual is rounded by 1e-8 of what is taken off.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Vector = NDArray[np.float64]

_BLOCK = 2048  # samples that stay in the nearest cache


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "nsz", "reassoc"})
def less_scatter(w: Vector, directions: NDArray[np.float32], shrink: Vector) -> Vector:
    """w - D (shrink * D'w), shape (n,).

    Args:
        w: Filtered residual, shape (n,).
        directions: D' , orthonormal rows, shape (r, n).
        shrink: Of each direction, the share that is taken off, shape (r,).
    """
    r, n = directions.shape
    amounts = np.empty(r)
    for k in range(r):
        total = 0.0
        row = directions[k]
        for i in range(n):
            total += row[i] * w[i]
        amounts[k] = total * shrink[k]
    result = w.copy()
    for first in range(0, n, _BLOCK):
        last = min(first + _BLOCK, n)
        block = result[first:last]
        k = 0
        while k + 3 < r:  # four at a time: a sum is stored once for four
            a1, a2, a3, a4 = amounts[k], amounts[k + 1], amounts[k + 2], amounts[k + 3]
            d1, d2 = directions[k, first:last], directions[k + 1, first:last]
            d3, d4 = directions[k + 2, first:last], directions[k + 3, first:last]
            for i in range(block.size):
                block[i] -= a1 * d1[i] + a2 * d2[i] + a3 * d3[i] + a4 * d4[i]
            k += 4
        for rest in range(k, r):
            a, d = amounts[rest], directions[rest, first:last]
            for i in range(block.size):
                block[i] -= a * d[i]
    return result
