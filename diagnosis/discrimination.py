r"""Expected gain in the probability of the right candidate, for every recording of the menu (B.2, stage 10).

For candidates i, j and a planned recording x, with i true,

    D_ij(x) = min over theta_j of |L^-1 (y_i(x) - y_j(x, theta_j))|^2 over the old and the new recordings together:

what remains between the two when j is refitted to everything (T-optimality, Atkinson and Fedorov 1975). The refit is
linear about j's present optimum: with d the whitened departure, J its Jacobian on x and N = J_old' J_old what the old
recordings hold j to, D = d'd - d'J (N + J'J)^-1 J'd. Without the refit the score would prefer recordings that merely
estimate theta anew. The odds of i against j grow by D/2 nats, tempered as the present probabilities are, and

    gain(x) = sum_i p_i [P(i | x, i true) - p_i].
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.coordinates import Coordinates, coordinates
from jointscope.diagnosis.effects import ActiveEffect
from jointscope.diagnosis.foretelling import (
    Foretold,
    foretell,
    planned_noise,
    planned_whitener,
    under,
)
from jointscope.diagnosis.menu import Lab, Take, lab_of, planned
from jointscope.diagnosis.parameters import base_spec, bounded
from jointscope.diagnosis.search import CONTAINED
from jointscope.diagnosis.verdict import TEMPERATURE

if TYPE_CHECKING:
    from jointscope.diagnosis.adjudicate import Judged, Judgement
    from jointscope.diagnosis.problem import Problem
    from jointscope.diagnosis.verdict import Decision

Vector = NDArray[np.float64]

CANDIDATES = 3  # leading sets that are told apart
LISTED = 0.02  # probability below which a set is not worth a recording
TRUSTED = 0.1  # share of the distance that survives laws of the right name but the wrong form, and the noise's re-estimate
WEAK_PRIOR = 1e-4  # of a coordinate that no old recording moves: one unit is a hundred of its sizes


@dataclass(frozen=True, eq=False)
class Candidate:
    """A leading set.

    Attributes:
        probability: Among the candidates.
        theta, effects: As fitted.
        where: Coordinates of the candidate in the widened problem.
        x: Its optimum in them.
        known: J'J of the old recordings there, shape (n, n).
    """

    names: tuple[str, ...]
    probability: float
    theta: Vector
    effects: tuple[ActiveEffect, ...]
    where: Coordinates
    x: Vector
    known: NDArray[np.float64]


@dataclass(frozen=True)
class Item:
    """One recording of the menu.

    Attributes:
        expected_gain: In the probability of the right candidate.
        distance: sqrt of the p-weighted mean D, which orders items that would all decide.
        pair: The two candidates that it tells apart best, weighted by their probabilities.
    """

    key: str
    expected_gain: float
    distance: float
    pair: tuple[tuple[str, ...], tuple[str, ...]]


def widened(problem: Problem, runs: Sequence[Foretold]) -> Problem:
    """The problem with planned runs in it: what they can move is free too."""
    every = (*problem.runs, *(f.run for f in runs))
    base = bounded(base_spec(problem.rig, every), every, problem.rig)
    free = base.free | problem.base.free
    scale = np.where(problem.base.free, problem.base.scale, base.scale)
    lower = np.where(problem.base.free, problem.base.lower, base.lower)
    upper = np.where(problem.base.free, problem.base.upper, base.upper)
    start = problem.base.start
    return replace(problem, base=replace(base, start=start, scale=scale, lower=lower, upper=upper, free=free))


def candidate(judged: Judged, probability: float, wide: Problem) -> Candidate:
    """The set in the coordinates of the widened problem, with what the old recordings say of each."""
    fit = judged.fit
    theta, effects = fit.coordinates.unpack(fit.x)
    where = coordinates(wide, fit.coordinates.effects)
    places = {int(index): k for k, index in enumerate(where.free)}
    old = [places[int(index)] for index in fit.coordinates.free]
    old += list(range(where.n_base, where.n))
    known = np.zeros((where.n, where.n))
    known[np.ix_(old, old)] = fit.jacobian.T @ fit.jacobian
    known[np.diag_indices_from(known)] += WEAK_PRIOR
    return Candidate(judged.names, probability, theta, effects, where, where.pack(theta, effects), known)


def leading(decision: Decision, wide: Problem) -> list[Candidate]:
    """The sets worth telling apart, probabilities summing to one."""
    chosen = [r for r in decision.ranking if r.probability >= LISTED][:CANDIDATES]
    total = sum(r.probability for r in chosen)
    return [candidate(r.judged, r.probability / total, wide) for r in chosen]


def _shifted(rival: Candidate, wide: Problem) -> list[tuple[float, Vector, tuple[ActiveEffect, ...]]]:
    """Every coordinate moved a little: (step, theta, effects)."""
    moved = []
    for k in range(rival.where.n):
        step = rival.where.difference(rival.x, k)
        x = rival.x.copy()
        x[k] += step
        moved.append((step, *rival.where.unpack(x)))
    return moved


def distances(
    takes: Sequence[Take], lab: Lab, candidates: Sequence[Candidate], problem: Problem, judgement: Judgement,
    pool: ThreadPoolExecutor,
) -> NDArray[np.float64] | None:  # fmt: skip
    """D_ij over ``takes``, shape (n, n): row i true, column j fitted; ``None`` where no take can be foretold."""
    tasks = [(take, i) for take in takes for i in range(len(candidates))]

    def own(task: tuple[Take, int]) -> Foretold | None:
        take, i = task
        return foretell(take, lab, candidates[i].theta, candidates[i].effects, problem)

    foretold = dict(zip(tasks, pool.map(own, tasks), strict=True))
    usable = [take for take in takes if all(foretold[take, i] is not None for i in range(len(candidates)))]
    if not usable:
        return None

    def column(task: tuple[Take, int]) -> tuple[NDArray[np.float64], dict[int, Vector]]:
        """Candidate j's Jacobian on a take, and its whitened departures from each i."""
        take, j = task
        rival, mine = candidates[j], foretold[take, j]
        assert mine is not None
        noise = planned_noise(judgement.noise, (mine.run,))
        whitener = planned_whitener(mine.run, noise, mine.outputs)
        columns = [
            whitener([b - a for a, b in zip(mine.outputs, under(mine, theta, effects, problem), strict=True)])[
                :, 0
            ]
            / step
            for step, theta, effects in _shifted(rival, problem)
        ]
        jacobian = np.stack(columns, axis=1)
        departures = {}
        for i in range(len(candidates)):
            if i == j:
                continue
            true = foretold[take, i]
            assert true is not None
            said = under(true, rival.theta, rival.effects, problem)
            seen = planned_whitener(true.run, planned_noise(judgement.noise, (true.run,)), true.outputs)
            departures[i] = seen([a - b for a, b in zip(true.outputs, said, strict=True)])[:, 0]
        return np.nan_to_num(jacobian), departures

    work = [(take, j) for take in usable for j in range(len(candidates))]
    found = dict(zip(work, pool.map(column, work), strict=True))
    n = len(candidates)
    result = np.zeros((n, n))
    for j in range(n):
        normal = candidates[j].known.copy()
        for take in usable:
            jacobian = found[take, j][0]
            normal += take.count * jacobian.T @ jacobian
        for i in range(n):
            if i == j or holds(candidates[j].names, candidates[i].names):
                continue
            whole, inner = 0.0, np.zeros(candidates[j].where.n)
            for take in usable:
                jacobian, departures = found[take, j]
                d = departures[i]
                if not np.all(np.isfinite(d)):
                    return None
                whole += take.count * float(d @ d)
                inner += take.count * jacobian.T @ d
            size = np.sqrt(np.diag(normal))
            step = np.linalg.lstsq(normal / np.outer(size, size), inner / size, rcond=1e-10)[0]
            result[i, j] = max(whole - float(step @ (inner / size)), 0.0)
    return result


def holds(names: tuple[str, ...], others: tuple[str, ...]) -> bool:
    """Whether a set can follow another one exactly: it holds all its effects, Stribeck's friction holding Coulomb's."""
    can = set(names)
    for inner, outer in CONTAINED:
        can |= {f"{inner}@{name.split('@')[1]}" for name in names if name.split("@")[0] == outer}
    return set(others) <= can


def expected_gain(probabilities: Vector, distance: NDArray[np.float64], temperature: float = TEMPERATURE) -> float:
    """sum_i p_i [P(i | x, i true) - p_i] for D_ij, shape (n, n)."""
    log_p = np.log(np.maximum(probabilities, 1e-12))
    gain = 0.0
    for i, p in enumerate(probabilities):
        logits = log_p - TRUSTED * distance[i] / (2.0 * temperature)
        weights = np.exp(logits - logits.max())
        gain += p * (weights[i] / weights.sum() - p)
    return float(gain)


def menu_of(
    problem: Problem, judgement: Judgement, decision: Decision, pool: ThreadPoolExecutor
) -> tuple[Item, ...]:
    """Every item that can be simulated with what it is expected to bring, best first; empty where none can."""
    lab = lab_of(problem)
    items: Mapping[str, tuple[Take, ...]] = planned(lab)
    if sum(r.probability >= LISTED for r in decision.ranking) < 2:
        return ()
    found = []
    for key, takes in items.items():
        theta, effects = judgement.base.fit.coordinates.unpack(judgement.base.fit.x)
        trial = [f for take in takes if (f := foretell(take, lab, theta, effects, problem)) is not None]
        if not trial:
            continue
        wide = widened(problem, trial)
        candidates = leading(decision, wide)
        distance = distances(takes, lab, candidates, wide, judgement, pool)
        if distance is None:
            continue
        p = np.array([c.probability for c in candidates])
        weight = np.outer(p, p) * distance
        i, j = np.unravel_index(int(np.argmax(weight + weight.T)), weight.shape)
        found.append(
            Item(
                key,
                expected_gain(p, distance),
                float(np.sqrt(np.sum(weight))),
                (candidates[min(i, j)].names, candidates[max(i, j)].names),
            )
        )
    return tuple(sorted(found, key=lambda item: (-round(item.expected_gain, 2), -item.distance)))
