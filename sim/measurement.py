"""Acquisition devices: anti-alias filter, clock, converter; the same chain on every channel of a device.

A sample is the instantaneous value of the signal band-limited below half the device's rate (formats: "Samples"): the
filters are linear-phase with their delay taken off, as delta-sigma converters do, so that devices of different rates
agree in time.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from jointscope.errors import JointscopeError

Real = NDArray[np.float64]


class MeasurementError(JointscopeError):
    """The measurement chain is set to something no device can do."""


@dataclass(frozen=True, kw_only=True)
class Clock:
    """How a device's time stamps differ from true time: stamp = (1 + ppm 1e-6) t + delay.

    Attributes:
        delay: Positive where the device stamps late [s].
        ppm: Positive where its clock runs fast [1e-6].
    """

    delay: float = 0.0
    ppm: float = 0.0

    def true_times(self, stamps: Real) -> Real:
        """When the samples stamped ``stamps`` [s] were really taken [s], same shape."""
        return (stamps - self.delay) / (1.0 + 1e-6 * self.ppm)


@dataclass(frozen=True, kw_only=True)
class AntiAlias:
    """A linear-phase low-pass, band edges as shares of the sampling rate.

    Attributes:
        passband: Flat up to here [-].
        stopband: ``attenuation`` from here on [-].
        attenuation: [dB].
    """

    passband: float = 0.42
    stopband: float = 0.5
    attenuation: float = 90.0

    def __post_init__(self) -> None:
        if not 0.0 < self.passband < self.stopband:
            raise MeasurementError(
                f"AntiAlias.passband = {self.passband}: must lie between 0 and stopband = {self.stopband}"
            )


@dataclass(frozen=True, kw_only=True)
class Device:
    """One acquisition device.

    Attributes:
        sampling_rate: [Hz].
        anti_alias: On each of its channels.
        clock: Its time stamps against true time.
    """

    sampling_rate: float
    anti_alias: AntiAlias = AntiAlias()
    clock: Clock = Clock()

    def __post_init__(self) -> None:
        if not self.sampling_rate > 0.0:
            raise MeasurementError(f"Device.sampling_rate = {self.sampling_rate}: must be positive")

    def reach(self, timestep: float) -> float:
        """How far beyond the last sample the signal must be known [s]."""
        return (len(self._taps(timestep)) // 2 + 4) * timestep + max(0.0, -self.clock.delay)

    def stamps(self, duration: float) -> Real:
        """Time stamps from 0 up to ``duration`` [s], shape (n,)."""
        return np.arange(round(duration * self.sampling_rate)) / self.sampling_rate

    def sample(self, values: Real, timestep: float, stamps: Real) -> Real:
        """Samples at ``stamps`` [s] of ``values``, shape (m,), given on a grid of ``timestep`` [s] from t = 0 on.

        Before the grid the signal has its first value (runs start at rest), after it its last.
        """
        taps = self._taps(timestep)
        half = len(taps) // 2
        padded = np.concatenate([np.full(half, values[0]), values, np.full(half, values[-1])])
        offset = values[0]  # filtering deviations keeps a resting signal exact
        smooth = signal.oaconvolve(padded - offset, taps, mode="valid") + offset
        return interpolate_grid(smooth, timestep, self.clock.true_times(stamps))

    def _taps(self, timestep: float) -> Real:
        return _low_pass(self.sampling_rate, 1.0 / timestep, self.anti_alias)


@cache
def _low_pass(rate: float, grid: float, design: AntiAlias) -> Real:
    """Kaiser-windowed linear-phase low-pass of odd length and unit gain at rest."""
    if design.stopband * rate >= 0.5 * grid:
        return np.ones(1)  # the grid itself holds nothing above the edge
    width = (design.stopband - design.passband) * rate / (0.5 * grid)
    length, beta = signal.kaiserord(design.attenuation, width)
    middle = 0.5 * (design.stopband + design.passband) * rate
    taps = np.asarray(signal.firwin(length | 1, middle, window=("kaiser", beta), fs=grid), dtype=np.float64)
    taps.setflags(write=False)
    return taps


def interpolate_grid(values: Real, timestep: float, times: Real) -> Real:
    """Six-point Lagrange interpolation of a grid from t = 0 on, at ``times`` [s]; end values outside."""
    position = np.clip(times / timestep, 0.0, len(values) - 1.0)
    nearest = np.rint(position)
    position = np.where(np.abs(position - nearest) < 1e-7, nearest, position)
    if len(values) < 6:
        return np.interp(position, np.arange(len(values)), values)
    first = np.clip(np.floor(position).astype(int) - 2, 0, len(values) - 6)
    x = position - first  # 0..5
    result = np.zeros_like(position)
    for node in range(6):
        others = [other for other in range(6) if other != node]
        weight = np.prod([(x - other) / (node - other) for other in others], axis=0)
        result += weight * values[first + node]
    return result


@dataclass(frozen=True, kw_only=True)
class Converter:
    """What the electronics add to a channel: range, white noise, quantisation.

    Attributes:
        full_scale: Largest magnitude that passes [unit of the channel].
        bits: Of the converter, over the range from -full_scale to full_scale.
        noise_rms: White noise per sample [unit of the channel].
    """

    full_scale: float
    bits: int = 24
    noise_rms: float = 0.0

    def __post_init__(self) -> None:
        if not self.full_scale > 0.0 or self.bits < 2 or self.noise_rms < 0.0:
            raise MeasurementError(f"{self}: needs full_scale > 0, bits >= 2, noise_rms >= 0")

    def convert(self, samples: Real, rng: np.random.Generator) -> Real:
        """Add noise, clip and round ``samples``, same shape."""
        noisy = samples + rng.normal(0.0, self.noise_rms, samples.shape) if self.noise_rms > 0.0 else samples
        step = 2.0 * self.full_scale / 2**self.bits
        return np.asarray(
            np.rint(np.clip(noisy, -self.full_scale, self.full_scale) / step) * step, dtype=np.float64
        )
