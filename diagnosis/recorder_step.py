"""The step of a recorder, read off its record."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

PLACES = 10  # of the largest sample's, that are tried: five fewer than a double holds
ON_GRID = 1e-4  # of a step, by which a decimal number in binary is off it at most


def decimal_step(data: NDArray[np.float64]) -> float:
    """The decimal place, 10^k, on which all samples of a record, shape (n,), lie, as files write them; 0 if there is none.

    A carriage at constant speed moves by many steps a sample, always the same number: its differences show no step.
    """
    finite = data[np.isfinite(data)]
    largest = float(np.max(np.abs(finite))) if finite.size else 0.0
    if largest == 0.0:
        return 0.0
    highest = int(np.floor(np.log10(largest)))
    for place in range(highest, highest - PLACES, -1):
        scaled = finite * 10.0**-place
        if np.all(np.abs(scaled - np.round(scaled)) < ON_GRID):
            return float(10.0**place)
    return 0.0


def recorder_step(data: NDArray[np.float64]) -> float:
    """The smallest change between samples, shape (n,), if the record sits on a grid, else 0 [its unit]."""
    steps = np.abs(np.diff(data))
    steps = steps[steps > 0.0]
    if steps.size < max(32, data.size // 32):  # it hardly ever leaves its step
        levels = np.unique(data)
        return float(np.min(np.diff(levels))) if 1 < levels.size < data.size // 8 else 0.0
    smallest = float(np.percentile(steps, 1.0))
    multiples = steps / smallest
    on_grid = np.mean(np.abs(multiples - np.round(multiples)) < 0.02)
    return smallest if on_grid > 0.95 and np.median(multiples) < 200 else 0.0
