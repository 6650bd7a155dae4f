"""From screened candidates to fitted hypotheses: singles, then pairs and triples along a beam, the base always free.

Every fit starts from its parent's optimum with the new effect at the size that the screening asked for, and again at
nearly nothing where that ends above the parent, so a child is never worse than its parent (B.2, stage 6).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.base import representative
from jointscope.diagnosis.coordinates import coordinates
from jointscope.diagnosis.effects import ActiveEffect
from jointscope.diagnosis.noise import Key, block_key
from jointscope.diagnosis.objective import Objective
from jointscope.diagnosis.refit import Fit, least_squares
from jointscope.diagnosis.screen import (
    Trial,
    best_per_spec,
    pair_gains,
    refined,
    resized,
    screen,
    tangent,
    trial_effects,
)

if TYPE_CHECKING:
    from jointscope.diagnosis.effects import EffectSpec
    from jointscope.diagnosis.prepare import Problem

Vector = NDArray[np.float64]

NEARLY_NOTHING = 0.02  # of the amplitude the screening asked for: the safe start


@dataclass(frozen=True, kw_only=True)
class Effort:
    """How much is tried; counts, never seconds, so that the answer does not depend on the machine.

    Attributes:
        screen_runs: Runs per experiment in the screening.
        singles: Single effects fitted.
        refine: Candidates whose screening is repeated at their own amplitude.
        beam: Parents extended per round.
        children: Extensions fitted per parent.
        pairs: Pairs fitted that neither member alone would lead to.
        size: Effects in a hypothesis at most.
        fit_simulations: Evaluations per fit at most.
        worth: Decrease of w'w below which a candidate is not fitted.
    """

    screen_runs: int = 4
    singles: int = 8
    refine: int = 24
    beam: int = 2
    children: int = 4
    pairs: int = 3
    size: int = 3
    fit_simulations: int = 45
    worth: float = 8.0


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """A fitted set of effects.

    Attributes:
        names: ``effect@location``, sorted.
        loss: Profile log likelihood under unknown noise level per block, negative; smaller is better.
    """

    specs: tuple[EffectSpec, ...]
    fit: Fit
    loss: float

    @property
    def names(self) -> tuple[str, ...]:
        """``effect@location`` of each effect, sorted, without repeats."""
        return names_of(self.specs)


def name_of(spec: EffectSpec) -> str:
    """``effect@location``."""
    return f"{spec.name}@{spec.location}"


def names_of(specs: Iterable[EffectSpec]) -> tuple[str, ...]:
    """Sorted names without repeats."""
    return tuple(sorted({name_of(s) for s in specs}))


def block_energies(objective: Objective, w: Vector) -> dict[Key, tuple[float, int]]:
    """w'w and number of samples of every kind of channel."""
    energies: dict[Key, tuple[float, int]] = {}
    position = 0
    for run, whitener in zip(objective.prepared, objective.whiteners, strict=True):
        for output, size in zip(run.outputs, whitener.sizes, strict=True):
            part = w[position : position + size]
            known = energies.get(block_key(run, output), (0.0, 0))
            energies[block_key(run, output)] = (known[0] + float(part @ part), known[1] + size)
            position += size
    return energies


def profile_loss(objective: Objective, w: Vector) -> float:
    """sum_b N_b / 2 ln(E_b / N_b): minus the log likelihood with every block's noise level at its best."""
    return float(sum(0.5 * n * np.log(max(e, 1e-12) / n) for e, n in block_energies(objective, w).values() if n))


def fit_child(objective: Objective, parent: Fit, actives: Sequence[ActiveEffect], effort: Effort) -> Fit:
    """Fit the parent's effects plus ``actives``, base free, starting from the parent's optimum."""
    specs = (*parent.coordinates.effects, *(a.spec for a in actives))
    where = coordinates(objective.problem, specs)
    theta, effects = parent.coordinates.unpack(parent.x)
    best: Fit | None = None
    for factor in (1.0, NEARLY_NOTHING):
        added = tuple(a if factor == 1.0 else resized(a, factor) for a in actives)
        x = where.pack(theta, (*effects, *added))
        w = objective.residual(x, where)
        new = range(parent.coordinates.n, where.n)
        jacobian = np.concatenate([parent.jacobian, objective.columns(x, where, w, new)], axis=1)
        fit = least_squares(
            objective,
            where,
            x,
            jacobian=jacobian,
            iterations=14,
            tolerance=3e-3,
            simulations=effort.fit_simulations,
        )
        if best is None or fit.chi2 < best.chi2:
            best = fit
        if best.chi2 < parent.chi2:
            break
    assert best is not None
    return best


@dataclass(frozen=True, eq=False)
class Screening:
    """Trials on top of one parent, over a few runs of every experiment, best first."""

    trials: tuple[Trial, ...]
    w: Vector


def screen_on(objective: Objective, parent: Fit, candidates: Sequence[ActiveEffect], effort: Effort) -> Screening:
    """Score every candidate on top of ``parent``, the leading ones again at their own amplitude."""
    chosen = representative(objective.problem, objective.runs, effort.screen_runs)
    positions = [i for i, run in enumerate(objective.runs) if run in chosen]
    few, rows = objective.restricted(positions), objective.rows(positions)
    parents = tangent(parent.w[rows], parent.jacobian[rows])
    trials = best_per_spec(screen(few, parent, parents, parent.w[rows], candidates))
    leading, rest = trials[: effort.refine], trials[effort.refine :]
    leading = refined(few, parent, parents, parent.w[rows], leading)
    return Screening((*leading, *rest), parents.w)


def leaders(trials: Sequence[Trial], count: int, worth: float, taken: tuple[str, ...] = ()) -> list[Trial]:
    """The best trials of distinct names (two laws of one name at most), leaving out names that are taken."""
    seen: dict[str, int] = {}
    found: list[Trial] = []
    for trial in trials:
        name = name_of(trial.spec)
        if trial.gain < worth or name in taken or seen.get(name, 0) >= 2:
            continue
        if seen.get(name, 0) == 1 and len(found) > count // 2:
            continue
        seen[name] = seen.get(name, 0) + 1
        found.append(trial)
        if len(found) == count:
            break
    return found


def at_own_size(trial: Trial) -> ActiveEffect:
    """The effect at the amplitude its screening asked for, within reach."""
    if trial.factor <= 0.0:
        return resized(trial.active, trial.factor if trial.factor < 0 else NEARLY_NOTHING)
    return resized(trial.active, float(np.clip(trial.factor, 0.05, 2.0)))


def fit_singles(objective: Objective, base: Fit, screening: Screening, effort: Effort) -> list[Hypothesis]:
    """Fit the leading single effects."""
    found = []
    for trial in leaders(screening.trials, effort.singles, effort.worth):
        fit = fit_child(objective, base, [at_own_size(trial)], effort)
        found.append(Hypothesis((trial.spec,), fit, profile_loss(objective, fit.w)))
    return sorted(found, key=lambda h: h.loss)


def fit_pairs(
    objective: Objective, base: Fit, screening: Screening, known: Sequence[tuple[str, ...]], effort: Effort
) -> list[Hypothesis]:
    """Fit the pairs that explain most to first order and are not reached from the leading singles."""
    leading = list(screening.trials[: effort.refine])
    found: list[Hypothesis] = []
    seen = set(known)
    for gain, i, j in pair_gains(leading, screening.w):
        names = names_of((leading[i].spec, leading[j].spec))
        if len(found) == effort.pairs or gain < effort.worth:
            break
        if names in seen or len(names) < 2:
            continue
        seen.add(names)
        fit = fit_child(objective, base, [at_own_size(leading[i]), at_own_size(leading[j])], effort)
        found.append(Hypothesis((leading[i].spec, leading[j].spec), fit, profile_loss(objective, fit.w)))
    return found


def extend(
    objective: Objective, parent: Hypothesis, candidates: Sequence[ActiveEffect], effort: Effort
) -> list[Hypothesis]:
    """Fit the parent's best extensions by one effect."""
    screening = screen_on(objective, parent.fit, candidates, effort)
    found = []
    for trial in leaders(screening.trials, effort.children, effort.worth, taken=parent.names):
        fit = fit_child(objective, parent.fit, [at_own_size(trial)], effort)
        found.append(Hypothesis((*parent.specs, trial.spec), fit, profile_loss(objective, fit.w)))
    return sorted(found, key=lambda h: h.loss)


def candidates_for(problem: Problem, specs: Sequence[EffectSpec]) -> list[ActiveEffect]:
    """Every trial of every effect that these channels and experiments can show."""
    return [
        active for spec in specs if spec.possible(problem) is None for active in trial_effects(spec, problem)
    ]
