"""Energies of errors by kind of channel: what a model explains there, and whether that is more than a log's echo."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.excitation import asked_only, below_excitation
from jointscope.diagnosis.noise import dynamic_level

if TYPE_CHECKING:
    from jointscope.diagnosis.echo import Echo
    from jointscope.diagnosis.objective import Objective, Predictions
    from jointscope.diagnosis.prepare import Output, PreparedRun
    from jointscope.diagnosis.whiten import RunWhitener

Vector = NDArray[np.float64]
Kind = tuple[object, ...]
Energies = Mapping[Kind, tuple[float, float]]  # squared error of all runs, and squared signal


AGREEING = 20.0  # nats that runs must gain which no log drives


def kind_of(run: PreparedRun, output: Output) -> Kind:
    """Experiment, quantity, location and direction of an output."""
    return (run.run.experiment, output.quantity, output.location, output.direction)


def energies_between(
    runs: Sequence[PreparedRun], some: Sequence[Sequence[Vector]], others: Sequence[Sequence[Vector]]
) -> Energies:
    """Squared difference of ``some`` and ``others`` and squared signal per experiment and channel, over the scored samples.

    An angle's signal is what it does within a quarter second: slower than that the observer follows the recording.
    """
    pooled: dict[Kind, tuple[float, float]] = {}
    for run, ones, twos in zip(runs, some, others, strict=True):
        for output, one, two in zip(run.outputs, ones, twos, strict=True):
            key = kind_of(run, output)
            apart, signal = pooled.get(key, (0.0, 0.0))
            x = asked_only(one - two, below_excitation(run, output))[output.mask]
            pooled[key] = (apart + float(x @ x), signal + dynamic_level(output) ** 2 * int(output.mask.sum()))
    return pooled


def error_energies(
    runs: Sequence[PreparedRun], predictions: Predictions, whiteners: Sequence[RunWhitener]
) -> Energies:
    """Squared error and squared signal per experiment and channel, over the scored samples of ``runs``.

    A hit's error is less what most likely scattered, its gain of a few per cent above all: nothing that is modelled adds
    to that or takes from it but by chance.
    """
    left = [
        whitener.settled([o.data - y for o, y in zip(run.outputs, predicted, strict=True)])
        for run, predicted, whitener in zip(runs, predictions, whiteners, strict=True)
    ]
    return energies_between(runs, left, [[np.zeros_like(r) for r in residuals] for residuals in left])


def improvement(
    base: Energies,
    before: Energies,
    after: Energies,
    echo: Mapping[Kind, float],
) -> tuple[float, float, float]:
    """(material, share, rest) of :class:`Comparison` from the error energies of base, parent and child.

    Of what is explained, what the noise of a log makes the model do (``echo``) does not count.
    """
    best = (0.0, 0.0, 0.0)
    for key, (parent, signal) in before.items():
        gained, whole = parent - after[key][0], base[key][0] - after[key][0]
        beyond = gained - echo.get(key, 0.0)
        if signal > 0.0 and beyond > 0.0:
            share = math.sqrt(gained / whole) if whole > 0.0 else 1.0
            best = max(best, (math.sqrt(beyond / signal), min(share, 1.0), gained / parent))
    return best


def drowned(
    echo: Echo,
    before: Energies,
    after: Energies,
    gained: Mapping[str, float],
    along: Mapping[str, float],
    by_noise: Callable[[], Mapping[str, float]],
) -> set[str]:
    """Experiments in which all that is explained is no more than the echo of a log's noise.

    More is explained where a channel's error falls by more than the echo's energy, or where the likelihood gains more
    than following all of the echo would, or all that lies along what is explained (``gained`` and ``along``, per
    experiment [nats]): an angle's echo is slow, and large. The latter only where runs that no
    log drives gain too, or where it is more than a noise alone would make the effect gain (``by_noise``, asked last): an
    effect that lets less of the noise through gains from it, along whatever it changes.
    """
    above: dict[str, bool] = {}
    for key, energy in echo.energies.items():
        experiment = str(key[0])
        above[experiment] = above.get(experiment, False) or before[key][0] - after[key][0] > energy
    quiet = {experiment for experiment, found in above.items() if not found}
    quiet -= {name for name in quiet if gained.get(name, 0.0) > echo.nats.get(name, math.inf)}
    beyond = {name for name in quiet if gained.get(name, 0.0) > along.get(name, math.inf)}
    if beyond and sum(nats for name, nats in gained.items() if name not in echo.nats) <= AGREEING:
        most = by_noise()
        beyond = {name for name in beyond if gained[name] > most.get(name, math.inf)}
    return quiet - beyond


def by_experiment(gains: Vector, runs: Sequence[PreparedRun]) -> dict[str, float]:
    """Gains of the runs, shape (n_runs,), summed per experiment."""
    found: dict[str, float] = {}
    for run, gain in zip(runs, gains, strict=True):
        found[run.run.experiment] = found.get(run.run.experiment, 0.0) + float(gain)
    return found


def heard(gains: Vector, runs: Sequence[PreparedRun], silent: set[str]) -> Vector:
    """The gain of every run, and nothing of those in which a model only follows an echo."""
    drowned_out = np.array([run.run.experiment in silent for run in runs], dtype=bool)
    return np.where(drowned_out, np.minimum(gains, 0.0), gains)


def in_proportion(objective: Objective, further: Objective, gains: Vector) -> float:
    """What the runs of ``further`` would gain if every sample gained as in the runs of their kind [nats].

    Args:
        gains: Of the runs of ``objective``, shape (n_runs,) [nats].
    """

    def kinds(of: Objective) -> list[tuple[str, bool]]:
        return [(run.run.experiment, run.run.brake) for run in of.prepared]

    sizes = np.array([sum(w.sizes) for w in objective.whiteners])
    further_sizes = np.array([sum(w.sizes) for w in further.whiteners])
    told, wanted = kinds(objective), kinds(further)
    total = 0.0
    for kind in dict.fromkeys(wanted):
        theirs = np.array([k == kind for k in wanted])
        mine = np.array([k == kind for k in told])
        mine = mine if mine.any() else np.ones_like(mine)
        total += float(gains[mine].sum() / max(sizes[mine].sum(), 1) * further_sizes[theirs].sum())
    return total
