"""Whether what is explained lies where the recordings hold anything: a model may ring with its log's noise, and they don't.

Noise of a torque log that is not white passes for torque, and makes the model ring at the joint's resonance where the joint
was quiet. Whatever damps or stiffens the model there makes the error smaller, and explains nothing that was recorded. So the
gain is split by frequency, and counts where the recordings are louder than what the child leaves of them.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.noise import Key, block_key

if TYPE_CHECKING:
    from jointscope.diagnosis.objective import Objective
    from jointscope.diagnosis.prepare import PreparedRun
    from jointscope.diagnosis.whiten import RunWhitener

Vector = NDArray[np.float64]

WINDOW = 512  # samples of a spectrum
LOUD = 2.0  # times what the child leaves, from which on a band of the recording holds something
QUIET = 0.1  # of what is explained, below which it is not what was recorded
WORTH_ASKING = 20.0  # nats

Spectra = dict[Key, Vector]


def silent_bands(objective: Objective, parent: Vector, child: Vector, gained: Mapping[str, float]) -> set[str]:
    """Experiments driven by a torque's log in which what the child explains is not in the recordings.

    Args:
        parent, child: w of the fitted runs, shape (n,) each.
        gained: By the child over its parent, per experiment [nats].
    """
    driven = {run.run.experiment for run in objective.prepared if run.motor is not None and run.load is None}
    asked = {name for name in driven if gained.get(name, 0.0) > WORTH_ASKING}
    if not asked:
        return set()
    recorded, before, after = _recorded(objective), _spectra(objective, parent), _spectra(objective, child)
    split: dict[str, Vector] = {name: np.zeros(2) for name in asked}
    for key, left in after.items():
        if str(key[0]) in asked:
            split[str(key[0])] += _explained(recorded[key], before[key], left)
    return {name for name, gain in split.items() if _is_quiet(gain)}


def unrecorded(recorded: Vector, before: Vector, after: Vector) -> bool:
    """The same of one kind of channel: whitened recording and what is left of it before and after, shape (n,) each."""
    return _is_quiet(_explained(_power(recorded), _power(before), _power(after)))


def _explained(recorded: Vector, before: Vector, left: Vector) -> Vector:
    """What is explained in all, and of it where the recording is loud, of the powers by frequency, shape (2,)."""
    gain = before - left
    return np.array([np.sum(gain), np.sum(gain[recorded > LOUD * left])])


def _is_quiet(gain: Vector) -> bool:
    explained, loud = gain
    return bool(0.0 < explained and loud < QUIET * explained)


@lru_cache(maxsize=1)  # all of a judgement's comparisons ask the same
def _recorded(objective: Objective) -> Spectra:
    """Of the recordings, whitened as what is left of them."""
    runs = zip(objective.whiteners, objective.prepared, strict=True)
    return _spectra(objective, np.concatenate([as_recorded(run, whitener) for whitener, run in runs]))


def as_recorded(run: PreparedRun, whitener: RunWhitener) -> Vector:
    """The recording itself as ``whitener`` has what is left of it, shape (n,)."""
    return np.asarray(whitener([output.data for output in run.outputs])[:, 0])


def _spectra(objective: Objective, w: Vector) -> Spectra:
    """Power of every kind of channel by frequency, over all its runs, shape (WINDOW / 2 + 1,)."""
    found: Spectra = {}
    position = 0
    for run, whitener in zip(objective.prepared, objective.whiteners, strict=True):
        for output, size in zip(run.outputs, whitener.sizes, strict=True):
            power = _power(w[position : position + size])
            key = block_key(run, output)
            found[key] = found.get(key, np.zeros(WINDOW // 2 + 1)) + power
            position += size
    return found


def _power(w: Vector) -> Vector:
    """Sum of the periodograms of half-overlapping windows, shape (WINDOW / 2 + 1,)."""
    if w.size < WINDOW:
        w = np.concatenate([w, np.zeros(WINDOW - w.size)])
    parts = np.lib.stride_tricks.sliding_window_view(w, WINDOW)[:: WINDOW // 2]
    return np.asarray(np.sum(np.square(np.abs(np.fft.rfft(parts * np.hanning(WINDOW), axis=1))), axis=0))
