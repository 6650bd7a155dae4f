"""How much of a mismatch an answer explains, told from noise by what recordings of one excitation have in common.

Residuals of two runs that were driven alike share the mismatch and not the noise, so the mean of their product is the
energy of the mismatch, whatever the noise's colour (cross-spectral estimation, Bendat and Piersol 2010, section 6.1).
Within one run the periods of a periodic excitation do the same. What a coarse quantiser does is shared as well and is
taken off. Explained = 1 - common energy left by the model / common energy left by the base, with each hit's own gain
and timing taken off (B.2, stage 8).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft
from scipy.ndimage import uniform_filter1d

from jointscope.diagnosis.channels import ACCELERATIONS
from jointscope.diagnosis.noise import ANGULAR, Key, NoiseModel, block_key, dynamic_level, fast_part, quantum
from jointscope.diagnosis.own_hit import is_hit
from jointscope.diagnosis.whiten import run_whitener, without_scatter
from jointscope.recordings.campaign import FORCES

if TYPE_CHECKING:
    from jointscope.diagnosis.input_scatter import Pushes
    from jointscope.diagnosis.prepare import Output, PreparedRun

Vector = NDArray[np.float64]

ALIKE = 0.98  # correlation of recordings above which two takes count as one excitation
ALIKE_HITS = 0.9  # the same for hits, whose pulses differ in shape
REACH = 0.1  # s by which two takes may be shifted against each other
PAIRS = 40  # of runs that are compared per kind of channel
LAGS = 400  # at least, over which the noise's own memory is counted: a joint rings for longer
BURST = 0.25  # s over which the noise's power is averaged
EXCESS = 0.01  # of the signal's rms: unexplained residual that is worth explaining
GONE = 0.05  # of what the base leaves of a record, below which that was no noise
SURE = 3.0  # standard errors by which common energy must stand out: 1.5 at most in 40 blocks of 14 nulls
DIFFERING = 6  # pairs from which their own scatter can be told
COARSE = 0.25  # of a residual's energy that is the quantiser's, above which nothing can be told from it


@dataclass(frozen=True)
class Block:
    """One kind of channel in one kind of experiment, mean squares over the signal's mean square [-].

    Attributes:
        base, model: What is left as a whole.
        base_common, model_common: What is left in common to runs driven alike; ``nan`` where no two runs are.
        error: Standard error of the common parts.
        claimed: What the base would leave in common if the model were true: the two predictions' difference, which a level
            or a noisy input changes from run to run; ``nan`` where no two runs are driven alike.
    """

    key: Key
    samples: int
    base: float
    model: float
    base_common: float
    model_common: float
    error: float
    claimed: float = math.nan

    @property
    def floor(self) -> float:
        """What no two runs have in common: the noise as the model leaves it; ``nan`` where nothing tells it."""
        return max(self.model - max(self.model_common, 0.0), 0.0) if math.isfinite(self.model_common) else math.nan

    @property
    def excess(self) -> float:
        """RMS of the mismatch that the base leaves, over the signal's RMS [-]; 0 where it does not stand out."""
        return _standing_out(self.base_common, self.error)

    @property
    def left(self) -> float:
        """The same of the model."""
        return _standing_out(self.model_common, self.error)

    @property
    def gone(self) -> bool:
        """Whether the model takes away nearly all that the base leaves, where no two runs tell how much of that is noise."""
        return math.isnan(self.base_common) and self.base > EXCESS**2 and self.model < GONE * self.base

    @property
    def explained(self) -> float:
        """Share of the energy common to runs driven alike that the model explains [-].

        All of it where what is left does not stand out; 0 where what the base leaves does not.
        """
        return 1.0 - self.left**2 / self.base_common if self.excess > 0.0 else 0.0


def _standing_out(common: float, error: float) -> float:
    return math.sqrt(common) if math.isfinite(common) and common > SURE * error else 0.0


@dataclass(frozen=True)
class Adequacy:
    """The base and a model against what runs have in common.

    Attributes:
        blocks: Per kind of channel.
        explained: Share of the mismatch's energy that the model explains; ``nan`` where none is known or the base
            leaves nothing worth explaining.
        base_left, model_left: Largest mismatch over signal of any block [-].
    """

    blocks: tuple[Block, ...]
    explained: float
    base_left: float
    model_left: float

    @property
    def at_least(self) -> float:
        """Share of the mismatch's energy that the model explains at the least: where no two runs tell noise, all is mismatch.

        Of accelerations then, if any were recorded: angles are followed, or as good as their zero.
        """
        if math.isfinite(self.explained):
            return self.explained
        blocks = [b for b in self.blocks if b.key[2] in ACCELERATIONS] or self.blocks
        base, model = sum(b.base for b in blocks), sum(b.model for b in blocks)
        return 1.0 - model / base if base > 0.0 else math.nan


def _cleaned(
    runs: Sequence[PreparedRun],
    noise: NoiseModel,
    predictions: Sequence[Sequence[Vector]],
    pushed: Sequence[Pushes | None],
) -> list[list[Vector]]:
    return [
        without_scatter(run, noise, predicted, run_whitener(run, noise, None), force)
        for run, predicted, force in zip(runs, predictions, pushed or [None] * len(runs), strict=True)
    ]


def _mean_square(x: Vector) -> float:
    return float(np.mean(np.square(x))) if x.size else math.nan


def _aligned(a: Vector, b: Vector, reach: int) -> tuple[int, float]:
    """Shift of ``b`` against ``a`` [samples] within ``reach`` that makes them most alike, and their correlation there."""
    n = min(len(a), len(b))
    x, y = a[:n] - np.mean(a[:n]), b[:n] - np.mean(b[:n])
    size = next_fast_len(2 * n, real=True)
    product = irfft(rfft(x, size) * np.conj(rfft(y, size)), size)
    shifts = np.arange(-min(reach, n - 2), min(reach, n - 2) + 1)
    best = int(shifts[np.argmax(product[shifts])])
    u, v = _overlap(x, best), _overlap(y, -best)
    scale = float(np.sqrt((u @ u) * (v @ v)))
    return best, float(u @ v) / scale if scale > 0.0 else 0.0


def _overlap(x: Vector, shift: int) -> Vector:
    """The part of ``x`` that meets another record moved by ``shift`` samples later."""
    return x[shift:] if shift >= 0 else x[:shift]


def _memory(a: Vector, b: Vector, rate: float) -> float:
    """sum_k c(k)^2 of the noise, which is what ``a`` and ``b`` differ by: variance of the mean of products times n.

    Noise that comes in bursts, as where a sweep passes a resonance that the noise of its torque log rings at, has fewer
    samples to be averaged over: mean(v^2) / mean(v)^2 times the variance, v its local power.
    """
    noise = (a - b) / math.sqrt(2.0)
    n = len(noise)
    size = next_fast_len(2 * n, real=True)
    c = irfft(np.square(np.abs(rfft(noise, size))), size)[: max(LAGS, n // 4)] / n
    power = uniform_filter1d(np.square(noise), max(3, round(BURST * rate)), mode="nearest")
    mean = float(np.mean(power))
    bursts = float(np.mean(np.square(power))) / mean**2 if mean > 0.0 else 1.0
    return bursts * float(c[0] ** 2 + 2.0 * (c[1:] @ c[1:]))


@dataclass(frozen=True, eq=False)
class _Take:
    """One output of one run: its recording, and what base and model leave of it, over the recording's own rms."""

    output: Output
    hit: bool
    base: Vector
    model: Vector
    quantised: float


def _take(run: PreparedRun, output: Output, base: Vector, model: Vector) -> _Take:
    size = dynamic_level(output) or math.inf
    if output.quantity in ANGULAR and output.mask.any():  # nor is an encoder's standing offset a mismatch
        base, model = (fast_part(output, x) for x in (base, model))
    if is_hit(run) and output.quantity in ACCELERATIONS and output.mask.any():  # nor is an amplifier's
        base, model = (x - np.mean(x[output.mask]) for x in (base, model))
    masked = [np.where(output.mask, x, 0.0) / size for x in (base, model)]
    return _Take(output, is_hit(run), masked[0], masked[1], quantum(output) ** 2 / 12.0 / size**2)


def _coarse(take: _Take) -> bool:
    return take.quantised > COARSE * _mean_square(take.model[take.output.mask])


@dataclass(frozen=True)
class _Pair:
    """Common energy of two takes that were driven alike, as in :class:`Block`, and its variance."""

    base: float
    model: float
    claimed: float
    variance: float


def _pair(a: _Take, b: _Take, shift: int, shared: float) -> _Pair:
    """Of ``b`` moved by ``shift`` samples later; ``shared`` is the quantiser's."""
    n = min(len(a.base), len(b.base))
    ab, bb = _overlap(a.base[:n], shift), _overlap(b.base[:n], -shift)
    am, bm = _overlap(a.model[:n], shift), _overlap(b.model[:n], -shift)
    return _Pair(
        float(np.mean(ab * bb)) - shared,
        float(np.mean(am * bm)) - shared,
        float(np.mean((ab - am) * (bb - bm))),
        _memory(am, bm, a.output.rate) / len(am),
    )


def _pairs(takes: Sequence[_Take]) -> list[_Pair]:
    """Every pair that was driven alike."""
    found: list[_Pair] = []
    order = sorted(range(len(takes)), key=lambda i: dynamic_level(takes[i].output))
    pairs = sorted(itertools.combinations(range(len(order)), 2), key=lambda p: p[1] - p[0])
    for i, j in pairs:
        a, b = takes[order[i]], takes[order[j]]
        rate = a.output.rate
        if min(len(a.base), len(b.base)) < 128 or rate != b.output.rate or len(found) == PAIRS:
            continue
        shift, alike = _aligned(a.output.data, b.output.data, round(REACH * rate) if a.hit else 2)
        if alike < (ALIKE_HITS if a.hit else ALIKE) or _coarse(a) or _coarse(b):
            continue
        found.append(_pair(a, b, shift, math.sqrt(a.quantised * b.quantised)))
    return found


def _standard_error(found: Sequence[_Pair]) -> float:
    """Of the mean common energy: from the noise's memory, or from how the pairs differ where that is more.

    A joint that ambient noise keeps ringing gives two or three independent values per record, from which no memory can be told.
    """
    if not found:
        return math.nan
    values = np.array([pair.model for pair in found])
    differing = float(np.std(values, ddof=1)) if len(found) >= DIFFERING else 0.0
    return max(math.sqrt(sum(pair.variance for pair in found)) / len(found), differing / math.sqrt(len(found)))


def input_period(run: PreparedRun) -> float | None:
    """Period of what drives the run [s] where it repeats itself at least twice, else ``None``."""
    drive = run.motor or run.load
    if drive is None or len(drive.samples) < 256:
        return None
    x = drive.samples - np.mean(drive.samples)
    n = len(x)
    spectrum = np.square(np.abs(np.fft.rfft(x, 2 * n)))
    lagged = np.fft.irfft(spectrum)[:n]
    energy = np.cumsum(np.square(x))
    lags = np.arange(n)
    early, late = energy[n - 1 - lags], energy[-1] - np.concatenate([[0.0], energy[:-1]])
    correlation = lagged / np.sqrt(np.maximum(early * late, 1e-300))
    first = int(np.argmax(correlation < 0.5)) if np.any(correlation < 0.5) else n
    window = correlation[first : n // 2]
    if window.size == 0 or window.max() < ALIKE:
        return None
    best = first + int(np.argmax(window > 0.995 * window.max()))
    while best + 1 < n // 2 and correlation[best + 1] > correlation[best]:
        best += 1
    return best / drive.signal.rate


def _periods(run: PreparedRun, take: _Take) -> list[_Pair]:
    """The same for successive periods of one run, where the excitation repeats itself."""
    period = input_period(run)
    if period is None or _coarse(take):
        return []
    lag = round(period * take.output.rate)
    if len(take.base) - lag < 128:
        return []
    later = replace(take, base=take.base[lag:], model=take.model[lag:])
    earlier = replace(take, base=take.base[:-lag], model=take.model[:-lag])
    return [_pair(later, earlier, 0, take.quantised)]


def share_explained(blocks: Sequence[Block]) -> float:
    """Share of the mismatch's energy that the model explains [-], blocks by its rms; ``nan`` where no two runs tell any.

    Where they do, records without a like one count too if the model leaves nearly nothing of them.
    """
    telling = [b for b in blocks if b.excess > EXCESS]
    if not telling:
        return math.nan
    parts = [(1.0 - max(b.model_common, 0.0) / b.base_common, b.excess) for b in telling]
    parts.extend((1.0 - b.model / b.base, math.sqrt(b.base)) for b in blocks if b.gone)
    return sum(share * excess for share, excess in parts) / sum(excess for _, excess in parts)


def adequacy(
    runs: Sequence[PreparedRun],
    noise: NoiseModel,
    base: Sequence[Sequence[Vector]],
    model: Sequence[Sequence[Vector]],
    base_pushed: Sequence[Pushes | None] = (),
    model_pushed: Sequence[Pushes | None] = (),
) -> Adequacy:
    """Compare base and model predictions of ``runs`` by what takes of one excitation have in common.

    Args:
        base_pushed, model_pushed: What the noise of every run's input does to either, see
            :func:`input_scatter.pushes`; empty where that is left out.
    """
    before, after = _cleaned(runs, noise, base, base_pushed), _cleaned(runs, noise, model, model_pushed)
    table: dict[Key, list[tuple[PreparedRun, _Take]]] = {}
    for run, old, new in zip(runs, before, after, strict=True):
        for output, a, b in zip(run.outputs, old, new, strict=True):
            # what a drive answers is its own law's affair, not the joint's
            if dynamic_level(output) > 0.0 and (output.quantity not in FORCES or run.takes(output)):
                table.setdefault(block_key(run, output), []).append((run, _take(run, output, a, b)))
    blocks = []
    for key, rows in table.items():
        found = _pairs([take for _, take in rows])
        if not found:
            found = [p for run, take in rows for p in _periods(run, take)]
        blocks.append(
            Block(
                key,
                sum(int(take.output.mask.sum()) for _, take in rows),
                float(np.mean([_mean_square(take.base[take.output.mask]) for _, take in rows])),
                float(np.mean([_mean_square(take.model[take.output.mask]) for _, take in rows])),
                float(np.mean([pair.base for pair in found])) if found else math.nan,
                float(np.mean([pair.model for pair in found])) if found else math.nan,
                _standard_error(found),
                float(np.mean([pair.claimed for pair in found])) if found else math.nan,
            )
        )
    return Adequacy(
        tuple(blocks),
        share_explained(blocks),
        max((b.excess for b in blocks), default=0.0),
        max((b.left for b in blocks), default=0.0),
    )
