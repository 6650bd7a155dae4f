"""Two encoders, one on either side of the transmission: their difference is compared in place of the arm's angle.

Whatever moves the rigid body otherwise than the model says moves both angles alike. Compared one by one, both carry that
common error, which is larger than the whole wind-up; their difference is free of it and holds what the transmission does.
With the motor's innovation beside it nothing is lost: (q_s, q) and (q_s, q_s - q) are the same data.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from jointscope.diagnosis.noise import quantum
from jointscope.recordings.campaign import gearing

if TYPE_CHECKING:
    from jointscope.diagnosis.problem import Output, PreparedRun

WIND_UP = "wind-up"
_ANGLES = ("angle", "position")


def with_wind_up(run: PreparedRun) -> PreparedRun:
    """The run with the arm's angle replaced by q_s - q where one device recorded both and the motor's is followed."""
    motor = next((o for o in run.outputs if o.observed and o.location == "motor" and o.quantity in _ANGLES), None)
    if motor is None or not run.motor_moves:
        return run
    n = gearing(motor.quantity, motor.location, run.ratio)
    outputs = tuple(_difference(motor, o, n) if _pairs(motor, o) else o for o in run.outputs)
    return replace(run, outputs=outputs)


def _pairs(motor: Output, other: Output) -> bool:
    """Whether the other one is the arm's angle on the same samples."""
    return (
        other.location != "motor"
        and other.quantity in _ANGLES
        and other.device == motor.device
        and np.array_equal(other.times, motor.times)
    )


def _difference(motor: Output, arm: Output, ratio: float) -> Output:
    """q_s - q; its zero is nobody's, since encoders are zeroed each for itself and play and friction keep a torque in."""
    return replace(
        arm,
        quantity=WIND_UP,
        location="transmission",
        data=motor.data / ratio - arm.data,
        mask=motor.mask & arm.mask,
        step=math.hypot(quantum(motor) / ratio, quantum(arm)),  # which the difference's own levels don't show
        floating=True,
    )
