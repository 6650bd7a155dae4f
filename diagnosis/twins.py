"""One mode, two names: an arm's outer part and a neighbour beyond it move alike where neither hammer nor sensor rides on them.

Each such hypothesis is given both names. No recording of this kind tells them apart, so what is known of such modes
does: the arms of industrial robots bend at 60-250 Hz, their joints and mounts give at 8-60 Hz.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from jointscope.diagnosis.assembly import BASE_INDEX
from jointscope.diagnosis.coordinates import coordinates
from jointscope.diagnosis.effects import ActiveEffect, at_rig
from jointscope.diagnosis.effects.modes import INBOARD
from jointscope.diagnosis.search import Hypothesis, names_of

if TYPE_CHECKING:
    from jointscope.diagnosis.effects import EffectSpec
    from jointscope.diagnosis.objective import Objective

BETWEEN = 60.0  # Hz, below which a neighbour or a mount is the likelier, above which the arm
STEEPNESS = 6.0  # nats per factor e in frequency: three to one at 72 and at 50 Hz
MOST = 4.0  # nats: nothing that is known beforehand is surer
ARM, AROUND = ("link-flexibility",), ("neighbour-flexibility", "base-compliance")


def twins(objective: Objective, hypotheses: Sequence[Hypothesis]) -> list[Hypothesis]:
    """The same fits under the arm's name, of every hypothesis that has a neighbour beyond the sensors."""
    found = []
    inboard = at_rig(INBOARD, objective.problem)
    for hypothesis in hypotheses:
        theta, effects = hypothesis.fit.coordinates.unpack(hypothesis.fit.x)
        specs = tuple(inboard if s.variant == "absorber" else s for s in hypothesis.specs)
        if specs == hypothesis.specs or len(names_of(specs)) < len(specs):
            continue
        named = tuple(
            _as_the_arm(effect, inboard, float(theta[BASE_INDEX["load_inertia"]])) if spec is inboard else effect
            for spec, effect in zip(specs, effects, strict=True)
        )
        where = coordinates(objective.problem, specs)
        x = where.pack(theta, named)
        w = objective.residual(x, where)
        fit = replace(
            hypothesis.fit, coordinates=where, x=x, w=w,
            jacobian=objective.columns(x, where, w, range(where.n)), fresh=True,
        )  # fmt: skip
        found.append(replace(hypothesis, specs=specs, fit=fit))
    return found


def _as_the_arm(effect: ActiveEffect, inboard: EffectSpec, inertia: float) -> ActiveEffect:
    frequency, share, damping = effect.values
    return ActiveEffect(inboard, (frequency, share * inertia, damping))


def foreknown(effects: Sequence[ActiveEffect]) -> float:
    """Nats of belief in these modes' owners that their frequencies give by themselves."""
    nats = 0.0
    for effect in effects:
        above = max(-MOST, min(MOST, STEEPNESS * math.log(effect.values[0] / BETWEEN))) if _owned(effect) else 0.0
        nats += 0.5 * above if effect.spec.name in ARM else -0.5 * above
    return nats


def _owned(effect: ActiveEffect) -> bool:
    return effect.spec.name in (*ARM, *AROUND) and effect.spec.parameters[0].name == "frequency"
