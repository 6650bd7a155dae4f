"""One mode, two names: an arm's outer part and a neighbour beyond it move alike where neither hammer nor sensor rides on them.

Where only encoders look, and nothing but the motor drives, what turns below the joint moves like them too: with a mount of
the share s and the frequency w, J_L q''/T_S = (p^2 (1 + s) + 2 zeta w p + w^2)/(p^2 + 2 zeta w p + w^2), which is that of a
part beyond the joint with the share s/(1 + s), at w/sqrt(1 + s) with zeta/sqrt(1 + s).

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
    from jointscope.diagnosis.adjudicate import Judged
    from jointscope.diagnosis.effects import EffectSpec
    from jointscope.diagnosis.effects.spec import Values
    from jointscope.diagnosis.problem import Problem
    from jointscope.diagnosis.refit import Fit

BETWEEN = 60.0  # Hz, below which a neighbour or a mount is the likelier, above which the arm
SLOWEST = 5.0  # Hz, below which nothing is known: no robot's arm, joint or mount is as soft
STEEPNESS = 6.0  # nats per factor e in frequency: three to one at 72 and at 50 Hz
BY_EYE = 0.1  # rad, to which an accelerometer is mounted upright
MOST = 4.0  # nats: nothing that is known beforehand is surer
OWNERS = {"link-flexibility": 0.5, "neighbour-flexibility": -0.5, "base-compliance": -0.5}  # share of the nats
BEYOND = "absorber"  # the neighbour's law
BELOW = "turning-mount"
TOLD = (
    " An outer part of the arm and a neighbour beyond it would move alike in these recordings; "
    "the mode's frequency alone says which of the two is the likelier."
)


def twins(problem: Problem, hypotheses: Sequence[Hypothesis]) -> list[Hypothesis]:
    """The same fits under the arm's name, of every hypothesis that has a neighbour beyond the sensors."""
    inboard = at_rig(INBOARD, problem)
    found = []
    for hypothesis in hypotheses:
        place = next((k for k, spec in enumerate(hypothesis.specs) if spec.variant == BEYOND), None)
        if place is None:
            continue
        specs = (*hypothesis.specs[:place], inboard, *hypothesis.specs[place + 1 :])
        if len(names_of(specs)) == len(specs):
            found.append(replace(hypothesis, specs=specs, fit=_renamed(problem, hypothesis.fit, specs, place)))
    return found


def each_once(judged: Sequence[Judged]) -> list[Hypothesis]:
    """The hypotheses as they stand, without second names of one fit."""
    fits: dict[int, Hypothesis] = {}
    for one in judged:
        fits.setdefault(id(one.fit.w), one.hypothesis)
    return list(fits.values())


def on_the_other_side(leader: ActiveEffect, spec: EffectSpec) -> Values | None:
    """Values of a part beyond the joint that an encoder sees move like the mount ``leader``, or the other way round."""
    if {leader.spec.variant, spec.variant} != {BELOW, BEYOND}:
        return None
    frequency, share, damping = leader.values
    if leader.spec.variant == BELOW:
        root = math.sqrt(1.0 + share)
        return frequency / root, share / (1.0 + share), damping / root
    root = 1.0 / math.sqrt(max(1.0 - share, 1e-3))
    return frequency * root, share * root**2, damping * root


def _renamed(problem: Problem, fit: Fit, specs: tuple[EffectSpec, ...], place: int) -> Fit:
    """The fit in the arm's parameters: inertia J_p = share J_L for the share, so dw/dJ_L at a fixed J_p differs."""
    before, after = fit.coordinates, coordinates(problem, specs)
    theta, effects = before.unpack(fit.x)
    frequency, share, damping = effects[place].values
    inertia = float(theta[BASE_INDEX["load_inertia"]])
    arm = ActiveEffect(specs[place], (frequency, share * inertia, damping))
    x = after.pack(theta, (*effects[:place], arm, *effects[place + 1 :]))
    physical = fit.jacobian / before.per_unit(fit.x)
    at_share = before.effect_slices()[place].start + 1
    for column, position in enumerate(before.free):
        if position == BASE_INDEX["load_inertia"]:
            physical[:, column] -= physical[:, at_share] * share / inertia
    physical[:, at_share] /= inertia
    return replace(fit, coordinates=after, x=x, jacobian=physical * after.per_unit(x))


def foreknown(effects: Sequence[ActiveEffect]) -> float:
    """Nats of belief in these modes' owners, by their frequency, and in these tilts, by their angle: first parameters both.

    On a level arm a tilt is seen by its cosine alone, which is a gain: 22 degrees would be 7 per cent.
    """
    owned = [
        (OWNERS[e.spec.name], e.values[0]) for e in effects if e.spec.name in OWNERS and e.values[0] > SLOWEST
    ]
    tilts = [e.values[0] for e in effects if e.spec.name == "sensor-tilt"]
    return sum(share * max(-MOST, min(MOST, STEEPNESS * math.log(hz / BETWEEN))) for share, hz in owned) - sum(
        min(MOST, 0.5 * (angle / BY_EYE) ** 2) for angle in tilts
    )


def told_by_frequency(law: str) -> str:
    """The sentence that a law of two owners owes its reader; empty for any other."""
    return TOLD if law in (BEYOND, INBOARD.variant) else ""
