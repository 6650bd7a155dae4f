"""Between the samples: a record read as what it is, the instantaneous values of a band-limited signal.

At 80 Hz on a 500 Hz log a hold costs -4.2 % and 1 ms, a straight line -8.2 %; the interpolation here costs less than
1e-5 up to 0.9 of half the rate (Kaiser-windowed sinc to 16 times the rate, then a quintic spline).
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy import interpolate, ndimage, signal

Real = NDArray[np.float64]

OVERSAMPLING = 16
_REACH = 64  # samples to either side of the kernel's centre
_EDGE = _REACH + 8  # samples by which a record is continued past its ends
_DEGREE = 5


@dataclass(frozen=True, eq=False)
class Bandlimited:
    """A uniformly sampled record as a function of time; constant outside it (a run starts at rest).

    Attributes:
        start: Time of the first sample [s].
        end: Time of the last sample [s].
        rate: Sampling rate [Hz].
    """

    start: float
    end: float
    rate: float
    _samples: Real = field(repr=False)

    def __call__(self, times: Real, derivative: int = 0) -> Real:
        """Value, or its time derivative, at ``times`` [s], same shape; outside the record the end value, or 0."""
        inside = np.clip(times, self.start, self.end)
        values = np.asarray(self._spline(inside - self.start, nu=derivative), dtype=np.float64)
        if derivative:
            values = np.where((times < self.start) | (times > self.end), 0.0, values)
        return values

    @functools.cached_property
    def _spline(self) -> interpolate.BSpline:
        """By time from the start on [s]; made when first asked for, as many records are never read between samples."""
        coefficients, lead = self.quintic
        knots = np.arange(coefficients.size + _DEGREE + 1) - (_DEGREE + 1) // 2 - lead
        return interpolate.BSpline.construct_fast(knots / (self.rate * OVERSAMPLING), coefficients, _DEGREE)

    @functools.cached_property
    def quintic(self) -> tuple[Real, int]:
        """Coefficients of the quintic B-spline, OVERSAMPLING to a sample, and how many of them precede the start."""
        values = self._samples
        edge = min(_EDGE, values.size - 1)
        padded = np.concatenate(
            [2.0 * values[0] - values[edge:0:-1], values, 2.0 * values[-1] - values[-2 : -edge - 2 : -1]]
        )
        lead = min(8, edge) * OVERSAMPLING  # a few samples outside the ends keep the spline's end conditions away
        begin = edge * OVERSAMPLING - lead
        fine = _oversampled(padded)[begin : begin + (values.size - 1) * OVERSAMPLING + 1 + 2 * lead]
        return np.asarray(ndimage.spline_filter1d(fine, _DEGREE, mode="mirror"), dtype=np.float64), lead


def bandlimited(samples: Real, rate: float, start: float = 0.0) -> Bandlimited:
    """Read ``samples``, shape (n,), taken at ``rate`` [Hz] from ``start`` [s] on, as a band-limited signal.

    The record is continued by point reflection at both ends, which keeps value and slope. Gaps (NaN) are bridged by
    straight lines.
    """
    values = bridged(np.array(samples, dtype=np.float64))
    return Bandlimited(start, start + (values.size - 1) / rate, rate, values)


def bridged(samples: Real) -> Real:
    """Straight lines where samples, shape (n,), are NaN or infinite; zero where none is left."""
    there = np.flatnonzero(np.isfinite(samples))
    if there.size == samples.size:
        return samples
    return np.interp(np.arange(samples.size), there, samples[there]) if there.size else np.zeros(samples.size)


def resampled(samples: Real, rate: float, start: float, times: Real) -> Real:
    """``samples`` of a band-limited signal at other ``times`` [s], shape of ``times``."""
    return bandlimited(samples, rate, start)(times)


def _oversampled(x: Real) -> Real:
    """``x``, shape (n,), OVERSAMPLING times as dense, zero beyond its ends; one matrix product, no loop over samples."""
    silent = np.zeros(_REACH)
    around = np.lib.stride_tricks.sliding_window_view(
        np.concatenate([silent, x, silent]), 2 * _REACH + 1
    )  # (n, taps)
    return np.asarray((around @ _phases()).ravel())


@functools.cache
def _phases() -> Real:
    """The kernel by sample around (later ones last) and phase behind the middle one, shape (2 reach + 1, OVERSAMPLING)."""
    padded = np.concatenate([_kernel(), np.zeros(OVERSAMPLING - 1)])
    return np.ascontiguousarray(padded.reshape(2 * _REACH + 1, OVERSAMPLING)[::-1])


@functools.cache
def _kernel() -> Real:
    """Kaiser-windowed sinc, shape (2 * reach * oversampling + 1,), that passes the samples themselves unchanged.

    Each of its phases is corrected, to read straight lines exactly: a speed taken from a steadily
    turning encoder must have no bias.
    """
    offset = np.arange(-_REACH * OVERSAMPLING, _REACH * OVERSAMPLING + 1) / OVERSAMPLING
    weight = np.asarray(signal.windows.kaiser(offset.size, 16.0), dtype=np.float64)
    kernel = np.sinc(offset) * weight
    for phase in range(OVERSAMPLING):
        part = slice(phase, None, OVERSAMPLING)
        powers = (offset[part] / _REACH)[:, None] ** np.arange(2)  # (taps, 2)
        lacking = np.array([1.0, 0.0]) - powers.T @ kernel[part]
        kernel[part] += (weight[part, None] * powers) @ np.linalg.solve(
            (powers.T * weight[part]) @ powers, lacking
        )
    return kernel
