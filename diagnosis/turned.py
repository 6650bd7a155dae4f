"""The angle that a recorded speed adds up to: what an observer follows where no encoder was read."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from jointscope.recordings.bandlimited import bridged

Vector = NDArray[np.float64]


def turned(speed: Vector, rate: float, start: float) -> Vector:
    """The angle that a speed [rad/s] recorded at ``rate`` [Hz] adds up to from ``start`` [rad], shape (n,).

    What an observer of the speed alone lets go, a torque that is off by a little, is a speed, and an angle that runs away:
    a ripple's phase with it. What a record's noise adds up to is less by far.
    """
    steps = 0.5 * (speed[1:] + speed[:-1]) / rate
    return start + np.concatenate([[0.0], np.cumsum(bridged(steps))])
