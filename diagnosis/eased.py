"""Leading hypotheses whose joint has become rigid, fitted again from the stiffness that the rig should have.

Where friction is most of what the base lacks, the base's joint goes as stiff as it may: far above the band a stiffness has no
gradient, and no refit beside the friction brings it back. What is soft is then found as a further spring, in the link.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from jointscope.diagnosis.refit import least_squares
from jointscope.diagnosis.search import Hypothesis, profile_loss

if TYPE_CHECKING:
    from jointscope.diagnosis.objective import Objective

RIGID = 2.0  # times the stiffness that was stated, or found in the responses
EASED = (1.0, 0.5)  # of that stiffness, from where it is sought
TRIED = 4  # hypotheses, best first


def eased(objective: Objective, hypotheses: Sequence[Hypothesis]) -> list[Hypothesis]:
    """Those of the best ``hypotheses`` with a rigid joint that are better with a soft one."""
    names = objective.problem.base.names
    if "stiffness" not in names:  # several joints
        return []
    stiffness, damping = names.index("stiffness"), names.index("damping")
    found = []
    for hypothesis in hypotheses[:TRIED]:
        where = hypothesis.fit.coordinates
        theta, effects = where.unpack(hypothesis.fit.x)
        known = objective.problem.rig.stiffness_reference or where.start[stiffness]
        if stiffness not in where.free or theta[stiffness] < RIGID * known:
            continue
        best = hypothesis.fit
        for factor in EASED:
            moved = theta.copy()
            moved[stiffness], moved[damping] = factor * known, where.start[damping]
            fit = least_squares(objective, where, where.pack(moved, effects), iterations=30, tolerance=1e-3)
            best = min(best, fit, key=lambda f: f.chi2)
        if best is not hypothesis.fit:
            found.append(replace(hypothesis, fit=best, loss=profile_loss(objective, best.w)))
    return found
