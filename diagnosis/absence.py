"""What a further effect explains in runs in which the first one does nothing.

A lag of the drive acts in no hit on a held joint, and neither does any other law at its place: whatever is explained there is
no form of it. Only the base is shared with the other runs, and a wrong form there has moved it. So base, and base with what
the child adds, are fitted to those runs alone; the held-out runs of that kind must gain as well.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.coordinates import coordinates
from jointscope.diagnosis.form import own_share
from jointscope.diagnosis.gates import AS_FORETOLD, HELD, OWN_FORM, REAL_BESIDE
from jointscope.diagnosis.refit import Fit, least_squares
from jointscope.diagnosis.search import name_of

if TYPE_CHECKING:
    from jointscope.diagnosis.adjudicate import Judged, Judgement
    from jointscope.diagnosis.effects import ActiveEffect
    from jointscope.diagnosis.objective import Objective

Vector = NDArray[np.float64]

NOTHING = 1e-6  # of a run's residual, that removing the first effect may change there
FIT = (10, 120)  # steps and simulations


def of_its_own(judgement: Judgement, parent: Judged, child: Judged) -> bool:
    """Whether no other form of the parent could do what the child adds: most of it, or that where the parent does nothing."""
    return own_share(judgement, parent, child) > OWN_FORM or shown_in_absence(judgement, parent, child)


def shown_in_absence(judgement: Judgement, parent: Judged, child: Judged) -> bool:
    """Whether the child's further effects are real where the parent's are silent, in fitted and held-out runs."""
    theta, effects = parent.fit.coordinates.unpack(parent.fit.x)
    quiet = _silent(judgement.objective, theta, effects)
    kept = _silent(judgement.held, theta, effects)
    if not quiet or not kept or not effects:
        return False
    few, held = judgement.objective.restricted(quiet), judgement.held.restricted(kept)
    of_child, others = child.fit.coordinates.unpack(child.fit.x)
    added = tuple(a for a in others if name_of(a.spec) not in parent.names)
    base, more = _fitted(few, theta, ()), _fitted(few, of_child, added)
    samples = max(len(base.w), 2)
    dispersion = max(1.0, more.chi2 / samples)
    cost = 0.5 * sum(len(a.spec.parameters) for a in added) * math.log(samples)
    if 0.5 * (base.chi2 - more.chi2) / dispersion - cost < REAL_BESIDE:
        return False
    before, after = (held.residual(fit.x, fit.coordinates) for fit in (base, more))
    gained = 0.5 * float(before @ before - after @ after) / dispersion
    foretold = 0.5 * float(np.sum(np.square(before - after))) / dispersion
    return gained > max(HELD, AS_FORETOLD * foretold)


def _silent(objective: Objective, theta: Vector, effects: Sequence[ActiveEffect]) -> list[int]:
    """Runs that ``effects`` leave as they are."""
    found = []
    for i in range(len(objective.runs)):
        with_them, without = (objective.run_residual(i, theta, active) for active in (tuple(effects), ()))
        if float(np.linalg.norm(with_them - without)) <= NOTHING * float(np.linalg.norm(without)):
            found.append(i)
    return found


def _fitted(objective: Objective, theta: Vector, effects: tuple[ActiveEffect, ...]) -> Fit:
    where = coordinates(objective.problem, tuple(a.spec for a in effects))
    return least_squares(
        objective, where, where.pack(theta, effects), iterations=FIT[0], tolerance=1e-3, simulations=FIT[1]
    )
