"""What the recordings ask of a model, and one change of its file."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from jointscope.experiments.own_model.xml_document import Draft
from jointscope.sim.own_model import OwnJoint

Share = Literal["numerics", "parameters", "left-out", "contradicted"]
Interval = tuple[float, float] | None

SHARES: tuple[Share, ...] = ("numerics", "parameters", "left-out", "contradicted")


@dataclass(frozen=True, eq=False)
class Change:
    """One change of the file.

    Attributes:
        key: What it is about.
        share: Which part of the error it is to mend.
        reason: One sentence.
        edit: Makes it, in a draft that may hold others already.
        interval: 95 % interval of the new value, at the element; ``None`` where it is exact or no number.
        sigmas: By how many standard errors the old value is off; infinite where that says nothing.
        joint: The map's joint once the change is made, where it makes another one.
    """

    key: str
    share: Share
    reason: str
    edit: Callable[[Draft], None]
    interval: Interval = None
    sigmas: float = math.inf
    joint: OwnJoint | None = None


@dataclass(frozen=True)
class Wanted:
    """What the recordings ask for.

    Attributes:
        base: Base parameters at the joint output, by name.
        intervals: 95 % of those that were fitted.
        effects: Entries of ``model.json``, with the ``intervals`` of their parameters where known, and whether the
            diagnosis has ``named`` them or hands them on as what fits best.
        merged: Parameters that stand for a sum, by the name under which they were fitted.
        single, vertical: Kind of rig.
        spring: Whether the load sits on a spring (always so with a motor side).
        ratio, efficiency: n and eta.
    """

    base: Mapping[str, float]
    intervals: Mapping[str, tuple[float, float]]
    effects: tuple[Mapping[str, Any], ...]
    merged: frozenset[str]
    single: bool
    vertical: bool
    spring: bool
    ratio: float
    efficiency: float

    def find(self, *names: str, location: str | None = None) -> Mapping[str, Any] | None:
        """The first effect of one of these names."""
        return next((e for e in self.effects if e["effect"] in names and location in (None, e["location"])), None)

    @property
    def weight(self) -> complex:
        """M exp(i phi) of the gravity torque -M cos(q + phi), what was left out of it added [N m]."""
        moment = complex(self.base["gravity_moment"])
        gravity = self.find("gravity")
        if gravity is not None:
            p = gravity["parameters"]
            phase = p.get("phase") or 0.0
            moment += p["moment"] * complex(math.cos(phase), math.sin(phase))
        return moment


def interval_of(entry: Mapping[str, Any], name: str) -> Interval:
    found = entry.get("intervals", {}).get(name)
    return None if found is None or None in found else (float(found[0]), float(found[1]))
