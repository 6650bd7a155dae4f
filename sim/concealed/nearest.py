"""The rivals of a case that come nearest, each of their textbook laws refitted together with the base.

A rival that is far off to first order may come near when its shape and the base follow: Coulomb friction in the place of
Stribeck's, say. So the distance of the nearest few is what a full refit leaves, not what a projection does.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from jointscope.sim.concealed import catalogue, strength
from jointscope.sim.concealed.bench import Bench
from jointscope.sim.concealed.law import Effect, Law
from jointscope.sim.concealed.rival_fit import refitted
from jointscope.sim.concealed.yardstick import Yardstick

Real = NDArray[np.float64]

NEAREST: Final = 3  # rivals refitted
LAWS: Final = 3  # of each
SHAPES: Final = (
    "frequency",
    "yield",
    "knee",
    "stribeck_velocity",
    "width",
    "damping",
    "presliding",
)  # free in a fit
BEYOND: Final = 3.0  # times a law's range, within which its strength may end


@dataclass(frozen=True, eq=False)
class Rival:
    """A look-alike as it is held against an effect.

    Attributes:
        effect: With the effect's own frequency, order, ... where it has such a parameter too.
        directions: What it adds, off the base's tangents, first as ``effect``, shape (n, m).
    """

    effect: Effect
    directions: Real


@dataclass(frozen=True)
class Refits:
    """What is left of a case by the rival that comes nearest.

    Attributes:
        rival: ``name@location``.
        z_d: Its distance [-].
        fits: How many refits were done.
    """

    rival: str
    z_d: float
    fits: int


def rival_laws(bench: Bench, label: str) -> list[Law]:
    """Textbook laws of ``label`` that the case's experiments can show."""
    return [
        law for law in catalogue.laws("development")
        if f"{law.effect}@{law.location}" == label and not law.departs and law.applies(bench.setting)
    ]  # fmt: skip


def nearest_refit(
    yard: Yardstick, bench: Bench, sight: strength.Sight, r: Real, rivals: Mapping[str, Rival]
) -> Refits:
    """Refit the ``rivals`` (at least one) that are nearest to first order, in each of their laws."""
    near = sorted(rivals, key=lambda name: strength.left_over(r, rivals[name].directions))[:NEAREST]
    best, fits = Refits(near[0], np.inf, 0), 0
    for name in near:
        for start in _starts(yard, bench, r, name, rivals[name]):
            fits += 1
            left = _refitted(yard, bench, sight, start)
            if left < best.z_d:
                best = Refits(name, left, fits)
    return Refits(best.rival, best.z_d, fits)


def _starts(yard: Yardstick, bench: Bench, r: Real, name: str, rival: Rival) -> list[Effect]:
    """The rival in each of its laws that this case admits, at about the size of ``r``."""
    others = [law for law in rival_laws(bench, name) if law != rival.effect.law]
    rng = np.random.default_rng(7)
    starts = [rival.effect] + [
        Effect(law, {**law.shape(bench.setting, rng), **_shared(rival, law.strength)}) for law in others
    ]
    return [_matched(yard, bench, r, start) for start in starts[:LAWS]]


def _shared(rival: Rival, strength_name: str) -> dict[str, float]:
    values = rival.effect.values
    shared = {name: values[name] for name in SHAPES if name in values}
    if strength_name in values:
        shared[strength_name] = values[strength_name]
    return shared


def _matched(yard: Yardstick, bench: Bench, r: Real, rival: Effect) -> Effect:
    low, high = sorted(rival.law.span(bench.setting))
    rival = rival.scaled(float(np.clip(rival.values.get(rival.law.strength, np.sqrt(low * high)), low, high)))
    d = strength.direction(yard, rival)
    share = float(d @ r) / max(float(d @ d), 1e-300)
    return rival.scaled(float(np.clip(share * rival.values[rival.law.strength], low, high)))


def _refitted(yard: Yardstick, bench: Bench, sight: strength.Sight, start: Effect) -> float:
    free = [name for name in SHAPES if name in start.values and name != start.law.strength]
    low, high = sorted(start.law.span(bench.setting))
    return refitted(yard, sight, start, free, (low / BEYOND, BEYOND * high))
