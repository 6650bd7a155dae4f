"""Play fitted to the first periods after each hit, then to more and more of them.

Between the flanks an oscillation has no period of its own: after twenty of them a gap that is off by a fiftieth has it out
of step, and a search from anywhere else ends in the next of many valleys. Over the first two periods there is one valley,
and it is wide. What it gives starts the fit to a few more, and the last of these starts the fit to whole runs.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from jointscope.diagnosis.assembly import BASE_INDEX
from jointscope.diagnosis.coordinates import coordinates
from jointscope.diagnosis.effects import ActiveEffect
from jointscope.diagnosis.objective import whitened
from jointscope.diagnosis.refit import Fit, least_squares
from jointscope.diagnosis.search import Hypothesis, profile_loss

if TYPE_CHECKING:
    from jointscope.diagnosis.coordinates import Coordinates
    from jointscope.diagnosis.effects import EffectSpec
    from jointscope.diagnosis.noise import NoiseModel
    from jointscope.diagnosis.objective import Objective
    from jointscope.diagnosis.problem import PreparedRun

PERIODS = (2.0, 3.0, 4.5, 6.5, 10.0, 15.0)  # of the base's resonance after the hit, one fit each
STRUCK = 0.05  # of a hit's peak, where it begins
STIFFER = (1.0, 1.06, 1.12, 1.2, 1.3, 1.45, 1.6, 1.8)  # times the base's stiffness, which a gap makes too soft
GAPS = (0.01, 0.02, 0.04, 0.08, 0.15, 0.3, 0.6)  # of the largest wind-up
DEPTHS = (0.15, 0.5)  # of the gap, over which rounded flanks give way
SETTLING = 50  # steps simulated beyond a window, which the recorder's filter reads
LAWS = 2  # fitted to whole runs
TRIED = 4  # starts fitted to the first window
STEP = 1e-3  # of a parameter's size, over which contacts are differenced: an event moves by whole steps below
FIRST, FURTHER, WHOLE = (15, 120), (20, 200), (20, 120)  # iterations and simulations of one fit


def ring_downs(
    objective: Objective, base: Fit, noise: NoiseModel, specs: Sequence[EffectSpec]
) -> list[Hypothesis]:
    """The two laws of play among ``specs`` that follow the hits best, fitted so; none where no held joint was hit."""
    problem = objective.problem
    hits = tuple(
        i for i in objective.runs if problem.runs[i].mode == "braked" and problem.runs[i].load is not None
    )
    laws = [
        spec for spec in specs if spec.name == "backlash" and "centre" not in {p.name for p in spec.parameters}
    ]
    if not hits or problem.scales.wind_up <= 0.0:
        return []
    paths = sorted((_by_windows(objective, base, noise, hits, spec) for spec in laws), key=lambda path: path[-1].chi2)
    found = []
    for path in paths[:LAWS]:
        best = min((_whole(objective, fit) for fit in path), key=lambda fit: fit.chi2)
        if best.chi2 < base.chi2:
            found.append(Hypothesis(best.coordinates.effects, best, profile_loss(objective, best.w)))
    return found


def _by_windows(
    objective: Objective, base: Fit, noise: NoiseModel, hits: tuple[int, ...], spec: EffectSpec
) -> list[Fit]:
    """The fits to the last two windows; shape of a window's own residual."""
    theta, _ = base.coordinates.unpack(base.x)
    path: list[Fit] = []
    for periods in PERIODS:
        near = _within(objective, noise, hits, periods / objective.problem.scales.frequency)
        where = _coarse(coordinates(near.problem, (spec,)))
        if not path:
            starts = _starts(near, theta, spec, where)
            fits = [_fit(near, where, x, FIRST) for x in starts]
            path.append(min(fits, key=lambda fit: fit.chi2))
        else:
            path.append(_fit(near, where, path[-1].x, FURTHER))
    return path[-2:]


def _fit(objective: Objective, where: Coordinates, x: np.ndarray, effort: tuple[int, int]) -> Fit:
    return least_squares(objective, where, x, iterations=effort[0], tolerance=3e-3, simulations=effort[1])


def _whole(objective: Objective, fit: Fit) -> Fit:
    """Fitted on to whole runs, once with steps across contacts and once with small ones."""
    where = coordinates(objective.problem, fit.coordinates.effects)
    rough = _fit(objective, _coarse(where), fit.x, WHOLE)
    return replace(_fit(objective, where, rough.x, WHOLE), coordinates=where)


def _coarse(where: Coordinates) -> Coordinates:
    return replace(where, step=np.maximum(where.step, STEP))


def _starts(near: Objective, theta: np.ndarray, spec: EffectSpec, where: Coordinates) -> list[np.ndarray]:
    """The nearest of a grid of stiffnesses, gaps and depths, as coordinates."""
    wind_up = near.problem.scales.wind_up
    trials = []
    for factor in STIFFER:
        stiffer = theta.copy()
        stiffer[BASE_INDEX["stiffness"]] *= factor
        for gap in GAPS:
            for depth in DEPTHS if len(spec.parameters) > 1 else DEPTHS[:1]:
                values = (gap * wind_up, depth * gap * wind_up, 1.0)[: len(spec.parameters)]
                trials.append((stiffer, ActiveEffect(spec, values)))
    costs = near.map(lambda trial: near.misfit(trial[0], (trial[1],)), trials)
    order = np.argsort(costs, kind="stable")
    return [where.pack(trials[k][0], (trials[k][1],)) for k in order[:TRIED]]


def _within(objective: Objective, noise: NoiseModel, hits: tuple[int, ...], seconds: float) -> Objective:
    """The hits alone, up to ``seconds`` after each began, whitened by ``noise``."""
    runs = list(objective.problem.runs)
    for i in hits:
        runs[i] = _cut(runs[i], seconds)
    return whitened(
        replace(objective, problem=replace(objective.problem, runs=tuple(runs)), runs=hits, whiteners=()),
        noise,
        None,
    )


def _cut(run: PreparedRun, seconds: float) -> PreparedRun:
    """The run up to ``seconds`` after its external force first was a share of its peak."""
    force = np.abs(run.load_half)
    begins = run.t0 + int(np.argmax(force > STRUCK * force.max())) / (2.0 * run.grid_rate)
    ends = begins + seconds
    steps = min(run.steps, math.ceil((ends - run.t0) * run.grid_rate) + SETTLING)
    half = 2 * steps + 1
    outputs = tuple(
        replace(o, times=o.times[o.times <= ends], data=o.data[o.times <= ends], mask=o.mask[o.times <= ends])
        for o in run.outputs
    )
    return replace(
        run,
        steps=steps,
        load_half=run.load_half[:half],
        motor_half=run.motor_half[:half],
        command_half=run.command_half[:half],
        observed_half=run.observed_half[:half],
        command_rate_half=run.command_rate_half[:half],
        outputs=outputs,
    )
