"""Where a periodic or resonant candidate should start: lines in what a model leaves, against frequency and position."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion, median_filter, uniform_filter1d

from jointscope.diagnosis.channels import ACCELERATIONS

if TYPE_CHECKING:
    from jointscope.diagnosis.problem import Problem

Vector = NDArray[np.float64]

_APART = 0.04  # relative spacing of two lines that count as two


@dataclass(frozen=True, eq=False)
class Residuals:
    """What a model leaves: data less prediction, zero where nothing is scored.

    Attributes:
        rows: Per run of the problem and output of the run, shape (n,).
    """

    rows: Sequence[Sequence[Vector]]

    def __iter__(self) -> Iterator[Sequence[Vector]]:
        return iter(self.rows)


def recorded(problem: Problem) -> Residuals:
    """The data themselves, where no model's residual is at hand."""
    return Residuals(
        [[np.where(o.mask, o.data - np.mean(o.data), 0.0) for o in run.outputs] for run in problem.runs]
    )


def spectral_peaks(
    problem: Problem, residuals: Residuals, low: float, high: float, count: int, *, narrow: bool
) -> tuple[float, ...]:
    """Frequencies [Hz] of the strongest lines, each channel against its own background.

    A tone is sought in every kind of channel: a motor's angle may show it where its torque hardly moves it, at the
    anti-resonance. A resonance is sought in accelerations alone: what is left of an angle is slow, whatever its cause.

    Args:
        problem: The campaign as prepared.
        residuals: What a model leaves, per run and output.
        low, high: Band [Hz].
        count: How many lines at most.
        narrow: Lines against a local background (a tone); else broad maxima (a resonance).
    """
    grid = np.geomspace(low, high, 1200) if not narrow else np.linspace(low, high, int((high - low) / 0.1) + 2)
    total = np.zeros(grid.size)
    for run, rows in zip(problem.runs, residuals, strict=True):
        for output, r in zip(run.outputs, rows, strict=True):
            if r.size < 64 or not np.any(r) or not (narrow or output.quantity in ACCELERATIONS):
                continue
            x = np.where(output.mask, r, 0.0)
            if output.quantity not in ACCELERATIONS:  # steep spectra leak into their own gaps
                x = np.where(binary_erosion(output.mask, iterations=2), np.gradient(np.gradient(x)), 0.0)
            size = 2 ** int(np.ceil(np.log2(x.size))) * (4 if narrow else 1)
            power = np.abs(np.fft.rfft(x * np.hanning(x.size), size)) ** 2
            f = np.fft.rfftfreq(size, 1.0 / output.rate)
            density = np.interp(grid, f, power, right=0.0)
            if narrow:
                empty = 1e-3 if output.quantity in ACCELERATIONS else 1e-9  # of the mean: no noise is less
                background = median_filter(density, size=61, mode="nearest") + empty * density.mean() + 1e-300
                total += np.minimum(density / background, 1e4)
            else:
                total += median_filter(density, size=9) / (density.mean() + 1e-300)
    return strongest(grid, total, count)


def response_peaks(
    problem: Problem, residuals: Residuals, low: float, high: float, count: int
) -> tuple[float, ...]:
    """Frequencies [Hz] at which what a model leaves follows the input most clearly, all runs averaged in phase.

    |sum conj(U) E|^2 over sum |U|^2 is the energy of E that is coherent with U; against its own background in frequency
    a further mode stands out long before it does in any one spectrum.

    Args:
        problem: The campaign as prepared.
        residuals: What a model leaves, per run and output.
        low, high: Band [Hz].
        count: How many frequencies at most.
    """
    grid = np.geomspace(low, high, 1600)
    pooled: dict[tuple[object, ...], list[tuple[Vector, Vector, float]]] = {}
    for run, rows in zip(problem.runs, residuals, strict=True):
        drive = run.load or run.motor
        for output, r in zip(run.outputs, rows, strict=True):
            if drive is None or output.quantity not in ACCELERATIONS or r.size < 64 or not np.any(r):
                continue
            key = (run.run.experiment, output.location, output.direction, output.rate)
            u = drive.signal(output.times)
            pooled.setdefault(key, []).append((u - np.mean(u[-8:]), np.where(output.mask, r, 0.0), output.rate))
    total = np.zeros(grid.size)
    for takes in pooled.values():
        size = 2 ** int(np.ceil(np.log2(max(r.size for _, r, _ in takes))))
        spectra = [(np.fft.rfft(u, size), np.fft.rfft(r, size)) for u, r, _ in takes]
        cross = np.abs(sum(np.conj(u) * e for u, e in spectra)) ** 2
        power = np.asarray(sum(np.abs(u) ** 2 for u, _ in spectra))
        coherent = cross / (power + 1e-6 * power.max())
        f = np.fft.rfftfreq(size, 1.0 / takes[0][2])
        density = np.interp(grid, f, uniform_filter1d(coherent, 3), right=0.0)
        background = median_filter(density, size=201, mode="nearest") + 1e-3 * density.mean() + 1e-300
        total += np.minimum(density / background, 1e3)
    return strongest(grid, total, count)


def strongest(grid: Vector, total: Vector, count: int) -> tuple[float, ...]:
    """The highest maxima of ``total`` over ``grid``, at least a few per cent apart."""
    inner = (total[1:-1] >= total[:-2]) & (total[1:-1] > total[2:])
    peaks = np.flatnonzero(inner) + 1
    found: list[float] = []
    for index in peaks[np.argsort(total[peaks])[::-1]]:
        if total[index] <= 0.0 or len(found) >= count:
            break
        value = float(grid[index])
        if all(abs(value - other) > _APART * other for other in found):
            found.append(value)
    return tuple(found)


__all__ = ["Residuals", "recorded", "response_peaks", "spectral_peaks", "strongest"]
