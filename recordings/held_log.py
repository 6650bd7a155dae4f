"""The rate at which a log was refreshed, where its file was written faster: repeated values tell by themselves.

A log that is held at f_h changes at its updates only. The squared changes d_k^2 = (x_k - x_{k-1})^2 are then a train of
pulses, whose spectrum D(f) has lines at f_h and its multiples that are as high as D(0) itself; those of any other log
fall off from 0. Between updates only noise that was added after the hold is left, and that is the log's noise: what
stands between 0.5 f_h and the file's own rate is a staircase's image, no noise.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len, rfft

Vector = NDArray[np.float64]

LINE = 0.6  # of D(0), above which a line of the squared changes is the updates'
QUIET = 0.2  # of the rms change at an update, that may be left of changes in between
ENOUGH = 64  # updates, below which nothing is said
FINER = 8  # cells of the spectrum per 1/length
PHASES = 16  # tried per update
OFF = np.array(
    [0.0, 0.25, -0.25, 0.5, -0.5, 0.75, -0.75, 1.0, -1.0]
)  # cells of the spectrum from a line's top, tried
PLACED = 0.95  # of the changes in between: at a rate near a fraction of the file's a few are an update's
OF_NORMAL = 0.8711  # rms of that share of a normal distribution's smallest deviations over that of all
AGREE = 0.01  # of the rate, within which the logs of one device must agree
LOUDEST = (
    100.0  # times the median square of all changes that moved at which a change's square is cut: a jump is one
)


@dataclass(frozen=True)
class Hold:
    """How a log repeats itself.

    Attributes:
        rate: Of its updates [Hz].
        noise: Standard deviation of what was added after the hold [the log's unit].
    """

    rate: float
    noise: float


def hold_of(samples: Vector, rate: float) -> Hold | None:
    """How ``samples``, shape (n,), written at ``rate`` [Hz], repeat themselves; ``None`` where they don't."""
    change = np.diff(np.asarray(samples, dtype=np.float64))
    square = np.square(change)
    moved = square[square > 0.0]
    if moved.size < ENOUGH:
        return None
    square = np.minimum(square, LOUDEST * float(np.median(moved)))
    n = change.size
    size = next_fast_len(FINER * n, real=True)
    lines = np.abs(np.asarray(rfft(square, size)))
    f = np.arange(lines.size) * (rate / size)
    reach = (f > 2.0 * FINER * rate / size) & (f * n / rate > ENOUGH) & (f <= 0.5 * rate * (1.0 + 1e-9))
    tall = np.flatnonzero(reach & (lines > LINE * lines[0]))
    if tall.size == 0:
        return None
    near = tall[f[tall] < f[tall[0]] + 2.0 * rate / n]
    about = float(f[near[np.argmax(lines[near])]])
    update, at_update = max(
        (_updates(n, u, rate, square) for u in about + OFF * rate / size),
        key=lambda found: float(square[found[1]].sum()) / max(int(found[1].sum()), 1),
    )
    if not at_update.any() or at_update.all():
        return None
    still = np.sort(np.abs(change[~at_update]))[: round(PLACED * np.sum(~at_update))]
    left, jumps = float(np.sqrt(np.mean(np.square(still)))) / OF_NORMAL, np.sqrt(square[at_update])
    if left > QUIET * float(np.sqrt(np.mean(np.square(jumps)))) or not float(np.median(jumps)) > left:
        return None
    return Hold(update, left / math.sqrt(2.0))


def _updates(n: int, update: float, rate: float, square: Vector) -> tuple[float, NDArray[np.bool_]]:
    """(``update``, which of ``n`` changes are an update's), at the phase that holds most of them."""
    steps = np.arange(n + 1) * (update / rate)
    phases = (np.diff(np.floor(steps + phase)) > 0.0 for phase in np.arange(PHASES) / PHASES)
    return update, max(phases, key=lambda at: float(square[at].sum()))


def common_hold(logs: Sequence[Vector], rate: float) -> Hold | None:
    """What the logs of one device, each shape (n,), say together: those that tell agree, a third of those that move.

    A log that hardly moves between its updates shows noise alone.
    """
    moving = [x for x in logs if np.unique(x).size > ENOUGH]
    found = [hold for hold in (hold_of(x, rate) for x in moving) if hold is not None]
    if not found or 3 * len(found) < len(moving):
        return None
    update = float(np.median([hold.rate for hold in found]))
    if any(abs(hold.rate / update - 1.0) > AGREE for hold in found):
        return None
    return Hold(update, float(np.median([hold.noise for hold in found])))
