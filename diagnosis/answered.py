"""Whether what looks like a torque log's noise is torque: then the arm answers to it.

A drive feeds back what its encoder shows, so in motions its torque may be broadband and true; or its log is noisier there,
as sensors are whose noise grows with the signal. The accelerometer tells: the coherence of what would be taken off the log
with what the arm does (Bendat and Piersol, Random Data, 4th ed., section 6.1), over all takes of an experiment.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.signal import csd

from jointscope.diagnosis.channels import ACCELERATIONS
from jointscope.diagnosis.input_estimate import estimated_input
from jointscope.recordings.bandlimited import bandlimited

if TYPE_CHECKING:
    from jointscope.diagnosis.inputs import Drive
    from jointscope.recordings.campaign import Run, Signal

Vector = NDArray[np.float64]

SEGMENT = 0.5  # s
GROUPED = 3  # neighbouring frequencies whose coherence is averaged
FEWEST = 16  # segments, over all takes, from which a coherence is read: noise alone has one over their number
ANSWERED = 0.2  # coherence at the frequency that shows most


def answered(takes: Sequence[tuple[Run, Drive, float]]) -> bool | None:
    """Whether the arm answers to what ``input_estimate`` would take off these logs; ``None`` where nothing tells.

    Args:
        takes: Of one experiment and device: the run, its torque as logged, and the noise of the log [as the torque].
    """
    together: dict[float, Vector] = {}
    segments: dict[float, int] = {}
    for run, log, noise in takes:
        rate, start = log.signal.rate, log.signal.start
        removed = bandlimited(log.samples - estimated_input(log.samples, rate, noise), rate, start)
        for signal in _accelerometers(run):
            own = signal.sampling_rate
            inside = (signal.times >= removed.start) & (signal.times <= removed.end)
            x, y = removed(signal.times[inside]), signal.samples[inside]
            length = round(SEGMENT * own)
            if x.size < 2 * length or not (np.isfinite(y).all() and np.ptp(x) > 0.0 and np.ptp(y) > 0.0):
                continue
            spectra = np.stack([csd(a, b, own, nperseg=length)[1] for a, b in ((x, x), (y, y), (x, y))])
            together[own] = together.get(own, 0.0) + spectra
            segments[own] = segments.get(own, 0) + 2 * x.size // length
    told = [own for own in together if segments[own] >= FEWEST]
    return any(_coherence(*together[own]).max() > ANSWERED for own in told) if told else None


def _accelerometers(run: Run) -> list[Signal]:
    return [
        s
        for s in run.signals
        if s.channel.quantity in ACCELERATIONS and s.channel.role == "output" and s.channel.samples is not None
    ]


def _coherence(own: Vector, other: Vector, cross: Vector) -> Vector:
    """Averaged over neighbouring frequencies, from the second on: a mean tells nothing."""
    found = np.square(np.abs(cross)) / np.maximum(np.real(own * other), 1e-300)
    return np.convolve(found[2:-1], np.ones(GROUPED) / GROUPED, mode="valid")
