"""Hits in the time domain: where the hammer touches, how loud its channel is in between, and which hits are no good."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Real = NDArray[np.float64]

DOUBLE_HIT_SHARE = 0.03  # a second contact above this share of the first peak
DOUBLE_HIT_WITHIN = 0.05  # s after the first


@dataclass(frozen=True, kw_only=True, eq=False)
class Contact:
    """Where a force record holds contact.

    Attributes:
        window: Indices of the samples that may hold force, rising, shape (m,).
        length: Time from first to last sample above the noise, of the strongest pulse [s].
        peak: Largest force, with its sign.
        at: Index of that sample.
        noise: Standard deviation of the samples outside the window.
        offset: Their mean.
        secondary: Peak of the strongest further pulse over the first [-]; 0 where there is none.
        secondary_delay: Its time after the first [s]; 0 where there is none.
        pulses: Number of separate pulses found.
    """

    window: NDArray[np.intp]
    length: float
    peak: float
    at: int
    noise: float
    offset: float
    secondary: float
    secondary_delay: float
    pulses: int


def find_contact(force: Real, rate: float) -> Contact | None:
    """Find the contact in one force record of shape (n,), sampled at ``rate`` [Hz]; ``None`` where nothing stands out.

    A pulse is a stretch above five standard deviations of the record's rest (by the median, so that the pulse itself
    doesn't count) and above 0.3 % of the peak. The window adds to either side 15 % of the pulse, for its flanks
    below the threshold, and three samples, for the ringing of the anti-alias filter.
    """
    offset = float(np.median(force))
    size = np.abs(force - offset)
    noise = 1.4826 * float(np.median(size))
    at = int(np.argmax(size))
    peak = float(force[at] - offset)
    if abs(peak) < 8.0 * noise or abs(peak) == 0.0:
        return None
    loud = size > max(5.0 * noise, 0.003 * abs(peak))
    pulses = _merge(np.flatnonzero(loud), gap=max(3, round(0.002 * rate)))
    main = next(pulse for pulse in pulses if pulse[0] <= at <= pulse[1])
    rest = [pulse for pulse in pulses if pulse is not main and size[pulse[0] : pulse[1] + 1].max() > 6.0 * noise]
    pieces = []
    for first, last in [main, *rest]:
        margin = round(0.15 * (last - first + 1)) + 3
        pieces.append(np.arange(max(0, first - margin), min(force.size, last + margin + 1)))
    window = np.unique(np.concatenate(pieces))
    outside = np.delete(force, window)
    strongest = max(rest, key=lambda pulse: size[pulse[0] : pulse[1] + 1].max(), default=None)
    top = 0 if strongest is None else strongest[0] + int(np.argmax(size[strongest[0] : strongest[1] + 1]))
    return Contact(
        window=window,
        length=(main[1] - main[0] + 1) / rate,
        peak=peak,
        at=at,
        noise=float(np.std(outside, ddof=1)) if outside.size > 8 else noise,
        offset=float(np.mean(outside)) if outside.size > 8 else offset,
        secondary=0.0 if strongest is None else float(size[top] / abs(peak)),
        secondary_delay=0.0 if strongest is None else (top - at) / rate,
        pulses=1 + len(rest),
    )


def _merge(index: NDArray[np.intp], gap: int) -> list[tuple[int, int]]:
    breaks = np.flatnonzero(np.diff(index) > gap)
    firsts = np.concatenate([index[:1], index[breaks + 1]])
    lasts = np.concatenate([index[breaks], index[-1:]])
    return [(int(a), int(b)) for a, b in zip(firsts, lasts, strict=True)]


def is_double_hit(contact: Contact) -> bool:
    """Whether the hammer bounced: a second force peak above 3 % of the first within 50 ms."""
    return contact.secondary > DOUBLE_HIT_SHARE and 0.0 < abs(contact.secondary_delay) <= DOUBLE_HIT_WITHIN


def is_clipped(samples: Real, full_scale: float | None = None) -> bool:
    """Whether a record is cut off: three or more samples in a row at its extreme, or any at ``full_scale``."""
    extreme = float(np.max(np.abs(samples)))
    if extreme == 0.0:
        return False
    if full_scale is not None and extreme >= 0.999 * full_scale:
        return True
    flat = np.abs(np.abs(samples) - extreme) <= 1e-9 * extreme
    run = np.convolve(flat.astype(float), np.ones(3), mode="valid")
    return bool(run.max() >= 3.0)
