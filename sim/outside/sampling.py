"""From the engine's 20 kHz to a device's samples: band-limited first, without a phase, so that nothing aliases."""

from __future__ import annotations

import functools
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.signal import firwin, oaconvolve

from jointscope.sim.outside.layout import RATE

Real = NDArray[np.float64]
TRANSITION: Final = 0.16  # of the device's rate, from where samples pass (0.34) to where they are gone (0.5)
KAISER: Final = 8.0  # -80 dB
LENGTH: Final = 3.6  # taps per transition width


@functools.cache
def _taps(rate: float) -> Real:
    if rate >= 0.9 * RATE:
        return np.ones(1)
    count = int(LENGTH / (TRANSITION * rate / RATE)) | 1
    return np.asarray(firwin(count, (1.0 - TRANSITION) * rate / 2.0, fs=RATE, window=("kaiser", KAISER)))


def sampled(signal: Real, rate: float, times: Real) -> Real:
    """``signal``, given at ``RATE`` from t = 0, as a device of ``rate`` [Hz] reads it at ``times`` [s]."""
    taps = _taps(rate)
    half = taps.size // 2
    limited = oaconvolve(np.pad(signal - signal[0], (half, half), "edge"), taps, "valid") + signal[0]
    places = np.clip(times, 0.0, (limited.size - 1) / RATE) * RATE
    if np.allclose(places, np.round(places), atol=1e-6):
        return np.asarray(limited[np.round(places).astype(int)])
    if not np.all(np.isfinite(limited)):
        raise FloatingPointError("a sampled signal flew apart")
    return np.asarray(CubicSpline(np.arange(limited.size), limited)(places))
