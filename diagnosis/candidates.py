"""What is tried: every law at its starts, and lines and modes also where a residual shows them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.effects import ActiveEffect
from jointscope.diagnosis.effects.lines import Residuals
from jointscope.diagnosis.screen import trial_effects

if TYPE_CHECKING:
    from jointscope.diagnosis.effects import EffectSpec
    from jointscope.diagnosis.objective import Objective, Predictions
    from jointscope.diagnosis.prepare import Problem

Vector = NDArray[np.float64]

THINNED = 3  # every third of a grid of lines or modes is kept where the residual itself shows where to start ...
WIDTHS = 2  # in which every peak of a mode is tried
FEW = ("periodic", "sensor-gain")  # ... but of these: a wrong phase hides an order, and a sensor has few starts


def candidates_for(
    problem: Problem, specs: Sequence[EffectSpec], residuals: Residuals | None = None
) -> list[ActiveEffect]:
    """Every trial of every effect that these channels and experiments can show.

    Laws with few shapes are tried small, medium and large: what play or friction does at one size is no guide to
    another. Lines and modes start also where ``residuals`` (data less the base, per run and output) show them.
    """
    found: list[ActiveEffect] = []
    for spec in specs:
        if spec.possible(problem) is None:
            shapes = len(spec.starts(problem))
            sizes = (0, 1, 2) if shapes == 1 else (0, 1) if shapes <= 3 else (1,)
            smaller = tuple(range(-spec.decades, 0))
            trials = trial_effects(spec, problem, (*smaller, *sizes))
            dense = spec.residual_starts is not None and spec.family not in FEW
            found.extend(trials[::THINNED] if dense and residuals is not None else trials)
            if residuals is not None:
                found.extend(where_shown(problem, (spec,), residuals, (0, 1), 1))
    return found


def where_shown(
    problem: Problem,
    specs: Sequence[EffectSpec],
    residuals: Residuals,
    sizes: Sequence[int] = (0,),
    every: int = WIDTHS,
) -> list[ActiveEffect]:
    """Lines and modes where ``residuals`` show them, of these ``sizes`` (0 small, 1 medium).

    Args:
        every: How many of a mode's shapes go to one that is tried.
    """
    found: list[ActiveEffect] = []
    for spec in specs:
        if spec.residual_starts is None:
            continue
        shapes = spec.residual_starts(problem, residuals)
        for shape in shapes[::every] if spec.family == "mode" else shapes:
            whole = len(shape) == len(spec.parameters)  # of a frequency that is the size itself
            for size in () if whole else sizes:
                values = [*shape[: spec.amplitude], spec.scale(problem)[size], *shape[spec.amplitude :]]
                found.append(ActiveEffect(spec, tuple(float(v) for v in values)))
            if whole:
                found.append(ActiveEffect(spec, tuple(float(v) for v in shape)))
    return found


def residuals_of(objective: Objective, predictions: Predictions) -> Residuals:
    """Data less ``predictions`` for every run and output of the problem; zeros for runs that are not the objective's."""
    runs = objective.problem.runs
    found = [[np.zeros(len(o.data)) for o in run.outputs] for run in runs]
    for position, predicted in zip(objective.runs, predictions, strict=True):
        pairs = zip(runs[position].outputs, predicted, strict=True)
        found[position] = [np.where(o.mask, o.data - y, 0.0) for o, y in pairs]
    return Residuals(found)
