"""What the noise of a torque log makes a model do: the least that an effect must explain in runs that the log drives.

The log's white noise is taken off as well as can be (``input_estimate``), never wholly: what remains drives the model and
not the joint, and rings at the joint's resonance. Its size is found by doing it again: noise of the same size is put onto
the torque as estimated, taken off once more (``relog``), and what both torques make the model do is compared, for some
noises that no covariance was read off. An effect follows an echo only as far as the echo lies along what the effect changes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.energies import Kind, kind_of
from jointscope.diagnosis.excitation import asked_only, below_excitation
from jointscope.diagnosis.relog import AGAIN, LOGS, Relogged, driven_by

if TYPE_CHECKING:
    from jointscope.diagnosis.effects import ActiveEffect
    from jointscope.diagnosis.objective import Objective
    from jointscope.diagnosis.problem import PreparedRun

Vector = NDArray[np.float64]

BEYOND = 5.0  # standard deviations of what a noise alone makes an effect gain
ALIGNED = (
    12.5  # half the square of five standard deviations: an effect that was sought among many follows that much
)

Relogs = dict[int, Relogged]  # by position in an objective


def relogs(objective: Objective) -> Relogs:
    """Further logs of every run of ``objective`` that a noisy log drives."""
    found = objective.map(lambda run: run.relogged, objective.prepared)
    return {i: relog for i, relog in enumerate(found) if relog is not None}


@dataclass(frozen=True)
class Echo:
    """What both torques make the model do.

    Attributes:
        energies: Per experiment and channel, over the scored samples [the outputs' units squared].
        nats: Per experiment, half its whitened energy: what a model that follows it gains at most; empty where the
            runs were not whitened.
        again: Per run, what every noise does, whitened, shape (AGAIN, n); without rows where no log drives it.
    """

    energies: dict[Kind, float]
    nats: dict[str, float]
    again: tuple[Vector, ...] = ()

    def along(self, runs: Sequence[PreparedRun], changes: Sequence[Vector]) -> dict[str, float]:
        """Nats per experiment that an effect gains at most from such an echo, by what it changes.

        Args:
            runs: As the echo was found in.
            changes: Per run, what the effect changes, whitened, shape (n,).
        """
        dots: dict[str, Vector] = {}
        sizes: dict[str, float] = {}
        for run, echo, change in zip(runs, self.again, changes, strict=False):
            if len(echo):
                name = run.run.experiment
                dots[name] = dots.get(name, np.zeros(len(echo))) + echo @ change
                sizes[name] = sizes.get(name, 0.0) + float(change @ change)
        return {
            name: ALIGNED * float(np.mean(np.square(dot))) / sizes[name]
            for name, dot in dots.items()
            if sizes[name] > 0.0
        }


Noisy = dict[int, list[list[Vector]]]  # by run: its outputs as it was driven, and as each noise would drive it


def _predicted(objective: Objective, again: Relogs, theta: Vector, effects: tuple[ActiveEffect, ...]) -> Noisy:
    """What the model does in every run that a noisy log drives."""

    def predicted(run: PreparedRun) -> list[Vector]:
        found = objective.predict(run, theta, effects, objective.problem)
        return [np.nan_to_num(x, nan=0.0, posinf=0.0, neginf=0.0) for x in found]

    runs = objective.prepared
    driven = [
        run
        for i, relog in again.items()
        for run in (runs[i], *(driven_by(runs[i], relog, LOGS + turn) for turn in range(AGAIN)))
    ]
    results = iter(objective.map(predicted, driven))
    return {i: [next(results) for _ in range(AGAIN + 1)] for i in again}


def _apart(still: Sequence[Vector], noisy: Sequence[Vector]) -> list[Vector]:
    return [b - a for a, b in zip(still, noisy, strict=True)]


def echoes(objective: Objective, again: Relogs, theta: Vector, effects: tuple[ActiveEffect, ...]) -> Echo:
    """The echo in all runs of ``objective`` at these parameters; ``again``: its :func:`relogs`."""
    energies: dict[Kind, float] = {}
    nats: dict[str, float] = {}
    whitened = [np.zeros((0, sum(whitener.sizes))) for whitener in objective.whiteners]
    for i, (still, *noisy) in _predicted(objective, again, theta, effects).items():
        run, errors = objective.prepared[i], [_apart(still, y) for y in noisy]
        for k, output in enumerate(run.outputs):
            key, below = kind_of(run, output), below_excitation(run, output)
            scored = [asked_only(error[k], below)[output.mask] for error in errors]
            energies[key] = energies.get(key, 0.0) + float(np.mean([x @ x for x in scored]))
        if objective.whiteners:
            whitened[i] = np.stack([objective.whiteners[i](error)[:, 0] for error in errors])
            name = run.run.experiment
            nats[name] = nats.get(name, 0.0) + 0.5 * float(np.mean(np.sum(np.square(whitened[i]), axis=1)))
    return Echo(energies, nats, tuple(whitened))


def redriven(
    objective: Objective, again: Relogs, theta: Vector, effects: tuple[ActiveEffect, ...]
) -> dict[int, Vector]:
    """Whitened predictions by run, as it was driven and as every noise would drive it, shape (AGAIN + 1, n)."""
    found = _predicted(objective, again, theta, effects)
    return {i: np.stack([objective.whiteners[i](y)[:, 0] for y in all_y]) for i, all_y in found.items()}


def from_noise_alone(
    runs: Sequence[PreparedRun], parent: Mapping[int, Vector], child: Mapping[int, Vector]
) -> dict[str, float]:
    """Nats per experiment that a child gains at most over a parent that is true, for what a log's noise does to both.

    The recording is what the parent predicts; both are driven by noisy logs of its torque. A model that lets less of the
    noise through gains where nothing was left out: damping, friction, a mode beside the resonance.

    Args:
        parent, child: See :func:`redriven`.
    """
    gains: dict[str, Vector] = {}
    for i, (still, *noisy) in parent.items():
        left, other = still - np.stack(noisy), still - child[i][1:]
        gain = 0.5 * (np.sum(np.square(left), axis=1) - np.sum(np.square(other), axis=1))
        name = runs[i].run.experiment
        gains[name] = gains.get(name, 0.0) + gain
    return {name: float(np.mean(g) + BEYOND * np.std(g, ddof=1)) for name, g in gains.items()}
