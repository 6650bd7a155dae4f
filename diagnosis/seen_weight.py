"""Whether an accelerometer that is coupled by AC sees its weight turn with the arm, as a specific force does.

An IEPE sensor passes what of g cos q is faster than its corner. Records that were made by another reading (r q'' alone) tell
it themselves in motions, where the arm turns: the reading that leaves less is taken, by the refitted base, and said.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from jointscope.diagnosis.channels import ACCELERATIONS
from jointscope.diagnosis.own_hit import is_hit

if TYPE_CHECKING:
    from collections.abc import Collection

    from numpy.typing import NDArray

    from jointscope.diagnosis.objective import Predict
    from jointscope.diagnosis.problem import Output, PreparedRun, Problem

Sensor = tuple[str, str, float]

HALF = 0.5  # of the error's energy that must be gone without the weight, over all runs that show it


def as_seen(problem: Problem, theta: NDArray[np.float64], predict: Predict) -> Problem:
    """``problem`` without the weight in AC-coupled accelerations where the base at ``theta``, shape (n_theta,), refutes it."""
    left: dict[Sensor, NDArray[np.float64]] = {}
    for run in problem.runs:
        if is_hit(run) or not any(_coupled(o) and o.mask.any() for o in run.outputs):
            continue
        both = (predict(run, theta, (), problem), predict(weightless(run, _coupled_of(run)), theta, (), problem))
        for k, output in enumerate(run.outputs):
            if _coupled(output):
                errors = [float(np.sum(np.square((output.data - y[k])[output.mask]))) for y in both]
                left[_sensor(output)] = left.get(_sensor(output), np.zeros(2)) + errors
    refuted = {sensor for sensor, (with_it, bare) in left.items() if bare < HALF * with_it < np.inf}
    if not refuted:
        return problem
    said = [
        f"accelerometer at the {place}, AC coupled: its weight does not turn with the arm"
        for place, _, _ in refuted
    ]
    runs = tuple(weightless(run, _coupled_of(run, refuted)) for run in problem.runs)
    return replace(problem, runs=runs, findings=(*problem.findings, *sorted(said)))


def weightless(run: PreparedRun, channels: Collection[tuple[int, int]]) -> PreparedRun:
    """The run with no weight in outputs of these channels (device, column), declared ones too."""

    def bare(outputs: tuple[Output, ...]) -> tuple[Output, ...]:
        return tuple(replace(o, gravity=0.0) if o.channel in channels else o for o in outputs)

    return replace(run, outputs=bare(run.outputs), declared=bare(run.declared))


def _coupled_of(run: PreparedRun, sensors: Collection[Sensor] | None = None) -> set[tuple[int, int]]:
    """Channels of the run's AC-coupled accelerometers, of all or of these ``sensors``."""
    coupled = [o for o in (*run.outputs, *run.declared) if _coupled(o)]
    return {o.channel for o in coupled if sensors is None or _sensor(o) in sensors}


def _sensor(output: Output) -> Sensor:
    return output.location, output.direction, output.radius or 0.0


def _coupled(output: Output) -> bool:
    return output.quantity in ACCELERATIONS and output.low_cutoff is not None and output.gravity != 0.0
