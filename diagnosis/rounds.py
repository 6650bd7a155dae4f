"""The rounds of the search: singles, then sets of two and three, each round under the noise its best hypothesis leaves.

A mismatch that stands in the residual looks like noise. So after every round the noise is estimated anew from the best
hypothesis, the leading ones are refitted under it, and only then are parents chosen.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.adjudicate import PROFILED, profiled
from jointscope.diagnosis.afresh import afresh, sorted_afresh
from jointscope.diagnosis.anchors import beside_other_laws
from jointscope.diagnosis.base import EARLY_ORDER, Stage, representative, rewhiten
from jointscope.diagnosis.bent_loop import bent_loop
from jointscope.diagnosis.briefly import briefly
from jointscope.diagnosis.by_posture import by_posture
from jointscope.diagnosis.candidates import candidates_for, residuals_of
from jointscope.diagnosis.carriers import carriers
from jointscope.diagnosis.eased import eased
from jointscope.diagnosis.effects.coupled import PLAIN
from jointscope.diagnosis.energies import error_energies, improvement
from jointscope.diagnosis.extensions import extensions
from jointscope.diagnosis.far_modes import far_modes
from jointscope.diagnosis.gain_or_weight import gain_or_weight
from jointscope.diagnosis.gates import MATERIAL
from jointscope.diagnosis.heavy_modes import heavy_modes
from jointscope.diagnosis.loops import loops
from jointscope.diagnosis.modal import several_bends
from jointscope.diagnosis.modes_apart import modes_apart
from jointscope.diagnosis.noise import MAX_ORDER, NoiseModel
from jointscope.diagnosis.objective import Objective, Predictions
from jointscope.diagnosis.other_base import from_other_base
from jointscope.diagnosis.overshot import overshot
from jointscope.diagnosis.per_run import labelling_cost, per_run_specs
from jointscope.diagnosis.polish import beside_the_data, worth_judging
from jointscope.diagnosis.rattling import beside_bent_spring, may_rattle
from jointscope.diagnosis.refit import least_squares
from jointscope.diagnosis.rescaled import rescaled
from jointscope.diagnosis.resonances import resonances, resonances_beside
from jointscope.diagnosis.ring_downs import ring_downs
from jointscope.diagnosis.rivals import BEHIND, Laws, contained, grown, laws_of, reshaped, rivals, strangers
from jointscope.diagnosis.search import (
    Effort,
    Hypothesis,
    Screening,
    fit_instead,
    fit_pairs,
    fit_singles,
    name_of,
    nested,
    profile_loss,
    screen_on,
    seen,
    weightings,
)
from jointscope.diagnosis.uncoupling import as_mounts, bends_beside, in_own_terms

if TYPE_CHECKING:
    from jointscope.diagnosis.effects import ActiveEffect, EffectSpec

Vector = NDArray[np.float64]
Report = Callable[[str], None]

BEYOND = 2  # leading single effects that are started from beyond themselves
SWAPS = 3  # times that look-alikes are tried in the place of a pair's members, while that changes its laws
HOPES = 6  # effects, the first law of each, of which one must be worth building upon
LOOKS_ALIKE = 0.02  # of what the leading pair gains, within which a pair that shares one effect with it is tried in all forms
PROMISING = 5.0  # nats per added parameter below which a round's best is not built upon


@dataclass(frozen=True, eq=False)
class Arena:
    """The runs of the search under one noise model, and what was fitted to them.

    Attributes:
        base: The base refitted here; its ``names`` are empty.
        hypotheses: Sorted by loss, comparable with each other and the base.
    """

    objective: Objective
    noise: NoiseModel
    base: Hypothesis
    hypotheses: tuple[Hypothesis, ...]


def opened(stage: Stage, candidates: Sequence[ActiveEffect], effort: Effort) -> Arena:
    """The arena on a few runs of every kind, and on runs that ``candidates`` tell apart; the base refitted to them."""
    problem, fitted = stage.objective.problem, stage.objective.runs
    runs = representative(problem, fitted, effort.hits, effort.others, weightings(candidates))
    positions = [i for i, run in enumerate(stage.objective.runs) if run in runs]
    objective, noise, jacobian = _in_brief(stage, positions, effort)
    fit = least_squares(
        objective,
        stage.fit.coordinates,
        stage.fit.x,
        jacobian=jacobian,
        iterations=6,
        tolerance=1e-3,
    )
    return Arena(objective, noise, Hypothesis((), fit, profile_loss(objective, fit.w)), ())


def _in_brief(
    stage: Stage, positions: Sequence[int], effort: Effort
) -> tuple[Objective, NoiseModel, NDArray[np.float64] | None]:
    """The runs at ``positions`` as the search takes them, their noise, and the base's slopes where they are known."""
    objective = stage.objective.restricted(positions)
    runs = list(objective.problem.runs)
    for i in objective.runs if effort.brief else ():
        runs[i] = briefly(runs[i], objective.problem.scales.frequency)
    if all(new is old for new, old in zip(runs, objective.problem.runs, strict=True)):
        return objective, stage.noise, stage.fit.jacobian[stage.objective.rows(positions)]
    cut = replace(objective, problem=replace(objective.problem, runs=tuple(runs)))
    cut, noise, _ = rewhiten(cut, stage.fit, stage.noise, EARLY_ORDER)
    return cut, noise, None


def _refitted(objective: Objective, hypothesis: Hypothesis) -> Hypothesis:
    fit = least_squares(
        objective, hypothesis.fit.coordinates, hypothesis.fit.x, iterations=6, tolerance=2e-3, simulations=40
    )
    return replace(hypothesis, fit=fit, loss=profile_loss(objective, fit.w))


def settled(arena: Arena, found: Sequence[Hypothesis], effort: Effort) -> Arena:
    """All hypotheses under the noise of the best, the leading ones refitted; once more if that changes the best."""
    objective, noise, base = arena.objective, arena.noise, arena.base
    pool = sorted([*arena.hypotheses, *found], key=lambda h: h.loss)
    for _ in range(2):
        best = min([base, *pool], key=lambda h: h.loss)
        objective, noise, _ = rewhiten(objective, best.fit, noise, EARLY_ORDER)
        pool = sorted((seen(objective, h) for h in pool), key=lambda h: h.loss)
        pool = [_refitted(objective, h) if i < effort.polished else h for i, h in enumerate(pool)]
        pool.sort(key=lambda h: h.loss)
        base = seen(objective, base)
        if not pool or pool[0].names == best.names:
            break
    return Arena(objective, noise, beside_the_data(objective, base, _refitted(objective, base)), tuple(pool))


def promising(arena: Arena, child: Hypothesis, *parents: Hypothesis) -> bool:
    """Whether a child is worth building upon: more than its parameters cost beyond each parent, and enough to matter."""
    if any(parent.loss - child.loss < PROMISING * _added(child, parent) for parent in parents):
        return False
    coloured, _, after = rewhiten(arena.objective, child.fit, arena.noise, MAX_ORDER)
    return all(_promising(arena, child, parent, coloured, after) for parent in parents)


def _added(child: Hypothesis, parent: Hypothesis) -> int:
    return max(child.fit.coordinates.n - parent.fit.coordinates.n, 1)


def _promising(
    arena: Arena, child: Hypothesis, parent: Hypothesis, coloured: Objective, after: Predictions
) -> bool:
    """The same over one parent, under the noise that the child leaves."""
    before = arena.objective.predictions(*parent.fit.coordinates.unpack(parent.fit.x))
    gain = PROFILED * len(coloured.runs) * (profiled(parent) - profiled(child))
    gain -= sum(labelling_cost(spec) for spec in child.specs) - sum(labelling_cost(spec) for spec in parent.specs)
    for i in range(len(coloured.runs)):
        old, new = coloured.whiten_run(i, before[i]), coloured.whiten_run(i, after[i])
        gain += 0.5 * float(old @ old - new @ new)
    runs = arena.objective.prepared
    parents, children = (error_energies(runs, y, coloured.whiteners) for y in (before, after))
    material, _, _ = improvement(parents, parents, children, {})
    return gain > PROMISING * _added(child, parent) and material > MATERIAL


def _first_of_each(arena: Arena) -> list[Hypothesis]:
    """The best law of every name, best first: forms of one effect may all be what the noise's colour explains as well."""
    first = {h.names: h for h in reversed(arena.hypotheses)}
    return sorted(first.values(), key=lambda h: h.loss)


def _to_grow(arena: Arena, count: int, grown_already: Sequence[Hypothesis] = ()) -> list[Hypothesis]:
    """The leading single effects, and the best law of each other name that is not far behind the first."""
    singles = [h for h in arena.hypotheses if len(h.specs) == 1]
    first = {h.names: h for h in reversed(singles)}
    near = singles[0].loss + BEHIND * (arena.base.loss - singles[0].loss) if singles else 0.0
    named = {h.names for h in singles[:count]}
    chosen = [*singles[:count], *(h for names, h in first.items() if names not in named and h.loss < near)]
    done = {id(spec) for h in grown_already for spec in h.specs}
    return [h for h in chosen if id(h.specs[0]) not in done]


def _parents(arena: Arena, count: int) -> list[Hypothesis]:
    """The leading sets that find partners of their own: other laws of a name, or one that it contains, find the same."""
    found: dict[tuple[str, ...], Hypothesis] = {}
    for h in sorted(arena.hypotheses, key=lambda h: h.loss):
        if not any(_same_partners(h.names, names) for names in found):
            found[h.names] = h
    return list(found.values())[:count]


def _same_partners(one: tuple[str, ...], other: tuple[str, ...]) -> bool:
    apart = sorted(set(one) ^ set(other))
    return not apart or (len(apart) == 2 and len(one) == len(other) and nested(apart[0], (apart[1],)))


def _losses(arena: Arena) -> dict[tuple[str, ...], float]:
    """Loss of the best fit of every set that has the leading set's own laws of what both hold."""
    leader = arena.hypotheses[0]
    own = {name_of(spec): spec for spec in leader.specs}
    alike = (h for h in reversed(arena.hypotheses) if all(own.get(name_of(s), s) is s for s in h.specs))
    return {h.names: h.loss for h in alike}


def _worth_more(arena: Arena, size: int) -> bool:
    """Whether a set of ``size`` leads, and is worth more than every part of it: a stand-in for two is not looked into."""
    best = arena.hypotheses[0]
    parts = [h for h in arena.hypotheses if set(h.names) < set(best.names)]
    return len(best.names) >= size and (not parts or promising(arena, best, *parts))


def _swapped(arena: Arena, candidates: Sequence[ActiveEffect], effort: Effort) -> Arena:
    """Each member of the leading pair may have stood in for its look-alike, and that may let the other one be told."""
    tried: frozenset[Laws] = frozenset()
    for _ in range(SWAPS):
        leader, known = arena.hypotheses[0], _losses(arena)
        if len(leader.names) != 2:
            break
        found = rivals(arena.objective, arena.base.fit, leader, candidates, known, effort, tried)
        found.extend(grown(arena.objective, arena.base.fit, leader, candidates, effort, tried))
        found.extend(
            reshaped(arena.objective, arena.base.fit, leader, candidates, arena.hypotheses, effort, tried)
        )
        found.extend(contained(arena.objective, arena.base.fit, leader, candidates, known, effort))
        if not found:
            break
        tried = tried.union(laws_of(h.specs) for h in found)
        arena = settled(arena, found, effort)
        if arena.hypotheses[0].specs == leader.specs:
            break
    return _rival_reshaped(arena, candidates, effort)


def _rival_reshaped(arena: Arena, candidates: Sequence[ActiveEffect], effort: Effort) -> Arena:
    """With the other laws of what the nearest other pair has in place of one of the leader's effects.

    The leader's own laws have all been tried: a look-alike in its first form only would lose to them by its form.
    """
    leader = arena.hypotheses[0]
    reach = leader.loss + LOOKS_ALIKE * (arena.base.loss - leader.loss)
    pairs = [h for h in arena.hypotheses[1:] if len(h.names) == 2 and h.loss < reach]
    rival = next((h for h in pairs if len(set(h.names) & set(leader.names)) == 1), None)
    if rival is None or len(leader.names) != 2:
        return arena
    own = [c for c in candidates if name_of(c.spec) in rival.names and name_of(c.spec) not in leader.names]
    found = reshaped(arena.objective, arena.base.fit, rival, own, arena.hypotheses, effort)
    return settled(arena, found, effort) if found else arena


def _uncoupled(arena: Arena) -> Arena:
    own = in_own_terms(arena.objective, arena.hypotheses)
    own.extend(as_mounts(arena.objective, own))
    return replace(arena, hypotheses=tuple(sorted(own, key=lambda h: h.loss)))


def _with_strangers(
    arena: Arena,
    starts: Sequence[Arena],
    outside: Sequence[EffectSpec],
    effort: Effort,
    more: Sequence[ActiveEffect],
) -> Arena:
    """All hypotheses, and what physics outside the contract's table does in place of the leading one.

    Under the noise that a leader leaves the base is so far off that its hits' gains seem free, and a law fitted from it
    runs away with the inertia; so there each is also fitted under the noise that the search began with.

    Args:
        starts: Under whose noise, and from whose base, each is fitted.
        more: Trials of theirs that the runs' own numbers gave.
    """
    if not arena.hypotheses or not outside:
        return arena
    leader = arena.hypotheses[0]
    found: list[Hypothesis] = []
    for start in starts:
        fitted = strangers(start.objective, start.base.fit, leader, outside, effort, more)
        found.extend(fitted if start is arena else (seen(arena.objective, h) for h in fitted))
    return settled(arena, found, effort) if found else arena


def explore(
    stage: Stage,
    specs: Sequence[EffectSpec],
    effort: Effort,
    report: Report,
    outside: Sequence[EffectSpec] = (),
) -> tuple[Screening, tuple[Hypothesis, ...]]:
    """Every hypothesis worth judging.

    Args:
        specs: The laws that may be named.
        outside: Laws that may only lead: physics outside the contract's table, where the forward model knows any.
    """
    problem = stage.objective.problem
    left = residuals_of(stage.objective, stage.predictions)
    own = (*per_run_specs(stage, problem), *several_bends(stage, left))
    more = by_posture(stage, outside)
    candidates = candidates_for(problem, (*specs, *own), left)
    laws = list({id(a.spec): a.spec for a in candidates}.values())
    first = opened(stage, candidates, effort)
    report(f"screening {len(candidates)} trials of {len(specs)} candidate laws")
    screening = screen_on(first.objective, first.base.fit, candidates, effort)
    report("fitting single effects")
    singles = fit_singles(first.objective, first.base.fit, screening, effort)
    singles.extend(fit_instead(first.objective, first.base.fit, (), screening, singles, effort))
    singles.extend(afresh(first.objective, first.base.fit, candidates, effort))
    singles.extend(from_other_base(stage, first.objective, first.noise, first.base.fit, laws, effort))
    singles.extend(sorted_afresh(stage, first.objective, own))
    singles.extend(resonances(first.objective, first.base.fit, candidates))
    singles.extend(far_modes(stage, first.objective, first.base.fit, candidates))
    singles.extend(modes_apart(first.objective, first.base.fit, candidates, problem, left, effort))
    singles.extend(carriers(stage, first.objective, laws))
    bends = any(spec.variant == PLAIN.variant for spec in specs)
    if bends:
        singles.extend(bends_beside(first.objective, first.base, effort))
    pairs: list[Hypothesis] = []
    arena = settled(first, singles, effort)
    softer = eased(arena.objective, arena.hypotheses)
    if softer:
        arena = settled(arena, softer, effort)
    if not any(promising(arena, s, arena.base) for s in _first_of_each(arena)[:HOPES]):
        return screening, _with_strangers(_uncoupled(arena), (first,), outside, effort, more).hypotheses
    further = overshot(arena.objective, arena.hypotheses[:BEYOND])
    further.extend(loops(stage, arena.objective, arena.base, arena.hypotheses, specs))
    further.extend(heavy_modes(first.objective, first.base.fit, candidates))
    if may_rattle(arena):
        further.extend(ring_downs(stage, first.objective, first.base.fit, specs))
    if further:
        arena = settled(arena, further, effort)
    known = _losses(arena)
    alike = rivals(arena.objective, arena.base.fit, arena.hypotheses[0], candidates, known, effort)
    leaders = _to_grow(arena, effort.beam + 1)
    wider = [h for leader in leaders for h in grown(arena.objective, arena.base.fit, leader, candidates, effort)]
    alike.extend(wider)
    alike.extend(
        reshaped(arena.objective, arena.base.fit, arena.hypotheses[0], candidates, arena.hypotheses, effort)
    )
    if alike:
        arena = settled(arena, alike, effort)
    later = _to_grow(arena, 1, [*leaders, *wider])  # a look-alike of the first may have led to it
    found = [h for leader in later for h in grown(arena.objective, arena.base.fit, leader, candidates, effort)]
    found.extend(rescaled(arena.objective, arena.hypotheses[:BEYOND]))
    found.extend(gain_or_weight(arena.objective, arena.hypotheses[:BEYOND], candidates))
    if found:
        arena = settled(arena, found, effort)
    pairs.extend(
        contained(arena.objective, arena.base.fit, arena.hypotheses[0], candidates, _losses(arena), effort)
    )
    report("fitting pairs")
    for k, parent in enumerate(_parents(arena, effort.beam)):
        beside = extensions(arena.objective, arena.base.fit, parent, laws, screening, effort)
        if k == 0:
            beside.extend(fit_instead(arena.objective, parent.fit, parent.specs, screening, beside, effort))
            beside.extend(resonances_beside(arena.objective, parent, candidates))
        pairs.extend(beside)
        if bends:
            pairs.extend(bends_beside(arena.objective, parent, effort))
        best = min((h.loss for h in beside), default=parent.loss)
        pairs.extend(heavy_modes(arena.objective, parent.fit, candidates, best))
    pairs.extend(fit_pairs(arena.objective, arena.base.fit, screening, [p.names for p in pairs], effort))
    pairs.extend(beside_bent_spring(arena, stage, pairs, specs))
    pairs.extend(bent_loop(arena.objective, arena.base, arena.hypotheses, pairs, specs))
    for size in range(3, effort.size + 2):
        arena = settled(arena, pairs, effort)
        if not _worth_more(arena, size - 1):
            break
        if size == 3:
            found = beside_other_laws(arena.objective, arena.base.fit, arena.hypotheses, candidates, effort)
            found.extend(gain_or_weight(arena.objective, arena.hypotheses[:BEYOND], candidates))
            arena = _swapped(settled(arena, found, effort) if found else arena, candidates, effort)
            if not _worth_more(arena, size - 1):
                break
        if size > effort.size:
            break
        report(f"fitting sets of {size}")
        pairs = extensions(arena.objective, arena.base.fit, arena.hypotheses[0], laws, screening, effort)
    arena = _uncoupled(arena)
    if not arena.hypotheses[0].sensible:  # no such friction falls: the simpler one is what it stands for
        inner = contained(arena.objective, arena.base.fit, arena.hypotheses[0], candidates, _losses(arena), effort)
        arena = settled(arena, inner, effort) if inner else arena
    arena = _with_strangers(arena, (arena, first), outside, effort, more)
    return screening, tuple(worth_judging([arena.base, *arena.hypotheses])[1:])
