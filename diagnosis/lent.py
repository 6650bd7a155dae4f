"""Numbers that a fitted law lends to trials of others: what both have, and what says the same in other terms."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from jointscope.diagnosis.effects import ActiveEffect
from jointscope.diagnosis.effects.periodic import PHASES
from jointscope.diagnosis.twins import on_the_other_side

WAYS = (
    "direction",
    "eccentricity",
)  # in each of which a carrier is tried, as nothing found in one posture tells them


def same_numbers(trials: Sequence[ActiveEffect], leader: ActiveEffect) -> list[ActiveEffect]:
    """Trials of each law with the leader's values of all parameters that both have: a mode stays where it was found."""
    known = {("asymmetry", "1"): 0.0}
    known.update(((p.name, p.unit), v) for p, v in zip(leader.spec.parameters, leader.values, strict=True))
    if ("soft_share", "1") in known:  # the play that leaves the same spring outside of a soft middle
        unit = next(
            p.unit for p in leader.spec.parameters if p.name == "transition_angle"
        )  # m where the axis slides
        known["gap", unit] = 2.0 * known["soft_share", "1"] * known["transition_angle", unit]
    known |= _bristles_and_loop(known)
    found: dict[tuple[object, ...], ActiveEffect] = {}
    for trial in trials:
        moved = on_the_other_side(leader, trial.spec)
        if moved is not None:
            found.setdefault((id(trial.spec), "moved"), ActiveEffect(trial.spec, moved))
        keys = [(p.name, p.unit) for p in trial.spec.parameters]
        if any(key in known for key in keys):
            values = _as_play(known, keys) or tuple(
                known.get(key, value) for key, value in zip(keys, trial.values, strict=True)
            )
            ways = tuple(v for (name, _), v in zip(keys, trial.values, strict=True) if name in WAYS)
            found.setdefault((id(trial.spec), ways), ActiveEffect(trial.spec, values))
            if trial.spec.family == "periodic" and trial.spec.name != leader.spec.name:
                for turn in PHASES:  # an angle's phase is not that of a torque with the same response
                    turned = (*values[:2], turn, *values[3:])
                    found.setdefault((id(trial.spec), turn), ActiveEffect(trial.spec, turned))
    return list(found.values())


def _as_play(known: Mapping[tuple[str, str], float], keys: Sequence[tuple[str, str]]) -> tuple[float, ...] | None:
    """The play that is a soft middle: as much is missed, as much is left; ``None`` where it is not asked for or known."""
    share, names = known.get(("soft_share", "1")), [name for name, _ in keys]
    if share is None or names[:1] != ["gap"] or not {"inside", "corner"} & set(names):
        return None
    width = 2.0 * known["transition_angle", keys[0][1]]
    if names[1] == "inside":
        return width, max(1.0 - share, 0.0)
    return width * share, math.sqrt(max(min(max(share, 0.5), 1.0) ** -2.0 - 1.0, 0.01)), 1.0


def _bristles_and_loop(known: Mapping[tuple[str, str], float]) -> dict[tuple[str, str], float]:
    """The angle over which friction builds up that bends like a loop of this torque and stiffness, and the reverse."""
    for force, angle in (("N m", "rad"), ("N", "m")):
        torque = known.get(("torque", force), 0.0)
        for (name, unit), other in ((("stiffness", f"{force}/{angle}"), ("presliding", angle)),
                                    (("presliding", angle), ("stiffness", f"{force}/{angle}"))):  # fmt: skip
            bend = known.get((name, unit), 0.0)
            if torque > 0.0 and bend > 0.0:
                return {other: torque / bend}
    return {}


def same_shape(trials: Sequence[ActiveEffect], leader: ActiveEffect) -> list[ActiveEffect]:
    """The trials of laws that have a shape's parameter of the leader's, with its value."""
    known = dict(zip((p.name for p in leader.spec.parameters[1:]), leader.values[1:], strict=True))
    return [
        ActiveEffect(t.spec, tuple(known.get(p.name, v) for p, v in zip(t.spec.parameters, t.values, strict=True)))
        for t in trials
        if any(p.name in known for p in t.spec.parameters)
    ]


def with_force(active: ActiveEffect, force: float) -> ActiveEffect:
    """The trial with this force, its other forces in proportion."""
    spec, values = active.spec, list(active.values)
    for place in spec.proportional:
        values[place] *= force / values[0] if values[0] else 1.0
    values[0] = force
    return ActiveEffect(spec, tuple(values))
