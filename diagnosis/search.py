"""From screened candidates to fitted hypotheses: singles, then pairs and triples along a beam, the base always free.

Every fit starts from its parent's optimum with the new effect at the size that the screening asked for, and again at
nearly nothing where that ends above the parent, so a child is never worse than its parent (B.2, stage 6).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.base import representative
from jointscope.diagnosis.coordinates import Coordinates, coordinates
from jointscope.diagnosis.effects import ActiveEffect
from jointscope.diagnosis.noise import Key, block_key
from jointscope.diagnosis.objective import Objective
from jointscope.diagnosis.refit import Fit, least_squares, unspent
from jointscope.diagnosis.screen import (
    Tangent,
    Trial,
    best_per_spec,
    pairs,
    refined,
    resized,
    screen,
    tangent,
)

if TYPE_CHECKING:
    from jointscope.diagnosis.effects import EffectSpec

Vector = NDArray[np.float64]

CONTAINED = (("coulomb-friction", "stribeck-friction"),)
TOGETHER = 1.2  # times what its members explain alone, that a pair explains which no search from either would meet
ABOUT_RIGHT = (0.5, 2.0)  # of a trial's size, asked for by its own screening
KEEPS_UP = (
    0.3  # of what the best set of as many effects explains; what is fitted slowly and explains less is left there
)
NEARLY_NOTHING = 0.02  # of the amplitude the screening asked for: the safe start


@dataclass(frozen=True, kw_only=True)
class Effort:
    """How much is tried; counts, never seconds, so that the answer does not depend on the machine.

    Attributes:
        screen_hits, screen_others: Runs of the hammer and of any other experiment in the first screening.
        hits, others: The same in the search; judging uses all.
        singles: Single effects fitted.
        refine: Candidates whose screening is repeated at their own amplitude.
        beam: Parents extended per round.
        children: Extensions fitted per parent.
        pairs: Pairs fitted that neither member alone would lead to.
        size: Effects in a hypothesis at most.
        fit_simulations: Evaluations per fit at most.
        polished: Leading hypotheses refitted under a new noise model.
        worth: Decrease of w'w below which a candidate is not fitted.
        brief: Whether long and finely stepped runs are searched in less of them (:mod:`jointscope.diagnosis.briefly`).
    """

    screen_hits: int = 3
    screen_others: int = 1
    hits: int = 5
    others: int = 2
    singles: int = 12
    refine: int = 24
    beam: int = 2
    children: int = 2
    pairs: int = 2
    size: int = 3
    fit_simulations: int = 36
    polished: int = 3
    worth: float = 10.0
    brief: bool = True


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
    def sensible(self) -> bool:
        """Whether every effect's numbers are such as its name has."""
        return all(a.spec.sensible(a.values) for a in self.fit.coordinates.unpack(self.fit.x)[1])

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


def fit_child(
    objective: Objective,
    parent: Fit,
    actives: Sequence[ActiveEffect],
    effort: Effort,
    other_bases: Sequence[Vector] = (),
    reach: float = math.inf,
) -> Fit | None:
    """Fit the parent's effects plus ``actives``, base free; ``None`` where that ends no better than the parent.

    Args:
        other_bases: Base parameter vectors beside the parent's from which to start, whichever is nearer the data:
            look-alikes shift the base alike.
        reach: Loss beyond which the fit is of no use: one that will not come within it is left where it is.
    """
    specs = (*parent.coordinates.effects, *(a.spec for a in actives))
    where = coordinates(objective.problem, specs)
    theta, effects = parent.coordinates.unpack(parent.x)
    starts = [where.pack(base, (*effects, *actives)) for base in (theta, *other_bases)]
    starts.extend(
        where.pack(base, (*effects, *actives[:k], ActiveEffect(active.spec, values), *actives[k + 1 :]))
        for k, active in enumerate(actives)
        if active.spec.instead is not None
        for base, values in active.spec.instead(theta)
    )
    starts.append(where.pack(theta, (*effects, *(resized(a, NEARLY_NOTHING) for a in actives))))
    residuals = [objective.residual(x, where) for x in starts]
    order = np.argsort([float(w @ w) for w in residuals], kind="stable")
    best: Fit | None = None
    for i in order[:2]:
        new = objective.columns(starts[i], where, residuals[i], range(parent.coordinates.n, where.n))
        jacobian = np.concatenate([parent.jacobian, new], axis=1)
        start = starts[i]
        held = with_orders_held(where, start, parent.coordinates.n)
        if held is not where:
            there = least_squares(
                objective, held, start, jacobian=jacobian, iterations=5, tolerance=1e-2,
                simulations=effort.fit_simulations // 2,
            )  # fmt: skip
            start, jacobian = there.x, there.jacobian
        fit = least_squares(
            objective,
            where,
            start,
            jacobian=jacobian,
            iterations=14,
            tolerance=3e-3,
            simulations=effort.fit_simulations,
            behind=None if reach == math.inf else lambda w: profile_loss(objective, w) - reach,
        )
        if fit.chi2 < (parent if best is None else best).chi2:
            best = fit
        if best is not None and (i < len(starts) - 1 or not other_bases):
            break  # from nearly nothing, where other effects and bases were at hand, is no more than a second best
    return best


def with_orders_held(where: Coordinates, x: Vector, new: int) -> Coordinates:
    """Bounds that keep the orders of effects from ``new`` on where ``x`` has them; ``where`` itself without any.

    A line's order slides off to another valley while its amplitude and phase are still to be found.
    """
    fixed = [
        position + k
        for spec, position in zip(where.effects, (s.start for s in where.effect_slices()), strict=True)
        if position >= new
        for k, parameter in enumerate(spec.parameters)
        if parameter.name == "order"
    ]
    return held_at(where, x, fixed) if fixed else where


def held_at(where: Coordinates, x: Vector, positions: Sequence[int]) -> Coordinates:
    """Bounds that keep the coordinates at ``positions`` where ``x`` has them."""
    lower, upper = where.lower.copy(), where.upper.copy()
    lower[positions] = upper[positions] = x[positions]
    return replace(where, lower=lower, upper=upper)


@dataclass(frozen=True, eq=False)
class Screening:
    """Trials on top of the base.

    Attributes:
        leading: One per candidate law, retaken at its own amplitude over the arena's runs, best first.
        trials: Every trial that was simulated, over ``positions`` of the arena's runs, in the order of the candidates.
        objective: Those runs under the noise of that time.
        w: P w of the base over the arena's runs.
        w_few: The same over ``positions``.
    """

    leading: tuple[Trial, ...]
    trials: tuple[Trial, ...]
    positions: tuple[int, ...]
    objective: Objective
    w: Vector
    w_few: Vector


def weightings(candidates: Sequence[ActiveEffect]) -> list[tuple[float, ...]]:
    """The weights of the runs that candidates act in by their own, each shape (n_runs,), without repeats."""
    return list(dict.fromkeys(a.spec.run_weights for a in candidates if a.spec.run_weights is not None))


def seen(objective: Objective, hypothesis: Hypothesis) -> Hypothesis:
    """The hypothesis as it stands under the noise of ``objective``, its loss comparable with what was fitted there."""
    w = objective.residual(hypothesis.fit.x, hypothesis.fit.coordinates)
    return replace(hypothesis, fit=replace(hypothesis.fit, w=w, fresh=False), loss=profile_loss(objective, w))


def screen_on(objective: Objective, parent: Fit, candidates: Sequence[ActiveEffect], effort: Effort) -> Screening:
    """Score every candidate on top of ``parent`` over a few runs, the leading ones over all at their own amplitude."""
    chosen = representative(
        objective.problem, objective.runs, effort.screen_hits, effort.screen_others, weightings(candidates)
    )
    positions = tuple(i for i, run in enumerate(objective.runs) if run in chosen)
    few, rows = objective.restricted(positions), objective.rows(positions)
    parents_few = tangent(parent.w[rows], unspent(parent)[rows])
    trials = screen(few, parent, parents_few, parent.w[rows], candidates)
    leading, parents = over_all_runs(objective, parent, trials, effort)
    return Screening(tuple(leading), tuple(trials), positions, few, parents.w, parents_few.w)


def over_all_runs(
    objective: Objective, parent: Fit, trials: Sequence[Trial], effort: Effort
) -> tuple[list[Trial], Tangent]:
    """The leading ones of ``trials`` over all runs of ``objective`` at their own amplitude, one per law, best first."""
    parents = tangent(parent.w, unspent(parent))
    best = [t.active for t in best_per_spec(trials)[: effort.refine]]
    again = best_per_spec(screen(objective, parent, parents, parent.w, best))
    return refined(objective, parent, parents, parent.w, again), parents


def keeps_up(loss: float, parent: float, best: float) -> bool:
    """Whether a fit begun explains enough, beside the best that is known, to be gone on with (all three losses)."""
    return parent - loss > KEEPS_UP * (parent - best)


def nested(name: str, taken: tuple[str, ...]) -> bool:
    """Whether an effect is a part of one that is there already, or holds it: Coulomb's law within Stribeck's."""
    effect, _, place = name.partition("@")
    others = (outer if effect == inner else inner for inner, outer in CONTAINED if effect in (inner, outer))
    return any(f"{other}@{place}" in taken for other in others)


def leaders(trials: Sequence[Trial], count: int, worth: float, taken: tuple[str, ...] = ()) -> list[Trial]:
    """The best trials of distinct names (two laws of one name at most), leaving out names that are taken."""
    seen: dict[str, int] = {}
    found: list[Trial] = []
    for trial in trials:
        name = name_of(trial.spec)
        if trial.gain < worth or name in taken or seen.get(name, 0) >= 2:
            continue
        if seen.get(name, 0) == 1 and len(found) >= count // 2:
            continue
        seen[name] = seen.get(name, 0) + 1
        found.append(trial)
        if len(found) == count:
            break
    return found


def at_own_size(trial: Trial) -> ActiveEffect:
    """The effect at the amplitude its screening asked for, within reach; a frequency that is about right stays.

    To first order in its compliance a narrow resonance is anywhere.
    """
    parameter = trial.spec.parameters[trial.spec.amplitude]
    if parameter.name == "frequency" and ABOUT_RIGHT[0] < trial.factor < ABOUT_RIGHT[1]:
        return trial.active
    if trial.factor <= 0.0:
        return resized(trial.active, trial.factor if trial.factor < 0 else NEARLY_NOTHING)
    return resized(trial.active, float(np.clip(trial.factor, 0.05, 2.0)))


def fit_singles(objective: Objective, base: Fit, screening: Screening, effort: Effort) -> list[Hypothesis]:
    """Fit the leading single effects; modes of a frequency of their own are laid out by ``resonances``."""
    trials = [t for t in screening.leading if not t.spec.of_own_frequency]
    return fit_leading(objective, base, (), leaders(trials, effort.singles, effort.worth), effort)


def fit_instead(
    objective: Objective,
    parent: Fit,
    specs: tuple[EffectSpec, ...],
    screening: Screening,
    known: Sequence[Hypothesis],
    effort: Effort,
) -> list[Hypothesis]:
    """Fit what stands for a part of the base, wherever a test to first order, at a base that is full of it, put it.

    Args:
        parent: The base's fit, or one with effects that obey ``specs``.
        known: Fits with whose laws this need not be tried again.
    """
    fitted = {id(spec) for h in known for spec in h.specs}
    names = names_of(specs)
    trials = [t for t in screening.trials if t.spec.instead is not None and id(t.spec) not in fitted]
    trials = [t for t in trials if name_of(t.spec) not in names]
    return fit_leading(objective, parent, specs, best_per_spec(trials), effort)


def fit_leading(
    objective: Objective, parent: Fit, specs: tuple[EffectSpec, ...], trials: Sequence[Trial], effort: Effort
) -> list[Hypothesis]:
    """Fit every trial on top of the parent, whose effects obey ``specs``."""
    found: list[Hypothesis] = []
    for trial in trials:
        best = min(found, key=lambda h: h.loss, default=None)
        others = [best.fit.coordinates.unpack(best.fit.x)[0]] if best is not None else []
        fit = fit_child(objective, parent, [at_own_size(trial)], effort, others)
        if fit is not None:
            found.append(Hypothesis((*specs, trial.spec), fit, profile_loss(objective, fit.w)))
    return sorted(found, key=lambda h: h.loss)


def fit_pairs(
    objective: Objective, base: Fit, screening: Screening, known: Sequence[tuple[str, ...]], effort: Effort
) -> list[Hypothesis]:
    """Fit the pairs that explain most to first order and are not reached from the leading singles.

    Among the leading candidates, and among all those that undo each other: each may explain nothing alone.
    """
    found: list[Hypothesis] = []
    seen = set(known)
    everything = best_per_spec(screening.trials)
    alone = max((trial.gain for trial in everything), default=0.0)
    undoing = [
        pair
        for pair in pairs(everything, screening.w_few)
        if pair.gain > max(alone, TOGETHER * sum(trial.gain for trial in pair.trials))
    ]
    for pool in (pairs(screening.leading[: effort.refine], screening.w), undoing):
        tried = 0
        for pair in pool:
            specs = tuple(trial.spec for trial in pair.trials)
            names = names_of(specs)
            if tried == effort.pairs or pair.gain < effort.worth:
                break
            if names in seen or len(names) < 2 or nested(names[0], names[1:]):
                continue
            seen.add(names)
            tried += 1
            fit = fit_child(objective, base, [at_own_size(trial) for trial in pair.trials], effort)
            if fit is not None:
                found.append(Hypothesis(specs, fit, profile_loss(objective, fit.w)))
    return found
