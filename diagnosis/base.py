"""The base model refitted to a converged optimum, with the noise that it leaves: "the parameters were off" comes first."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.coordinates import Coordinates, coordinates
from jointscope.diagnosis.input_noise import Inlet, inlet
from jointscope.diagnosis.noise import MAX_ORDER, Key, NoiseModel, block_key, white
from jointscope.diagnosis.objective import Objective, Predict, Predictions, whitened
from jointscope.diagnosis.problem import recorded_angle
from jointscope.diagnosis.refit import Fit, least_squares
from jointscope.diagnosis.resolution import clips
from jointscope.diagnosis.split import content_order, level
from jointscope.diagnosis.whiten import completed, estimate_noise

if TYPE_CHECKING:
    from jointscope.diagnosis.effects import ActiveEffect
    from jointscope.diagnosis.input_scatter import Pushes
    from jointscope.diagnosis.prepare import Output, PreparedRun, Problem

Vector = NDArray[np.float64]

EARLY_ORDER = (
    0  # of the noise filter while a mismatch may still stand in the residual: a filter would learn the mismatch
)
GIVEN_UP = 0.25  # of the data's rms, left in the median of a kind of channel ...
TIMES = 3.0  # ... and so many times what the prepared start leaves there: it has been given up for others
POOR = 0.3  # residual over signal above which other starting stiffnesses are tried
STIFFNESS_STARTS = (0.8, 0.9, 1.12, 1.25)
FEW = 3  # runs per experiment in the first, coarse fit


@dataclass(frozen=True, eq=False)
class Stage:
    """A fitted hypothesis together with the noise it was judged by.

    Attributes:
        objective: Whitened with ``noise``.
        predictions: Of ``objective.runs`` at the optimum.
    """

    objective: Objective
    fit: Fit
    noise: NoiseModel
    predictions: Predictions


ASTRAY = math.log(
    4.0
)  # of the mean squared error of runs that were not fitted, by which the likeliest model goes astray there
EDGE = 0.01  # of the longest travel
CONTRAST = 2  # runs on either side of a payload's, or a drift's, middle


def representative(
    problem: Problem,
    positions: tuple[int, ...],
    hits: int,
    others: int,
    weightings: Sequence[Sequence[float]] = (),
) -> tuple[int, ...]:
    """Positions that span the levels: at most ``hits`` of the hammer and ``others`` of any other experiment.

    The runs that reach farthest to either side are added where the chosen ones stay short of them: a stop is met there.
    So is a run whose record clips, where none of the chosen ones does, and what lies to either side of the middle of one
    of ``weightings``, each of shape (n_runs,): among runs that all carry a payload, or none, it can't be seen.
    """
    strata: dict[tuple[str, bool], list[int]] = {}
    for i in content_order(problem.runs):
        if i in positions:
            run = problem.runs[i]
            strata.setdefault((run.run.experiment, run.run.brake), []).append(i)
    chosen: list[int] = []
    for (experiment, _), members in strata.items():
        members = sorted(members, key=lambda i: (level(problem.runs[i]), members.index(i)))
        count = min(hits if experiment == "hammer" else others, len(members))
        spread = np.linspace(0, len(members) - 1, count) if count > 1 else [0.5 * (len(members) - 1)]
        chosen.extend(members[round(j)] for j in spread)
    chosen.extend(_farthest(problem, positions, chosen))
    clipped = [
        i for i in content_order(problem.runs) if i in positions and any(map(clips, problem.runs[i].outputs))
    ]
    if clipped and not set(clipped) & set(chosen):
        chosen.append(max(clipped, key=lambda i: level(problem.runs[i])))
    for weights in weightings:
        chosen.extend(_either_side(problem, positions, chosen, weights))
    return tuple(i for i in positions if i in chosen)


def _either_side(
    problem: Problem, positions: tuple[int, ...], chosen: list[int], weights: Sequence[float]
) -> list[int]:
    """What is short of ``CONTRAST`` runs on either side of the middle weight, the outermost and loudest first."""
    middle = 0.5 * (min(weights) + max(weights))
    added: list[int] = []
    for sign in (-1.0, 1.0):
        side = [i for i in content_order(problem.runs) if i in positions and sign * (weights[i] - middle) > 0.0]
        side.sort(key=lambda i: (-sign * weights[i], -level(problem.runs[i])))
        missing = max(CONTRAST - sum(i in chosen for i in side), 0)
        added.extend([i for i in side if i not in chosen][:missing])
    return added


def _farthest(problem: Problem, positions: tuple[int, ...], chosen: list[int]) -> list[int]:
    reach: dict[int, tuple[float, float]] = {}
    for i in content_order(problem.runs):
        ends = _reach(problem.runs[i]) if i in positions else None
        if ends is not None:
            reach[i] = ends
    if not reach:
        return []
    short = EDGE * max(high - low for low, high in reach.values())
    added = []
    for side in (0, 1):
        sign = -1.0 if side == 0 else 1.0
        farthest = max(reach, key=lambda i: sign * reach[i][side])
        known = [sign * reach[i][side] for i in chosen if i in reach]
        if not known or max(known) < sign * reach[farthest][side] - short:
            added.append(farthest)
    return added


def _reach(run: PreparedRun) -> tuple[float, float] | None:
    """Lowest and highest recorded angle at the output [rad], or integral of a speed, where one was followed."""
    angle = recorded_angle(run)
    return None if angle is None else (float(angle.min()), float(angle.max()))


def relative_misfit(runs: tuple[PreparedRun, ...], predictions: Predictions) -> float:
    """Median over runs and outputs of RMS(residual) / RMS(data about its mean) [-]."""
    ratios = [ratio for _, _, ratio in misfits(runs, predictions)]
    return float(np.median(ratios)) if ratios else 0.0


def worst_misfit(runs: tuple[PreparedRun, ...], predictions: Predictions) -> float:
    """The same of the kind of channel that is predicted worst: what one sensor of several shows."""
    return max(_by_kind(runs, predictions).values(), default=0.0)


def _by_kind(runs: tuple[PreparedRun, ...], predictions: Predictions) -> dict[Key, float]:
    """The same of every kind of channel."""
    kinds: dict[Key, list[float]] = {}
    for run, output, ratio in misfits(runs, predictions):
        kinds.setdefault(block_key(run, output), []).append(ratio)
    return {key: float(np.median(ratios)) for key, ratios in kinds.items()}


def misfits(
    runs: tuple[PreparedRun, ...], predictions: Predictions
) -> Iterator[tuple[PreparedRun, Output, float]]:
    """RMS(residual) / RMS(data about its mean) [-] of every output that moves."""
    for run, predicted in zip(runs, predictions, strict=True):
        for output, y in zip(run.outputs, predicted, strict=True):
            data = output.data[output.mask]
            size = float(np.std(data))
            if size > 0.0:
                error = float(np.sqrt(np.mean(np.square(data - y[output.mask]))))
                yield run, output, error / size if np.all(np.isfinite(y)) else math.inf


def _coarse(objective: Objective, where: Coordinates) -> Fit:
    """From the prepared start, and from other stiffnesses where that ends far from the data."""
    x = where.pack(where.start, ())
    best = least_squares(objective, where, x, iterations=15, tolerance=1e-2)
    theta, _ = where.unpack(best.x)
    if relative_misfit(objective.prepared, objective.predictions(theta, ())) < POOR:
        return best
    names = [objective.problem.base.names[i] for i in where.free]
    if "stiffness" not in names:
        return best
    k = names.index("stiffness")
    for factor in STIFFNESS_STARTS:
        moved = x.copy()
        moved[k] *= factor
        other = least_squares(objective, where, moved, iterations=15, tolerance=1e-2)
        if other.chi2 < best.chi2 * (1.0 - 1e-6):
            best = other
    return best


def _heard(
    objective: Objective,
    theta: Vector,
    effects: tuple[ActiveEffect, ...],
    predictions: Predictions,
    max_order: int,
) -> tuple[list[Pushes | None], Inlet]:
    """What reaches the outputs beside their own noise, per run, and how.

    Early, while parameters are sought, neither the oil nor what shakes the joint: either would stand in for what they are
    off by.
    """
    late = max_order >= MAX_ORDER
    way = inlet(objective.problem, theta)
    return objective.pushes(theta, effects, predictions, oil=late), way if late else replace(way, poles={})


def rewhiten(
    objective: Objective, fit: Fit, before: NoiseModel, max_order: int
) -> tuple[Objective, NoiseModel, Predictions]:
    """Noise from what ``fit`` leaves, and the objective whitened by it."""
    theta, effects = fit.coordinates.unpack(fit.x)
    predictions = objective.predictions(theta, effects)
    pushed, way = _heard(objective, theta, effects, predictions, max_order)
    noise = estimate_noise(objective.prepared, predictions, before, max_order, way, pushed)
    noise = _not_given_up(objective, predictions, noise, before, max_order)
    return whitened(objective, noise, predictions, pushed), noise, predictions


def _not_given_up(
    objective: Objective, predictions: Predictions, noise: NoiseModel, before: NoiseModel, max_order: int
) -> NoiseModel:
    """``noise``, but for kinds of channels that were given up though the prepared start follows them: what that one leaves."""
    start = objective.problem.base.start
    given_up, at_start = _given_up(objective, predictions)
    if not given_up:
        return noise
    told, way = _heard(objective, start, (), at_start, max_order)
    known = estimate_noise(objective.prepared, at_start, before, max_order, way, told)
    return replace(noise, blocks={**noise.blocks, **{key: known.blocks[key] for key in given_up}})


def _given_up(objective: Objective, predictions: Predictions) -> tuple[list[Key], Predictions]:
    """Channels of runs on the brake that the prepared start follows and ``predictions`` do not, and what the start predicts."""
    braked = {block_key(run, output) for run in objective.prepared for output in run.outputs if run.run.brake}
    ratios = _by_kind(objective.prepared, predictions)
    left = {key: ratio for key, ratio in ratios.items() if ratio > GIVEN_UP and key in braked}
    if not left:
        return [], ()
    at_start = objective.predictions(objective.problem.base.start, ())
    followed = _by_kind(objective.prepared, at_start)
    return [key for key, ratio in left.items() if ratio > TIMES * followed[key]], at_start


def of_further_runs(
    objective: Objective,
    runs: tuple[int, ...],
    noise: NoiseModel,
    max_order: int,
    models: Sequence[tuple[Vector, tuple[ActiveEffect, ...]]],
) -> tuple[Objective, NoiseModel, Predictions]:
    """Other runs whitened by ``noise``, completed by what is left of kinds of channels that were not fitted.

    Args:
        models: Parameters and effects by which it is told what is left, the likeliest first; where that one goes astray
            in these runs, the one that goes least. No run is as noisy as a stop makes it that it never comes to.
    """
    other = replace(objective, runs=runs, whiteners=())
    told = [other.predictions(*model) for model in models]
    astray = [_error(other, predictions) for predictions in told]
    chosen = 0 if astray[0] < min(astray) + ASTRAY else int(np.argmin(astray))
    theta, effects = models[chosen]
    predictions = told[chosen]
    pushed, way = _heard(other, theta, effects, predictions, max_order)
    noise = completed(noise, other.prepared, predictions, max_order, way, pushed)
    return whitened(other, noise, predictions, pushed), noise, predictions


def _error(objective: Objective, predictions: Predictions) -> float:
    """Mean over outputs of the logarithm of their squared error, infinite where one is not finite."""
    squares = [
        float(np.mean(np.square((output.data - y)[output.mask])))
        for run, predicted in zip(objective.prepared, predictions, strict=True)
        for output, y in zip(run.outputs, predicted, strict=True)
        if output.mask.any()
    ]
    return float(np.mean([math.log(s + 1e-300) if math.isfinite(s) else math.inf for s in squares] or [0.0]))


def _led_by(objective: Objective, where: Coordinates, kinds: Sequence[Key]) -> tuple[Objective, Fit]:
    """The start as the runs with ``kinds`` of channels put it by themselves, there and in the problem.

    With all that an axis leaves of its friction in the motions, an arm that hardly moves at all is the least wrong; hits with
    the brake on say what it is.
    """
    problem = objective.problem
    runs = tuple(
        i for i in objective.runs if any(block_key(problem.runs[i], o) in kinds for o in problem.runs[i].outputs)
    )
    own = replace(objective, runs=runs)
    fit = least_squares(whitened(own, white(own.prepared), None), where, where.pack(where.start, ()))
    start, _ = where.unpack(fit.x)
    return replace(objective, problem=replace(problem, base=replace(problem.base, start=start))), fit


def refit_base(problem: Problem, predict: Predict, runs: tuple[int, ...], pool: ThreadPoolExecutor) -> Stage:
    """Fit the base to ``runs``, its noise and its parameters in turn."""
    where = coordinates(problem)
    objective = Objective(problem, predict, runs, pool)
    noise = white(objective.prepared)
    few = replace(objective, runs=representative(problem, runs, FEW, FEW))
    fit = _coarse(whitened(few, noise, None), where)
    given_up, _ = _given_up(objective, objective.predictions(*where.unpack(fit.x)))
    if given_up:
        objective, fit = _led_by(objective, where, given_up)
    objective, noise, _ = rewhiten(objective, fit, noise, EARLY_ORDER)
    fit = least_squares(objective, where, fit.x, iterations=10, tolerance=1e-3)
    objective, noise, _ = rewhiten(objective, fit, noise, EARLY_ORDER)
    fit = least_squares(objective, where, fit.x, iterations=15)
    predictions = objective.predictions(*where.unpack(fit.x))
    return Stage(objective, fit, noise, predictions)
