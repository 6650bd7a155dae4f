"""The one spectral estimator of this room: whatever is compared, both sides go through the same few lines."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import signal

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]
Window = Literal["tukey", "hann", "boxcar"]


@dataclass(frozen=True, eq=False)
class Spectrum:
    """One-sided complex amplitude spectrum.

    Attributes:
        frequency: [Hz], shape (n,), from 0 to half the rate.
        amplitude: In the signal's unit (peak value of a sine on a bin), shape (n,).
    """

    frequency: Real
    amplitude: Complex

    def band(self, low: float, high: float) -> NDArray[np.bool_]:
        """Which bins lie in [low, high] Hz, shape (n,)."""
        return (self.frequency >= low) & (self.frequency <= high)


def spectrum(samples: Real, rate: float, window: Window = "tukey") -> Spectrum:
    """Windowed Fourier transform of a whole record.

    Args:
        samples: Shape (n,); the mean is removed first.
        rate: [Hz].
        window: Tukey (5 % taper at either end), Hann, or none.

    Returns:
        Amplitudes scaled so that a sine on a bin shows its peak value.
    """
    shape = {"tukey": ("tukey", 0.1), "hann": "hann", "boxcar": "boxcar"}[window]
    weight = np.asarray(signal.get_window(shape, samples.size))
    transformed = np.fft.rfft(weight * (samples - np.mean(samples))) * 2.0 / weight.sum()
    return Spectrum(np.asarray(np.fft.rfftfreq(samples.size, 1.0 / rate), dtype=np.float64), transformed)
