"""What of a record is compared: at which rate, and where its instrument resolves what happens."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from jointscope.diagnosis.channels import ACCELERATIONS, recorded
from jointscope.diagnosis.noise import ANGULAR, quantum
from jointscope.diagnosis.problem import Output
from jointscope.recordings.bandlimited import bandlimited

Vector = NDArray[np.float64]

TAIL = 8  # samples left out at the end, where the anti-aliasing kernel looks past the record
KEPT_HITS, KEPT_OTHERS = 2000.0, 1000.0  # Hz; records of twice this rate and more are thinned to no less
PLATEAU = 8  # samples at a record's very peak: it clips, and is left as it is
RESOLVED = 0.1  # s, two periods of a slow joint


def thinned(output: Output, *, hits: bool) -> Output:
    """The record band-limited and thinned to a whole fraction of its rate, no slower than is kept.

    A joint rings below 100 Hz: on motions and sweeps what lies above 400 Hz is noise, and every simulation pays for it.
    A record that has gaps or clips stays as it is.
    """
    step = int(output.rate // (KEPT_HITS if hits else KEPT_OTHERS))
    if step < 2 or not output.data.size or not output.mask[:-TAIL].all() or clips(output):
        return output
    rate = output.rate / step
    times = output.times[::step]
    mask = np.ones(times.size, dtype=np.bool_)
    mask[-TAIL:] = False
    data = recorded(output.data, output.rate, float(output.times[0]), times, rate)
    thin = replace(
        output, rate=rate, times=times, data=data, mask=mask, step=quantum(output), recorded_rate=output.rate
    )
    if output.quantity in ANGULAR or times.size < 2 or not output.mask.any():
        # angles lose nothing, and of one sample, or none that counts, nothing can be said
        return thin
    lost = (output.data - bandlimited(data, rate, float(times[0]))(output.times))[output.mask]
    return replace(thin, taken_off=float(np.mean(np.square(lost))))


def clips(output: Output) -> bool:
    """Whether an acceleration stays at its highest or lowest value for some samples."""
    if not output.data.size:
        return False
    ends = (float(output.data.min()), float(output.data.max()))
    often = max(np.count_nonzero(output.data == end) for end in ends)
    return output.quantity in ACCELERATIONS and bool(often >= PLATEAU)


def where_resolved(output: Output, thin: Output) -> Output:
    """``thin``, which is ``output`` thinned, compared only where the encoder of an angle resolves it."""
    if output.quantity not in ANGULAR or output.data.size <= 64:
        return thin
    seen = resolved(output.data, output.rate)[:: round(output.rate / thin.rate)]
    return replace(thin, mask=thin.mask & seen)


def resolved(data: Vector, rate: float) -> NDArray[np.bool_]:
    """Where an angle moves by more than two steps of its encoder within ``RESOLVED``, shape of ``data``.

    A decay below the step stands still in the record, as if dry friction had stopped it.
    """
    levels = np.unique(data)
    if levels.size < 2 or levels.size > data.size // 4:
        return np.ones(data.size, dtype=np.bool_)
    width = max(3, round(RESOLVED * rate)) | 1
    span = maximum_filter1d(data, width, mode="nearest") - minimum_filter1d(data, width, mode="nearest")
    return np.asarray(span > 2.5 * float(np.min(np.diff(levels))), dtype=np.bool_)
