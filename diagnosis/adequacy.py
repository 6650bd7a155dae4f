"""How much of a mismatch an answer explains, against a floor that no model had a hand in.

The floor of a channel is what repeats of one excitation, or periods within one run, differ by (the mismatch is common
to them, noise is not), and for hits what is left in the tail, where nothing moves any more.
Explained = (E_base - E_model) / (E_base - E_floor) in energies of the residual with each hit's own gain and timing taken
off (B.2, stage 8).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.noise import Key, NoiseModel, block_key, dynamic_level
from jointscope.diagnosis.whiten import is_hit, run_whitener, without_scatter

if TYPE_CHECKING:
    from jointscope.diagnosis.prepare import Output, PreparedRun

Vector = NDArray[np.float64]

TAIL = 0.2  # share of a hit's record, at its end, that shows the floor
ALIKE = 0.98  # correlation of recordings above which two runs count as repeats of one excitation
EXCESS = 0.01  # of the signal's rms: unexplained residual that is worth explaining


@dataclass(frozen=True)
class Block:
    """One kind of channel in one kind of experiment, mean squares over the signal's mean square [-].

    Attributes:
        floor: ``nan`` where nothing tells it.
    """

    key: Key
    samples: int
    base: float
    model: float
    floor: float

    @property
    def excess(self) -> float:
        """RMS of what the base leaves beyond the floor, over the signal's RMS [-]."""
        return math.sqrt(max(self.base - self.floor, 0.0)) if math.isfinite(self.floor) else 0.0

    @property
    def left(self) -> float:
        """RMS of what the model leaves beyond the floor, over the signal's RMS [-]."""
        return math.sqrt(max(self.model - self.floor, 0.0)) if math.isfinite(self.floor) else 0.0


@dataclass(frozen=True)
class Adequacy:
    """The base and a model against the floor.

    Attributes:
        blocks: Per kind of channel.
        explained: Share of the mismatch's energy that the model explains; ``nan`` where no floor is known or the base
            leaves nothing worth explaining.
        base_left, model_left: Largest unexplained residual over signal of any block [-].
    """

    blocks: tuple[Block, ...]
    explained: float
    base_left: float
    model_left: float


def _cleaned(
    runs: Sequence[PreparedRun], noise: NoiseModel, predictions: Sequence[Sequence[Vector]]
) -> list[list[Vector]]:
    return [
        without_scatter(run, noise, predicted, run_whitener(run, noise, None))
        for run, predicted in zip(runs, predictions, strict=True)
    ]


def _mean_square(x: Vector) -> float:
    return float(np.mean(np.square(x))) if x.size else math.nan


def _repeat_floor(pairs: Sequence[tuple[Output, Vector]]) -> list[float]:
    """Half the mean square difference of residuals of runs that recorded the same."""
    found = []
    for (a, ra), (b, rb) in itertools.combinations(pairs, 2):
        if len(ra) != len(rb):
            continue
        both = a.mask & b.mask
        if both.sum() < 64 or np.std(a.data[both]) == 0.0 or np.std(b.data[both]) == 0.0:
            continue
        if np.corrcoef(a.data[both], b.data[both])[0, 1] > ALIKE:
            found.append(0.5 * _mean_square((ra - rb)[both]))
    return found


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


def _period_floor(run: PreparedRun, output: Output, residual: Vector) -> list[float]:
    """Half the mean square difference of successive periods' residuals, where the excitation repeats itself."""
    period = input_period(run)
    if period is None:
        return []
    lag = round(period * output.rate)
    both = output.mask[lag:] & output.mask[:-lag]
    return [0.5 * _mean_square((residual[lag:] - residual[:-lag])[both])] if both.sum() > 64 else []


def _tail_floor(output: Output, residual: Vector) -> float:
    part = slice(int((1.0 - TAIL) * len(residual)), None)
    return _mean_square(residual[part][output.mask[part]])


def adequacy(
    runs: Sequence[PreparedRun],
    noise: NoiseModel,
    base: Sequence[Sequence[Vector]],
    model: Sequence[Sequence[Vector]],
) -> Adequacy:
    """Compare base and model predictions of ``runs`` with the floor of their channels."""
    before, after = _cleaned(runs, noise, base), _cleaned(runs, noise, model)
    table: dict[Key, list[tuple[PreparedRun, Output, Vector, Vector]]] = {}
    for run, old, new in zip(runs, before, after, strict=True):
        for output, a, b in zip(run.outputs, old, new, strict=True):
            table.setdefault(block_key(run, output), []).append((run, output, a, b))
    blocks = []
    for key, rows in table.items():
        signal = float(np.mean([dynamic_level(o) ** 2 for _, o, _, _ in rows]))
        if signal <= 0.0:
            continue
        floors = _repeat_floor([(o, b) for _, o, _, b in rows])
        for run, output, _, left in rows:
            floors.extend(_period_floor(run, output, left))
        if is_hit(rows[0][0]):
            floors.extend(_tail_floor(o, b) for _, o, _, b in rows)
        blocks.append(
            Block(
                key,
                sum(int(o.mask.sum()) for _, o, _, _ in rows),
                float(np.mean([_mean_square(a[o.mask]) for _, o, a, _ in rows])) / signal,
                float(np.mean([_mean_square(b[o.mask]) for _, o, _, b in rows])) / signal,
                float(np.median(floors)) / signal if floors else math.nan,
            )
        )
    telling = [b for b in blocks if b.excess > EXCESS]
    explained = math.nan
    if telling:
        explained = sum((b.base - b.model) / (b.base - b.floor) * b.excess for b in telling)
        explained /= sum(b.excess for b in telling)
    return Adequacy(
        tuple(blocks),
        explained,
        max((b.excess for b in blocks), default=0.0),
        max((b.left for b in blocks), default=0.0),
    )
