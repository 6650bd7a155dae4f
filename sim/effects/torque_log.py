"""A torque log slower than its stream: what drove the machine, from what the log held of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

Real = NDArray[np.float64]

WEAKEST = 0.3  # what a log passes of a frequency at the least, for that frequency to be raised again
_EDGE = 256  # samples by which the record is continued past its ends


def relogged(samples: Real, rate: float, log_rate: float, form: str, age: float = 0.0) -> Real:
    """The torque that a log held, averaged or thinned out at ``log_rate`` stands for.

    Args:
        samples: As logged, shape (n,).
        rate: Of the stream [Hz].
        log_rate: Of the log itself [Hz].
        form: ``averaged`` over the last 1/log_rate; ``held`` from its last update; ``seen-held``: likewise, and
            the rate is certain; ``averaged-held``: a mean, held; ``aliased``: thinned, drawn straight.
        age: What a value has when it is first written [s].

    Returns:
        Torque at the same times, shape (n,); what the log can't hold (above half its rate) is left out.
    """
    edge = min(_EDGE, samples.size - 1)
    long = np.pad(np.asarray(samples, dtype=np.float64), edge, mode="edge")
    trend = np.linspace(long[0], long[-1], long.size)
    f = np.fft.rfftfreq(long.size, 1.0 / rate)
    window = 1.0 / log_rate
    passed = np.sinc(f * window)
    lag = 0.5 * window
    if form in ("held", "seen-held", "averaged-held"):
        steps = passed / np.maximum(np.sinc(f / rate), 0.1) if window * rate > 1.0 else np.ones_like(f)
        stale = 0.5 * max(window - 1.0 / rate, 0.0)
        passed, lag = (steps * passed, stale + lag) if form == "averaged-held" else (steps, stale)
    elif form == "aliased":
        passed, lag = passed**2, 0.0
    restored = np.exp(2j * np.pi * f * (lag + age)) / np.maximum(np.abs(passed), WEAKEST)
    if log_rate < rate:
        restored[f > 0.5 * log_rate] = 0.0
    else:
        restored[f > 0.5 * log_rate] = 1.0
    whole = np.fft.irfft((np.fft.rfft(long - trend)) * restored, long.size) + trend
    return np.asarray(whole[edge : edge + samples.size], dtype=np.float64)


def unfolded(samples: Real, rate: float, line: float, age: float = 0.0) -> Real:
    """A log without the line that a ripple above half its rate has left in it.

    Sine and cosine are fitted to second differences, in which what drives the machine is small; where it is not, those
    samples are left out, three times over.

    Args:
        samples: As logged, shape (n,).
        rate: Of the stream [Hz].
        line: Where the ripple stands in the log [Hz].
        age: What a value has when it is written [s].
    """
    u = np.asarray(samples, dtype=np.float64)
    if u.size < 32:
        return u
    angle = 2.0 * np.pi * line / rate * np.arange(u.size)
    waves = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    bent, of_waves = np.diff(u, 2), np.diff(waves, 2, axis=0)
    keep = np.ones(bent.size, dtype=np.bool_)
    size: Real = np.zeros(2)
    for _ in range(4):
        size = np.asarray(np.linalg.lstsq(of_waves[keep], bent[keep], rcond=None)[0], dtype=np.float64)
        left = np.abs(bent - of_waves @ size)
        keep = left <= 3.0 * float(np.median(left)) + 1e-300
    rest = u - waves @ size
    k = np.arange(u.size, dtype=np.float64)
    return np.asarray(CubicSpline(k, rest)(np.clip(k + age * rate, 0.0, u.size - 1.0)), dtype=np.float64)
