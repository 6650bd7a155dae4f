"""Whether an accelerometer that is coupled by AC sees its weight turn with the arm, as a specific force does.

An IEPE sensor passes what of g cos q is faster than its corner. Records that were made by another reading (r q'' alone) tell
it themselves in motions, where the arm turns: the reading that leaves less is taken, by the refitted base, and said.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.channels import ACCELERATIONS
from jointscope.diagnosis.whiten import is_hit

if TYPE_CHECKING:
    from jointscope.diagnosis.objective import Predict
    from jointscope.diagnosis.problem import Output, PreparedRun, Problem

Vector = NDArray[np.float64]
Sensor = tuple[str, str, float]

HALF = 0.5  # of the error's energy that must be gone without the weight, over all runs that show it


def as_seen(problem: Problem, theta: Vector, predict: Predict) -> Problem:
    """``problem`` without the weight in AC-coupled accelerations where the base at ``theta``, shape (n_theta,), refutes it."""
    seen = _errors(problem, theta, predict)
    if not seen:
        return problem
    bare = _errors(_without(problem, set(seen)), theta, predict, set(seen))
    refuted = {sensor for sensor, error in seen.items() if bare[sensor] < HALF * error}
    if not refuted:
        return problem
    said = [
        f"accelerometer at the {place}, AC coupled: its weight does not turn with the arm"
        for place, _, _ in refuted
    ]
    found = _without(problem, refuted)
    return replace(found, findings=(*problem.findings, *sorted(said)))


def _sensor(output: Output) -> Sensor:
    return output.location, output.direction, output.radius or 0.0


def _coupled(output: Output) -> bool:
    return output.quantity in ACCELERATIONS and output.low_cutoff is not None and output.gravity != 0.0


def _errors(
    problem: Problem, theta: Vector, predict: Predict, sensors: set[Sensor] | None = None
) -> dict[Sensor, float]:
    """Energy that the base leaves of each AC-coupled sensor in runs that move [signal's unit^2]."""
    total: dict[Sensor, float] = {}
    for run in problem.runs:
        asked = [k for k, o in enumerate(run.outputs) if _asked(run, o, sensors)]
        if not asked:
            continue
        predicted = predict(run, theta, (), problem)
        for k in asked:
            output = run.outputs[k]
            left = (output.data - predicted[k])[output.mask]
            if np.all(np.isfinite(left)):
                sensor = _sensor(output)
                total[sensor] = total.get(sensor, 0.0) + float(left @ left)
    return total


def _asked(run: PreparedRun, output: Output, sensors: set[Sensor] | None) -> bool:
    if is_hit(run) or not output.mask.any():
        return False
    return _coupled(output) if sensors is None else _sensor(output) in sensors and output.low_cutoff is not None


def _without(problem: Problem, sensors: set[Sensor]) -> Problem:
    def bare(output: Output) -> Output:
        return replace(output, gravity=0.0) if _coupled(output) and _sensor(output) in sensors else output

    runs = [
        replace(run, outputs=tuple(map(bare, run.outputs)), declared=tuple(map(bare, run.declared)))
        for run in problem.runs
    ]
    return replace(problem, runs=tuple(runs))
