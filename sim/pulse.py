"""The force of a hammer on an arm: one pulse, or a pulse and its rebound."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from jointscope.errors import JointscopeError

Real = NDArray[np.float64]
Hardness = Literal["soft", "medium", "hard"]

CONTACT_TIMES: dict[Hardness, float] = {
    "soft": 10e-3,
    "medium": 7e-3,
    "hard": 4e-3,
}  # s, rubber to nylon on a 12 kg arm
_HERTZ = 1.5  # force grows with indentation to this power, which is nearly a half-sine in time


class PulseError(JointscopeError):
    """A pulse without duration."""


@dataclass(frozen=True, kw_only=True)
class Pulse:
    """One contact.

    Attributes:
        start: First touch [s].
        contact_time: [s].
        peak: [N].
    """

    start: float
    contact_time: float
    peak: float

    def __post_init__(self) -> None:
        if not self.contact_time > 0.0:
            raise PulseError(f"Pulse.contact_time = {self.contact_time}: must be positive")

    def force(self, times: Real) -> Real:
        """F = peak sin(pi (t - start)/contact_time)^1.5 during contact, else 0 [N], shape of ``times`` [s]."""
        phase = (times - self.start) / self.contact_time
        inside = (phase > 0.0) & (phase < 1.0)
        return self.peak * np.where(inside, np.sin(np.pi * np.clip(phase, 0.0, 1.0)), 0.0) ** _HERTZ


def total_force(pulses: tuple[Pulse, ...], times: Real) -> Real:
    """Sum of the pulses' forces [N], shape of ``times`` [s]."""
    return np.asarray(sum((pulse.force(times) for pulse in pulses), np.zeros_like(times)), dtype=np.float64)
