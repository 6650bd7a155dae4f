"""What the motor is asked to do: a swept torque, and the speed of a move there and back."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Real = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Sweep:
    """A linear sine sweep of torque with faded ends.

    The torque that holds the arm in equilibrium is added by the take: without it the arm would fall, and hanging below
    the horizontal it only swings slowly about its start.

    Attributes:
        start: [s].
        duration: [s].
        first_frequency: [Hz].
        last_frequency: [Hz].
        amplitude: Of the torque on the motor shaft [N m].
        fade: Raised-cosine rise and fall [s].
    """

    start: float
    duration: float
    first_frequency: float
    last_frequency: float
    amplitude: float
    fade: float = 0.1

    def torque(self, times: Real) -> Real:
        """[N m], shape of ``times`` [s]; starts as a cosine, so that the push it leaves behind is a shift, not a speed."""
        t = np.clip(times - self.start, 0.0, self.duration)
        rate = (self.last_frequency - self.first_frequency) / self.duration
        phase = 2.0 * math.pi * (self.first_frequency + 0.5 * rate * t) * t
        edge = np.clip(np.minimum(t, self.duration - t) / self.fade, 0.0, 1.0)
        return np.asarray(self.amplitude * np.cos(phase) * 0.5 * (1.0 - np.cos(math.pi * edge)), dtype=np.float64)


@dataclass(frozen=True, kw_only=True)
class ThereAndBack:
    """Triangular speed: to ``travel`` and back, at constant accelerations.

    Attributes:
        start: [s].
        duration: There and back [s].
        travel: At the joint output [rad].
    """

    start: float
    duration: float
    travel: float

    def speed(self, t: float) -> float:
        """At the joint output [rad/s]: 0, peak, 0, -peak, 0 at the quarters of ``duration``."""
        quarter = 0.25 * self.duration
        phase = (t - self.start) / quarter
        peak = self.travel / quarter
        if phase <= 0.0 or phase >= 4.0:
            return 0.0
        return peak * (phase if phase < 1.0 else 2.0 - phase if phase < 3.0 else phase - 4.0)

    @property
    def peak_speed(self) -> float:
        """At the joint output [rad/s]."""
        return abs(self.travel) / (0.25 * self.duration)
