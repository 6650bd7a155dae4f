"""A record's one-step prediction errors by a given noise: compiled, as every residual of every run passes through it."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Vector = NDArray[np.float64]

_BLOCK = 2048  # samples that stay in the nearest cache


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "nsz"})
def prediction_errors(
    r: NDArray[np.float64],
    weight: Vector,
    numerator: Vector,
    denominator: Vector,
    ar: Vector,
    keep: NDArray[np.intp],
    sigma: float,
) -> NDArray[np.float64]:
    """(ar * A/B * (weight r)) / sigma at the samples ``keep``, shape (n_kept, k), from rest.

    Args:
        r: Columns, shape (n, k).
        weight: Shape (n,).
        numerator, denominator: Of the second-order filter A/B, shape (3,), each with a leading 1; empty without one.
        ar: Coefficients of the prediction-error filter, shape (p + 1,), the first 1.
        keep: Indices of the samples wanted, shape (n_kept,).
        sigma: Standard deviation of the errors, in the columns' unit.
    """
    n, columns = r.shape
    result = np.empty((keep.shape[0], columns))
    x, y = np.empty(n), np.empty(n)
    scale = 1.0 / sigma
    for column in range(columns):
        for i in range(n):
            x[i] = weight[i] * r[i, column]
        if numerator.shape[0] == 3:
            b1, b2, a1, a2 = numerator[1], numerator[2], denominator[1], denominator[2]
            s1, s2 = 0.0, 0.0
            for i in range(n):
                before = x[i]
                after = before + s1
                s1 = b1 * before - a1 * after + s2
                s2 = b2 * before - a2 * after
                x[i] = after
        y[:] = x
        lags = ar.shape[0] - 1
        for lag in range(1, lags + 1):
            for i in range(lag, min(lags, n)):
                y[i] += ar[lag] * x[i - lag]
        for first in range(lags, n, _BLOCK):
            last = min(first + _BLOCK, n)
            block = y[first:last]
            lag = 1
            while lag + 3 <= lags:  # four at a time: a sum is stored once for four
                h1, h2, h3, h4 = ar[lag], ar[lag + 1], ar[lag + 2], ar[lag + 3]
                p1, p2 = x[first - lag : last - lag], x[first - lag - 1 : last - lag - 1]
                p3, p4 = x[first - lag - 2 : last - lag - 2], x[first - lag - 3 : last - lag - 3]
                for i in range(block.size):
                    block[i] += h1 * p1[i] + h2 * p2[i] + h3 * p3[i] + h4 * p4[i]
                lag += 4
            for rest in range(lag, lags + 1):
                h, part = ar[rest], x[first - rest : last - rest]
                for i in range(block.size):
                    block[i] += h * part[i]
        for i in range(keep.shape[0]):
            result[i, column] = scale * y[keep[i]]
    return result
