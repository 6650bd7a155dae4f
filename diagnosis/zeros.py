"""What no record tells of a channel's zero: where between two steps an encoder began."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.noise import NoiseModel, block_key, quantum

if TYPE_CHECKING:
    from jointscope.diagnosis.problem import PreparedRun

FROM_ZERO = ("angle", "position")  # what is counted from its first samples


def zero_scatter(run: PreparedRun, noise: NoiseModel) -> dict[int, float]:
    """s_0 of each output that is an angle: its encoder's step, or its noise where that is more."""
    return {
        k: max(quantum(o), noise.blocks[block_key(run, o)].marginal)
        for k, o in enumerate(run.outputs)
        if o.quantity in FROM_ZERO and o.mask.any()
    }


def zeros(run: PreparedRun, noise: NoiseModel) -> list[NDArray[np.float64]]:
    """[s_0 1] of each angle, in the rows of its output, shapes (n, n_angles)."""
    scatter = zero_scatter(run, noise)
    columns = [np.zeros((len(o.data), len(scatter))) for o in run.outputs]
    for place, (k, size) in enumerate(scatter.items()):
        columns[k][:, place] = size
    return columns
