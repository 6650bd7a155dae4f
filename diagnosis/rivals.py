"""Sets next to a leading one that the screening may have missed: look-alikes in its place, laws that hold its laws.

Other laws of the same name are tried from its numbers too: what a law of the right name and a wrong form leaves is always
explained by something.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.assembly import BASE_INDEX
from jointscope.diagnosis.candidates import candidates_for
from jointscope.diagnosis.coordinates import coordinates
from jointscope.diagnosis.effects import ActiveEffect, EffectSpec
from jointscope.diagnosis.effects.friction import falling_about
from jointscope.diagnosis.effects.periodic import counted_alike, slower_lines, turn_of
from jointscope.diagnosis.freer import FREER
from jointscope.diagnosis.lent import same_numbers, same_shape, with_force
from jointscope.diagnosis.refit import Fit, unspent
from jointscope.diagnosis.screen import Trial, best_per_spec, refined, screen, tangent
from jointscope.diagnosis.search import (
    CONTAINED,
    Effort,
    Hypothesis,
    at_own_size,
    fit_child,
    name_of,
    names_of,
    profile_loss,
)

if TYPE_CHECKING:
    from jointscope.diagnosis.objective import Objective

Vector = NDArray[np.float64]
Laws = frozenset[int]  # of a set, by identity

STUCK = 300.0  # nats behind a leader of the same names, from which on another law of one of them is fitted from its numbers
DAMPING = BASE_INDEX["damping"]
GIVEN_BACK = (
    5.0  # times the leader's damping, beyond which the base's stands for the leader's effects: no start for others
)
BEHIND = (
    0.03  # of what the leading set gained, beyond which a look-alike may have got stuck and is fitted once more
)


def rivals(
    objective: Objective,
    base: Fit,
    leader: Hypothesis,
    candidates: Sequence[ActiveEffect],
    known: Mapping[tuple[str, ...], float],
    effort: Effort,
    tried: Collection[Laws] = (),
) -> list[Hypothesis]:
    """Fit the look-alikes of a leading set's effects in their place, which the screening may have missed.

    Where a fit exists already and is far behind it is tried again from the leader's base: a strong effect pulls the
    base along, and a fit that starts at another base may end in a valley of its own.

    Args:
        base: The base's fit.
        candidates: Trials of every law.
        known: Loss of the sets whose fits exist already, by name.
        tried: Sets that were fitted so before, from a leader that shares the rest; left out.
    """
    found: list[Hypothesis] = []
    far, reach = _far_behind(objective, base, leader), within_reach(objective, base, leader)
    done = {names for names, loss in known.items() if loss < far}
    for place in _places(leader):
        for name in place.spec.look_alikes:
            trials = [c for c in candidates if c.spec.name == name and name_of(c.spec) not in names_of(place.kept)]
            trials = [c for c in trials if names_of((*place.kept, c.spec)) not in done]
            trials = [c for c in trials if laws_of((*place.kept, c.spec)) not in tried]
            if not trials:
                continue
            alike = same_numbers(trials, place.effect)
            lines = [a for a in alike if turn_of(a) and turn_of(a) == turn_of(place.effect)]
            trials = lines or [*trials, *alike]  # of a line the order is known
            active = _telling(objective, without(objective, leader.fit, place.position), trials)
            done.add(names_of((*place.kept, active.spec)))
            found.extend(_in_place(objective, base, place, active, effort, reach))
    return found


def strangers(
    objective: Objective,
    base: Fit,
    leader: Hypothesis,
    specs: Sequence[EffectSpec],
    effort: Effort,
    more: Sequence[ActiveEffect] = (),
) -> list[Hypothesis]:
    """Fit each law outside the contract's table in place of the whole leading set, also from each trial of ``more``.

    One of which no trial explains anything beside the base, to first order, is left out.
    """
    found: list[Hypothesis] = []
    theta, effects = leader.fit.coordinates.unpack(leader.fit.x)
    reach = within_reach(objective, base, leader)
    for spec in specs:
        trials = candidates_for(objective.problem, (spec,))
        groups = [trials, *([active] for active in more if active.spec is spec)]
        if spec.family == "periodic":  # at whole orders, and at what order the leader found
            groups.append(
                [a for e in effects for a in same_numbers(trials, e) if turn_of(a) and turn_of(a) == turn_of(e)]
            )
        for group in groups:
            best = _screened(objective, base, group) if group else []
            if best and best[0].gain > effort.worth:
                fit = fit_child(objective, base, [at_own_size(best[0])], effort, [theta], reach)
                if fit is not None:
                    found.append(Hypothesis((spec,), fit, profile_loss(objective, fit.w)))
    return found


def grown(
    objective: Objective,
    base: Fit,
    leader: Hypothesis,
    candidates: Sequence[ActiveEffect],
    effort: Effort,
    tried: Collection[Laws] = (),
) -> list[Hypothesis]:
    """Fit the laws that contain a law of the leader, from the very force that it found; a stop also in other places.

    A Stribeck friction that starts elsewhere ends above the Coulomb friction that it contains.

    Args:
        tried: As :func:`rivals` takes them.
    """
    found: list[Hypothesis] = []
    reach = within_reach(objective, base, leader)
    blind = all(run.observed is None for run in objective.problem.runs)
    for place in _places(leader):
        wider = {outer for inner, outer in CONTAINED if inner == place.spec.name and place.effect.values[0] > 0.0}
        about = [
            falling_about(c, place.effect.values[0])
            for c in candidates
            if c.spec.name in wider and c.spec.location == place.spec.location
        ]
        trials = [*about, *same_shape(about, place.effect)]
        for group in (trials, *_freer(candidates, place.effect, objective.problem.rig.reduction_ratio or 1.0)):
            group = [a for a in group if laws_of((*place.kept, a.spec)) not in tried]
            if not group:
                continue
            active = _nearest(objective, place.theta, place.others, group)
            found.extend(_in_place(objective, base, place, active, effort, reach))
        for group in filter(None, _elsewhere(candidates, place.effect) if blind else ()):
            active = _nearest(objective, place.theta, place.others, group)
            found.extend(h for h in _in_place(objective, base, place, active, effort, reach) if h.sensible)
    return found


def contained(
    objective: Objective,
    base: Fit,
    leader: Hypothesis,
    candidates: Sequence[ActiveEffect],
    known: Mapping[tuple[str, ...], float],
    effort: Effort,
) -> list[Hypothesis]:
    """Fit the laws that a law of the leader contains from where the leader is, where their own fits are far behind.

    The simpler law may have ended in a valley of the base that the wider one got out of.

    Args:
        known: Loss of the sets whose fits exist already, by name.
    """
    found: list[Hypothesis] = []
    far = _far_behind(objective, base, leader)
    for place in _places(leader):
        narrower = {inner for inner, outer in CONTAINED if outer == place.spec.name}
        trials = [c for c in candidates if c.spec.name in narrower and c.spec.location == place.spec.location]
        if trials and known.get(names_of((*place.kept, trials[0].spec)), math.inf) > far:
            active = _nearest(objective, place.theta, place.others, same_numbers(trials, place.effect))
            found.extend(_in_place(objective, base, place, active, effort))
    return found


def reshaped(
    objective: Objective,
    base: Fit,
    leader: Hypothesis,
    candidates: Sequence[ActiveEffect],
    hypotheses: Sequence[Hypothesis],
    effort: Effort,
    tried: Collection[Laws] = (),
) -> list[Hypothesis]:
    """Fit the other laws of the leader's names from its own numbers, where none of ``hypotheses`` is as near.

    What is far behind may be thousands of nats on quiet records, where a fit that got stuck is no answer either.

    Args:
        tried: As :func:`rivals` takes them.
    """
    found: list[Hypothesis] = []
    far = min(_far_behind(objective, base, leader), leader.loss + STUCK)
    reach = within_reach(objective, base, leader)
    done = {laws_of(h.specs) for h in hypotheses if h.loss < far}.union(tried)
    for place in _places(leader):
        spec = place.spec
        if spec.family == "periodic" or spec.of_own_frequency:
            continue  # an order of the motor is no number for one of the arm; a mode's law is there once per start
        freer = FREER.get(spec.variant, ())
        laws: dict[int, list[ActiveEffect]] = {}
        for trial in candidates:
            if name_of(trial.spec) == name_of(spec) and trial.spec is not spec and trial.spec.variant not in freer:
                laws.setdefault(id(trial.spec), []).append(trial)
        for trials in laws.values():
            if laws_of((*place.kept, trials[0].spec)) in done:
                continue
            active = _nearest(objective, place.theta, place.others, [*same_numbers(trials, place.effect), *trials])
            found.extend(_in_place(objective, base, place, active, effort, reach))
    return found


def laws_of(specs: Iterable[EffectSpec]) -> Laws:
    """The very laws of a set, whatever their order."""
    return frozenset(id(spec) for spec in specs)


def _far_behind(objective: Objective, base: Fit, leader: Hypothesis) -> float:
    """The loss from which on a fit may have got stuck."""
    return leader.loss + BEHIND * (profile_loss(objective, base.w) - leader.loss)


def within_reach(objective: Objective, base: Fit, leader: Hypothesis) -> float:
    """The loss beyond which a fit in the place of the leader, or of a part of it, is of no use however near it ends."""
    return max(_far_behind(objective, base, leader), leader.loss + STUCK)


@dataclass(frozen=True, eq=False)
class _Place:
    """One effect of a leading set, in whose place others are tried.

    Attributes:
        position: In the set.
        spec, effect: Its law, and the law with its fitted values.
        kept, others: The same of the rest of the set.
        theta: The set's base parameters, shape (n_theta,).
    """

    position: int
    spec: EffectSpec
    effect: ActiveEffect
    kept: tuple[EffectSpec, ...]
    others: tuple[ActiveEffect, ...]
    theta: Vector


def _places(leader: Hypothesis) -> Iterator[_Place]:
    theta, effects = leader.fit.coordinates.unpack(leader.fit.x)
    for position, (spec, effect) in enumerate(zip(leader.specs, effects, strict=True)):
        kept = tuple(s for k, s in enumerate(leader.specs) if k != position)
        others = tuple(e for k, e in enumerate(effects) if k != position)
        yield _Place(position, spec, effect, kept, others, theta)


def _in_place(
    objective: Objective,
    base: Fit,
    place: _Place,
    active: ActiveEffect,
    effort: Effort,
    reach: float = math.inf,
) -> list[Hypothesis]:
    """The set with ``active`` in this place, where the fit ends better than the base; within ``reach``, or not gone on with."""
    parent, bases = base, [place.theta]
    if base.coordinates.unpack(base.x)[0][DAMPING] > GIVEN_BACK * place.theta[DAMPING]:
        parent, bases = _at(objective, base, place.theta), []
    fit = fit_child(objective, parent, [*place.others, active], effort, bases, reach)
    if fit is None or not fit.chi2 < base.chi2:
        return []
    return [Hypothesis((*place.kept, active.spec), fit, profile_loss(objective, fit.w))]


def _at(objective: Objective, base: Fit, theta: Vector) -> Fit:
    """The base at other parameters, as it stands there."""
    where = base.coordinates
    x = where.pack(theta, ())
    w = objective.residual(x, where)
    return Fit(where, x, w, objective.columns(x, where, w, range(where.n)), math.nan, False, True, 1)


def _freer(candidates: Sequence[ActiveEffect], leader: ActiveEffect, ratio: float) -> list[list[ActiveEffect]]:
    """Trials of the freer laws, law by law: a mount that slides with the leader's mode, an order with its harmonic."""
    wider = [c for c in candidates if c.spec.variant in FREER.get(leader.spec.variant, ())]
    groups: dict[int, list[ActiveEffect]] = {}
    alike = [counted_alike(trial, leader, ratio) for trial in same_numbers(wider, leader)]
    if not leader.spec.sensible(leader.values):  # what it lacks has bent its own numbers
        alike += [with_force(trial, leader.values[0]) for trial in wider]
    for active in alike:
        groups.setdefault(id(active.spec), []).append(active)
    slower = [
        [ActiveEffect(active.spec, values) for values in slower_lines(active.values, k)]
        for active in alike
        if active.spec.variant.endswith("-harmonic")
        for k in (2, 3)
    ]
    return [*groups.values(), *(trials for trials in slower if trials)]


def _elsewhere(candidates: Sequence[ActiveEffect], leader: ActiveEffect) -> list[list[ActiveEffect]]:
    """Of an effect of one place, trials to either side of where it was found.

    Where nobody recorded where the arm was, each place is a valley of its own.
    """
    if not leader.spec.local:
        return []
    own, found = [c for c in candidates if c.spec is leader.spec], leader.values[0]
    return [[c for c in own if c.values[0] < found], [c for c in own if c.values[0] > found]]


def without(objective: Objective, fit: Fit, position: int) -> Fit:
    """The fit with its effect at ``position`` switched off and nothing refitted; its columns are those of the whole."""
    theta, effects = fit.coordinates.unpack(fit.x)
    kept = tuple(e for k, e in enumerate(effects) if k != position)
    where = coordinates(objective.problem, tuple(e.spec for e in kept))
    x = where.pack(theta, kept)
    columns = np.delete(fit.jacobian, fit.coordinates.effect_slices()[position], axis=1)
    return Fit(where, x, objective.residual(x, where), columns, math.nan, False, False, 1)


def _telling(objective: Objective, parent: Fit, trials: Sequence[ActiveEffect]) -> ActiveEffect:
    """The trial that explains most beside the parent's free parameters, at the size it asks for.

    A law that stiffens the joint is far from the data before the stiffness has followed.
    """
    taken = _screened(objective, parent, trials)
    theta, effects = parent.coordinates.unpack(parent.x)
    return at_own_size(taken[0]) if taken else _nearest(objective, theta, effects, trials)


def _screened(objective: Objective, parent: Fit, trials: Sequence[ActiveEffect]) -> list[Trial]:
    parents = tangent(parent.w, unspent(parent))
    best = best_per_spec(screen(objective, parent, parents, parents.w, trials))
    return refined(objective, parent, parents, parents.w, best)


def _nearest(
    objective: Objective, theta: Vector, effects: tuple[ActiveEffect, ...], trials: Sequence[ActiveEffect]
) -> ActiveEffect:
    """The trial with which the data are best predicted as they stand."""
    return trials[objective.nearest([(theta, (*effects, active)) for active in trials])]
