r"""What a further effect explains that no other form of the first ones could.

A law of the right name and the wrong form leaves something, and something always explains that. So a further effect with
little of the evidence is not believed for its evidence alone. Here it is asked what of it the first ones' own places could
have done instead. With w what the parent leaves, s what the child changes, both whitened, J the parent's columns and F
those of every other law at the parent's places, small and medium, of its own names' other laws with its own numbers, and of
forces without a name there (a sensor that bends every sample by itself has no form that lags; a law that nature knows in
one form only has none but those of its name),

    own = (s'P w)^2 / (s'P s) over the same with F left out, P = I - B B^+, B = [J, F]:

the share of the child's gain to first order that is left when the parent's places may do as they like.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.base import representative
from jointscope.diagnosis.effects import catalogue
from jointscope.diagnosis.effects.latent import LATENT, nodes
from jointscope.diagnosis.lent import same_numbers
from jointscope.diagnosis.screen import tangent, trial_effects
from jointscope.diagnosis.search import Effort, name_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jointscope.diagnosis.adjudicate import Judged, Judgement
    from jointscope.diagnosis.effects import ActiveEffect
    from jointscope.diagnosis.objective import Objective

Matrix = NDArray[np.float64]

LARGE = 60_000  # samples, beyond which only the runs of the search are asked
SHAPES = 2  # of a law's starts, tried small and medium
UNSEEN = 1e-9  # of a column's norm: nothing of it reaches the channels


def own_share(judgement: Judgement, parent: Judged, child: Judged) -> float:
    """Share of the child's gain that the parent's places can't explain by other forms [-]; 0 without a gain."""
    objective = judgement.objective
    positions = _asked(objective)
    few, rows = objective.restricted(positions), objective.rows(positions)
    w = parent.fit.w[rows]
    s = w - child.fit.w[rows]
    columns = few.columns(parent.fit.x, parent.fit.coordinates, w, range(parent.fit.coordinates.n))
    alone = _explained(s, w, columns)
    if alone <= 0.0:
        return 0.0
    forms = _columns(few, parent, w, [*_other_forms(few, parent, child), *_other_laws(few, parent)])
    return min(_explained(s, w, np.concatenate([columns, forms], axis=1)) / alone, 1.0)


def _asked(objective: Objective) -> list[int]:
    if sum(sum(w.sizes) for w in objective.whiteners) <= LARGE:
        return list(range(len(objective.runs)))
    effort = Effort()
    chosen = representative(objective.problem, objective.runs, effort.hits, effort.others, [])
    return [i for i, run in enumerate(objective.runs) if run in chosen]


def _explained(s: NDArray[np.float64], w: NDArray[np.float64], columns: Matrix) -> float:
    parents = tangent(w, columns)
    left = parents.project(s)
    size, inner = float(left @ left), float(left @ parents.w)
    return inner**2 / size if size > UNSEEN * float(s @ s) and inner > 0.0 else 0.0


def _other_forms(objective: Objective, parent: Judged, child: Judged) -> list[tuple[ActiveEffect, ...]]:
    """The parent with other laws at its places beside it but for what the child adds, and with forces without a name."""
    problem = objective.problem
    _, effects = parent.fit.coordinates.unpack(parent.fit.x)
    places = {spec.location for spec in parent.hypothesis.specs if not spec.exact}
    added = set(child.names) - set(parent.names)
    found: list[ActiveEffect] = []
    plain = all(spec.memoryless for spec in parent.hypothesis.specs if spec.location == "acquisition")
    for spec in catalogue(problem):
        if spec.location == "acquisition" and plain and not spec.memoryless:
            continue
        if spec.location in places and name_of(spec) not in added and spec.possible(problem) is None:
            found.extend(trial_effects(spec, problem, (0, 1))[: 2 * SHAPES])
    for spec in LATENT:
        if spec.location in places and spec.possible(problem) is None:
            found.extend(nodes(spec, problem))
    return [(*effects, form) for form in found]


def _other_laws(objective: Objective, parent: Judged) -> list[tuple[ActiveEffect, ...]]:
    """The parent with another law of one of its names, by the same numbers."""
    problem = objective.problem
    _, effects = parent.fit.coordinates.unpack(parent.fit.x)
    found: list[tuple[ActiveEffect, ...]] = []
    for position, effect in enumerate(effects):
        others = [
            trial
            for spec in catalogue(problem)
            if name_of(spec) == name_of(effect.spec) and spec.variant != effect.spec.variant
            if spec.possible(problem) is None
            for trial in trial_effects(spec, problem, (1,))
        ]
        found.extend((*effects[:position], law, *effects[position + 1 :]) for law in same_numbers(others, effect))
    return found


def _columns(
    objective: Objective, parent: Judged, w: NDArray[np.float64], forms: Sequence[tuple[ActiveEffect, ...]]
) -> Matrix:
    """What each form changes of the parent's residual, columns of unit length, shape (n, k)."""
    theta, _ = parent.fit.coordinates.unpack(parent.fit.x)

    def column(form: tuple[ActiveEffect, ...]) -> NDArray[np.float64]:
        parts = [objective.run_residual(i, theta, form) for i in range(len(objective.runs))]
        return np.concatenate(parts) - w

    found = [c for c in objective.map(column, forms) if np.all(np.isfinite(c))]
    sizes = [float(np.linalg.norm(c)) for c in found]
    least = UNSEEN * max([float(np.linalg.norm(w)), *sizes])
    kept = [c / size for c, size in zip(found, sizes, strict=True) if size > least]
    return np.stack(kept, axis=1) if kept else np.zeros((len(w), 0))
