r"""What could not have been seen: for every effect that was not found, the size that these recordings would have revealed.

An effect of amplitude a changes the outputs by y(theta, a) - y(theta); the refit of the base (and of what was found)
takes away what it can, and what is left is judged by the gates of ``adjudicate``. With P the projection off the refit,

    z(a) = |P L^-1 [y(theta + dtheta, a) - y(theta)]|,      s(a) = rms of the same in a channel over its signal's rms,

the effect shows at 80 % where z exceeds sqrt(2 (REAL + Occam)) + 0.84 (the likelihood gain is (z + n)^2 / 2, n standard
normal) and s exceeds MATERIAL in some channel. Both are taken at finite amplitudes, since play and friction do not grow
in proportion, and interpolated.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.adjudicate import Judged, Judgement
from jointscope.diagnosis.base import representative
from jointscope.diagnosis.effects import ActiveEffect, EffectSpec
from jointscope.diagnosis.excitation import asked_only, below_excitation
from jointscope.diagnosis.gates import MATERIAL, REAL, REAL_FURTHER, SHARES
from jointscope.diagnosis.noise import dynamic_level
from jointscope.diagnosis.objective import Objective, Predictions

if TYPE_CHECKING:
    from jointscope.diagnosis.problem import Problem

Vector = NDArray[np.float64]

SURE_ENOUGH = 0.84  # standard normal quantile of a detection in 80 % of repetitions
MARGIN = 1.0  # on both gates; not yet fitted: experiments.prove.power_check is what would set it
HITS, OTHERS = 2, 1  # runs of each kind that stand for all
PASSES = 2  # steps of the interpolation
RUN_AWAY = 1e100  # of a prediction whose square would overflow
REACH = 30.0  # times beyond the catalogue's small and large sizes that a size is sought


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


@dataclass(frozen=True, eq=False)
class _Yard:
    """The chosen hypothesis over a few runs that stand for all."""

    objective: Objective
    judged: Judged
    theta: Vector
    effects: tuple[ActiveEffect, ...]
    before: Predictions
    jacobian: NDArray[np.float64]
    basis: NDArray[np.float64]
    weights: Vector  # per row: sqrt of the runs that this one stands for
    needed: float
    missed: dict[tuple[object, ...], float]  # per channel: least explained energy over the signal's


def _yard(judgement: Judgement, judged: Judged) -> _Yard:
    objective = judgement.objective
    chosen = representative(objective.problem, objective.runs, HITS, OTHERS)
    few = objective.restricted([i for i, run in enumerate(objective.runs) if run in chosen])

    def kind(run: int) -> tuple[str, bool]:
        recorded = objective.problem.runs[run].run
        return recorded.experiment, recorded.brake

    everything = [kind(run) for run in objective.runs]
    taken = [kind(run) for run in few.runs]
    share = [math.sqrt(everything.count(k) / taken.count(k)) for k in taken]
    weights = np.concatenate(
        [np.full(piece.stop - piece.start, s) for piece, s in zip(few.slices, share, strict=True)]
    )
    fit = judged.fit
    theta, effects = fit.coordinates.unpack(fit.x)
    w = few.residual(fit.x, fit.coordinates)
    jacobian = few.columns(fit.x, fit.coordinates, w, range(fit.coordinates.n)) * weights[:, None]
    size = np.linalg.norm(jacobian, axis=0)
    u, singular, _ = np.linalg.svd(jacobian[:, size > 0.0] / size[size > 0.0], full_matrices=False)
    basis = u[:, singular > 1e-9 * singular.max()] if singular.size else np.zeros((len(w), 0))
    parents = len(judged.names)
    samples = sum(sum(v.sizes) for v in objective.whiteners)
    real = REAL if parents == 0 else REAL_FURTHER
    share_needed = SHARES[min(parents, len(SHARES) - 1)]
    missed = {}
    for key, (left, signal) in judged.energies.items():
        explained = max(judgement.base.energies[key][0] - left, 0.0) / signal if signal > 0.0 else 0.0
        missed[key] = max(MATERIAL**2, share_needed**2 * explained / (1.0 - share_needed**2))
    return _Yard(
        few, judged, theta, effects, few.predictions(theta, effects), jacobian, basis, weights,
        math.sqrt(2.0 * (real + 0.5 * math.log(max(samples, 2)))) + SURE_ENOUGH, missed,
    )  # fmt: skip


def _seen(yard: _Yard, active: ActiveEffect) -> tuple[float, float]:
    """(z over what is needed, explained rms over what is material), base and found effects moved to follow."""
    objective, fit = yard.objective, yard.judged.fit
    problem, count = objective.problem, len(objective.runs)
    data = [
        objective.predict(problem.runs[run], yard.theta, (*yard.effects, active), problem)
        for run in objective.runs
    ]
    if not all(np.all(np.isfinite(y)) for ys in data for y in ys):
        return math.inf, math.inf

    def whitened(model: Sequence[Sequence[Vector]]) -> Vector:
        parts = [
            objective.whiteners[i]([a - b for a, b in zip(data[i], model[i], strict=True)])[:, 0]
            for i in range(count)
        ]
        return np.concatenate(parts) * yard.weights

    s = whitened(yard.before)
    step = np.linalg.lstsq(yard.jacobian, -s, rcond=1e-10)[0]
    x = np.clip(fit.x + np.clip(step, -0.7, 0.7), fit.coordinates.lower, fit.coordinates.upper)
    theta, effects = fit.coordinates.unpack(x)
    moved = [objective.predict(problem.runs[run], theta, effects, problem) for run in objective.runs]
    if not all(np.all(np.abs(y) < RUN_AWAY) for ys in moved for y in ys):
        moved = [list(y) for y in yard.before]  # type: ignore[misc]
    left = whitened(moved)
    left = left - yard.basis @ (yard.basis.T @ left)
    pooled: dict[tuple[object, ...], list[float]] = {}
    for run, ya, yb in zip(objective.prepared, data, moved, strict=True):
        for output, a, b in zip(run.outputs, ya, yb, strict=True):
            key = (run.run.experiment, output.quantity, output.location, output.direction)
            r = asked_only(a - b, below_excitation(run, output))[output.mask]
            total = pooled.setdefault(key, [0.0, 0.0])
            total[0] += float(r @ r)
            total[1] += dynamic_level(output) ** 2 * int(output.mask.sum())
    shown = max(
        (
            math.sqrt(e / (signal * yard.missed.get(key, MATERIAL**2)))
            for key, (e, signal) in pooled.items()
            if signal > 0.0
        ),
        default=0.0,
    )
    return float(np.linalg.norm(left)) / yard.needed, shown


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
    yard: _Yard, spec: EffectSpec, shape: tuple[float, ...], problem: Problem
) -> tuple[float | None, str]:
    """(amplitude that shows in 80 % of repetitions, what limits it); the amplitude is ``None`` beyond reach."""
    scale = [_departure(spec, v) for v in spec.scale(problem)]
    low, high = scale[0] / REACH, scale[2] * REACH

    def margin(departure: float) -> tuple[float, str]:
        z, shown = _seen(yard, ActiveEffect(spec, values_at(spec, shape, _value(spec, departure), problem)))
        worst = min(z, shown) / MARGIN
        return math.log(max(worst, 1e-9)), "noise" if z < shown else "materiality"

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
        slope = (b[1] - a[1]) / (b[0] - a[0]) if b[0] != a[0] else 1.0
        slope = float(np.clip(slope if math.isfinite(slope) else 1.0, 0.3, 4.0))
        start = a if abs(a[1]) < abs(b[1]) else b
        u = float(np.clip(start[0] - start[1] / slope, math.log(low), math.log(high)))
        g, limit = margin(math.exp(u))
        points.append((u, g, limit))
        if abs(g) < 0.1:
            break
    nearest = min(points, key=lambda p: abs(p[1]))
    if nearest[1] < -0.7:
        return None, nearest[2]
    slope = 1.0
    return _value(spec, math.exp(nearest[0] - nearest[1] / slope)), nearest[2]


def unseen(
    problem: Problem, judgement: Judgement, judged: Judged, specs: Sequence[EffectSpec], pool: ThreadPoolExecutor
) -> tuple[Unseen, ...]:
    """Every effect of the catalogue that is not in ``judged``, under its plainest law, in the catalogue's order."""
    first: dict[tuple[str, str], EffectSpec] = {}
    for spec in specs:
        known = first.get((spec.name, spec.location))
        if known is None or (known.possible(problem) is not None and spec.possible(problem) is None):
            first[spec.name, spec.location] = spec
    yard = _yard(judgement, judged)

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
