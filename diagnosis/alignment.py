"""Streams whose start is not exact: their offset is found per run and is never an effect.

The offset of a device is the shift of its clock at which the base model fits best: searched on a grid over three
standard deviations (or half a second where the start is unknown), then by golden section. Where its standard deviation s is
given, what the offset has come to in all costs (offset/s)^2/2 beside the logarithm of the error: what the base lacks would
else pull a clock milliseconds past what its stream allows, and the phase of every line with it.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from jointscope.diagnosis.predict import predict_outputs

if TYPE_CHECKING:
    from jointscope.diagnosis.problem import PreparedRun, Problem
    from jointscope.recordings.bandlimited import Bandlimited
    from jointscope.recordings.campaign import Run

Vector = NDArray[np.float64]

WIDEST = 0.5  # s searched either way where the start is unknown
WITHIN = 3.0  # standard deviations
_STEP = 2e-3  # s of the first grid; a quarter period of the highest resonance that a joint has


def uncertain(run: Run, device: int) -> float:
    """Half width of the search for a device's offset [s]; 0 where its start is exact."""
    spread = run.streams[device].start_uncertainty
    return min(WITHIN * spread, WIDEST) if spread > 0.0 else 0.0


def aligned(problem: Problem, theta: Vector) -> Problem:
    """``problem`` with every inexact start moved to where the base at ``theta``, shape (n_theta,), fits best."""
    runs = []
    for run in problem.runs:
        for device in range(len(run.run.streams)):
            width = uncertain(run.run, device)
            if width > 0.0 and len(run.run.streams) > 1:
                run = _best(run, device, width, problem, theta)
        runs.append(run)
    return replace(problem, runs=tuple(runs))


def realigned(problem: Problem, theta: Vector) -> Problem:
    """The same once more near where the starts are, at parameters that were fitted: phases near a resonance need them."""
    runs = []
    for run in problem.runs:
        for device in range(len(run.run.streams)):
            if uncertain(run.run, device) > 0.0 and len(run.run.streams) > 1:
                run = moved(run, device, _nearby(run, device, 0.0, problem, theta))
        runs.append(run)
    return replace(problem, runs=tuple(runs))


def inexact(problem: Problem) -> bool:
    """Whether any stream's start is known to be off."""
    return any(uncertain(run.run, d) > 0.0 for run in problem.runs for d in range(len(run.run.streams)))


def moved(run: PreparedRun, device: int, offset: float) -> PreparedRun:
    """The run with one device's samples taken ``offset`` [s] later than its stream says."""
    half = run.t0 + np.arange(2 * run.steps + 1) / (2.0 * run.grid_rate)
    changes: dict[str, object] = {
        "offsets": {**run.offsets, device: run.offsets.get(device, 0.0) + offset},
        "outputs": tuple(replace(o, times=o.times + offset) if o.device == device else o for o in run.outputs),
        "declared": tuple(replace(o, times=o.times + offset) if o.device == device else o for o in run.declared),
    }
    for name in ("load", "motor", "command", "observed"):
        source = getattr(run, name)
        if source is None or source.device != device:
            continue
        later = replace(source, signal=_later(source.signal, offset))
        changes[name] = later
        changes[f"{name}_half"] = later.signal(half)
        if name == "command":
            changes["command_rate_half"] = later.signal(half, 1)
    return replace(run, **changes)  # type: ignore[arg-type]


def _later(signal: Bandlimited, offset: float) -> Bandlimited:
    return replace(signal, start=signal.start + offset, end=signal.end + offset)


def _cost(run: PreparedRun, device: int, offset: float, problem: Problem, theta: Vector) -> float:
    """Sum over outputs of the logarithm of their error's share."""
    trial = moved(run, device, offset)
    total = _unlikely(trial, device)
    for output, y in zip(trial.outputs, predict_outputs(trial, theta, (), problem), strict=True):
        data = output.data[output.mask]
        error = float(np.mean((data - y[output.mask]) ** 2)) / (float(np.var(data)) + 1e-300)
        total += math.log(error + 1e-12) if math.isfinite(error) else 50.0
    return total


def _unlikely(run: PreparedRun, device: int) -> float:
    """What a device's whole offset costs; nothing where its start is unknown."""
    spread = run.run.streams[device].start_uncertainty
    return 0.5 * (run.offsets.get(device, 0.0) / spread) ** 2 if 0.0 < WITHIN * spread < WIDEST else 0.0


def _nearby(run: PreparedRun, device: int, centre: float, problem: Problem, theta: Vector) -> float:
    """The best offset within a step of the grid [s]."""
    width, before = uncertain(run.run, device), run.offsets.get(device, 0.0)
    found = minimize_scalar(
        lambda offset: _cost(run, device, offset, problem, theta),
        bounds=(max(centre - _STEP, -width - before), min(centre + _STEP, width - before)),
        method="bounded",
        options={"xatol": 1e-6},
    )
    return float(found.x)


def _best(run: PreparedRun, device: int, width: float, problem: Problem, theta: Vector) -> PreparedRun:
    grid = np.minimum(np.arange(-width, width + _STEP, _STEP), width) - run.offsets.get(device, 0.0)
    costs = [_cost(run, device, float(offset), problem, theta) for offset in grid]
    return moved(run, device, _nearby(run, device, float(grid[int(np.argmin(costs))]), problem, theta))
