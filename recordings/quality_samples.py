"""Samples and their clock: gaps, values stuck or held, jitter, and the mains in between."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from jointscope.recordings.campaign import Run, Signal
from jointscope.recordings.finding import Finding
from jointscope.recordings.quality_levels import SENSED, resolution
from jointscope.recordings.units import si_unit

Real = NDArray[np.float64]
MAINS: Final = (50.0, 60.0)  # Hz
STUCK = 8  # equal samples in a row


def sample_findings(run: Run, signal: Signal) -> Iterator[Finding]:
    """``sample-gaps``, ``held-samples``, ``time-jitter`` and ``mains-hum``."""
    x, rate, column = signal.samples, signal.sampling_rate, signal.channel.column
    missing = int(np.isnan(x).sum())
    if missing:
        share = 100.0 * missing / x.size
        yield Finding("sample-gaps", run.id, column, f"{missing} of {x.size} samples missing ({share:.2g} %)")
    held = hold_length(x)
    if held > 1:
        detail = f"each value stands for {held} samples: refreshed at {rate / held:.4g} Hz, declared {rate:.4g} Hz"
        yield Finding("held-samples", run.id, column, detail)
    elif signal.channel.quantity in SENSED:
        at, count = longest_stuck(x)
        if count >= STUCK:
            detail = (
                f"{count} equal samples in a row from {at / rate + signal.stream.start:.4g} s in a moving signal"
            )
            yield Finding("sample-gaps", run.id, column, detail)
    if signal.stream.jitter * rate > 0.02 and signal.channel is signal.stream.channels[0]:
        detail = (
            f"time stamps off the grid by up to {signal.stream.jitter * 1e6:.3g} us "
            f"({100.0 * signal.stream.jitter * rate:.2g} % of a sample); resampled band-limited"
        )
        yield Finding("time-jitter", run.id, column, detail)
    if signal.channel.role == "output" and signal.channel.quantity in SENSED:
        yield from _hum(run, signal)


def hold_length(x: Real) -> int:
    """k where values come in blocks of k equal samples throughout; 1 for an ordinary record."""
    known = x[np.isfinite(x)]
    changes = np.flatnonzero(np.diff(known) != 0.0)
    if changes.size < 32:
        return 1
    gaps = np.diff(changes)
    # turning points of a coarse record may repeat a value; a hold repeats every one
    k = int(np.gcd.reduce(gaps))
    return k if k > 1 and changes.size * k > 0.5 * known.size else 1


def longest_stuck(x: Real) -> tuple[int, int]:
    """Start and length of the longest row of equal samples inside a signal that moves before and after it."""
    same = np.concatenate([[False], np.diff(x) == 0.0, [False]])
    edges = np.flatnonzero(np.diff(same.astype(np.int8)))
    step, extreme = resolution(x[np.isfinite(x)]), float(np.nanmax(np.abs(x)))
    best = (0, 1)
    for first, end in zip(edges[::2], edges[1::2], strict=True):
        count = int(end - first) + 1
        before, after = x[max(0, first - count) : first], x[end + 1 : end + 1 + count]
        if min(before.size, after.size) < 4 or abs(x[first]) >= 0.999 * extreme:
            continue
        moving = min(float(np.nanstd(before)), float(np.nanstd(after)))
        if moving > 5.0 * step and count > best[1]:
            best = (int(first), count)
    return best


def _hum(run: Run, signal: Signal) -> Iterator[Finding]:
    for mains in MAINS:
        amplitude = hum_amplitude(signal.samples, signal.sampling_rate, mains)
        rms = float(np.nanstd(signal.samples))
        if amplitude > 0.005 * rms:
            unit = si_unit(signal.channel)
            share = 100.0 * amplitude / rms
            detail = f"steady line at {mains:.0f} Hz of amplitude {amplitude:.3g} {unit}, {share:.2g} % of the rms"
            yield Finding("mains-hum", run.id, signal.channel.column, detail)


def hum_amplitude(x: Real, rate: float, mains: float) -> float:
    """Amplitude of a steady, narrow line at ``mains`` [Hz], or 0 where there is none.

    It must stand 20 dB above everything 1.5 to 6 Hz beside it in the record's second half, when what was excited has
    decayed, and be no weaker in the first: a resonance is wider, a decaying or swept one not steady.
    """
    if x.size < 4.0 * rate or rate < 2.5 * mains or not np.isfinite(x).all():
        return 0.0
    halves = [_line(part, rate, mains) for part in (x[: x.size // 2], x[x.size // 2 :])]
    (first, _), (second, beside) = halves
    return second if first > 0.7 * second and second > 10.0 * beside else 0.0


def _line(x: Real, rate: float, mains: float) -> tuple[float, float]:
    """Amplitudes [unit of x] at the line and, the largest, beside it (Hann window)."""
    window = np.hanning(x.size)
    spectrum = 2.0 * np.abs(np.fft.rfft((x - x.mean()) * window)) / window.sum()
    distance = np.abs(np.fft.rfftfreq(x.size, 1.0 / rate) - mains)
    near = max(0.1, 1.0 * rate / x.size)
    return float(spectrum[distance <= near].max()), float(spectrum[(distance > 1.5) & (distance < 6.0)].max())
