"""A motion that is prescribed by its record: the angle, its speed and its acceleration, and where it stands still.

A recorded angle with white noise of standard deviation s, low-passed at f_c and differentiated, has a speed with noise
s_v = 2 pi s sqrt(2 f_c^3/(3 f_s)), f_s its sampling rate. Where the axis rests, what is left of the speed is that noise, and
dry friction that reversed with it would be a force of +-T of which the recording shows nothing. So a speed that does not stand
out of its own noise is none.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, minimum_filter1d
from scipy.signal import butter, sosfiltfilt

from jointscope.diagnosis.input_noise import white_part
from jointscope.diagnosis.recorder_step import decimal_step, recorder_step
from jointscope.recordings.bandlimited import bandlimited
from jointscope.recordings.campaign import FORCES

if TYPE_CHECKING:
    from jointscope.diagnosis.problem import Output

Vector = NDArray[np.float64]

INVERSE_CORNER = 60.0  # Hz; low-pass of a prescribed or recorded motion before it is differentiated
WHOLLY = 0.99  # moving, between two times of the grid
STANDS_OUT = 4.0  # times its noise's standard deviation, from which on a speed is one


def lowest_pass(rate: float) -> float:
    """Corner of the low-pass of a motion recorded at ``rate`` [Hz]."""
    return min(INVERSE_CORNER, 0.2 * rate)


def prescribed_path(samples: Vector, rate: float, start: float, half: Vector) -> tuple[Vector, Vector, Vector]:
    """Angle [rad or m] at the times ``half``, and its first two derivatives, after a zero-phase low-pass; shapes of ``half``.

    Args:
        samples: As recorded, at the joint output, shape (n,).
        rate: Of the record [Hz].
        start: Time of its first sample [s].
        half: Times [s].
    """
    corner = lowest_pass(rate)
    path = bandlimited(sosfiltfilt(butter(4, corner, fs=rate, output="sos"), samples), rate, start)
    speed = path(half, 1)
    least = STANDS_OUT * speed_noise(samples, rate, corner)
    return path(half), np.where(np.abs(speed) < least, 0.0, speed), path(half, 2)


def where_it_moves(outputs: Sequence[Output], half: Vector, speed: Vector, rate: float) -> tuple[Output, ...]:
    """The outputs of a rigid axis with its forces scored in motion only: at rest dry friction bears what it is asked to.

    Where the axis sets off, stops or turns the smoothed speed is not its own for as long as the low-pass reaches, and friction
    that turns with it is a spike that is foretold where none is.

    Args:
        half: Times of ``speed`` [s], shape (n,), evenly spaced.
        speed: 0 where the axis rests [rad/s or m/s], shape (n,).
        rate: Of the prescribed record [Hz].
    """
    way = np.sign(speed)
    reach = max(1, round(0.5 / (lowest_pass(rate) * max(float(half[1] - half[0]), 1e-12))))
    moves = minimum_filter1d((way != 0.0) & (maximum_filter1d(way, 3) == minimum_filter1d(way, 3)), 2 * reach + 1)
    moves = moves.astype(np.float64)
    return tuple(
        replace(o, mask=o.mask & (np.interp(o.times, half, moves) > WHOLLY)) if o.quantity in FORCES else o
        for o in outputs
    )


def speed_noise(samples: Vector, rate: float, corner: float) -> float:
    """Standard deviation of the noise in the speed of a recorded angle, shape (n,), low-passed at ``corner`` [per s]."""
    step = max(recorder_step(samples), decimal_step(samples))
    own = max(white_part(samples), step / math.sqrt(12.0))
    return 2.0 * math.pi * own * math.sqrt(2.0 * corner**3 / (3.0 * rate))
