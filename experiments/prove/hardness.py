"""Is the hardness of a case, found by projection, what a full refit of its nearest rival finds?"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from jointscope.progress import track
from jointscope.sim.concealed import catalogue, strength
from jointscope.sim.concealed.draw import Order, draw_bench
from jointscope.sim.concealed.law import Effect, log_between

SHAPES = (
    "frequency",
    "yield",
    "knee",
    "stribeck_velocity",
    "width",
)  # a rival's further parameters that a fit frees


@dataclass(frozen=True)
class Check:
    """One case's discriminability, by projection and by refits of the nearest rival from several starts."""

    case: str
    truth: str
    rival: str
    projected: float
    refitted: float


def check(truth: Mapping[str, Any], order: Order) -> Check | None:
    """Refit the case's nearest rival; ``None`` where there is none."""
    if len(truth["effects"]) != 1 or not truth["strength"]["nearest"]:
        return None
    bench_seed = np.random.SeedSequence([order.seed, truth["index"]]).spawn(5)[1]
    bench = draw_bench(np.random.default_rng(bench_seed), order.draw)
    yard = strength.yardstick(bench.rig, bench.plan, bench.noise)
    known = truth["effects"][0]
    law = next(
        law for law in catalogue.LISTED + catalogue.UNLISTED
        if (law.effect, law.location, law.law) == (known["effect"], known["location"], known["law"])
    )  # fmt: skip
    effect = Effect(law, known["values"])
    nearest = truth["strength"]["nearest"]
    rng = np.random.default_rng([order.seed, truth["index"], 99])
    found = np.inf
    for rival in catalogue.laws("development"):
        if f"{rival.effect}@{rival.location}" != nearest or rival.departs or not rival.applies(bench.setting):
            continue
        low, high = rival.span(bench.setting)
        first = Effect(rival, rival.shape(bench.setting, rng)).scaled(log_between(low, high, 0.3))
        start = _matched(yard, effect, first)
        free = [name for name in SHAPES if name in start.values and name != rival.strength]
        found = min(found, strength.refitted(yard, (effect,), start, free))
    label = f"{known['effect']}@{known['location']}"
    return Check(truth["case"], label, nearest, float(truth["strength"]["z_d"]), float(found))


def _matched(yard: strength.Yardstick, truth: Effect, rival: Effect) -> Effect:
    """The rival at about the truth's size: one step in proportion."""
    r, _ = strength.residual(yard, (truth,))
    d = strength.direction(yard, rival)
    share = float(np.clip((d @ r) / max(float(d @ d), 1e-300), 0.02, 20.0))
    return rival.scaled(rival.values[rival.law.strength] * share)


def check_all(truths: Sequence[Mapping[str, Any]], order: Order, count: int) -> list[Check]:
    """Check the first ``count`` cases that have a rival and a z_d of 4 to 100."""
    fitting = [t for t in truths if t["kind"] == "single" and 4.0 <= t["strength"]["z_d"] <= 100.0]
    found: list[Check] = []
    for truth in track(fitting[:count], "refitting rivals", min(count, len(fitting))):
        one = check(truth, order)
        if one is not None:
            found.append(one)
    return found
