"""What no record tells of a channel's zero: where between two steps an encoder began, what a sensor reads at no acceleration."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.noise import NoiseModel, block_key, quantum

if TYPE_CHECKING:
    from jointscope.diagnosis.problem import Output, PreparedRun

FROM_ZERO = ("angle", "position")  # what is counted from its first samples
LINEAR = ("linear-acceleration", "acceleration")
OFFSET = 0.05  # m/s^2, five thousandths of g: an accelerometer's zero, that warms up and is trimmed by hand


def zero_scatter(run: PreparedRun, noise: NoiseModel) -> dict[int, float]:
    """s_0 of each output that has a zero of its own.

    An angle: its encoder's step, or its noise where that is more. An accelerometer of true zero frequency: its offset.
    """
    sizes = {
        k: max(quantum(o), noise.blocks[block_key(run, o)].marginal)
        for k, o in enumerate(run.outputs)
        if o.quantity in FROM_ZERO and o.mask.any()
    }
    return sizes | {k: OFFSET for k, o in enumerate(run.outputs) if _has_offset(o)}


def _has_offset(output: Output) -> bool:
    slow = output.quantity in LINEAR and output.low_cutoff is None and output.high_pass is None
    return slow and bool(output.mask.any())


def zeros(run: PreparedRun, noise: NoiseModel) -> list[NDArray[np.float64]]:
    """[s_0 1] of each output with a zero of its own, in its rows, shapes (n, n_zeros)."""
    scatter = zero_scatter(run, noise)
    columns = [np.zeros((len(o.data), len(scatter))) for o in run.outputs]
    for place, (k, size) in enumerate(scatter.items()):
        columns[k][:, place] = size
    return columns
