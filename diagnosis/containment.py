"""Laws that contain another one: whether two sets differ by such a pair, and whether the wider law is left open by the data."""

from __future__ import annotations

import math

from jointscope.diagnosis.adjudicate import Judged, Judgement, compare
from jointscope.diagnosis.effects.postures import APART
from jointscope.diagnosis.search import CONTAINED
from jointscope.diagnosis.uncoupling import is_mount

TURNING = ("base-compliance", "link-flexibility")  # a bend that is followed as a mount is holds the mount
MOUNTS = ("base-compliance", "neighbour-flexibility")
WIDER = (*CONTAINED, MOUNTS)  # law, and one that contains it
NOT_EXCLUDED = 6.0  # nats that a law which contains another may be behind it, its own numbers in range


def _exchanged(outer: Judged, inner: Judged) -> tuple[tuple[str, str], tuple[str, str]] | None:
    """(narrow, wide) and (its place, that of the wide one), where the sets differ by one law only."""
    more, less = set(outer.names) - set(inner.names), set(inner.names) - set(outer.names)
    if len(more) != 1 or len(less) != 1:
        return None
    (wide, place), (narrow, at) = (next(iter(x)).split("@") for x in (more, less))
    return (narrow, wide), (at, place)


def contains(outer: Judged, inner: Judged) -> bool:
    """Whether the sets differ by one law only, and that of ``outer`` contains that of ``inner``."""
    exchanged = _exchanged(outer, inner)
    if exchanged is None:
        return False
    laws, (at, place) = exchanged
    if laws == TURNING:
        return is_mount(outer.hypothesis)
    carries = any(spec.variant.startswith("carrier") for spec in outer.hypothesis.specs)
    return laws in WIDER and (place == at or (laws[1] == "neighbour-flexibility" and carries))


def holds(outer: Judged, inner: Judged) -> bool:
    """Whether the sets differ by one law, of which the outer one is the inner one at the edge of its range."""
    exchanged = _exchanged(outer, inner)
    return exchanged is not None and exchanged[0] in CONTAINED and exchanged[1][0] == exchanged[1][1]


def left_open(judgement: Judgement, inner: Judged, names: tuple[str, ...]) -> bool:
    """Whether a law that contains the leading one explains about as much with numbers by which it is another law.

    The data are then silent on which it is, whatever its further parameters cost.
    """
    likely = (j for j in judgement.judged if j.names == names and j.hypothesis.sensible and holds(j, inner))
    return any(_lead(judgement, inner, j) > -NOT_EXCLUDED for j in likely)


def unowned(judgement: Judgement, inner: Judged, outer: Judged) -> bool:
    """Whether hits in one posture show a mode that a mount and a neighbour would have alike: nobody can say whose it is.

    A neighbour about the joint's own axis is a mount that turns; what drives the motor would be felt by the mount alone.
    """
    exchanged = _exchanged(outer, inner)
    if exchanged is None or exchanged[0] != MOUNTS:
        return False
    runs = judgement.objective.problem.runs
    postures = [run.initial_angle for run in runs]
    hit = all(run.spring and run.run.experiment == "hammer" for run in runs)
    return hit and max(postures) - min(postures) < APART and _lead(judgement, inner, outer) > -NOT_EXCLUDED


def _lead(judgement: Judgement, parent: Judged, child: Judged) -> float:
    """What the child's likelihood is ahead, fitted and held out [nats]."""
    found = compare(judgement, parent, child)
    held = 0.0 if math.isnan(found.held_gain) else found.held_gain + child.occam_held - parent.occam_held
    return found.gain + child.occam - parent.occam + held
