"""What the noise of a torque log makes a model do: the least that an effect must explain in runs that the log drives.

The log's white noise is taken off as well as can be (``input_estimate``), never wholly: what remains drives the model and
not the joint, and rings at the joint's resonance. Its size is found by doing it again: noise of the same size is put onto
the torque as estimated, taken off once more, and what both torques make the model do is compared (parametric bootstrap,
Efron and Tibshirani 1993, section 6.5).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.energies import Kind, kind_of
from jointscope.diagnosis.excitation import asked_only, below_excitation
from jointscope.diagnosis.input_estimate import estimated_input
from jointscope.recordings.bandlimited import bandlimited

if TYPE_CHECKING:
    from jointscope.diagnosis.effects import ActiveEffect
    from jointscope.diagnosis.objective import Objective
    from jointscope.diagnosis.problem import PreparedRun

Vector = NDArray[np.float64]

SEED = 20221  # of the noise; the same for every run, so that the answer depends on nothing else


def noisy_again(run: PreparedRun) -> PreparedRun:
    """The run as another log of the same torque would drive it; unchanged where nothing is logged."""
    motor = run.motor
    if motor is None:
        return run
    rate, start = motor.signal.rate, motor.signal.start
    noise = motor.noise * np.random.default_rng(SEED).standard_normal(motor.samples.size)
    samples = estimated_input(motor.samples + noise, rate)
    half = run.t0 + np.arange(2 * run.steps + 1) / (2.0 * run.grid_rate)
    error = bandlimited(samples - motor.samples, rate, start)(half)
    drive = replace(motor, samples=samples, signal=bandlimited(samples, rate, start))
    return replace(run, motor=drive, motor_half=run.motor_half + error)


@dataclass(frozen=True)
class Echo:
    """What both torques make the model do.

    Attributes:
        energies: Per experiment and channel, over the scored samples [the outputs' units squared].
        nats: Per experiment, half its whitened energy: what a model that follows it gains at most; empty where the
            runs were not whitened.
    """

    energies: dict[Kind, float]
    nats: dict[str, float]


def echoes(objective: Objective, theta: Vector, effects: tuple[ActiveEffect, ...]) -> Echo:
    """The echo in all runs of ``objective`` at these parameters."""

    def apart(run: PreparedRun) -> list[Vector]:
        if run.motor is None or not run.motor.noise > 0.0:
            return []
        both = (objective.predict(r, theta, effects, objective.problem) for r in (run, noisy_again(run)))
        return [b - a for a, b in zip(*both, strict=True)]

    energies: dict[Kind, float] = {}
    nats: dict[str, float] = {}
    for i, (run, echo) in enumerate(
        zip(objective.prepared, objective.map(apart, objective.prepared), strict=True)
    ):
        finite = [np.nan_to_num(x, nan=0.0, posinf=0.0, neginf=0.0) for x in echo]
        for output, x in zip(run.outputs, finite, strict=False):
            key = kind_of(run, output)
            x = asked_only(x, below_excitation(run, output))[output.mask]
            energies[key] = energies.get(key, 0.0) + float(x @ x)
        if finite and objective.whiteners:
            w = objective.whiteners[i](finite)
            nats[run.run.experiment] = nats.get(run.run.experiment, 0.0) + 0.5 * float(np.sum(np.square(w)))
    return Echo(energies, nats)
