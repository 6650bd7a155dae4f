"""A torque as further logs of it would have it: noise of the same size once more, taken off once more.

The log's white noise is taken off as well as can be (``input_estimate``), never wholly. What is left of it has no formula,
but it can be had again (parametric bootstrap, Efron and Tibshirani 1993, section 6.5). Where the motor's angle is what a
drive's law makes of the torque, it is had again as well, by a law as likely as the one found.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.acquisition import read
from jointscope.diagnosis.drive_angle import followed_angle
from jointscope.diagnosis.input_estimate import estimated_input
from jointscope.recordings.bandlimited import bandlimited

if TYPE_CHECKING:
    from jointscope.diagnosis.inputs import Drive
    from jointscope.diagnosis.problem import Observed, PreparedRun

Vector = NDArray[np.float64]

SEED = 20221  # of the noise; the same for every run, so that the answer depends on nothing else
LOGS = 24  # further logs, each run's its own, that show the covariance of what the log's noise does
AGAIN = 8  # and further ones, which that covariance has not seen


@dataclass(frozen=True, eq=False)
class Relogged:
    """A torque as further logs of it would have it.

    Attributes:
        motor: As it was logged.
        samples: As :attr:`inputs.Drive.samples`, shape (LOGS + AGAIN, n).
        motor_half: As :attr:`problem.PreparedRun.motor_half`, shape (LOGS + AGAIN, 2 steps + 1).
        observed: The angle that each of them gives to follow; empty where it does not come from the torque.
        observed_half: The same as :attr:`problem.PreparedRun.observed_half`.
    """

    motor: Drive
    samples: Vector
    motor_half: Vector
    observed: tuple[Observed, ...] = ()
    observed_half: tuple[Vector, ...] = ()


def relogged(run: PreparedRun) -> Relogged | None:
    """Further logs of a run's torque, which no model has a part in; ``None`` where none is logged with noise."""
    motor = run.motor
    law = None if run.observed is None else run.observed.law
    if motor is None or not (motor.noise > 0.0 or law is not None):
        return None
    rate, start = motor.signal.rate, motor.signal.start
    half = run.t0 + np.arange(2 * run.steps + 1) / (2.0 * run.grid_rate)
    turns = range(1, LOGS + AGAIN + 1)
    samples = np.broadcast_to(motor.samples, (len(turns), motor.samples.size))
    if motor.noise > 0.0:
        noises = (
            np.random.default_rng([SEED, turn, run.index]).standard_normal(motor.samples.size) for turn in turns
        )
        samples = estimated_input(motor.samples + motor.noise * np.stack(list(noises)), rate, motor.noise)
    halves, angles = [], []
    for turn, log in zip(turns, samples, strict=True):
        halves.append(run.motor_half + read(bandlimited(log - motor.samples, rate, start), half))
        if law is not None and run.command is not None:
            likely = law.drawn(np.random.default_rng([SEED, turn]))  # one drive's law: the same in all of its runs
            logged = replace(motor, samples=log)
            angle = followed_angle(logged, run.command, run.initial_angle, likely)
            if angle is not None:
                angles.append(angle)
    paths = tuple(angle.signal(half) for angle in angles)
    return Relogged(motor, samples, np.stack(halves), tuple(angles), paths)


def driven_by(run: PreparedRun, relog: Relogged, turn: int) -> PreparedRun:
    """The run as the log of a turn would drive it."""
    samples, logged = relog.samples[turn], relog.motor.signal
    drive = replace(relog.motor, samples=samples, signal=bandlimited(samples, logged.rate, logged.start))
    run = replace(run, motor=drive, motor_half=relog.motor_half[turn])
    if not relog.observed:
        return run
    return replace(run, observed=relog.observed[turn], observed_half=relog.observed_half[turn])
