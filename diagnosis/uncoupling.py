"""Bends sought beside the joint's resonance, then written with the joint's own stiffness and inertia and fitted on from there.

To first order such a bend explains next to nothing, so that no screening finds it: it is fitted from every start.

A mount that turns by the joint's reaction, with the share s of J_L over its own inertia and the frequency w, makes the joint
softer by what an outer part J_p = J_L s/(1 + s) at w/sqrt(1 + s) does that neither hammer nor sensor follows (phi = J_p/J_L),
but for b_l, which rubs on the mount where there is one: less than 1 % of a response tells the two apart.
What was found as such a bend is fitted as a mount too.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from jointscope.diagnosis.assembly import BASE_INDEX
from jointscope.diagnosis.coordinates import coordinates
from jointscope.diagnosis.effects import ActiveEffect, at_rig
from jointscope.diagnosis.effects.coupled import COUPLED, MOST, PLAIN, uncoupled
from jointscope.diagnosis.effects.modes import SPECS as MODES
from jointscope.diagnosis.refit import least_squares
from jointscope.diagnosis.screen import trial_effects
from jointscope.diagnosis.search import Effort, Hypothesis, fit_child, name_of, names_of, profile_loss

if TYPE_CHECKING:
    from jointscope.diagnosis.effects.spec import Values
    from jointscope.diagnosis.objective import Objective

ONWARD = (12, 80)  # steps and simulations from where the coupled law ended
LEADING = 4  # sets of which a bend is fitted as a mount too
ASIDE = (0.6, 1.6)  # of the share that hammer and sensor follow of an outer part's motion where it is a mount's
AS_ASIDE = (0.97, 1.03)  # the same where the two are one: both shares are 1 there, and a bend's are anything
MOUNT = next(spec for spec in MODES if spec.variant == "turning-mount")


def bends_beside(objective: Objective, parent: Hypothesis, effort: Effort) -> list[Hypothesis]:
    """The best bend that hammer and sensor hardly follow, beside the parent's effects; none where it holds one already."""
    problem = objective.problem
    free = {int(position) for position in parent.fit.coordinates.free}
    moved = {BASE_INDEX["stiffness"], BASE_INDEX["load_inertia"]}
    if not moved <= free or name_of(COUPLED) in parent.names or COUPLED.possible(problem) is not None:
        return []
    spec = at_rig(COUPLED, problem)
    best: list[Hypothesis] = []
    for active in trial_effects(spec, problem, (1,)):
        reach = best[0].loss if best else math.inf
        fit = fit_child(objective, parent.fit, [active], effort, reach=reach)
        loss = math.inf if fit is None else profile_loss(objective, fit.w)
        if fit is not None and loss < reach:
            best = [Hypothesis((*parent.specs, spec), fit, loss)]
    return best


def as_mounts(objective: Objective, hypotheses: Sequence[Hypothesis]) -> list[Hypothesis]:
    """Those of the leading sets, best first, whose bend hammer and sensor hardly follow, with a mount that turns instead."""
    mount = at_rig(MOUNT, objective.problem)
    known = {h.names for h in hypotheses[:LEADING]}
    found = []
    for hypothesis in hypotheses[:LEADING]:
        theta, effects = hypothesis.fit.coordinates.unpack(hypothesis.fit.x)
        for place, effect in enumerate(effects):
            values = _as_mount(effect, float(theta[BASE_INDEX["load_inertia"]]))
            specs = (*hypothesis.specs[:place], mount, *hypothesis.specs[place + 1 :])
            if values is None or mount.possible(objective.problem) is not None or names_of(specs) in known:
                continue
            known.add(names_of(specs))
            where = coordinates(objective.problem, specs)
            x = where.pack(theta, (*effects[:place], ActiveEffect(mount, values), *effects[place + 1 :]))
            fit = least_squares(objective, where, x, iterations=ONWARD[0], tolerance=2e-3, simulations=ONWARD[1])
            found.append(Hypothesis(specs, fit, profile_loss(objective, fit.w)))
    return found


def is_mount(hypothesis: Hypothesis) -> bool:
    """Whether hammer and sensor follow a bend of the hypothesis as they would a mount that turns, as near as can be told."""
    theta, effects = hypothesis.fit.coordinates.unpack(hypothesis.fit.x)
    inertia = float(theta[BASE_INDEX["load_inertia"]])
    return any(_as_mount(effect, inertia, AS_ASIDE) is not None for effect in effects)


def _as_mount(bend: ActiveEffect, inertia: float, near: tuple[float, float] = ASIDE) -> Values | None:
    """Frequency, share and damping of the mount that a bend stands for; ``None`` where hammer or sensor follows it."""
    if bend.spec.variant not in (PLAIN.variant, "one-shape"):
        return None
    frequency, outer, damping, *shapes = bend.values
    share = outer / inertia
    aside = [shape / math.sqrt(share) for shape in shapes] if share > 0.0 else [0.0]
    if share > MOST or not all(near[0] < a < near[1] for a in aside):
        return None
    root = 1.0 / math.sqrt(1.0 - share)
    return frequency * root, share * root**2, damping * root


def in_own_terms(objective: Objective, hypotheses: Sequence[Hypothesis]) -> list[Hypothesis]:
    """The hypotheses, best first; of those that hold a coupled bend the best of each set, as the law of two shapes."""
    found = [h for h in hypotheses if not _is_coupled(h)]
    best: dict[tuple[str, ...], Hypothesis] = {}
    for h in sorted((h for h in hypotheses if _is_coupled(h)), key=lambda h: h.loss):
        best.setdefault(h.names, h)
    found.extend(_in_own_terms(objective, h) for h in best.values())
    return sorted(found, key=lambda h: h.loss)


def _is_coupled(hypothesis: Hypothesis) -> bool:
    return any(spec.variant == COUPLED.variant for spec in hypothesis.specs)


def _in_own_terms(objective: Objective, hypothesis: Hypothesis) -> Hypothesis:
    plain = at_rig(PLAIN, objective.problem)
    theta, effects = hypothesis.fit.coordinates.unpack(hypothesis.fit.x)
    place = next(k for k, spec in enumerate(hypothesis.specs) if spec.variant == COUPLED.variant)
    stiffness, inertia = BASE_INDEX["stiffness"], BASE_INDEX["load_inertia"]
    theta[stiffness], theta[inertia], bend = uncoupled(
        theta[stiffness], theta[inertia], effects[place].values, plain
    )
    specs = (*hypothesis.specs[:place], plain, *hypothesis.specs[place + 1 :])
    where = coordinates(objective.problem, specs)
    x = where.pack(theta, (*effects[:place], bend, *effects[place + 1 :]))
    fit = least_squares(objective, where, x, iterations=ONWARD[0], tolerance=2e-3, simulations=ONWARD[1])
    return replace(hypothesis, specs=specs, fit=fit, loss=profile_loss(objective, fit.w))
