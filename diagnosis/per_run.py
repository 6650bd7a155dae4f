"""Effects that act in some runs more than in others: which runs those are, from the runs themselves.

A payload or a stiffness that drifts from take to take is known by which takes it concerns. Neither order nor ids may
tell that, so every run's own inertia and stiffness are scored: a payload needs two clearly parted groups of inertia, a
drift a spread of stiffness beyond the estimates' own errors. The freedom of choosing is paid for in the evidence
(``labelling_cost``): n ln 2 nats for a choice of members, ln n! for an order.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.base import Stage
from jointscope.diagnosis.coordinates import coordinates
from jointscope.diagnosis.effects import DRIFT_PER_RUN, PAYLOAD, with_run_weights
from jointscope.diagnosis.objective import whitened

if TYPE_CHECKING:
    from jointscope.diagnosis.effects import EffectSpec
    from jointscope.diagnosis.prepare import Problem

Vector = NDArray[np.float64]

PARTED = 6.0  # gap between the groups over the pooled standard error
SPREAD = 4.0  # standard deviation of the stiffnesses over their median standard error
FEWEST = 4  # runs


def run_steps(stage: Stage, name: str) -> tuple[Vector, Vector]:
    """Each run's own relative departure of one base parameter and its standard error, shape (n_runs,) of the problem.

    Runs that say nothing of the parameter get an infinite error.
    """
    problem = stage.objective.problem
    everything = replace(stage.objective, runs=tuple(range(len(problem.runs))), whiteners=())
    where = coordinates(problem)
    predictions = everything.predictions(*where.unpack(stage.fit.x))
    everything = whitened(everything, stage.noise, predictions)
    w = np.concatenate([everything.whiten_run(i, p) for i, p in enumerate(predictions)])
    position = int(np.flatnonzero(where.free == problem.base.names.index(name))[0])
    column = everything.columns(stage.fit.x, where, w, [position])[:, 0]
    step, error = np.zeros(len(problem.runs)), np.full(len(problem.runs), np.inf)
    for i, rows in enumerate(everything.slices):
        size = float(column[rows] @ column[rows])
        if size > 0.0:
            step[i] = -float(column[rows] @ w[rows]) / size / stage.fit.x[position]
            error[i] = 1.0 / math.sqrt(size) / abs(stage.fit.x[position])
    return step, error


def two_groups(values: Vector, errors: Vector) -> NDArray[np.bool_] | None:
    """Members of the upper group where the widest gap parts the values beyond doubt, shape of ``values``; else ``None``."""
    known = np.isfinite(errors)
    if known.sum() < FEWEST:
        return None
    ordered = np.sort(values[known])
    gaps = np.diff(ordered)
    k = int(np.argmax(gaps))
    upper = values > 0.5 * (ordered[k] + ordered[k + 1])
    groups = values[known & upper], values[known & ~upper]
    within = max((float(np.std(g)) for g in groups if len(g) > 1), default=0.0)
    scale = max(within, float(np.median(errors[known])))
    if gaps[k] < PARTED * scale or min(len(g) for g in groups) < 1:
        return None
    return np.asarray(known & upper)


def labelling_cost(spec: EffectSpec) -> float:
    """What the choice of runs costs [nats]; 0 for effects that act alike in all."""
    if spec.run_weights is None:
        return 0.0
    n = len(spec.run_weights)
    return n * math.log(2.0) if spec.name == PAYLOAD.name else math.lgamma(n + 1.0)


def per_run_specs(stage: Stage, problem: Problem) -> tuple[EffectSpec, ...]:
    """Payload and drift from run to run, where the runs' own estimates suggest them."""
    free = {problem.base.names[i] for i in np.flatnonzero(problem.base.free)}
    found: list[EffectSpec] = []
    if "load_inertia" in free and PAYLOAD.possible(problem) is None:
        inertia, error = run_steps(stage, "load_inertia")
        members = two_groups(inertia, error)
        if members is not None:
            found.append(with_run_weights(PAYLOAD, tuple(float(m) for m in members), problem))
    if "stiffness" in free and DRIFT_PER_RUN.possible(problem) is None:
        stiffness, error = run_steps(stage, "stiffness")
        known = np.isfinite(error)
        if known.sum() >= FEWEST and np.std(stiffness[known]) > SPREAD * np.median(error[known]):
            ranks = np.zeros(len(stiffness))
            ranks[known] = np.argsort(np.argsort(stiffness[known])) - 0.5 * (known.sum() - 1)
            found.append(with_run_weights(DRIFT_PER_RUN, tuple(float(r) for r in ranks), problem))
    return tuple(found)
