"""A line at the joint's own resonance: broadband noise leaves one there as well, and no other runs show it.

A held joint rings at sqrt(K/J_L), which is no resonance of one whose motor moves (its motor's anti-resonance lies there: the
torque hardly moves it, and a line from outside stands out). So a line is only doubted for what it explains in runs that ring
where it is.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from jointscope.diagnosis.gates import REAL
from jointscope.diagnosis.poles import joint_poles
from jointscope.diagnosis.search import name_of

if TYPE_CHECKING:
    from jointscope.diagnosis.adjudicate import Judged, Judgement

NEAR_RESONANCE = 0.04  # of that frequency, beside its half width


def only_at_resonance(judgement: Judgement, child: Judged, parent: Judged) -> bool:
    """Whether the child adds a line on a pole of the joint, and gains too little in the runs that do not ring there."""
    theta, effects = child.fit.coordinates.unpack(child.fit.x)
    poles = joint_poles(judgement.objective.problem, theta)
    lines = [a.values[0] for a in effects if a.spec.profiled and name_of(a.spec) not in parent.names]
    ringing = {
        moves
        for moves, (f, zeta) in poles.items()
        if any(abs(line / f - 1.0) < NEAR_RESONANCE + zeta for line in lines)
    }
    if not ringing:
        return False
    gains = 0.5 * np.concatenate([parent.fitted - child.fitted, parent.held_out - child.held_out])
    runs = (*judgement.objective.prepared, *judgement.held.prepared)
    elsewhere = sum(float(g) for run, g in zip(runs, gains, strict=True) if run.motor_moves not in ringing)
    return elsewhere < REAL
