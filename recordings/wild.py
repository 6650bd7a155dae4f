r"""Single wild readings of a sensor, bridged: a bit that flipped, a contact that opened for a sample.

What a cubic through the two samples before and the two behind misses,

    d_t = x_t - (-x_{t-2} + 4 x_{t-1} + 4 x_{t+1} - x_{t+2}) / 6,

shows one wild reading of size a as a (1/6, -2/3, 1, -2/3, 1/6), and nothing of the motion beside it. Nothing else near by may be
like it: impacts come in numbers, and last longer than a sample of any record that was filtered before it was taken.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d

from jointscope.recordings.campaign import FORCES, Campaign, Channel, Run, with_channels

TRACE: Final = np.array([1.0, -4.0, 6.0, -4.0, 1.0]) / 6.0
WIDE: Final = 60  # samples to either side, in which ...
APART: Final = 5.0  # ... nothing else is a fifth as wild
BY_ITSELF: Final = 0.1  # of its size, that its trace may leave beside ...
NOISE: Final = 2.0  # ... so many times the median of |d|: a kink leaves 0.17
OF_ALL: Final = 12.0  # times the median of |d|, at least
OF_LARGEST: Final = 0.005  # of the record's largest sample, at least: less does no harm
FEW: Final = 0.002  # of a record's samples: what happens more often is no accident

Real = NDArray[np.float64]


def tamed(campaign: Campaign) -> tuple[Campaign, tuple[str, ...]]:
    """The campaign with single wild readings of its outputs bridged, and one line for each channel that had some.

    What drives a rig stays as it is logged: a hard tip's pulse may be a sample or two.
    """
    found = {
        id(channel): (run, channel, at)
        for run, channel in _outputs(campaign)
        if (at := wild_readings(np.asarray(channel.samples, dtype=np.float64))).size
    }
    if not found:
        return campaign, ()
    lines = tuple(
        f"{channel.quantity} at the {channel.location} (run {run.id}): {at.size} single wild "
        f"reading{'s' if at.size > 1 else ''} bridged"
        for run, channel, at in found.values()
    )
    bridged = {key: _bridged(channel, at) for key, (_, channel, at) in found.items()}
    runs = tuple(with_channels(run, bridged) for run in campaign.runs)
    return replace(campaign, runs=runs), lines


def wild_readings(x: Real) -> NDArray[np.intp]:
    """Positions of the samples of ``x``, shape (n,), that are wild by themselves; none where there are more than a few."""
    none = np.zeros(0, dtype=np.intp)
    if x.size < 2 * WIDE or not np.all(np.isfinite(x)):
        return none
    d = np.zeros_like(x)
    d[2:-2] = np.convolve(x, TRACE, mode="valid")
    size = np.abs(d)
    least = max(OF_ALL * float(np.median(size)), OF_LARGEST * float(np.max(np.abs(x - np.median(x)))))
    peaks = np.flatnonzero((size > least) & (size >= maximum_filter1d(size, 2 * WIDE + 1)))
    noise = NOISE * float(np.median(size))
    found = np.array([t for t in peaks if _alone(d, int(t), noise)], dtype=np.intp)
    return found if found.size <= max(1.0, FEW * x.size) else none


def _alone(d: Real, t: int, noise: float) -> bool:
    """Whether the peak of ``d`` at ``t`` is one reading's trace but for ``noise``, and nothing near it is like it."""
    low, high = t - WIDE, t + WIDE + 1
    if low < 0 or high > d.size:
        return False
    left = d[low:high].copy()
    left[WIDE - 2 : WIDE + 3] -= d[t] * TRACE / TRACE[2]
    size, itself = np.abs(left), slice(WIDE - 2, WIDE + 3)
    return bool(np.max(size[itself]) < BY_ITSELF * abs(d[t]) + noise and np.max(size) < abs(d[t]) / APART)


def _outputs(campaign: Campaign) -> Iterator[tuple[Run, Channel]]:
    for run in campaign.runs:
        for signal in run.signals:
            channel = signal.channel
            if (
                channel.samples is not None
                and channel.role == "output"
                and channel.quantity not in (*FORCES, "frf")
            ):
                yield run, channel


def _bridged(channel: Channel, at: NDArray[np.intp]) -> Channel:
    assert channel.samples is not None
    x = np.array(channel.samples, dtype=np.float64)
    x[at] = (4.0 * (x[at - 1] + x[at + 1]) - x[at - 2] - x[at + 2]) / 6.0
    x.setflags(write=False)
    return replace(channel, samples=x)
