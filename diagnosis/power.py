"""What could not have been seen: for every effect that was not found, the size that these recordings would have revealed.

An effect shows at 80 % where it clears every gate of ``adjudicate`` (see ``visibility``). Sizes are taken at finite
amplitudes, since play and friction do not grow in proportion, and interpolated.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from jointscope.diagnosis.effects import ActiveEffect, EffectSpec
from jointscope.diagnosis.visibility import Yard, clearance, seen, yard_of

if TYPE_CHECKING:
    from jointscope.diagnosis.adjudicate import Judged, Judgement
    from jointscope.diagnosis.problem import Problem

PASSES = 3  # steps of the interpolation
SHORT = (
    -0.25
)  # logarithm of what is cleared over what is asked at the size nearest to it, below which none is stated
REACH = 100.0  # times beyond the catalogue's small and large sizes that a size is sought


@dataclass(frozen=True)
class Unseen:
    """The smallest visible size of one effect.

    Attributes:
        parameter, unit: Of the effect's amplitude.
        size: Value of it that would have been revealed in 80 % of repetitions; ``None`` where no size within reach
            would have been.
        shape: The other parameters, for which it holds.
        limited_by: ``noise`` or ``materiality``.
        reason: Why these recordings cannot show the effect at all, else ``None``.
    """

    effect: str
    location: str
    law: str
    parameter: str
    unit: str
    size: float | None
    shape: dict[str, float]
    limited_by: str
    reason: str | None

    @property
    def sentence(self) -> str:
        """In units of the laboratory."""
        where = f"{self.effect.replace('-', ' ')} at the {self.location}"
        if self.effect in ("delay", "clock-drift", "torque-logging") or self.location == "acquisition":
            where = self.effect.replace("-", " ")
        if self.reason is not None:
            return f"{where}: cannot be seen here, {self.reason}"
        if self.size is None:
            return f"{where}: no size within reach of the rig would have shown here"
        return f"{where}: {_bound(self.effect, self.parameter, self.unit, self.size)} can't be seen here"


def _bound(effect: str, parameter: str, unit: str, size: float) -> str:
    if parameter == "gain":
        return f"less than {100.0 * abs(size - 1.0):.2g} % off"
    above = effect in ("sensor-resonance", "sensor-saturation", "torque-logging")
    word = "above" if above else "below"
    if unit == "rad" and effect != "sensor-tilt":
        return f"{parameter} {word} {size * 180.0 / math.pi * 60.0:.2g} arcmin"
    if unit == "rad":
        return f"{parameter} {word} {size * 180.0 / math.pi:.2g} deg"
    if unit == "s":
        return f"{parameter.replace('_', ' ')} {word} {1e3 * size:.2g} ms"
    if unit == "1":
        return f"{parameter.replace('_', ' ')} {word} {100.0 * size:.2g} %"
    return f"{parameter.replace('_', ' ')} {word} {size:.3g} {unit}"


def _departure(spec: EffectSpec, value: float) -> float:
    """Distance from the null value; the inverse where the effect vanishes at infinity."""
    null = spec.parameters[spec.amplitude].null
    if null is None:
        return abs(value)
    return 1.0 / value if math.isinf(null) else abs(value - null)


def _value(spec: EffectSpec, departure: float) -> float:
    null = spec.parameters[spec.amplitude].null
    if null is None:
        return departure
    return 1.0 / departure if math.isinf(null) else null + departure


def _farthest(spec: EffectSpec) -> float:
    """Departure beyond which no fit goes."""
    main = spec.parameters[spec.amplitude]
    null = main.null or 0.0
    return _departure(spec, main.lower if math.isinf(null) else main.upper)


def values_at(spec: EffectSpec, shape: tuple[float, ...], amplitude: float, problem: Problem) -> tuple[float, ...]:
    """The effect's parameters at an amplitude; those of the amplitude's own unit (a breakaway torque) go with it."""
    main, medium = spec.parameters[spec.amplitude], spec.scale(problem)[1]
    others = [p for k, p in enumerate(spec.parameters) if k != spec.amplitude]
    grown = [
        v * amplitude / medium if p.unit == main.unit and p.unit not in ("1", "rad") else v
        for v, p in zip(shape, others, strict=True)
    ]
    return tuple(float(v) for v in (*grown[: spec.amplitude], amplitude, *grown[spec.amplitude :]))


def smallest_visible(
    yard: Yard, spec: EffectSpec, shape: tuple[float, ...], problem: Problem
) -> tuple[float | None, str]:
    """(amplitude that shows in 80 % of repetitions, what limits it); the amplitude is ``None`` beyond reach."""
    scale = [_departure(spec, v) for v in spec.scale(problem)]
    low, high = scale[0] / REACH, min(scale[2] * REACH, _farthest(spec))

    def margin(departure: float) -> tuple[float, str]:
        active = ActiveEffect(spec, values_at(spec, shape, _value(spec, departure), problem))
        clear, limit = clearance(yard, spec, seen(yard, active))
        return math.log(max(clear, 1e-9)), limit

    points: list[tuple[float, float, str]] = []
    for departure in (scale[0], scale[2]):
        g, limit = margin(departure)
        points.append((math.log(departure), g, limit))
    for _ in range(PASSES):
        points.sort()
        below = [p for p in points if p[1] < 0.0]
        above = [p for p in points if p[1] >= 0.0]
        if below and above:
            a, b = below[-1], next((p for p in above if p[0] > below[-1][0]), above[-1])
        else:
            a, b = (points[0], points[1]) if above else (points[-2], points[-1])
        start = a if abs(a[1]) < abs(b[1]) else b
        u = float(np.clip(start[0] - start[1] / _slope(a, b), math.log(low), math.log(high)))
        g, limit = margin(math.exp(u))
        points.append((u, g, limit))
        if abs(g) < 0.1:
            break
    nearest = min(points, key=lambda p: abs(p[1]))
    if nearest[1] < SHORT:
        return None, nearest[2]
    other = min((p for p in points if p is not nearest), key=lambda p: abs(p[1]))
    departure = math.exp(nearest[0] - nearest[1] / _slope(nearest, other))
    return (None if departure > high else _value(spec, departure)), nearest[2]


def _slope(a: tuple[float, float, str], b: tuple[float, float, str]) -> float:
    """d ln(clearance)/d ln(departure) between two points, within what a root is sought with."""
    slope = (b[1] - a[1]) / (b[0] - a[0]) if b[0] != a[0] else 1.0
    return float(np.clip(slope if math.isfinite(slope) else 1.0, 0.3, 4.0))


def unseen(
    problem: Problem, judgement: Judgement, judged: Judged, specs: Sequence[EffectSpec], pool: ThreadPoolExecutor
) -> tuple[Unseen, ...]:
    """Every effect of the catalogue that is not in ``judged``, under its plainest law, in the catalogue's order."""
    first: dict[tuple[str, str], EffectSpec] = {}
    for spec in specs:
        known = first.get((spec.name, spec.location))
        if known is None or (known.possible(problem) is not None and spec.possible(problem) is None):
            first[spec.name, spec.location] = spec
    yard = yard_of(judgement, judged)

    def one(spec: EffectSpec) -> Unseen:
        parameter = spec.parameters[spec.amplitude]
        reason = spec.possible(problem)
        size: float | None = None
        limit, shape = "", tuple[float, ...]()
        if reason is None:
            starts = spec.starts(problem)
            shape = starts[len(starts) // 2] if starts else ()
            size, limit = smallest_visible(yard, spec, shape, problem)
        return Unseen(
            spec.name, spec.location, spec.variant, parameter.name, parameter.unit, size,
            {} if size is None else _named(spec, values_at(spec, shape, size, problem)), limit, reason,
        )  # fmt: skip

    missing = [s for key, s in first.items() if f"{key[0]}@{key[1]}" not in judged.names]
    return tuple(pool.map(one, missing))


def _named(spec: EffectSpec, values: tuple[float, ...]) -> dict[str, float]:
    return {p.name: v for k, (p, v) in enumerate(zip(spec.parameters, values, strict=True)) if k != spec.amplitude}


def unseen_json(found: Sequence[Unseen]) -> list[dict[str, Any]]:
    """``not_seen`` of diagnosis.json."""
    return [
        {
            "effect": u.effect, "location": u.location, "law": u.law, "parameter": u.parameter, "size": u.size,
            "unit": u.unit, "for": u.shape, "limited_by": u.limited_by or None, "reason": u.reason, "sentence": u.sentence,
        }
        for u in found
    ]  # fmt: skip
