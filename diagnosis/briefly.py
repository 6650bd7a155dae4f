"""What the search simulates of a run: less of it than judging does, where less says the same.

Nineteen periods of a multisine say of a law's form what five do; how sure it is they say fourfold, and that is asked when
hypotheses are judged. A sweep's beginning is not like its end: it is left whole. And a slow joint needs no fine grid: at
25 steps per period Runge and Kutta's fourth order is 2e-3 of a sweep off, 1e-5 of a motion, where instruments leave 1e-2.
What hits ring in need not be the joint: their grid has to resolve all they hold, too.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.signal import periodogram, welch

from jointscope.diagnosis.opening import up_to
from jointscope.diagnosis.problem import recorded_angle

if TYPE_CHECKING:
    from jointscope.diagnosis.problem import PreparedRun

Vector = NDArray[np.float64]

LONG = 30_000  # steps of a run that is looked at as to whether less of it would do
ENOUGH = 10_000  # steps that are kept at least
PARTS = (8, 6, 4, 3, 2)  # of a run, the shortest that is like all of it
SEGMENTS = 8  # of the shortest part, over which its spectrum is averaged
BANDS = 4  # per octave, in which spectra are compared
HOLDS = 0.01  # of all power, below which a band is not asked
ALIKE = 1.5  # times the density of the whole, or less by that
SPANNED = 0.95  # of what the angle travels, and of the span of each input
PER_PERIOD = 25.0  # steps of a period of the arm on its held motor, at least
FINE_DRIVEN, FINE_HITS = 1000.0, 1500.0  # Hz, at least, of driven runs and of hits, whose pulse takes milliseconds
RUNG = 0.99  # of the power that a hit's outputs hold, below the frequency that its grid resolves
PER_RING = 6.0  # steps of that frequency's period, at least


def briefly(run: PreparedRun, frequency: float) -> PreparedRun:
    """The run as the search takes it, itself where nothing can be left out.

    Args:
        frequency: Resonance of the arm on the held motor [Hz].
    """
    if run.run.experiment == "hammer":
        return _coarser(run, max(FINE_HITS, PER_PERIOD * frequency, PER_RING * _rings_up_to(run)))
    return _coarser(_beginning(run), max(FINE_DRIVEN, PER_PERIOD * frequency))


def _rings_up_to(run: PreparedRun) -> float:
    """Frequency below which every output holds ``RUNG`` of its power [Hz]."""
    highest = 0.0
    for output in run.outputs:
        frequency, power = periodogram(np.where(output.mask, output.data, 0.0), output.rate)
        highest = max(highest, float(frequency[np.searchsorted(np.cumsum(power), RUNG * power.sum())]))
    return highest


def _coarser(run: PreparedRun, least: float) -> PreparedRun:
    """On half the grid, where that is no coarser than ``least`` [Hz] and still meets every sample."""
    rate = run.grid_rate / 2.0
    if rate < least or any(o.rate > rate for o in run.outputs):
        return run
    steps = -(-run.steps // 2)

    def nodes(x: Vector) -> Vector:
        return np.pad(x[::2], (0, 2 * steps + 1 - len(x[::2])), mode="edge")

    return replace(
        run,
        grid_rate=rate,
        steps=steps,
        load_half=nodes(run.load_half),
        motor_half=nodes(run.motor_half),
        command_half=nodes(run.command_half),
        observed_half=nodes(run.observed_half),
        command_rate_half=nodes(run.command_rate_half),
    )


def _beginning(run: PreparedRun) -> PreparedRun:
    """The beginning of a long run that is like all of it, the run itself where there is none."""
    if run.steps < LONG:
        return run
    for part in PARTS:
        steps = run.steps // part
        if steps >= ENOUGH and _alike(run, steps):
            return up_to(run, run.t0 + steps / run.grid_rate)
    return run


def _alike(run: PreparedRun, steps: int) -> bool:
    drives = (run.load_half, run.motor_half, run.command_half, run.observed_half)
    told = [x[::2] for x in drives if np.any(x)]
    angle = recorded_angle(run)
    spans = told if angle is None else [*told, angle[::2]]
    if not told or any(np.ptp(x[:steps]) < SPANNED * np.ptp(x) for x in spans):
        return False
    return all(_same_spectrum(x, x[:steps], run.grid_rate) for x in told)


def _same_spectrum(whole: Vector, part: Vector, rate: float) -> bool:
    """Whether both hold as much power per time in every band that matters."""
    length = part.size // SEGMENTS
    frequency, of_whole = welch(whole, rate, nperseg=length)
    _, of_part = welch(part, rate, nperseg=length)
    edges = frequency[1] * 2.0 ** (np.arange(BANDS * int(np.log2(frequency.size)) + 1) / BANDS)
    band = np.searchsorted(edges, frequency[1:], side="right")
    powers = [np.bincount(band, x[1:], minlength=band.max() + 1) for x in (of_whole, of_part)]
    asked = powers[0] > HOLDS * powers[0].sum()
    ratio = powers[1][asked] / powers[0][asked]
    return bool(np.all((ratio < ALIKE) & (ratio > 1.0 / ALIKE)))
