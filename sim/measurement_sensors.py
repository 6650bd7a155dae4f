"""What the sensors make of the motion before any device samples it: IEPE accelerometer, encoder, phase currents."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import signal

Real = NDArray[np.float64]


def iepe(acceleration: Real, timestep: float, low_cutoff: float) -> Real:
    """The signal of an ac-coupled sensor that had settled before t = 0: first-order high-pass, bilinear.

    Args:
        acceleration: Specific force along the sensitive axis, gravity and centripetal part included [m/s^2], shape (n,).
        timestep: [s].
        low_cutoff: -3 dB [Hz].
    """
    b, a = signal.butter(1, low_cutoff, "highpass", fs=1.0 / timestep)
    return np.asarray(signal.lfilter(b, a, acceleration - acceleration[0]), dtype=np.float64)


@dataclass(frozen=True, kw_only=True)
class Encoder:
    """An absolute encoder on the motor shaft; the angle is known to one count.

    Attributes:
        counts_per_turn: [-].
    """

    counts_per_turn: float = 2.0**20

    def read(self, angle: Real) -> Real:
        """``angle`` [rad] rounded to counts, same shape."""
        count = 2.0 * math.pi / self.counts_per_turn
        return np.rint(angle / count) * count


def phase_currents(
    torque: Real, motor_angle: Real, torque_constant: float, pole_pairs: int
) -> tuple[Real, Real, Real]:
    """i_k = -i_q sin(pole_pairs angle - 2 pi k / 3) [A] for k = 0, 1, 2 (u, v, w), with i_q = T_e/K_t.

    Args:
        torque: T_e on the motor shaft [N m], shape (n,).
        motor_angle: On the motor shaft, n q_s [rad], shape (n,).
        torque_constant: K_t [N m/A].
        pole_pairs: [-].
    """
    i_q = torque / torque_constant
    u, v, w = (-i_q * np.sin(pole_pairs * motor_angle - 2.0 * math.pi * k / 3.0) for k in range(3))
    return u, v, w
