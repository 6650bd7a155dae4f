r"""Where a narrow mode may be: one resonant term beside a local constant, fitted to what a model leaves of every channel.

Around a frequency f what a further mode of damping zeta adds to any channel is the model's own output X there, which is
smooth, times one resonant term, whatever the mode couples to; what the base is off by is X times something smooth:

    E(u) = [a + b H(u)] X(u) + noise,   H(u) = f^2 / (f^2 - u^2 + 2 i zeta f u),   |u - f| < half width,

a and b complex, the same in all runs of a kind (a local rational model of known pole). The gain of b over a alone, in nats
of the channel's own noise there, is summed over channels and kept apart by kind of experiment: a mode that one encoder
shows in the hits alone stands out among what friction leaves of the motions.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len
from scipy.ndimage import median_filter
from scipy.signal.windows import tukey

from jointscope.diagnosis.effects.lines import Residuals

if TYPE_CHECKING:
    from jointscope.diagnosis.problem import Output, Problem

Vector = NDArray[np.float64]

DAMPINGS = ((0.006, 1.01), (0.02, 1.02), (0.06, 1.05))  # tried, and the ratio of the frequencies at which each is
HALF_WIDTHS = 8.0  # of the mode, fitted to either side
FEWEST_BINS = 5  # of the spectrum, the same
BACKGROUND = 101  # bins whose median is the noise
EDGES = 0.1  # of a record that starts or ends in motion, tapered
HIGHEST = 0.45  # of the sampling rate
APART = (
    0.05,
    5.0,
)  # in frequency, or this many half widths of the clearer one in the same runs: there is no other
TELLING = 12.0  # nats that the clearest of a thousand hardly gains from noise alone
EACH = 3  # per kind of experiment
MOST = 6


@functools.lru_cache(maxsize=8)
def narrow_modes(
    problem: Problem, residuals: Residuals, low: float, high: float
) -> tuple[tuple[float, float], ...]:
    """Frequency [Hz] and damping ratio of modes that what a model leaves shows, clearest first.

    Args:
        problem: The campaign as prepared.
        residuals: What the model leaves.
        low, high: Band [Hz].
    """
    grids = _grids(low, high)
    kinds = [[_gains(channels, *grid) for grid in grids] for channels in _kinds(problem, residuals).values()]
    found = [mode for gains in kinds for mode in _clearest(gains, grids)[:EACH]]
    return tuple((f, zeta) for _, f, zeta in _distinct(found, 0.0)[:MOST])


def _grids(low: float, high: float) -> list[tuple[Vector, float]]:
    counts = [max(2, math.ceil(math.log(high / low) / math.log(ratio)) + 1) for _, ratio in DAMPINGS]
    return [(np.geomspace(low, high, n), zeta) for n, (zeta, _) in zip(counts, DAMPINGS, strict=True)]


def _kinds(problem: Problem, residuals: Residuals) -> dict[tuple[str, bool], list[_Channel]]:
    """Every channel in every kind of experiment, accelerations and what is differentiated to be like them.

    The spectrum of a travel would leak everywhere.
    """
    takes: dict[tuple[str, bool], dict[tuple[object, ...], list[tuple[Vector, Vector]]]] = {}
    rates: dict[tuple[object, ...], float] = {}
    for run, rows in zip(problem.runs, residuals, strict=True):
        for output, r in zip(run.outputs, rows, strict=True):
            if r.size < BACKGROUND or not np.any(r):
                continue
            times = _differentiations(output)
            e = np.diff(np.where(output.mask, r, 0.0), times)
            x = np.diff(np.where(output.mask, output.data - r, 0.0), times)
            if run.run.experiment != "hammer":
                taper = tukey(e.size, EDGES)
                e, x = taper * (e - e.mean()), taper * (x - x.mean())
            key = (output.rate, output.quantity, output.location, output.direction)
            rates[key] = output.rate
            kind = takes.setdefault((run.run.experiment, run.run.brake), {})
            kind.setdefault(key, []).append((e, x))
    return {
        kind: [_spectra(pairs, rates[key]) for key, pairs in channels.items()] for kind, channels in takes.items()
    }


def _differentiations(output: Output) -> int:
    if output.quantity.endswith(("angle", "position")):
        return 2
    return 1 if output.quantity.endswith(("speed", "velocity")) else 0


@dataclass(frozen=True, eq=False)
class _Channel:
    """Spectra of a channel in the runs of one kind, over the size of the noise at each frequency.

    What is differentiated is noisier at its upper end: over the noise in its middle alone a wide window is all gain.

    Attributes:
        left, said: What the model leaves and says, shape (n_runs, n_bins).
        bins: Their frequencies [Hz], shape (n_bins,).
        rate: Sampling rate [Hz].
    """

    left: NDArray[np.complex128]
    said: NDArray[np.complex128]
    bins: Vector
    rate: float


def _spectra(takes: list[tuple[Vector, Vector]], rate: float) -> _Channel:
    n = next_fast_len(max(e.size for e, _ in takes), real=True)
    left, said = (np.stack([np.fft.rfft(take[k], n) for take in takes]) for k in (0, 1))
    power = np.mean(np.abs(left) ** 2, axis=0)
    of_mean = (
        1.0 - 1.0 / (9.0 * len(takes))
    ) ** 3  # the median of that many exponentials' mean (Wilson and Hilferty)
    noise: Vector = median_filter(power, size=BACKGROUND, mode="nearest") / of_mean + 1e-12 * float(power.max())
    size = np.sqrt(noise)
    return _Channel(left / size, said / size, np.arange(size.size) * (rate / n), rate)


def _gains(channels: list[_Channel], frequencies: Vector, zeta: float) -> Vector:
    """Gain of a resonant term at every frequency, over the channels [nats]."""
    total = np.zeros(frequencies.size)
    for channel in channels:
        bins, width = channel.bins, channel.bins[1]
        for i, f in enumerate(frequencies[frequencies < HIGHEST * channel.rate]):
            half = max(HALF_WIDTHS * zeta * f, FEWEST_BINS * width)
            around = slice(max(int((f - half) / width), 1), int((f + half) / width) + 2)
            u, x = bins[around], channel.said[:, around]
            size = np.vdot(x, x).real
            if u.size < FEWEST_BINS or size <= 0.0:
                continue
            term = x * (f * f / (f * f - u * u + 2j * zeta * f * u))
            term -= np.vdot(x, term) / size * x
            size = np.vdot(term, term).real
            if size > 0.0:
                total[i] += abs(np.vdot(term, channel.left[:, around])) ** 2 / size
    return total


def _clearest(gains: list[Vector], grids: list[tuple[Vector, float]]) -> list[tuple[float, float, float]]:
    """Gain, frequency and damping of what stands out, clearest first."""
    everything = [
        (float(g), float(f), zeta)
        for row, (frequencies, zeta) in zip(gains, grids, strict=True)
        for g, f in zip(row, frequencies, strict=True)
        if g > TELLING
    ]
    return _distinct(everything, APART[1])


def _distinct(modes: list[tuple[float, float, float]], skirts: float) -> list[tuple[float, float, float]]:
    """Clearest first, without those within so many half widths of a clearer one: its skirts, in runs of its kind."""
    found: list[tuple[float, float, float]] = []
    for mode in sorted(modes, reverse=True):
        if all(abs(mode[1] / f - 1.0) > max(APART[0], skirts * zeta) for _, f, zeta in found):
            found.append(mode)
    return found
