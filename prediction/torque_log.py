r"""A slow torque log put right again, where it is known what the logger did.

A PLC that reads its torque at f_log may hand out the instantaneous value, may hold each value until the next
(``hold``: a staircase where the file's rate is higher), or may hand out the mean over the past period
(``average``: the spectrum is multiplied by sinc(f/f_log) exp(-j pi f/f_log), which at 80 Hz and 500 Hz costs 4.2 %
and 1 ms). The first needs no correction as long as it is read as samples of a band-limited signal; the other two are
undone here. What was aliased when the log was taken is lost.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Real = NDArray[np.float64]
LogKind = Literal["instantaneous", "hold", "average"]


@dataclass(frozen=True, kw_only=True)
class TorqueLog:
    """What a logger does to the torque.

    Attributes:
        kind: See the module's docstring.
        rate: At which it makes a new value, f_log [Hz]; ``None``: the file's own rate.
    """

    kind: LogKind = "instantaneous"
    rate: float | None = None


@dataclass(frozen=True, eq=False)
class Samples:
    """Uniform samples.

    Attributes:
        values: Shape (n,).
        rate: [Hz].
        start: Time of the first [s].
    """

    values: Real
    rate: float
    start: float


def undistorted(samples: Samples, log: TorqueLog) -> Samples:
    """Instantaneous samples of the signal that ``log`` turned into ``samples``.

    A staircase is taken back to its updates, so the result may have a lower rate; a running mean is deconvolved.

    Raises:
        ValueError: The file's rate is below the log's.
    """
    if log.kind == "instantaneous":
        return samples
    f_log = samples.rate if log.rate is None else log.rate
    if f_log > samples.rate * 1.0001:
        raise ValueError(f"a log made at {f_log:g} Hz can't be read from a file at {samples.rate:g} Hz")
    updates = samples if f_log > 0.999 * samples.rate else _updates(samples, f_log)
    return updates if log.kind == "hold" else _deconvolved(updates, f_log)


def _updates(samples: Samples, f_log: float) -> Samples:
    """The staircase's values at f_log; its phase is where the file's values change most often."""
    step = samples.rate / f_log
    changed = np.flatnonzero(np.diff(samples.values) != 0.0) + 1
    phase = 0.0
    if changed.size:
        turns = np.exp(2j * np.pi * changed / step)
        phase = (np.angle(turns.sum()) / (2 * np.pi) * step) % step
        phase = 0.0 if step - phase < 1e-6 * step else phase
    # The change is seen at the first file sample at or after the update, half a file period late on average
    # unless the two rates are commensurate.
    late = 0.0 if abs(step - round(step)) < 1e-6 else 0.5
    count = int(np.floor((samples.values.size - 1 - phase) / step)) + 1
    at = phase + step * np.arange(count)
    values = samples.values[
        np.minimum(np.ceil(at + 1e-9 * step + late - 0.5).astype(int), samples.values.size - 1)
    ]
    return Samples(values, f_log, samples.start + (phase - late) / samples.rate)


def _deconvolved(samples: Samples, f_log: float) -> Samples:
    """Divide by sinc(f/f_log) exp(-j pi f/f_log): the mean over the past period becomes the value at its end."""
    edge = min(256, samples.values.size - 1)
    x = samples.values
    padded = np.concatenate([2.0 * x[0] - x[edge:0:-1], x, 2.0 * x[-1] - x[-2 : -edge - 2 : -1]])
    f = np.fft.rfftfreq(padded.size, 1.0 / samples.rate)
    response = np.sinc(f / f_log) * np.exp(-1j * np.pi * f / f_log)
    whole = np.fft.irfft(np.fft.rfft(padded) / response, padded.size)
    return Samples(whole[edge : edge + x.size], samples.rate, samples.start)
