r"""A torque's gain and a weight that is stated too small are nearly one: each is also tried where the other leads.

Of an arm that a torque moves, with a weight M cos q that the nameplate states, a torque that is logged too large by 1/g says

    J qdd + b qd + F + M cos q = g T    or    (J qdd + b qd + F + M cos q) / g = T,

the second of which is another arm, its inertia, damping and friction 1/g as large, with a weight of M (1/g - 1) beside the
stated one. Only a motor's stated inertia and a spring's wind-up tell them apart, by little of what either explains. From the
base the weight is sought at the friction's and the inertia's size that fit without it, a valley that a search does not leave;
from the gain's optimum the weight's is known.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from jointscope.diagnosis.coordinates import coordinates
from jointscope.diagnosis.effects import ActiveEffect
from jointscope.diagnosis.refit import least_squares
from jointscope.diagnosis.search import Hypothesis, name_of, profile_loss

if TYPE_CHECKING:
    from jointscope.diagnosis.effects import EffectSpec
    from jointscope.diagnosis.objective import Objective

GAIN, WEIGHT = "torque-gain@motor", "gravity@load"
ALONG = ("stiffness", "damping", "load_inertia", "motor_damping", "load_damping", "torque_offset")
ITERATIONS, SIMULATIONS = 30, 200


def gain_or_weight(
    objective: Objective, leading: Sequence[Hypothesis], candidates: Sequence[ActiveEffect]
) -> list[Hypothesis]:
    """Those of ``leading`` that hold one of the two, with the other in its place and all else to scale.

    Args:
        candidates: Trials of every law.

    Returns:
        Nothing where no weight is stated, or where the weight is one of the base's free parameters.
    """
    names = objective.problem.base.names
    place = names.index("gravity_moment") if "gravity_moment" in names else None
    if place is None or objective.problem.base.start[place] == 0.0:
        return []
    stated = float(objective.problem.base.start[place])
    laws: dict[str, EffectSpec] = {}
    for c in candidates:
        if name_of(c.spec) in (GAIN, WEIGHT) and len(c.spec.parameters) == 1:
            laws.setdefault(name_of(c.spec), c.spec)
    if len(laws) < 2:
        return []
    found = []
    for h in leading:
        held = [k for k, spec in enumerate(h.specs) if spec in laws.values()]
        if len(held) == 1 and not (GAIN in h.names and WEIGHT in h.names):
            other = _swapped(objective, h, held[0], laws, stated)
            found.extend([] if other is None else [other])
    return found


def _swapped(
    objective: Objective, h: Hypothesis, position: int, laws: dict[str, EffectSpec], stated: float
) -> Hypothesis | None:
    """``None`` where the whole weight is none or turned round, or the gain beyond its bounds: no gain makes up for that."""
    theta, effects = h.fit.coordinates.unpack(h.fit.x)
    value = effects[position].values[0]
    gain = laws[GAIN].parameters[0]
    if name_of(h.specs[position]) == GAIN:
        scale = 1.0 / value
        instead = ActiveEffect(laws[WEIGHT], (stated * (scale - 1.0),))
    elif gain.lower * (1.0 + value / stated) <= 1.0 <= gain.upper * (1.0 + value / stated):
        scale = stated / (stated + value)
        instead = ActiveEffect(laws[GAIN], (scale,))
    else:
        return None
    names = objective.problem.base.names
    for k in h.fit.coordinates.free:
        if names[k] in ALONG:
            theta[k] *= scale
    changed = tuple(instead if k == position else _at_scale(e, scale) for k, e in enumerate(effects))
    where = coordinates(objective.problem, tuple(e.spec for e in changed))
    x = where.pack(theta, changed)
    fit = least_squares(objective, where, x, iterations=ITERATIONS, tolerance=1e-3, simulations=SIMULATIONS)
    return Hypothesis(where.effects, fit, profile_loss(objective, fit.w))


def _at_scale(effect: ActiveEffect, scale: float) -> ActiveEffect:
    """An effect ``scale`` times as strong: what is a torque, or a torque per something, or an inertia, at the same motion."""
    values = tuple(
        value * scale if parameter.unit.startswith(("N", "kg")) else value
        for parameter, value in zip(effect.spec.parameters, effect.values, strict=True)
    )
    return ActiveEffect(effect.spec, values)
