"""Whitened residuals of a set of runs as a function of a hypothesis, evaluated run by run on a pool of threads.

Every run is its own task and results are assembled in a fixed order, so the answer does not depend on the number of
workers.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.input_scatter import Pushes, pushes
from jointscope.diagnosis.memory import Memory
from jointscope.diagnosis.noise import NoiseModel
from jointscope.diagnosis.whiten import RunWhitener, run_whitener

if TYPE_CHECKING:
    from jointscope.diagnosis.coordinates import Coordinates
    from jointscope.diagnosis.effects import ActiveEffect
    from jointscope.diagnosis.prepare import PreparedRun, Problem

Vector = NDArray[np.float64]
Predictions = tuple[tuple[Vector, ...], ...]
T = TypeVar("T")
R = TypeVar("R")

DIVERGED = 1e3  # whitened residual of a sample that a hypothesis cannot predict at all
UNREAL = 1e60  # whitened residual beyond which a prediction that is still finite is none


class Predict(Protocol):
    """The forward model, one run at a time."""

    def __call__(
        self, run: PreparedRun, theta: Vector, effects: tuple[ActiveEffect, ...], problem: Problem
    ) -> tuple[Vector, ...]:
        """One array per ``run.outputs``, of the length of its data."""
        ...


def _finite(y: Vector) -> bool:
    """Whether every sample is: the squares' sum says so, but where they are too large for one."""
    with np.errstate(over="ignore", invalid="ignore"):
        return math.isfinite(float(y @ y)) or bool(np.all(np.isfinite(y)))


@dataclass(frozen=True, eq=False)
class Objective:
    """The runs that are compared, how they are predicted, and how their residuals are whitened.

    Attributes:
        runs: Positions in ``problem.runs``, in the order in which residuals are stacked.
        whiteners: One per run, or empty before :func:`whitened`.
        memory: Predictions of whole sets of runs, which are asked for again.
        slopes: Those beside a point, by which its slopes are found; kept where the same points are judged again and again.
    """

    problem: Problem
    predict: Predict
    runs: tuple[int, ...]
    pool: ThreadPoolExecutor
    whiteners: tuple[RunWhitener, ...] = ()
    memory: Memory = field(default_factory=Memory)
    slopes: Memory = field(default_factory=lambda: Memory(limit=0))

    @property
    def prepared(self) -> tuple[PreparedRun, ...]:
        """The runs themselves."""
        return tuple(self.problem.runs[i] for i in self.runs)

    @property
    def slices(self) -> tuple[slice, ...]:
        """Where each run stands in the stacked residual."""
        edges = np.concatenate([[0], np.cumsum([sum(w.sizes) for w in self.whiteners])]).astype(int)
        return tuple(slice(int(a), int(b)) for a, b in pairwise(edges))

    def map(self, function: Callable[[T], R], tasks: Sequence[T]) -> list[R]:
        """``function`` over ``tasks`` on the pool, results in the order of the tasks."""
        return list(self.pool.map(function, tasks))

    def of_runs(self, function: Callable[[int], R]) -> list[R]:
        """``function`` of every run's position on the pool, longest runs begun first; results in order."""
        order = self._longest_first
        found = self.map(function, order)
        return [result for _, result in sorted(zip(order, found, strict=True), key=lambda pair: pair[0])]

    @cached_property
    def _longest_first(self) -> list[int]:
        return sorted(range(len(self.runs)), key=lambda i: -self.problem.runs[self.runs[i]].steps)

    def predictions(self, theta: Vector, effects: tuple[ActiveEffect, ...]) -> Predictions:
        """Predicted outputs of every run."""
        return tuple(self.of_runs(lambda i: self._predicted(self.memory, i, theta, effects)))

    def _predicted(
        self, kept: Memory, position: int, theta: Vector, effects: tuple[ActiveEffect, ...]
    ) -> tuple[Vector, ...]:
        run, problem = self.problem.runs[self.runs[position]], self.problem
        return kept.outputs(run, theta, effects, problem, lambda: self.predict(run, theta, effects, problem))

    def pushes(
        self, theta: Vector, effects: tuple[ActiveEffect, ...], predictions: Predictions, *, oil: bool = True
    ) -> list[Pushes | None]:
        """What the noise of every run's input, and its oil, do to ``predictions``, see :func:`input_scatter.pushes`."""
        prepared = self.prepared
        return self.of_runs(
            lambda i: pushes(prepared[i], theta, effects, self.problem, self.predict, predictions[i], oil=oil)
        )

    def whiten_run(self, position: int, predicted: Sequence[Vector]) -> Vector:
        """w of one run as predicted, shape (n_kept,)."""
        run = self.problem.runs[self.runs[position]]
        whitener = self.whiteners[position]
        if not all(_finite(y) for y in predicted):
            return np.full(sum(whitener.sizes), DIVERGED)
        left = [o.data - y for o, y in zip(run.outputs, predicted, strict=True)]
        w = whitener(left)[:, 0]
        real = float(w @ w) < UNREAL**2 or bool(np.all(np.abs(w) < UNREAL))
        return w if real else np.full(sum(whitener.sizes), DIVERGED)

    def run_residual(self, position: int, theta: Vector, effects: tuple[ActiveEffect, ...]) -> Vector:
        """Predict and whiten one run."""
        run = self.problem.runs[self.runs[position]]
        return self.whiten_run(position, self.predict(run, theta, effects, self.problem))

    def misfit(self, theta: Vector, effects: tuple[ActiveEffect, ...]) -> float:
        """w @ w of all runs, one after the other on the caller's thread: many trials are compared side by side."""
        parts = [self.run_residual(i, theta, effects) for i in range(len(self.runs))]
        return float(sum(p @ p for p in parts))

    def nearest(self, trials: Sequence[tuple[Vector, tuple[ActiveEffect, ...]]]) -> int:
        """Position of the trial (theta, effects) with the least w @ w of all runs, the first of equals.

        One that is beyond the best so far is left there, the runs that tell most per step first. Whatever was the best so
        far when a thread looked, the least is never left.
        """
        steps = [self.problem.runs[i].steps for i in self.runs]

        def energy(position: int, trial: tuple[Vector, tuple[ActiveEffect, ...]]) -> float:
            w = self.run_residual(position, *trial)
            return float(w @ w)

        whole = [energy(i, trials[0]) for i in range(len(self.runs))]
        order = sorted(range(len(self.runs)), key=lambda i: -whole[i] / steps[i])
        best = [sum(whole[i] for i in order)]

        def cost(trial: tuple[Vector, tuple[ActiveEffect, ...]]) -> float:
            total = 0.0
            for i in order:
                total += energy(i, trial)
                if total > best[0]:
                    return math.inf
            best[0] = min(best[0], total)
            return total

        return int(np.argmin([best[0], *self.map(cost, trials[1:])]))

    def residual(self, x: Vector, where: Coordinates) -> Vector:
        """w at ``x``, runs stacked, shape (n,)."""
        theta, effects = where.unpack(x)
        return np.concatenate(
            self.of_runs(lambda i: self.whiten_run(i, self._predicted(self.memory, i, theta, effects)))
        )

    def columns(self, x: Vector, where: Coordinates, w: Vector, which: Sequence[int]) -> NDArray[np.float64]:
        """dw/dx for the coordinates ``which`` by forward differences, shape (n, len(which)); 0 for what is held."""
        moved = []
        kept = [k for k, j in enumerate(which) if j not in where.held]
        for j in (which[k] for k in kept):
            step = where.difference(x, j)
            shifted = x.copy()
            shifted[j] += step
            moved.append((step, *where.unpack(shifted)))
        slices = self.slices
        result = np.zeros((len(w), len(which)))

        def fill(task: tuple[int, int]) -> None:
            at, i = task
            step, theta, effects = moved[at]
            there = self.whiten_run(i, self._predicted(self.slopes, i, theta, effects))
            result[slices[i], kept[at]] = (there - w[slices[i]]) / step

        self.map(fill, [(k, i) for i in self._longest_first for k in range(len(kept))])
        return result

    def restricted(self, positions: Sequence[int]) -> Objective:
        """The same with only the runs at ``positions`` of this one."""
        return replace(
            self,
            runs=tuple(self.runs[p] for p in positions),
            whiteners=tuple(self.whiteners[p] for p in positions) if self.whiteners else (),
        )

    def rows(self, positions: Sequence[int]) -> NDArray[np.intp]:
        """Rows of the stacked residual that belong to the runs at ``positions``."""
        slices = self.slices
        return np.concatenate([np.arange(slices[p].start, slices[p].stop) for p in positions])


def whitened(
    objective: Objective,
    noise: NoiseModel,
    predictions: Predictions | None,
    pushed: Sequence[Pushes | None] = (),
) -> Objective:
    """The objective with whiteners built from ``noise``, the response that scatters, and what the inputs' noise does."""
    prepared = objective.prepared
    nothing = [None] * len(prepared)
    given: Sequence[tuple[Vector, ...] | None] = nothing if predictions is None else predictions
    forced = pushed or nothing
    whiteners = objective.of_runs(lambda i: run_whitener(prepared[i], noise, given[i], forced[i]))
    return replace(objective, whiteners=tuple(whiteners))
