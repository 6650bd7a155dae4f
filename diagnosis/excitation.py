"""The band that a run's excitation asks of the joint; what wanders below it is nobody's mismatch.

A multisine from 11 Hz says nothing of the motion below; there an angle drifts with whatever the bench does, and with
white weights that drift outweighs every resonance. It is cut where the excitation begins well above the observer's own
corner; a sweep that begins near it, and a motion, keep everything.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfilt

from jointscope.diagnosis.assembly import OBSERVER_HZ
from jointscope.recordings.drift import lower_edge

if TYPE_CHECKING:
    from jointscope.diagnosis.prepare import Output, PreparedRun

Vector = NDArray[np.float64]

CLEAR = 2.0  # times the observer's corner, above which an excitation's lower edge is clear of it
LEFT = 0.1  # of what lies below
BELOW = 0.7  # of the lower edge: corner of the cut


@lru_cache(maxsize=512)
def _sections(corner: float, rate: float) -> NDArray[np.float64]:
    return np.asarray(butter(2, corner, "highpass", fs=rate, output="sos"))


def below_excitation(run: PreparedRun, output: Output) -> NDArray[np.float64] | None:
    """Second-order sections that cut what lies below the run's excitation, or ``None`` where nothing is to be cut."""
    if run.mode != "observer" or run.motor is None or run.load is not None or run.command is not None:
        return None
    edge = lower_edge(run.motor.samples, run.motor.signal.rate)
    if edge < CLEAR * OBSERVER_HZ:
        return None
    return _sections(BELOW * edge, output.rate)


def asked_only(x: Vector, sections: NDArray[np.float64] | None) -> Vector:
    """``x`` with a tenth of what lies below the excitation, same shape, time along the first axis.

    A tenth and not nothing: offsets must stay determined.
    """
    if sections is None:
        return x
    return np.asarray(LEFT * x + (1.0 - LEFT) * sosfilt(sections, x, axis=0))
