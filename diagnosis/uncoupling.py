"""Bends sought beside the joint's resonance, then written with the joint's own stiffness and inertia and fitted on from there.

To first order such a bend explains next to nothing, so that no screening finds it: it is fitted from every start.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from jointscope.diagnosis.assembly import BASE_INDEX
from jointscope.diagnosis.coordinates import coordinates
from jointscope.diagnosis.effects import at_rig
from jointscope.diagnosis.effects.coupled import COUPLED, PLAIN, uncoupled
from jointscope.diagnosis.refit import least_squares
from jointscope.diagnosis.screen import trial_effects
from jointscope.diagnosis.search import Effort, Hypothesis, fit_child, name_of, profile_loss

if TYPE_CHECKING:
    from jointscope.diagnosis.objective import Objective

ONWARD = (12, 80)  # steps and simulations from where the coupled law ended


def bends_beside(objective: Objective, parent: Hypothesis, effort: Effort) -> list[Hypothesis]:
    """The best bend that hammer and sensor hardly follow, beside the parent's effects; none where it holds one already."""
    problem = objective.problem
    free = {int(position) for position in parent.fit.coordinates.free}
    moved = {BASE_INDEX["stiffness"], BASE_INDEX["load_inertia"]}
    if not moved <= free or name_of(COUPLED) in parent.names or COUPLED.possible(problem) is not None:
        return []
    spec = at_rig(COUPLED, problem)
    fits = [fit_child(objective, parent.fit, [active], effort) for active in trial_effects(spec, problem, (1,))]
    best = min((fit for fit in fits if fit is not None), key=lambda fit: fit.chi2, default=None)
    return [] if best is None else [Hypothesis((*parent.specs, spec), best, profile_loss(objective, best.w))]


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
