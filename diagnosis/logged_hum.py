"""Hum of the mains in a torque log acts on nothing and is the recording's own, as it is in an accelerometer (``mains``).

A line in the log at which the joint stands still is a ripple folded by a slow log, unless it stands at the mains' own
frequency or a multiple: that is what any log picks up. It is said as a finding, and nothing is named for it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from jointscope.diagnosis.mains import KEPT_TO, MAINS, MULTIPLES
from jointscope.diagnosis.verdict import adequacy_of, nothing_named

if TYPE_CHECKING:
    from jointscope.diagnosis.effects import ActiveEffect
    from jointscope.diagnosis.pipeline import Diagnosis

FOLDED = ("torque-logging", "folded")


def mains_line(effects: tuple[ActiveEffect, ...]) -> float | None:
    """Frequency [Hz] of the mains' line that is all that these effects say of a torque log, or ``None``."""
    if len(effects) != 1 or (effects[0].spec.name, effects[0].spec.variant) != FOLDED:
        return None
    line = effects[0].values[[p.name for p in effects[0].spec.parameters].index("line")]
    known = [k * mains for mains in MAINS for k in range(1, MULTIPLES + 1)]
    return line if any(abs(line - f) < KEPT_TO * f for f in known) else None


def without_logged_hum(diagnosis: Diagnosis) -> Diagnosis:
    """The same, where hum in the torque log is all that was named, with nothing named and a finding."""
    decision = diagnosis.decision
    if decision.verdict != "effects":
        return diagnosis
    line = mains_line(decision.chosen.fit.coordinates.unpack(decision.chosen.fit.x)[1])
    if line is None:
        return diagnosis
    said = f"hum of {line:.2f} Hz, a multiple of the mains', in the torque log: it moves nothing and is the recording's own"
    problem = replace(diagnosis.problem, findings=(*diagnosis.problem.findings, said))
    base = diagnosis.judgement.base
    bare = replace(nothing_named(decision, base), adequacy=adequacy_of(diagnosis.judgement, base))
    return replace(diagnosis, problem=problem, decision=bare)
