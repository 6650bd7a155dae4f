r"""How hard a case is, by two numbers computed with the truth and its own simulator; they are sealed with it.

With r what the refitted base leaves of the recordings' outputs, given their inputs, whitened, and P the projection off
what a fit can absorb besides (each hit's gain and timing). Hits are driven by the measured force; driven runs by the
logged torque, the model tied loosely to the logged motor angle, so that nothing is assumed of the drive.

z   = |P r|: how far the best base stays away from the truth, in standard deviations;
z_d = min over the rivals of |P' r|, P' also off the rival's own directions: how far the best wrong name stays away.

The base is refitted by chord steps before r is taken (secant responses, not derivatives, for what is not small).
Runs of each experiment are represented by some of them, their weights raised to stand for all. The engine steps twice
as far here as for the recordings (both sides of every difference alike).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from jointscope.models.joint import load_acceleration_per_torque, motor_acceleration_per_torque
from jointscope.models.parameters import Joint, Rig
from jointscope.sim.concealed.law import Effect
from jointscope.sim.concealed.measurement import Noise, noise_spectrum
from jointscope.sim.concealed.rehearsal import TIE, Plan, clean_channels, declared, rehearse, replayed

Real = NDArray[np.float64]
Record = list[dict[str, Real]]

STEP: Final = 2e-4  # s, of the engine
_ROUNDS: Final = 4
FREE = ("stiffness", "damping", "load_inertia", "motor_damping", "load_damping")
_SHIFT = 0.02


@dataclass(frozen=True)
class Strength:
    """How visible, and how distinct, an effect is.

    Attributes:
        z: Distance of the truth from the refitted base [standard deviations].
        z_d: Distance from the nearest rival.
        nearest: That rival, ``name@location``; empty where none was tried.
        materiality: Share of the outputs' energy that the refitted base misses, as an NRMSE.
    """

    z: float
    z_d: float
    nearest: str
    materiality: float


@dataclass(frozen=True, eq=False)
class Yardstick:
    """The space in which cases of one plan are measured.

    Attributes:
        plan: The case's, at this module's own timestep.
        runs: Which runs stand for all.
        base: Clean channels without any effect.
        origin: Whitened misfit of the base on its own recordings (interpolation only).
        columns: What each free parameter's step takes away, shape (n, k).
        tangents: Orthonormal basis of all that is absorbed, shape (n, m).
        scatter: The part of it that isn't the base's parameters, shape (n, m - k).
    """

    rig: Rig
    plan: Plan
    runs: tuple[int, ...]
    base: Record = field(repr=False)
    weights: Sequence[Mapping[str, Real]] = field(repr=False)
    origin: Real = field(repr=False)
    columns: Real = field(repr=False)
    steps: Mapping[str, float] = field(repr=False)
    tangents: Real = field(repr=False)
    scatter: Real = field(repr=False)


def changed(rig: Rig, changes: Mapping[str, float]) -> Rig:
    """The rig with joint parameters multiplied by exp(change)."""
    joint: Joint = rig.joint
    values = {name: getattr(joint, name) * float(np.exp(change)) for name, change in changes.items()}
    if "load_inertia" in values:  # the arm's mass and its place are known, so this much inertia is there
        values["load_inertia"] = max(values["load_inertia"], 1.02 * rig.arm_mass * rig.arm_com_radius**2)
    return replace(rig, joint=replace(joint, **values))


def representatives(plan: Plan) -> tuple[int, ...]:
    """Three hits over the levels, a sweep and a motion at the largest level and one more of what is alone."""
    chosen: list[int] = []
    kinds = {take.kind for take in plan.takes}
    motions = 1 if len(kinds) > 2 else 2
    for kind, count in (("hammer", 3), ("torque-sweep", 2), ("speed-motion", motions)):
        of_kind = [i for i, take in enumerate(plan.takes) if take.kind == kind]
        by_size = sorted(
            of_kind, key=lambda i: plan.takes[i].force + plan.takes[i].amplitude + plan.takes[i].travel
        )
        places = np.unique(np.linspace(len(by_size) - 1, 0, min(count, len(by_size))).round().astype(int))
        chosen += [by_size[i] for i in places]
    return tuple(sorted(chosen))


def _weights(rig: Rig, plan: Plan, noise: Noise, runs: Sequence[int], base: Record) -> list[dict[str, Real]]:
    """By run and output channel, the factor per bin that makes noise white, shape (n // 2 + 1,).

    In driven runs the noise of the torque log counts too: it drives the model. Each run counts for its share of the
    case's runs of that experiment.
    """
    out = []
    kinds = [take.kind for take in plan.takes]
    for run, channels in zip(runs, base, strict=True):
        stands_for = kinds.count(kinds[run]) / sum(kinds[other] == kinds[run] for other in runs)
        shown = declared(channels, plan.devices)
        weights: dict[str, Real] = {}
        for name in ("acceleration", "arm", "motor"):
            if name not in shown or (name == "motor" and plan.takes[run].braked):
                continue
            y = shown[name]
            rate = plan.devices.log_rate if name == "motor" else plan.devices.daq_rate
            power = noise_spectrum(name, float(np.std(y)), y.size, rate, plan.devices, noise)
            if not plan.takes[run].braked:
                power = power + noise.torque**2 * _torque_to(name, rig, plan, power.size, y.size / rate)
            bins = np.arange(power.size)
            two_sided = np.where((bins == 0) | (2 * bins == y.size), 1.0, 2.0)
            weights[name] = np.where(
                bins / y.size <= 0.40, np.sqrt(stands_for * two_sided / (power * y.size)), 0.0
            )
        out.append(weights)
    return out


def _torque_to(name: str, rig: Rig, plan: Plan, bins: int, duration: float) -> Real:
    """|channel over motor torque|^2 of the tied rig per bin, at the sampling rates' ratio, shape (bins,)."""
    joint = rig.joint
    s = np.asarray(2j * np.pi * np.arange(1, bins) / duration, dtype=np.complex128)
    w = 2.0 * np.pi * TIE
    tied = s**2 / (s**2 + 1.4 * w * s + w**2)
    ratio = joint.efficiency * joint.reduction_ratio
    if name == "motor":
        response = joint.reduction_ratio * ratio * motor_acceleration_per_torque(joint, s) / s**2
    else:
        response = ratio * load_acceleration_per_torque(joint, s)
        response = response * rig.accelerometer_radius if name == "acceleration" else response / s**2
    squared = np.abs(response * tied) ** 2
    rate = plan.devices.log_rate if name == "motor" else plan.devices.daq_rate
    inside = np.arange(1, bins) / duration < 0.45 * plan.devices.log_rate
    squared = np.where(inside, squared, 0.0) * rate / plan.devices.log_rate
    return np.concatenate([squared[:1], squared])  # a constant torque is caught by the tie, as the slowest bin is


def _whiten(misfits: Record, weights: Sequence[Mapping[str, Real]]) -> Real:
    parts: list[Real] = []
    for channels, weight in zip(misfits, weights, strict=True):
        for name, w in weight.items():
            spectrum = np.fft.rfft(channels[name]) * w
            parts += [spectrum.real, spectrum.imag]
    return np.concatenate(parts)


def _misfit(
    rig: Rig, plan: Plan, runs: Sequence[int], record: Record, base: Record | None, effects: Sequence[Effect] = ()
) -> Record:
    """What ``rig``, with ``effects``, leaves of the recordings' outputs, given their inputs; ``base``: its hits, if known."""
    out: Record = []
    for place, run in enumerate(runs):
        if not plan.takes[run].braked:
            model = replayed(rig, plan, run, record[place], effects)
        elif base is not None:
            model = base[place]
        else:
            model = clean_channels(rig, plan, run, effects)
        compared = [name for name in ("acceleration", "arm", "motor") if name in model]
        out.append({name: record[place][name] - model[name] for name in compared})
    return out


def refitted(
    yard: Yardstick, sight: Sight, rival: Effect, free: Sequence[str], limits: tuple[float, float], steps: int = 24
) -> float:
    """z_d by a full refit: how far ``rival``, with the base and its own parameters free, stays from the truth.

    Levenberg-Marquardt on the whitened misfit with logarithms of the base's parameters, of the rival's strength and of
    its ``free`` parameters as unknowns; hits' gain and timing projected out. Slopes by secants, kept up by Broyden's
    update, taken anew where a step fails; it ends where fresh slopes don't gain a per cent either.

    Args:
        yard: Where.
        sight: The truth.
        rival: Where to start from.
        free: Its parameters that may change beside its strength.
        limits: Of the strength.
        steps: Most trials.
    """
    names = list(yard.steps)
    bounds = np.sort(np.log(np.array(limits) / rival.values[rival.law.strength]))

    def left(x: Real) -> Real:
        rig = changed(yard.rig, dict(zip(names, x[: len(names)], strict=True)))
        values = dict(rival.values)
        for name, shift in zip((rival.law.strength, *free), x[len(names) :], strict=True):
            values[name] = values[name] * float(np.exp(shift))
        try:
            misfit = _misfit(rig, yard.plan, yard.runs, sight.record, None, (Effect(rival.law, values),))
        except FloatingPointError:
            return np.full(yard.origin.size, np.inf)
        return off(yard.scatter, _whiten(misfit, yard.weights) - yard.origin)

    x = np.zeros(len(names) + 1 + len(free))
    shift = np.array([0.01] * len(names) + [0.1] + [0.03] * len(free))
    r, damping, fresh = left(x), 1e-3, False
    slopes = np.zeros((r.size, 0))
    for _ in range(steps):
        if not slopes.size:
            slopes = np.column_stack(
                [(left(x + h * e) - r) / h for h, e in zip(shift, np.eye(x.size), strict=True)]
            )
            fresh = True
        before = float(np.linalg.norm(r))
        trial = x + _damped(slopes, r, damping)
        trial[len(names)] = np.clip(trial[len(names)], *bounds)
        new = left(trial)
        after = float(np.linalg.norm(new))
        if np.isfinite(after) and np.any(trial != x):
            move = trial - x
            slopes = slopes + np.outer(new - r - slopes @ move, move) / float(move @ move)
        if after < before:
            x, r, damping = trial, new, damping / 5.0
        else:
            damping *= 10.0
        if after > 0.99 * before:
            if fresh and (after <= before or damping > 1e-2):
                break
            if not fresh:
                slopes = np.zeros((r.size, 0))
        else:
            fresh = False
    return float(np.linalg.norm(r))


def _damped(slopes: Real, r: Real, damping: float) -> Real:
    size = np.maximum(np.linalg.norm(slopes, axis=0), 1e-12)
    scaled = slopes / size
    move = -np.linalg.solve(scaled.T @ scaled + damping * np.eye(size.size), scaled.T @ r) / size
    return np.asarray(np.clip(move, -1.0, 1.0))


def yardstick(rig: Rig, plan: Plan, noise: Noise) -> Yardstick:
    """Simulate the base and what it can absorb."""
    plan = replace(plan, timestep=STEP)
    runs = representatives(plan)
    base = rehearse(rig, plan, (), runs)
    weights = _weights(rig, plan, noise, runs, base)
    origin = _whiten(_misfit(rig, plan, runs, base, base), weights)
    braked_only = all(plan.takes[i].braked for i in runs)
    columns: list[Real] = []
    steps: dict[str, float] = {}
    for name in FREE:
        if (braked_only and name in ("motor_damping", "load_damping")) or getattr(rig.joint, name) <= 0.0:
            continue
        misfit = _misfit(changed(rig, {name: _SHIFT}), plan, runs, base, None)
        columns.append(origin - _whiten(misfit, weights))
        steps[name] = _SHIFT
    matrix = np.column_stack(columns)
    nuisance = _scatter(plan, runs, base, weights)
    return Yardstick(
        rig=rig, plan=plan, runs=runs, base=base, weights=weights, origin=origin,
        columns=matrix, steps=steps, tangents=_orthonormal(np.column_stack([matrix, *nuisance])),
        scatter=_orthonormal(np.column_stack(nuisance)) if nuisance else np.zeros((origin.size, 0)),
    )  # fmt: skip


def _scatter(plan: Plan, runs: Sequence[int], base: Record, weights: Sequence[Mapping[str, Real]]) -> list[Real]:
    """Each hit's gain and timing, as directions that are free (their scatter is far above what a hit resolves)."""
    out: list[Real] = []
    for place, run in enumerate(runs):
        if plan.takes[run].kind != "hammer":
            continue
        for derivative in (False, True):
            record = [{name: np.zeros_like(y) for name, y in channels.items()} for channels in base]
            for name in [name for name in ("acceleration", "arm") if name in base[place]]:
                y = base[place][name] - base[place][name][0]
                record[place][name] = np.gradient(y) * plan.devices.daq_rate * 1e-4 if derivative else 0.01 * y
            out.append(_whiten(record, weights))
    return out


def _orthonormal(columns: Real) -> Real:
    scaled = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    left, size, _ = np.linalg.svd(scaled, full_matrices=False)
    return np.asarray(left[:, size > 1e-6 * size[0]])


def off(basis: Real, vector: Real) -> Real:
    """``vector`` (n,) or (n, m) less its projection on the orthonormal ``basis`` (n, k)."""
    return np.asarray(vector - basis @ (basis.T @ vector))


@dataclass(frozen=True, eq=False)
class Sight:
    """What effects do to the representative runs.

    Attributes:
        record: Clean channels with them.
        misfit: Whitened misfit of the base, parameters as they are, shape (n,).
    """

    record: Record = field(repr=False)
    misfit: Real = field(repr=False)


def look(yard: Yardstick, effects: Sequence[Effect]) -> Sight:
    """Simulate the representative runs with ``effects``."""
    record = rehearse(yard.rig, yard.plan, effects, yard.runs)
    misfit = _whiten(_misfit(yard.rig, yard.plan, yard.runs, record, yard.base), yard.weights) - yard.origin
    return Sight(record, misfit)


def projected(yard: Yardstick, sight: Sight) -> Real:
    """What the base's tangents can't follow, shape (n,)."""
    return off(yard.tangents, sight.misfit)


def refitted_base(yard: Yardstick, sight: Sight) -> Real:
    """What the refitted base can't follow, shape (n,).

    Two chord steps move the base to where it fits best, so that a large effect is not judged at the wrong parameters.
    """
    names = list(yard.steps)
    change = np.zeros(len(names))
    best = sight.misfit
    size = float(np.linalg.norm(off(yard.tangents, best)))
    free = np.column_stack([yard.columns, yard.tangents])
    for _ in range(2):
        step = np.linalg.lstsq(free, best, rcond=1e-9)[0][: change.size]
        if float(np.max(np.abs(step))) < 0.25:  # half a per cent: the tangent is good enough
            break
        gained = 0.0
        for share in (1.0, 0.4, 0.15):
            trial = change + share * step * _SHIFT
            rig = changed(yard.rig, dict(zip(names, trial, strict=True)))
            try:
                misfit = _misfit(rig, yard.plan, yard.runs, sight.record, None)
            except FloatingPointError:
                continue
            left = _whiten(misfit, yard.weights) - yard.origin
            new = float(np.linalg.norm(off(yard.tangents, left)))
            if new < size:
                change, best, gained, size = trial, left, size - new, new
                break
        if gained < 0.05 * size:
            break
    return off(yard.tangents, best)


def materiality(yard: Yardstick, r: Real, truth: Record) -> float:
    """NRMSE of the acceleration that the refitted base leaves, over the runs."""
    missed, whole, place = 0.0, 0.0, 0
    for channels, weights in zip(truth, yard.weights, strict=True):
        for name, weight in weights.items():
            n = weight.size
            if name == "acceleration":
                part = r[place : place + n] + 1j * r[place + n : place + 2 * n]
                use = weight > 0.0
                missed += float(np.sum(np.abs(part[use] / weight[use]) ** 2)) / n
                spectrum = np.fft.rfft(channels[name] - np.median(channels[name]))
                whole += float(np.sum(np.abs(spectrum[use]) ** 2)) / n
            place += 2 * n
    return float(np.sqrt(missed / max(whole, 1e-300)))


def direction(yard: Yardstick, rival: Effect) -> Real:
    """What a rival would add, off the base's tangents; nothing where it would fly apart."""
    try:
        return projected(yard, look(yard, (rival,)))
    except FloatingPointError:
        return np.zeros_like(yard.origin)


def nearest_form(
    yard: Yardstick, r: Real, rival: Effect, first: Real, free: Sequence[str], limits: tuple[float, float]
) -> tuple[Real, Effect]:
    """The form of ``rival`` that comes nearest to ``r``: its strength and ``free`` parameters fitted, the base linear.

    Starts at the strength that r has in proportion. Secants in the logarithms, kept up by Broyden's update; a step
    that doesn't help is shortened once.

    Args:
        yard: Where.
        r: What is to be come near to, shape (n,).
        rival: Where to start from.
        first: Its direction.
        free: Parameters that may change beside the strength.
        limits: Of the strength.

    Returns:
        Its direction, shape (n,), and the rival with those numbers.
    """
    names = (rival.law.strength, *free)
    share = float(first @ r) / max(float(first @ first), 1e-300)
    rival = rival.scaled(float(np.clip(share * rival.values[rival.law.strength], min(limits), max(limits))))
    d = direction(yard, rival)
    columns = [d]  # in proportion to the strength, to begin with
    for name in free:
        moved = direction(yard, Effect(rival.law, {**rival.values, name: rival.values[name] * 1.03}))
        columns.append((moved - d) / 0.03)
    slopes = np.column_stack(columns)
    reach = 1.0
    for _ in range(_ROUNDS):
        before = float(np.linalg.norm(r - d))
        step = reach * np.clip(np.linalg.lstsq(slopes, r - d, rcond=1e-6)[0], -1.0, 1.0)
        predicted = float(np.linalg.norm(r - d - slopes @ step))
        if predicted > 0.97 * before or not np.any(step):
            break
        values = dict(rival.values)
        for name, shift in zip(names, step, strict=True):
            values[name] = values[name] * float(np.exp(shift))
        trial = direction(yard, Effect(rival.law, values))
        if not np.any(trial):
            break
        slopes = slopes + np.outer(trial - d - slopes @ step, step) / float(step @ step)
        if float(np.linalg.norm(r - trial)) < before:
            rival, d, reach = Effect(rival.law, values), trial, 1.0
        else:
            reach *= 0.3
    return d, rival


def left_over(r: Real, directions: Real) -> float:
    """|r| off the given directions, shape (n, m) [standard deviations]."""
    if not np.any(directions):
        return float(np.linalg.norm(r))
    return float(np.linalg.norm(off(_orthonormal(directions), r)))


def graded(yard: Yardstick, r: Real, record: Record, against: Mapping[str, Real]) -> Strength:
    """z and z_d of what leaves ``r`` of ``record``; ``against`` holds each rival's directions, shape (n, m)."""
    z = float(np.linalg.norm(r))
    nearest, z_d = "", z
    for label, directions in against.items():
        left = left_over(r, directions)
        if left < z_d:
            nearest, z_d = label, left
    return Strength(z=z, z_d=z_d, nearest=nearest, materiality=materiality(yard, r, record))
