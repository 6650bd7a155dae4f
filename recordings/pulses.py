"""Hammer pulses in a force record: where they are, which are second contacts, which are a filter's ringing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Real = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Pulse:
    """One contact.

    Attributes:
        first: Index of its first sample above a tenth of the peak.
        peak: Index of its largest sample.
        last: Index of its last sample above a tenth of the peak.
        height: Its largest value with its sign, baseline removed, in the channel's unit.
        width: Time between its half-height points, interpolated [samples].
    """

    first: int
    peak: int
    last: int
    height: float
    width: float


def baseline(force: Real) -> tuple[float, float]:
    """Level and standard deviation of what lies between the pulses (median; median absolute deviation)."""
    known = force[np.isfinite(force)]
    level = float(np.median(known))
    return level, 1.4826 * float(np.median(np.abs(known - level)))


def find_pulses(force: Real, rate: float, *, share: float = 0.1, dead_time: float = 0.0) -> tuple[Pulse, ...]:
    """Contacts in ``force``, shape (n,), sampled at ``rate`` [Hz], in order of time.

    Args:
        share: Smallest height that counts, as a share of the largest.
        dead_time: After a contact further ones are ignored for this long [s].

    A lobe beside which an opposite one of over 60 % of its height stands is a filter's ringing and no contact.
    """
    level, noise = baseline(force)
    x = np.where(np.isfinite(force), force - level, 0.0)
    largest = float(np.max(np.abs(x), initial=0.0))
    if largest <= max(8.0 * noise, 1e-300):
        return ()
    sign = 1.0 if x[int(np.argmax(np.abs(x)))] > 0.0 else -1.0
    y = sign * x
    rises = _peaks(y, max(share * largest, 6.0 * noise))
    found: list[Pulse] = []
    for peak in rises:
        pulse = _measured(y, peak, sign)
        if found and (pulse.first <= found[-1].last or peak - found[-1].peak <= max(3, round(dead_time * rate))):
            if y[peak] > y[found[-1].peak]:
                found[-1] = pulse
            continue
        if not _rings(y, peak):
            found.append(pulse)
    return tuple(found)


def _peaks(y: Real, threshold: float) -> list[int]:
    from scipy.signal import find_peaks

    padded = np.concatenate([[0.0], y, [0.0]])
    return [int(p) - 1 for p in find_peaks(padded, height=threshold, prominence=0.5 * threshold)[0]]


def _measured(y: Real, peak: int, sign: float) -> Pulse:
    foot = 0.1 * y[peak]
    first = last = peak
    while first > 0 and y[first - 1] > foot:
        first -= 1
    while last + 1 < y.size and y[last + 1] > foot:
        last += 1
    return Pulse(
        first=first, peak=peak, last=last, height=float(sign * y[peak]), width=_width(y, peak, 0.5 * y[peak])
    )


def _width(y: Real, peak: int, level: float) -> float:
    left = right = float(peak)
    for step, at in ((-1, peak), (1, peak)):
        while 0 <= at + step < y.size and y[at + step] > level:
            at += step
        beyond = y[at + step] if 0 <= at + step < y.size else 0.0
        edge = at + step * (y[at] - level) / max(y[at] - beyond, 1e-300)
        left, right = (edge, right) if step < 0 else (left, edge)
    return right - left


def _rings(y: Real, peak: int) -> bool:
    """Whether a lobe belongs to an alternating row: its neighbour on the larger side is opposite and as large."""
    around = y[max(0, peak - 3) : peak + 4]
    larger = y[max(0, peak - 12) : peak + 13].max() > 1.5 * y[peak]
    return bool(larger and -around.min() > 0.6 * y[peak])
