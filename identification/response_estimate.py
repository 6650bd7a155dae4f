"""Responses of several outputs to one broadband input: averaged over periods where there are any, else over segments.

A periodic input (multisine) is recognised by itself: a whole number of samples after which the input repeats. Each
period is then one average, leakage is nil, and the scatter between periods is the noise of every line. Any other
excitation (sweep, random) is cut into overlapping Hann segments (Welch 1967). Angles are differentiated first, by
exact differences whose transfer is divided out again, so that a drifting angle leaks nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jointscope.errors import RefusedError

Real = NDArray[np.float64]
Complex = NDArray[np.complexfloating[Any, Any]]

REPEATS = 0.9  # autocorrelation above which two stretches are the same excitation
EXCITED = 0.2  # of the strongest line down to which a line counts as excited
WELL_BEHAVED = 0.5  # relative standard deviation above which a line says nothing


@dataclass(frozen=True, kw_only=True, eq=False)
class Responses:
    """Outputs per input on the excited lines.

    Attributes:
        frequency: [Hz], shape (n,).
        values: Shape (n_outputs, n).
        deviation: Standard deviation of real and of imaginary part of ``values``, shape (n_outputs, n).
        averages: Periods or segments behind them.
        period: Samples per period; 0 where the input does not repeat.
    """

    frequency: Real
    values: Complex
    deviation: Real
    averages: int
    period: int


def find_period(samples: Real) -> int:
    """Samples after which the record, shape (n,), repeats; 0 where it doesn't, or holds fewer than two periods."""
    x = samples - np.mean(samples)
    n = x.size
    spectrum = np.fft.rfft(x, 2 * n)
    overlap = np.fft.irfft(np.abs(spectrum) ** 2)[:n]
    energy = np.concatenate([[0.0], np.cumsum(x**2)])
    lag = np.arange(n)
    left, right = energy[n - lag], energy[n] - energy[lag]
    usable = lag <= n // 2
    correlation = np.where(usable, overlap / np.sqrt(np.maximum(left * right, 1e-300)), -1.0)
    fallen = np.flatnonzero(correlation[: n // 2 + 1] < 0.5)
    if fallen.size == 0:
        return 0
    beyond = correlation.copy()
    beyond[: int(fallen[0])] = -1.0
    peaks = (
        np.flatnonzero((beyond[1:-1] > REPEATS) & (beyond[1:-1] >= beyond[:-2]) & (beyond[1:-1] >= beyond[2:])) + 1
    )
    if peaks.size == 0:
        return 0
    best = float(beyond[peaks].max())
    return int(peaks[np.flatnonzero(beyond[peaks] >= best - 0.02)[0]])


def estimate_responses(drive: Real, outputs: Real, rate: float, orders: tuple[int, ...]) -> Responses:
    """Accelerations per input from records on one clock.

    Args:
        drive: Input, shape (n,).
        outputs: Shape (n_outputs, n).
        rate: [Hz].
        orders: Per output, its time derivatives of the angle: 0 angle, 1 velocity, 2 acceleration.

    Returns:
        Responses of the second derivatives (angular accelerations) to the input.

    Raises:
        RefusedError: Nothing is excited, or the record is too short.
    """
    period = find_period(drive)
    if period >= 64 and drive.size // period >= 2:
        return _periodic(drive, outputs, rate, orders, period)
    return _segments(drive, outputs, rate, orders)


def _periodic(drive: Real, outputs: Real, rate: float, orders: tuple[int, ...], period: int) -> Responses:
    count = drive.size // period
    first = 1 if count >= 3 else 0  # the transient dies out in the first period
    span = slice(first * period, count * period)
    U = np.fft.rfft(drive[span].reshape(-1, period), axis=1) / period
    lines = np.arange(U.shape[1])
    s = 2j * np.pi * lines * rate / period
    Y = []
    for output, order in zip(outputs, orders, strict=True):
        folded = output[span].reshape(-1, period)
        if order < 2 and folded.shape[0] > 2:  # a slow drift from period to period is no vibration
            drift = np.gradient(folded.mean(axis=1)) / period
            folded = folded - drift[:, None] * np.arange(period)
        Y.append(np.fft.rfft(folded, axis=1) / period * s ** (2 - order))
    return _average(U, np.array(Y), lines[1:-1] * rate / period, slice(1, -1), count - first, period)


def _average(U: Complex, Y: Complex, frequency: Real, lines: slice, averages: int, period: int) -> Responses:
    U, Y = U[:, lines], Y[:, :, lines]
    drive = np.mean(U, axis=0)
    size = np.abs(drive)
    noise = np.std(U, axis=0) / np.sqrt(averages) if averages > 1 else np.zeros(size.shape)
    excited = (size > EXCITED * size.max()) & (size > 10.0 * noise)
    if excited.sum() < 12:
        raise RefusedError(f"the input excites {int(excited.sum())} spectral lines; a multisine or sweep would do")
    drive, U, Y = drive[excited], U[:, excited], Y[:, :, excited]
    values = np.mean(Y, axis=1) / drive
    deviation = np.zeros(values.shape)
    if averages > 2:
        error = Y / drive - values[:, None] * (U / drive)
        deviation = np.sqrt(np.mean(np.abs(error) ** 2, axis=1) / (averages - 1.0) / 2.0)
    return Responses(
        frequency=frequency[excited], values=values, deviation=deviation, averages=averages, period=period
    )


def _segments(drive: Real, outputs: Real, rate: float, orders: tuple[int, ...]) -> Responses:
    length = min(drive.size // 4, int(4.0 * rate))
    if length < 128:
        raise RefusedError(
            f"the record of {drive.size / rate:.3g} s is too short for a response; record at least a minute"
        )
    step = length // 4
    starts = np.arange(0, drive.size - length - 1, step)
    window = np.hanning(length + 1)[:-1]
    lines = np.arange(length // 2 + 1)
    z = np.exp(2j * np.pi * lines / length)
    s = 2j * np.pi * lines * rate / length

    def spectra(samples: Real, differences: int) -> Complex:
        values = np.diff(samples, n=differences) if differences else samples
        rows = np.array([values[a : a + length] for a in starts if a + length <= values.size])
        return np.fft.rfft((rows - rows.mean(axis=1, keepdims=True)) * window, axis=1)

    U = spectra(drive, 0)
    xx = np.mean(np.abs(U) ** 2, axis=0)
    values, deviation = [], []
    for output, order in zip(outputs, orders, strict=True):
        differences = 2 - order
        Y = spectra(output, differences)
        used = min(len(U), len(Y))
        cross = np.mean(Y[:used] * np.conj(U[:used]), axis=0)
        response = cross / xx
        left = np.mean(np.abs(Y[:used] - response * U[:used]) ** 2, axis=0)
        with np.errstate(divide="ignore", invalid="ignore"):
            factor = np.where(lines > 0, (s / (z - 1.0)) ** differences, 1.0)
        independent = max(1.0, used * step / length * 1.9)
        values.append(response * factor)
        deviation.append(np.sqrt(left / xx / independent / 2.0) * np.abs(factor))
    keep = (xx > EXCITED**2 * xx[1:].max()) & (lines > 0) & (lines < 0.92 * lines[-1])
    if keep.sum() < 12:
        raise RefusedError(f"the input excites {int(keep.sum())} spectral lines; a multisine or sweep would do")
    return Responses(
        frequency=(lines * rate / length)[keep],
        values=np.array(values)[:, keep],
        deviation=np.array(deviation)[:, keep],
        averages=len(U),
        period=0,
    )
