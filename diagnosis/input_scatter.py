"""What the noise of a recorded input makes a model do: the joint was driven by the input, the model by its record.

With F + eta recorded over m samples of a hit's contact the model's response errs by sum_k eta_k h(t - t_k), h its response
to a sample of force: for a hit of 100 N and 6 ms recorded at 2 kHz with 0.7 N of noise by 1 % of the ring's amplitude and
0.01 rad of its phase, and by ten times an accelerometer's own noise while the contact lasts. eta is white and of the size
that the quiet part of the record shows, so its covariance is known. What is left of a torque log's noise has no formula;
what further logs would make the model do (``relog``) shows its covariance. Either way H H' is marginalised with a hit's gain
and time (:mod:`whiten`). Left out, a softening spring of -7.9e7 N m/rad^3 was found as -5.6e7, with 340 nats of the loudest
hit unexplained.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.channels import ACCELERATIONS
from jointscope.diagnosis.relog import LOGS, driven_by
from jointscope.recordings.bandlimited import bandlimited

if TYPE_CHECKING:
    from jointscope.diagnosis.effects import ActiveEffect
    from jointscope.diagnosis.objective import Predict
    from jointscope.diagnosis.problem import PreparedRun, Problem

Vector = NDArray[np.float64]
Respond = Callable[["PreparedRun"], tuple[Vector, ...]]
Pushes = tuple[NDArray[np.float64], ...]
VISCOUS = ("motor_damping", "load_damping")
VISCOSITY = 0.03  # of viscous friction, by which it scatters from run to run: oil of one kelvin more
STRENGTH = 0.03  # of a hit's force, by which its gain scatters
STEP = 5.0  # times the noise, by which one sample is moved to find h


def pushes(
    run: PreparedRun,
    theta: Vector,
    effects: tuple[ActiveEffect, ...],
    problem: Problem,
    predict: Predict,
    predicted: Sequence[Vector],
    *,
    oil: bool,
) -> Pushes | None:
    """What the noise of the recorded input does to each output, shapes (n, m): their covariance is the columns' H H'.

    With ``oil`` the last column is what a driven run's oil does by being warmer than on average. ``None`` where nothing
    is recorded with noise and nothing is viscous, or where the model flies apart.
    """

    def respond(moved: PreparedRun) -> tuple[Vector, ...]:
        return predict(moved, theta, effects, problem)

    if run.run.experiment == "hammer":
        found = [_of_the_contact(run, respond, predicted)]
        if run.mode == "observer":
            found.append(_of_the_strength(run, respond, predicted))
    else:
        found = [_of_the_log(run, respond, predicted)]
        if oil:
            found.append(_of_the_oil(predict(run, _warmer(problem, theta), effects, problem), predicted))
    known = [p for p in found if p is not None]
    return tuple(np.concatenate(columns, axis=1) for columns in zip(*known, strict=True)) if known else None


def _warmer(problem: Problem, theta: Vector) -> Vector:
    """The base in a run whose oil is as much warmer than on average as it may well be."""
    moved = theta.copy()
    moved[[name.startswith(VISCOUS) for name in problem.base.names]] *= 1.0 - VISCOSITY
    return moved


def _of_the_strength(run: PreparedRun, respond: Respond, predicted: Sequence[Vector]) -> Pushes | None:
    """What one standard deviation of a hit's own gain does where an observer holds the model to the recorded angle.

    There the response is no multiple of the force: most of the motion is the record's.
    """
    load = run.load
    if load is None:
        return None
    gain = 1.0 + STRENGTH
    signal = bandlimited(gain * load.samples, load.signal.rate, load.signal.start)
    harder = replace(load, samples=gain * load.samples, signal=signal)
    after = respond(replace(run, load=harder, load_half=gain * run.load_half))
    columns = tuple((z - y)[:, None] for z, y in zip(after, predicted, strict=True))
    return columns if all(np.all(np.isfinite(c)) for c in columns) else None


def _of_the_oil(warmer: Sequence[Vector], predicted: Sequence[Vector]) -> Pushes | None:
    """What one standard deviation of the oil's viscosity from run to run does."""
    columns = tuple((z - y)[:, None] for z, y in zip(warmer, predicted, strict=True))
    if not all(np.all(np.isfinite(c)) for c in columns) or not any(np.any(c) for c in columns):
        return None
    return columns


def _of_the_log(run: PreparedRun, respond: Respond, predicted: Sequence[Vector]) -> Pushes | None:
    """What further logs of the torque make of each acceleration.

    Of an angle that is held ``Ringing`` takes care, and what is left of a wind-up is too slow to be told from two dozen columns.
    """
    heard = any(output.quantity in ACCELERATIONS for output in run.outputs)
    relog = run.relogged if heard else None
    if relog is None:
        return None
    after = [respond(driven_by(run, relog, turn)) for turn in range(LOGS)]
    if not all(np.all(np.isfinite(y)) for each in (*after, predicted) for y in each):
        return None
    size = 1.0 / np.sqrt(LOGS)
    return tuple(
        np.stack([size * (each[k] - y) for each in after], axis=1)
        if output.quantity in ACCELERATIONS
        else np.zeros((y.size, LOGS))
        for k, (output, y) in enumerate(zip(run.outputs, predicted, strict=True))
    )


def _of_the_contact(run: PreparedRun, respond: Respond, predicted: Sequence[Vector]) -> Pushes | None:
    """What noise of one standard deviation in each sample of the contact does.

    h is the model's own, about the motion that the hit makes, and taken as the same for all samples of the contact.
    """
    load = run.load
    if load is None or not load.noise > 0.0:
        return None
    touched = np.flatnonzero(load.samples)
    if touched.size == 0 or touched.size == load.samples.size:
        return None
    rate, start = load.signal.rate, load.signal.start
    middle = int(touched[np.argmax(np.abs(load.samples[touched]))])
    sample = np.zeros(load.samples.size)
    sample[middle] = STEP * load.noise
    force = load.samples + sample
    half = run.t0 + np.arange(2 * run.steps + 1) / (2.0 * run.grid_rate)
    moved = replace(
        run,
        load=replace(load, samples=force, signal=bandlimited(force, rate, start)),
        load_half=run.load_half + bandlimited(sample, rate, start)(half),
    )
    after = respond(moved)
    if not all(np.all(np.isfinite(y)) for y in (*after, *predicted)):
        return None
    columns = []
    for output, y, z in zip(run.outputs, predicted, after, strict=True):
        h = (z - y) / STEP
        places = np.arange(h.size, dtype=np.float64)
        shifts = (touched - middle) * output.rate / rate
        columns.append(
            np.stack([np.interp(places - shift, places, h, left=0.0, right=0.0) for shift in shifts], axis=1)
        )
    return tuple(columns)
