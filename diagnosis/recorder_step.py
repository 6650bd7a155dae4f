"""The step of a recorder, read off its record."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


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
