"""A concealed law at a size stated under the contract's name: strengths are each law's own, sizes are the explainer's."""

from __future__ import annotations

import numpy as np

from jointscope.diagnosis.power import Unseen
from jointscope.sim.concealed.law import Effect, Law, Setting


def departure(name: str, value: float) -> float:
    """How far a main parameter is from nothing."""
    return abs(value - 1.0) if name == "gain" else abs(value)


def sized(law: Law, setting: Setting, said: Unseen, factor: float, rng: np.random.Generator) -> Effect | None:
    """The concealed law at ``factor`` times the stated size; ``None`` where its parameters are others."""
    values = law.shape(setting, rng)
    values.update({name: v for name, v in said.shape.items() if name in values and name != law.strength})
    low, high = law.span(setting)
    effect = Effect(law, values).scaled(float(np.sqrt(low * high)))
    assert said.size is not None
    for _ in range(6):
        now = effect.reported(setting)
        if said.parameter not in now or departure(said.parameter, now[said.parameter]) <= 0.0:
            return None
        wanted = departure(said.parameter, said.size)
        wanted = wanted / factor if low > high else wanted * factor
        ratio = wanted / departure(said.parameter, now[said.parameter])
        if abs(np.log(ratio)) < 1e-3:
            return effect
        strength = effect.values[law.strength]
        if law.strength == "gain":
            effect = effect.scaled(1.0 + (strength - 1.0) * ratio)
        else:
            effect = effect.scaled(strength * ratio)
    reached = effect.reported(setting)[said.parameter]
    return effect if abs(np.log(departure(said.parameter, reached) / wanted)) < 0.05 else None
