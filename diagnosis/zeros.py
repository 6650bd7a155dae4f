"""What no record tells of a channel's zero: where between two steps an encoder began, what an amplifier adds to a weight.

An offset that the quiet parts of the records show is taken off before (:mod:`jointscope.recordings.zeroed`). A smaller one
is a share of the weight that a level sensor reads, which no gain, tilt or clipping of it may be named for.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.noise import NoiseModel, block_key, quantum

if TYPE_CHECKING:
    from jointscope.diagnosis.problem import PreparedRun

FROM_ZERO = ("angle", "position")  # what is counted from its first samples
LINEAR = ("linear-acceleration", "acceleration")
AMPLIFIER = (
    0.004  # m/s^2 that an accelerometer's zero may be off unseen; ten times that took a gain's own evidence
)


def zero_scatter(run: PreparedRun, noise: NoiseModel) -> dict[int, float]:
    """s_0 of each output that has one: an angle's step, or its noise where that is more; an accelerometer's amplifier."""
    sizes = {}
    for k, output in enumerate(run.outputs):
        if output.quantity in FROM_ZERO and output.mask.any():
            sizes[k] = max(quantum(output), noise.blocks[block_key(run, output)].marginal)
        elif output.quantity in LINEAR and output.mask.any() and output.low_cutoff is output.high_pass is None:
            sizes[k] = AMPLIFIER
    return sizes


def zeros(run: PreparedRun, noise: NoiseModel) -> list[NDArray[np.float64]]:
    """[s_0 1] of each that has one, in the rows of its output, shapes (n, n_zeros)."""
    scatter = zero_scatter(run, noise)
    columns = [np.zeros((len(o.data), len(scatter))) for o in run.outputs]
    for place, (k, size) in enumerate(scatter.items()):
        columns[k][:, place] = size
    return columns
