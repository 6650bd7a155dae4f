"""A line that only the torque log has: a ripple above half its rate, folded down by sampling without a filter.

An inverter's or a current loop's ripple at f stands in a log of rate r at |f - k r|, where nothing acts. It is steady
while what drives the machine comes and goes, so in each log

    u - Re(a exp(i 2 pi f t)),  a the median over a quarter second's windows of 2 sum h u exp(-i 2 pi f t) / sum h,

h a Hann window; f is common to all logs of a campaign.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter
from scipy.signal import detrend

from jointscope.recordings.bandlimited import bridged

Vector = NDArray[np.float64]

LOWEST = 20.0  # Hz; what is slower, a joint answers to
PADDED = 4  # times a record's length, for frequencies between its own
BESIDE = 24  # widths 1/T to either side, whose median a line is held against
STANDS = 60.0  # times that, in power, by which a line must stand out of the log that shows it best ...
ELSEWHERE = 8.0  # ... and of most of the others
WIDTH = 1.0  # 1/T, within which it is the same line
WINDOW = 0.25  # s of one look at it


def folded_line(logs: Sequence[tuple[Vector, float]]) -> float:
    """Frequency [Hz] of the line that most logs have in common; 0 without one.

    Args:
        logs: Samples, shape (n,), and rate [Hz] of each.
    """
    spectra = [_spectrum(samples, rate) for samples, rate in logs if samples.size > 4 * BESIDE]
    if not spectra:
        return 0.0
    peaks = [(float(np.max(over)), i) for i, (_, _, over) in enumerate(spectra) if over.size]
    if not peaks or max(peaks)[0] < STANDS:
        return 0.0
    f, _, over = spectra[max(peaks)[1]]
    at = float(f[int(np.argmax(over))])
    found = []
    for f, power, over in spectra:
        near = np.flatnonzero(np.abs(f - at) < WIDTH * PADDED * (f[1] - f[0])) if f.size > 1 else np.zeros(0, int)
        if not near.size:
            continue
        best = near[int(np.argmax(over[near]))]
        if over[best] > ELSEWHERE:
            found.append((_summit(f, power, best), float(power[best])))
    if 2 * len(found) <= len(spectra):
        return 0.0
    where, weights = np.array(found).T
    return float(np.average(where, weights=weights))


def _spectrum(samples: Vector, rate: float) -> tuple[Vector, Vector, Vector]:
    """Frequencies [Hz], power, and power over its median beside, from ``LOWEST`` to nearly half the rate."""
    x = detrend(bridged(np.asarray(samples, dtype=np.float64))) * np.hanning(samples.size)
    power = np.asarray(np.square(np.abs(np.fft.rfft(x, PADDED * samples.size))), dtype=np.float64)
    f = np.asarray(np.fft.rfftfreq(PADDED * samples.size, 1.0 / rate), dtype=np.float64)
    beside = np.asarray(median_filter(power, 2 * BESIDE * PADDED + 1, mode="nearest"), dtype=np.float64)
    wanted = (f > LOWEST) & (f < 0.48 * rate)
    over = power / np.maximum(beside, 1e-12 * float(np.max(power, initial=0.0)) + 1e-300)
    return f[wanted], power[wanted], over[wanted]


def _summit(f: Vector, power: Vector, at: int) -> float:
    """Of the parabola through a peak's logarithms [Hz]."""
    if not 0 < at < f.size - 1:
        return float(f[at])
    a, b, c = np.log(np.maximum(power[at - 1 : at + 2], 1e-300))
    bend = a - 2.0 * b + c
    shift = 0.5 * (a - c) / bend if bend < 0.0 else 0.0
    return float(f[at] + np.clip(shift, -1.0, 1.0) * (f[1] - f[0]))


def without_line(u: Vector, rate: float, frequency: float) -> Vector:
    """``u`` [any unit], sampled at ``rate`` [Hz], without its steady line at ``frequency`` [Hz]; shape of ``u``."""
    turn = np.exp(2j * np.pi * frequency * np.arange(u.size) / rate)
    n = min(max(round(max(WINDOW, 6.0 / frequency) * rate), 8), u.size)
    window = np.hanning(n)
    starts = range(0, u.size - n + 1, max(n // 2, 1))
    looks = np.array(
        [2.0 * np.sum(window * detrend(u[k : k + n]) * np.conj(turn[k : k + n])) for k in starts]
    ) / np.sum(window)
    amplitude = complex(np.median(looks.real), np.median(looks.imag))
    return np.asarray(u - np.real(amplitude * turn), dtype=np.float64)
