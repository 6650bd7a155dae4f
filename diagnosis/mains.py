"""Hum of the mains taken off: a line at a multiple of 50 or 60 Hz, as weak as cables pick it up, is no physics of the joint.

A shaken floor and a ground loop look alike in one accelerometer. What tells them is the frequency, which a grid keeps to
0.2 %, and the size: a line of the mains below 2 % of a channel's signal, or below its white noise, is taken for the
recording's. In each record,

    y - Re(a exp(i 2 pi f t)),  a = 2 sum h r exp(-i 2 pi f t) / sum h,

r what the base leaves, h a Hann window over where the record is quiet (a hit's second half), f common to all runs.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.channels import ACCELERATIONS
from jointscope.diagnosis.input_noise import white_part
from jointscope.diagnosis.noise import dynamic_level
from jointscope.diagnosis.own_hit import is_hit
from jointscope.diagnosis.resolution import clips

if TYPE_CHECKING:
    from jointscope.diagnosis.objective import Predict
    from jointscope.diagnosis.problem import Output, PreparedRun, Problem

Vector = NDArray[np.float64]

MAINS = (50.0, 60.0)  # Hz
KEPT_TO = 0.002  # of its frequency, to which a grid is kept
MULTIPLES = 6  # of it that cables pick up
TRIED = 41  # frequencies within that band
HUM = 0.02  # of a channel's signal, rms, below which such a line is the recording's, as it is below the channel's noise
BESIDE = (3.0, 4.0, 5.0, 6.0, 7.0, 8.0)  # widths 1/T to either side, whose power a line is held against
SHORT = 0.25  # s of quiet, below which a line and its neighbours are one
STANDS = 12.0  # standard deviations by which its power over all records must exceed theirs ...
BESIDE_ANOTHER = 4.0  # ... and by which that of another multiple of the same grid's must


def without_hum(problem: Problem, theta: Vector, predict: Predict) -> Problem:
    """``problem`` with the weak lines of the mains taken off its accelerations, and a finding for each.

    Args:
        theta: The refitted base, shape (n_theta,).
        predict: The forward model.
    """
    left = [
        [np.nan_to_num(o.data - y) for o, y in zip(run.outputs, predict(run, theta, (), problem), strict=True)]
        for run in problem.runs
    ]
    found = sorted({round(f, 6) for mains in MAINS for f in _lines(problem, left, mains)})
    if not found:
        return problem
    runs = tuple(
        replace(run, outputs=tuple(_outputs(run, rows, found)))
        for run, rows in zip(problem.runs, left, strict=True)
    )
    said = [f"hum of {f:.2f} Hz, a multiple of the mains': taken off as the recording's own" for f in found]
    return replace(problem, runs=runs, findings=(*problem.findings, *said))


def _lines(problem: Problem, left: Sequence[Sequence[Vector]], mains: float) -> list[float]:
    """The multiples [Hz] of a grid's frequency near ``mains`` at which the records have a weak line."""
    tried = mains * (1.0 + np.linspace(-KEPT_TO, KEPT_TO, TRIED))
    heard: dict[int, tuple[Vector, Vector]] = {}
    for k in range(1, MULTIPLES + 1):
        takes = [
            _quietly(run, o, r)
            for run, rows in zip(problem.runs, left, strict=True)
            for o, r in zip(run.outputs, rows, strict=True)
            if _can_hum(run, o, k * mains)
        ]
        if not takes:
            continue
        beside = np.array([_beside(quiet, k * mains) for quiet in takes])
        power = np.stack([np.square(np.abs(_amplitudes(quiet, k * tried))) for quiet in takes], axis=1)
        excess = (np.sum(power / beside, axis=1) - len(takes)) / np.sqrt(len(takes))
        weak = np.array([quiet.weak for quiet in takes])
        sizes = np.median(np.sqrt(0.5 * np.maximum(power - beside, 0.0)) / weak, axis=1)
        heard[k] = (excess, sizes)
    loud = [excess for excess, _ in heard.values() if np.max(excess) > STANDS]
    if not loud:
        return []
    best = int(np.argmax(sum(loud)))
    return [
        float(k * tried[best])
        for k, (excess, sizes) in heard.items()
        if excess[best] > BESIDE_ANOTHER and sizes[best] < 1.0
    ]


def _can_hum(run: PreparedRun, output: Output, frequency: float) -> bool:
    if output.quantity not in ACCELERATIONS or frequency > 0.45 * output.rate or not dynamic_level(output) > 0.0:
        return False
    quiet = _quiet(run, output)
    return float(np.count_nonzero(quiet)) / output.rate > SHORT and not clips(output)


def _quiet(run: PreparedRun, output: Output) -> NDArray[np.bool_]:
    quiet = output.mask.copy()
    if is_hit(run):
        quiet[: quiet.size // 2] = False
    return quiet


@dataclass(frozen=True, eq=False)
class Quiet:
    """The quiet part of one record.

    Attributes:
        times: [s], shape (n,).
        weighted: h (r - its mean under h) / sum(h), shape (n,).
        width: Of a line [Hz], one over the part's duration.
        weak: Rms below which a line is the recording's own.
    """

    times: Vector
    weighted: Vector
    width: float
    weak: float


def _quietly(run: PreparedRun, output: Output, r: Vector) -> Quiet:
    where = _quiet(run, output)
    x, h = r[where], np.hanning(np.count_nonzero(where))
    h /= np.sum(h)
    weak = max(HUM * dynamic_level(output), white_part(x))
    return Quiet(output.times[where], h * (x - h @ x), output.rate / x.size, weak)


def _amplitudes(quiet: Quiet, frequencies: Vector) -> NDArray[np.complex128]:
    """a of evenly spaced ``frequencies`` [Hz], shape of them: one exponential, then turned from each to the next."""
    spacing = frequencies[1] - frequencies[0] if frequencies.size > 1 else 0.0
    turn = np.exp(-2j * np.pi * spacing * quiet.times)
    turned = quiet.weighted * np.exp(-2j * np.pi * frequencies[0] * quiet.times)
    a = np.empty(frequencies.size, dtype=np.complex128)
    for k in range(frequencies.size):
        a[k] = 2.0 * np.sum(turned)
        turned *= turn
    return a


def _beside(quiet: Quiet, frequency: float) -> float:
    """Mean of |a|^2 to either side of a frequency."""
    beyond = quiet.width * np.asarray(BESIDE)
    powers = [np.square(np.abs(_amplitudes(quiet, at))) for at in (frequency - beyond, frequency + beyond)]
    return max(float(np.mean(powers)), 1e-300)


def _outputs(run: PreparedRun, left: Sequence[Vector], found: Sequence[float]) -> Iterator[Output]:
    for output, r in zip(run.outputs, left, strict=True):
        data = output.data
        for f in found:
            if _can_hum(run, output, f):
                a = _amplitudes(_quietly(run, output, r), np.array([f]))[0]
                data = data - np.real(a * np.exp(2j * np.pi * f * output.times))
        yield replace(output, data=data)
