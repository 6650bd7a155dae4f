"""Sets of one effect more: the parent's alternatives scored anew on top of it, the leading ones fitted."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.candidates import residuals_of, where_shown
from jointscope.diagnosis.refit import Fit, unspent
from jointscope.diagnosis.screen import Trial, best_per_spec, one_sided, refined, screen, tangent
from jointscope.diagnosis.search import (
    Effort,
    Hypothesis,
    Screening,
    fit_leading,
    leaders,
    name_of,
    nested,
)

if TYPE_CHECKING:
    from jointscope.diagnosis.effects import ActiveEffect, EffectSpec
    from jointscope.diagnosis.objective import Objective

AFAR = (
    300.0  # nats between base and parent, beyond which directions and residuals at the one say little of the other
)
LAWS = 2  # of one name that are tried: seven of friction would leave no place for a spring's


def extensions(
    objective: Objective,
    base: Fit,
    parent: Hypothesis,
    specs: Sequence[EffectSpec],
    before: Screening,
    effort: Effort,
) -> list[Hypothesis]:
    """The parent's best extensions by one effect.

    Far from the base, lines and modes of ``specs`` start from what the parent leaves, and other laws are scored anew.

    Args:
        base: The base's fit under the noise of ``objective``.
        before: The screening on top of the base.
    """
    new: list[ActiveEffect] = []
    if 0.5 * (base.chi2 - parent.fit.chi2) > AFAR:
        theta, effects = parent.fit.coordinates.unpack(parent.fit.x)
        left = residuals_of(objective, objective.predictions(theta, effects))
        new = [*where_shown(objective.problem, specs, left), *some_of_each(before.trials)]
    tried = _alternatives(objective, parent, before, effort, new)
    trials = leaders(_scored(objective, parent.fit, tried, effort), effort.children, effort.worth, parent.names)
    return fit_leading(objective, parent.fit, parent.specs, trials, effort)


def some_of_each(tried: Sequence[Trial]) -> list[ActiveEffect]:
    """Of every law without starts from a residual the smallest trial and the middle one."""
    trials: dict[int, list[ActiveEffect]] = {}
    for trial in tried:
        if trial.spec.residual_starts is None:
            trials.setdefault(id(trial.spec), []).append(trial.active)
    return [a for each in trials.values() for a in dict.fromkeys((each[0], each[len(each) // 2]))]


def _alternatives(
    objective: Objective,
    parent: Hypothesis,
    before: Screening,
    effort: Effort,
    new: Sequence[ActiveEffect],
) -> list[ActiveEffect]:
    """What may explain most on top of a fitted set: of each law the trial that does so to first order.

    Those tried on top of the base are scored by their old directions, those that are ``new`` over a few runs.
    """
    fit, taken = parent.fit, parent.names
    w = before.objective.residual(fit.x, fit.coordinates)
    few, rows = objective.restricted(before.positions), objective.rows(before.positions)
    then = tangent(w, _converted(unspent(fit)[rows], few, before.objective))
    directions = np.stack([t.direction for t in before.trials])  # of unit length, as the basis is
    basis = directions @ then.basis.astype(np.float32)
    size = 1.0 - np.einsum("ij,ij->i", basis, basis).astype(float)
    inner = (directions @ then.w.astype(np.float32)).astype(float)
    admitted = (inner > 0.0) | np.array([not one_sided(t.spec) for t in before.trials])
    gains = np.where((size > 0.01) & admitted, inner**2 / np.maximum(size, 0.01), 0.0)
    chosen: dict[int, ActiveEffect] = {}
    laws: Counter[str] = Counter()
    for k in np.argsort(-gains, kind="stable"):
        trial = before.trials[k]
        name = name_of(trial.spec)
        if id(trial.spec) in chosen or laws[name] == LAWS or not _admitted(trial.spec, taken):
            continue
        chosen[id(trial.spec)] = trial.active
        laws[name] += 1
        if len(chosen) == effort.refine:
            break
    left, columns = fit.w[rows], unspent(fit)[rows]
    admitted_new = [active for active in new if _admitted(active.spec, taken)]
    further = best_per_spec(screen(few, fit, tangent(left, columns), left, admitted_new))
    return [*chosen.values(), *(t.active for t in further[: effort.refine])]


def _scored(objective: Objective, parent: Fit, tried: Sequence[ActiveEffect], effort: Effort) -> list[Trial]:
    """Score on top of a fitted set over all runs of ``objective``; the leading ones at their own amplitude."""
    parents = tangent(parent.w, unspent(parent))
    trials = best_per_spec(screen(objective, parent, parents, parent.w, tried))
    return refined(objective, parent, parents, parent.w, trials[: effort.refine // 2])


def _admitted(spec: EffectSpec, taken: tuple[str, ...]) -> bool:
    return name_of(spec) not in taken and not nested(name_of(spec), taken)


def _converted(jacobian: NDArray[np.float64], new: Objective, old: Objective) -> NDArray[np.float64]:
    """Columns whitened by ``new`` brought to the scale of ``old``; neither filters while the search goes on."""
    rows = []
    for position, piece in enumerate(new.slices):
        ratio = np.concatenate(
            [
                (b.weight[b.keep] / b.sigma) / (a.weight[a.keep] / a.sigma)
                for a, b in zip(new.whiteners[position].filters, old.whiteners[position].filters, strict=True)
            ]
        )
        rows.append(jacobian[piece] * ratio[:, None])
    return np.concatenate(rows)
