r"""Whether what a model leaves repeats with the turn of the joint: a test of every order that needs no candidate.

An encoder's grating, a gear, a cable or a magnet that no law of the catalogue has repeats with the angle, a s order after
order, and the noise of a channel does not. Per kind of channel the whitened residual w of the fitted runs is regressed on

    A cos(o q) + B sin(o q)

whitened alike, with q the recorded angle at the joint output, at every order o per turn of the output that the run
resolves and the channel's rate can follow. The best order, its amplitude and its phase are then held against the runs that
were not fitted: a line that is fixed in time, or noise, has another phase there.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.noise import Key, block_key, dynamic_level
from jointscope.diagnosis.problem import recorded_angle
from jointscope.diagnosis.remainder import Remainder
from jointscope.recordings.campaign import FORCES

if TYPE_CHECKING:
    from jointscope.diagnosis.adjudicate import Judged, Judgement
    from jointscope.diagnosis.objective import Objective, Predictions
    from jointscope.diagnosis.problem import PreparedRun

Vector = NDArray[np.float64]

TRAVEL = 0.1  # rad at the output that a run must turn through
HIGHEST = 0.2  # of a channel's rate, up to which a line may rise at the run's rms speed
ORDERS = 400  # tried at most
FEWEST = 2.0  # periods of a line within the shortest travel
PARAMETERS = 3  # amplitude, phase, and order


@dataclass(frozen=True, eq=False)
class Turned:
    """A run that turns, with what a model leaves of it.

    Attributes:
        index: Of the run in its objective.
        w: Whitened residual of the whole run, shape (n,).
        angles: Angle at the joint output at the samples of each of the run's outputs [rad].
        wanted: Whether each output is of the kind that is asked.
    """

    objective: Objective
    index: int
    w: Vector
    angles: tuple[Vector, ...]
    wanted: tuple[bool, ...]

    def columns(self, order: float) -> NDArray[np.float64]:
        """cos and sin of the order in the outputs of that kind, whitened, the others silent, shape (n, 2)."""
        return self.whitened(
            [
                np.stack([np.cos(order * q), np.sin(order * q)], axis=1) if wanted else np.zeros((q.size, 2))
                for q, wanted in zip(self.angles, self.wanted, strict=True)
            ]
        )

    def whitened(self, arrays: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
        """What these do to the outputs of that kind, one array (n_output, 2) each, whitened, shape (n, 2)."""
        kept = [array * float(wanted) for array, wanted in zip(arrays, self.wanted, strict=True)]
        return np.asarray(self.objective.whiteners[self.index](kept), dtype=np.float64)


def turned(objective: Objective, predictions: Predictions, key: Key) -> list[Turned]:
    """The runs that turn and hold a channel of this kind, with what the predictions leave of them."""
    found = []
    for i, (run, predicted) in enumerate(zip(objective.prepared, predictions, strict=True)):
        wanted = tuple(block_key(run, output) == key for output in run.outputs)
        angles = angles_at_outputs(run) if any(wanted) else ()
        if angles and np.ptp(angles[0]) >= TRAVEL:
            found.append(Turned(objective, i, objective.whiten_run(i, predicted), angles, wanted))
    return found


def angles_at_outputs(run: PreparedRun) -> tuple[Vector, ...]:
    """Recorded angle at the joint output at the samples of each of the run's outputs [rad]; none where none was recorded."""
    angle = recorded_angle(run) if run.observed is not None and not run.observed.commanded else None
    if angle is None:
        return ()
    half = run.t0 + np.arange(len(angle)) / (2.0 * run.grid_rate)
    return tuple(np.interp(output.times, half, angle) for output in run.outputs)


def _orders(runs: list[Turned]) -> Vector:
    """Orders per turn of the output that every run resolves and every channel follows."""
    travels, tops = [], []
    for run in runs:
        prepared = run.objective.prepared[run.index]
        for output, q, wanted in zip(prepared.outputs, run.angles, run.wanted, strict=True):
            if wanted:
                speed = math.sqrt(float(np.mean(np.square(np.gradient(q) * output.rate))))
                travels.append(float(np.ptp(q)))
                tops.append(2.0 * math.pi * HIGHEST * output.rate / max(speed, 1e-12))
    step = math.pi / max(travels)
    lowest = 2.0 * math.pi * FEWEST / min(travels)
    count = min(ORDERS, int((min(tops) - lowest) / step))
    return np.asarray(lowest + step * np.arange(max(count, 0)), dtype=np.float64)


def best_order(objective: Objective, runs: list[Turned]) -> tuple[float, int]:
    """The order that explains most in all runs together, and how many apart were tried (none where no run resolves any)."""
    orders = _orders(runs)
    if orders.size == 0:
        return math.nan, 0
    order = _best(objective, runs, orders.tolist())
    spacing = float(orders[-1] - orders[0]) / max(orders.size - 1, 1)
    for finer in (0.25, 0.0625):
        order = _best(objective, runs, [order + finer * spacing * k for k in range(-2, 3)])
    return order, len(orders)


def fitted_line(runs: list[Turned], order: float) -> tuple[float, Vector]:
    """w'w that the order explains in all runs together, and its two amplitudes."""
    return projected([(run.w, run.columns(order)) for run in runs])


def projected(parts: Iterable[tuple[Vector, NDArray[np.float64]]]) -> tuple[float, Vector]:
    """w'w that two columns explain in several runs together, and their two amplitudes."""
    normal, right = np.zeros((2, 2)), np.zeros(2)
    for w, columns in parts:
        normal += columns.T @ columns
        right += columns.T @ w
    if np.trace(normal) <= 0.0:
        return 0.0, np.zeros(2)
    step = np.asarray(np.linalg.lstsq(normal, right, rcond=1e-9)[0], dtype=np.float64)
    return float(right @ step), step


def _best(objective: Objective, runs: list[Turned], orders: list[float]) -> float:
    gains = objective.map(lambda order: fitted_line(runs, order)[0], orders)
    return orders[int(np.argmax(gains))]


def repeating(judgement: Judgement, judged: Judged) -> tuple[Remainder, ...]:
    """The best order of every kind of channel that was fitted and held out in runs that turn."""
    objective, held = judgement.objective, judgement.held
    keys = dict.fromkeys(
        block_key(run, o) for run in objective.prepared for o in run.outputs if o.quantity not in FORCES
    )
    found = []
    for key in keys:
        fitted, kept = turned(objective, judged.predictions, key), turned(held, judged.predictions_held, key)
        if not fitted or not kept:
            continue
        order, tried = best_order(objective, fitted)
        if tried > 0:
            found.append(_remainder(key, order, fitted, kept, tried))
    return tuple(sorted(found, key=lambda r: -r.gain))


def net_gain(runs: list[Turned], explained: float, tried: int) -> tuple[float, float]:
    """Nats of a line net of its parameters and of the orders tried, and the excess of the noise by which they count."""
    samples = sum(run.w.size for run in runs)
    dispersion = max(1.0, sum(float(run.w @ run.w) for run in runs) / samples)
    return 0.5 * explained / dispersion - 0.5 * PARAMETERS * math.log(samples) - math.log(tried), dispersion


def share_of_signal(runs: list[Turned], step: Vector) -> float:
    """Rms of a line over that of the channel's signal [-]; 0 where the channel holds none."""
    levels = [
        dynamic_level(output)
        for run in runs
        for output, wanted in zip(run.objective.prepared[run.index].outputs, run.wanted, strict=True)
        if wanted
    ]
    level = math.sqrt(float(np.mean(np.square(levels))))
    return float(np.hypot(*step)) / math.sqrt(2.0) / level if level > 0.0 else 0.0


def _remainder(key: Key, order: float, fitted: list[Turned], kept: list[Turned], tried: int) -> Remainder:
    explained, step = fitted_line(fitted, order)
    gain, dispersion = net_gain(fitted, explained, tried)
    changes = [run.columns(order) @ step for run in kept]
    held_gain = sum(
        float(run.w @ change) - 0.5 * float(change @ change) for run, change in zip(kept, changes, strict=True)
    )
    foretold = 0.5 * sum(float(change @ change) for change in changes)
    material = share_of_signal(fitted, step)
    return Remainder(key, gain, held_gain / dispersion, foretold / dispersion, material, order=order)
