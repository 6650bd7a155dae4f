"""A line by the order that carries it: a law with overtones, of which only one is there, is that one's sine.

The search tries a line as an overtone of a slower one. Where the slower one turns out to be nothing, the law's size is
nothing, and what it explains would be given up with it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from jointscope.diagnosis.coordinates import coordinates
from jointscope.diagnosis.effects import ActiveEffect
from jointscope.diagnosis.effects.periodic import HARMONIC, harmonics
from jointscope.diagnosis.refit import least_squares
from jointscope.diagnosis.search import Hypothesis, profile_loss

if TYPE_CHECKING:
    from jointscope.diagnosis.adjudicate import Judgement
    from jointscope.diagnosis.effects import EffectSpec

LEADING = 6  # sets of effects that are asked
CARRIES = 3.0  # times the slower line's amplitude, from which on an overtone is the line


def in_main_order(judgement: Judgement, specs: Sequence[EffectSpec]) -> list[Hypothesis]:
    """Those that explain most of the fitted runs and hold such a law, fitted with that one's sine in its place.

    Args:
        specs: The laws that may be named.
    """
    objective, found = judgement.objective, []
    first = {j.names: j for j in sorted(judgement.judged[1:], key=lambda j: -j.chi2)}
    leading = sorted(first.values(), key=lambda j: j.chi2)[:LEADING]
    for hypothesis in (j.hypothesis for j in leading):
        theta, effects = hypothesis.fit.coordinates.unpack(hypothesis.fit.x)
        turned = tuple(by_main_order(effect, specs) for effect in effects)
        if turned == effects:
            continue
        where = coordinates(objective.problem, tuple(effect.spec for effect in turned))
        fit = least_squares(objective, where, where.pack(theta, turned), iterations=8, tolerance=3e-3)
        found.append(Hypothesis(where.effects, fit, profile_loss(objective, fit.w)))
    return found


def by_main_order(effect: ActiveEffect, specs: Sequence[EffectSpec]) -> ActiveEffect:
    """The effect as the sine of its one overtone; itself where it is none, or its slowest line is there."""
    plain = effect.spec.variant.removesuffix(HARMONIC)
    own = (effect.spec.name, effect.spec.location, plain)
    sine = next((s for s in specs if (s.name, s.location, s.variant) == own), None)
    if plain == effect.spec.variant or sine is None:
        return effect
    slowest, *overtones = harmonics(effect.values)
    size, order, phase = max(overtones)
    if size < CARRIES * slowest[0]:
        return effect
    return ActiveEffect(sine, (size, order, math.remainder(phase, math.tau)))
