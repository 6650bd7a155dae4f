"""The effects of a case: drawn, scaled until they are as hard to name as wanted, held against their look-alikes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from jointscope.sim.concealed import catalogue, strength
from jointscope.sim.concealed.bench import Bench
from jointscope.sim.concealed.law import Draw, Effect, Law, Setting, log_between
from jointscope.sim.concealed.nearest import Rival, nearest_refit, rival_laws
from jointscope.sim.concealed.yardstick import Yardstick, yardstick

Real = NDArray[np.float64]
CaseKind = Literal["null", "single", "pair", "unlisted", "undecidable"]
EASIEST, HARDEST = 100.0, 4.5  # z_d that is aimed at
MATERIAL = 0.005
PLAIN = 100.0  # z_d above which a case is trivial
_TRIES = 3
_PAIRS = 3  # tries of two effects
_CARRIERS = {  # a mount and a neighbour under it: each is built, and sags, as if it carried the arm alone
    "base-compliance@base",
    "neighbour-flexibility@neighbour",
}
AMBIGUOUS = (
    "neighbour-flexibility", "base-compliance", "link-flexibility", "delay", "drive-lag", "torque-gain", "sensor-gain",
    "structural-damping", "coulomb-friction", "stribeck-friction", "payload", "clock-drift",
)  # fmt: skip
SHARED = (
    "frequency",
    "order",
    "per_output",
    "phase",
    "damping",
    "yield",
    "stribeck_velocity",
    "angle",
    "side",
    "sign",
)


def conceal(
    bench: Bench, kind: CaseKind, draw: Draw, rng: np.random.Generator
) -> tuple[tuple[Effect, ...], strength.Strength | None]:
    """The effects of a case, and how hard it is."""
    if kind == "null":
        return (), None
    yard = yardstick(bench.rig, bench.plan, bench.noise)
    target = log_between(HARDEST, EASIEST, float(rng.random()))
    if kind == "unlisted":
        return _single(bench, yard, _pool(bench, draw, unlisted=True), target, rng)
    pool = _pool(bench, draw, unlisted=False)
    if kind == "single":
        labels = sorted({f"{law.effect}@{law.location}" for law in pool})
        label = labels[int(rng.integers(len(labels)))]
        return _single(bench, yard, [law for law in pool if f"{law.effect}@{law.location}" == label], target, rng,
                       fallback=pool)  # fmt: skip
    if kind == "undecidable":
        return _undecidable(bench, yard, pool, rng)
    return _pair(bench, yard, pool, target, rng)


def _pool(bench: Bench, draw: Draw, *, unlisted: bool) -> list[Law]:
    fitting = [law for law in catalogue.laws(draw, unlisted=unlisted) if law.applies(bench.setting)]
    return fitting or [law for law in catalogue.laws(draw) if law.applies(bench.setting)]


def _start(law: Law, setting: Setting, rng: np.random.Generator) -> Effect:
    low, high = law.span(setting)
    return Effect(law, law.shape(setting, rng)).scaled(log_between(low, high, 0.5))


def _single(
    bench: Bench, yard: Yardstick, pool: Sequence[Law], target: float, rng: np.random.Generator,
    fallback: Sequence[Law] = (),
) -> tuple[tuple[Effect, ...], strength.Strength]:  # fmt: skip
    """One effect, scaled until z_d is about ``target`` (and the effect is material).

    What turns out indistinguishable from a rival after all is tried again with other numbers, at last with another law.
    """
    best: tuple[Effect, strength.Sight, dict[str, Rival], strength.Strength] | None = None
    for attempt in range(3):
        laws = pool if attempt < 2 or not fallback else fallback
        effect = _start(laws[int(rng.integers(len(laws)))], bench.setting, rng)
        try:
            sight = strength.look(yard, (effect,))
            rivals = held_against(yard, bench, effect, strength.projected(yard, sight), rng)
            effect, sight, measured = scale_to(yard, bench, effect, sight, rivals, target)
        except FloatingPointError:
            continue
        if _fits(measured, target):
            measured = _measured(yard, bench, sight, rivals)
            if _fits(measured, target):
                return (effect,), measured
        if best is None or _miss(measured, target) < _miss(best[3], target):
            best = effect, sight, rivals, measured
    if best is None:
        raise FloatingPointError(f"no law of {sorted({law.effect for law in pool})} can be simulated on this rig")
    return (best[0],), _measured(yard, bench, *best[1:3])


def _fits(measured: strength.Strength, target: float) -> bool:
    """Whether the case falls into a band: neither invisible, nor confused with a rival, nor plain to the eye."""
    return bool(measured.z >= 4.0 and min(4.0, target) <= measured.z_d <= 1.5 * PLAIN)


def _miss(measured: strength.Strength, target: float) -> float:
    return abs(float(np.log(max(measured.z_d, 1e-3) / target)))


def _undecidable(
    bench: Bench, yard: Yardstick, pool: Sequence[Law], rng: np.random.Generator
) -> tuple[tuple[Effect, ...], strength.Strength]:
    """An effect that is plain to see and can't be told from a rival with these channels; else the nearest to that."""
    doubtful = [law for law in pool if law.effect in AMBIGUOUS] or list(pool)
    best: tuple[tuple[Effect, ...], strength.Strength] | None = None
    for _ in range(4):
        effect = _start(doubtful[int(rng.integers(len(doubtful)))], bench.setting, rng)
        try:
            sight = strength.look(yard, (effect,))
            target = log_between(10.0, 60.0, float(rng.random()))
            effect, sight, _seen = scale_to(yard, bench, effect, sight, {}, target)
            rivals = held_against(yard, bench, effect, strength.projected(yard, sight), rng)
            measured = _measured(yard, bench, sight, rivals)
        except FloatingPointError:
            continue
        if best is None or measured.z_d / max(measured.z, 1e-9) < best[1].z_d / max(best[1].z, 1e-9):
            best = ((effect,), measured)
        if measured.z_d < 4.0 <= measured.z:
            break
    if best is None:
        raise FloatingPointError("none of the doubtful laws can be simulated on this rig")
    return best


def _measured(
    yard: Yardstick, bench: Bench, sight: strength.Sight, rivals: Mapping[str, Rival]
) -> strength.Strength:
    """z and z_d against the refitted base, the nearest rivals and the base fitted to this case."""
    r = strength.refitted_base(yard, sight)
    measured = strength.graded(yard, r, sight.record, {name: rival.directions for name, rival in rivals.items()})
    if not measured.nearest:
        return measured
    found = nearest_refit(yard, bench, sight, r, rivals)
    return replace(measured, z_d=found.z_d, nearest=found.rival) if found.z_d < measured.z_d else measured


def _like(effect: Effect, law: Law, setting: Setting, rng: np.random.Generator) -> Effect:
    """A rival with the effect's own frequency, order, ... where it has such a parameter too."""
    low, high = law.span(setting)
    first = Effect(law, law.shape(setting, rng)).scaled(log_between(low, high, 0.4))
    shared = {
        name: value for name, value in effect.values.items()
        if name in first.values and name != law.strength and name in SHARED
    }  # fmt: skip
    return Effect(law, {**first.values, **shared})


def scale_to(
    yard: Yardstick, bench: Bench, effect: Effect, sight: strength.Sight, rivals: Mapping[str, Rival],
    target: float,
) -> tuple[Effect, strength.Sight, strength.Strength]:  # fmt: skip
    """Change the effect's strength within its law's limits until z_d is near ``target``, the base refitted linearly."""
    low, high = effect.law.span(bench.setting)
    share = 0.5
    tried: list[tuple[float, float]] = []
    against = {name: rival.directions for name, rival in rivals.items()}
    measured = strength.graded(yard, strength.projected(yard, sight), sight.record, against)
    for _ in range(_TRIES):
        wanted = target * max(1.0, MATERIAL / max(measured.materiality, 1e-9)) if target > 4.0 else target
        wanted = min(wanted, 10.0 * target)
        if 0.6 < measured.z_d / wanted < 1.6:
            break
        tried.append((share, np.log(max(measured.z_d, 1e-6))))
        new = _next_share(tried, float(np.log(wanted)), abs(float(np.log(high / low))))
        if abs(new - share) < 0.01:
            break
        share = new
        effect = effect.scaled(log_between(low, high, share))
        sight = strength.look(yard, (effect,))
        measured = strength.graded(yard, strength.projected(yard, sight), sight.record, against)
    return effect, sight, measured


def _next_share(tried: Sequence[tuple[float, float]], wanted: float, decades: float) -> float:
    """A secant step on log z_d against the share of the law's range; the first assumes proportion."""
    share, got = tried[-1]
    slope = decades
    if len(tried) > 1 and tried[-1][0] != tried[-2][0]:
        slope = (tried[-1][1] - tried[-2][1]) / (tried[-1][0] - tried[-2][0])
        slope = float(np.clip(slope, 0.4 * decades, 4.0 * decades))
    return float(np.clip(share + (wanted - got) / slope, 0.0, 1.0))


def held_against(
    yard: Yardstick, bench: Bench, effect: Effect, r: Real, rng: np.random.Generator
) -> dict[str, Rival]:
    """The look-alikes of ``effect``, which leaves ``r``; the three that come nearest in one more shape and size."""
    pools = {rival: laws for rival in catalogue.rivals(effect.label) if (laws := rival_laws(bench, rival))}
    found: dict[str, Rival] = {}
    for rival, laws in pools.items():
        alike = _like(effect, laws[int(rng.integers(len(laws)))], bench.setting, rng)
        found[rival] = Rival(alike, strength.direction(yard, alike)[:, None])
    nearest = sorted(found, key=lambda rival: strength.left_over(r, found[rival].directions))[:3]
    for rival in nearest:
        another = _direction(yard, bench, pools[rival], float(rng.uniform(0.2, 0.8)), rng)
        found[rival] = replace(found[rival], directions=np.column_stack([found[rival].directions, another]))
    return found


def _direction(yard: Yardstick, bench: Bench, laws: Sequence[Law], share: float, rng: np.random.Generator) -> Real:
    law = laws[int(rng.integers(len(laws)))]
    low, high = law.span(bench.setting)
    effect = Effect(law, law.shape(bench.setting, rng)).scaled(log_between(low, high, share))
    return strength.direction(yard, effect)


def _pair(
    bench: Bench, yard: Yardstick, pool: Sequence[Law], target: float, rng: np.random.Generator
) -> tuple[tuple[Effect, ...], strength.Strength]:
    """Two effects, in two cases out of three look-alikes of each other, each hard to do without.

    A pair of which either alone explains everything, once its shape and the base follow, is tried again.
    """
    best: tuple[tuple[Effect, ...], strength.Strength] | None = None
    for _ in range(_PAIRS):
        try:
            chosen = _two(bench, yard, pool, target, rng)
            measured = without_either(yard, bench, chosen)
        except FloatingPointError:
            continue
        if best is None or _miss(measured, target) < _miss(best[1], target):
            best = chosen, measured
        if _fits(measured, target):
            break
    if best is None:
        raise FloatingPointError("no two laws can be simulated together on this rig")
    return best


def _partners(first: str, labels: Sequence[str]) -> list[str]:
    """Those of ``labels`` that may be concealed beside ``first``."""
    return [label for label in labels if label != first and {first, label} != _CARRIERS]


def _two(
    bench: Bench, yard: Yardstick, pool: Sequence[Law], target: float, rng: np.random.Generator
) -> tuple[Effect, ...]:
    labels = sorted({f"{law.effect}@{law.location}" for law in pool})
    first = labels[int(rng.integers(len(labels)))]
    beside = _partners(first, labels)
    alike = [label for label in catalogue.rivals(first) if label in beside]
    others = alike if alike and rng.random() < 0.66 else beside
    second = others[int(rng.integers(len(others)))]
    chosen: list[Effect] = []
    for label in (first, second):
        laws = [law for law in pool if f"{law.effect}@{law.location}" == label]
        effect = _start(laws[int(rng.integers(len(laws)))], bench.setting, rng)
        aim = target * float(np.exp(rng.uniform(0.3, 1.2)))
        effect, _, _ = scale_to(yard, bench, effect, strength.look(yard, (effect,)), {}, aim)
        chosen.append(effect)
    return tuple(chosen)


def without_either(yard: Yardstick, bench: Bench, effects: Sequence[Effect]) -> strength.Strength:
    """z of effects together, and as z_d what is left where only one of them is named, refitted in each of its laws."""
    alone = {e.label: Rival(e, strength.direction(yard, e)[:, None]) for e in effects}
    return _measured(yard, bench, strength.look(yard, effects), alone)
