"""The space in which concealed cases are measured: whitened misfits of a few runs, and what a fit can absorb of them.

Hits are driven by the measured force; driven runs by the logged torque, the model tied loosely to the logged motor
angle, so that nothing is assumed of the drive. Runs of each experiment are represented by some of them, their weights
raised to stand for all. The engine steps twice as far here as for the recordings (both sides of every difference alike).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from jointscope.models.joint import hammer_receptance, load_acceleration_per_torque, motor_acceleration_per_torque
from jointscope.models.parameters import Joint, Rig
from jointscope.sim.concealed.law import Effect
from jointscope.sim.concealed.measurement import Noise, noise_spectrum
from jointscope.sim.concealed.rehearsal import TIE, Plan, clean_channels, declared, rehearse, replayed

Real = NDArray[np.float64]
Record = list[dict[str, Real]]

STEP: Final = 2e-4  # s, of the engine
FREE = ("stiffness", "damping", "load_inertia", "motor_damping", "load_damping")
ANGLES: Final = frozenset({"arm", "motor"})
CONTACT: Final = 1e-3  # of a hit's peak: where the hammer touches
SHIFT = 0.02  # of a parameter's logarithm, for its secant


@dataclass(frozen=True, eq=False)
class Whitener:
    """What makes noise white.

    Attributes:
        weights: By run and output channel, the factor per bin, shape (n // 2 + 1,).
        pushed: Orthonormal directions in which the noise of recorded forces pushes, shape (n, k).
        kept: What is kept along each of them, shape (k,).
    """

    weights: Sequence[Mapping[str, Real]] = field(repr=False)
    pushed: Real = field(repr=False)
    kept: Real = field(repr=False)

    def __call__(self, misfits: Record) -> Real:
        """Whitened misfits of all runs, shape (n,)."""
        w = whiten(misfits, self.weights)
        return np.asarray(w - self.pushed @ ((1.0 - self.kept) * (self.pushed.T @ w)))


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
    white: Whitener = field(repr=False)
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
    for run, channels in zip(runs, base, strict=True):
        stands_for = _stands_for(plan, runs, run)
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


def _stands_for(plan: Plan, runs: Sequence[int], run: int) -> float:
    """How many of the case's runs of its experiment ``run`` represents."""
    kinds = [take.kind for take in plan.takes]
    return kinds.count(kinds[run]) / sum(kinds[other] == kinds[run] for other in runs)


def whitener(rig: Rig, plan: Plan, noise: Noise, runs: Sequence[int], base: Record) -> Whitener:
    """What makes the misfits of ``runs`` white, ``base`` their clean channels."""
    weights = _weights(rig, plan, noise, runs, base)
    size = sum(2 * w.size for channels in weights for w in channels.values())
    pushed, kept, first = [np.zeros((size, 0))], [np.zeros(0)], 0
    for run, channels, weight in zip(runs, base, weights, strict=True):
        last = first + sum(2 * w.size for w in weight.values())
        if plan.takes[run].kind == "hammer" and noise.force > 0.0:
            U = _pushes(rig, plan, noise.force, channels, weight) / np.sqrt(_stands_for(plan, runs, run))
            left, sizes, _ = np.linalg.svd(U, full_matrices=False)
            pushed.append(np.zeros((size, sizes.size)))
            pushed[-1][first:last] = left
            kept.append(1.0 / np.sqrt(1.0 + sizes**2))
        first = last
    return Whitener(weights, np.hstack(pushed), np.concatenate(kept))


def _pushes(rig: Rig, plan: Plan, level: float, channels: Mapping[str, Real], weights: Mapping[str, Real]) -> Real:
    """What noise of ``level`` [N] in each sample of a contact does to a hit, weighted, shape (n, samples)."""
    force, rate = channels["force"], plan.devices.daq_rate
    touched = np.flatnonzero(np.abs(force) > CONTACT * float(np.max(np.abs(force))))
    s = 2j * np.pi * np.arange(1, force.size // 2 + 1) * rate / force.size
    receptance = rig.hammer_radius * hammer_receptance(rig.joint, np.asarray(s, dtype=np.complex128))
    turn = np.exp(-np.outer(s, touched / rate))
    rows = []
    for name, w in weights.items():
        response = receptance * (s**2 * rig.accelerometer_radius if name == "acceleration" else 1.0)
        columns = np.zeros((w.size, touched.size), dtype=np.complex128)
        columns[1:] = level * (response * w[1:])[:, None] * turn
        rows += [columns.real, columns.imag]
    return np.concatenate(rows)


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


def whiten(misfits: Record, weights: Sequence[Mapping[str, Real]]) -> Real:
    """Weighted spectra of all runs and channels, real and imaginary parts one after the other, shape (n,).

    Angles are counted from the straight line between their ends: one that has drifted by the end of its run would jump
    back to the start of a period, and the jump counts at frequencies where the drift, and the noise of a log that
    makes any angle drift, has nothing.
    """
    parts: list[Real] = []
    for channels, weight in zip(misfits, weights, strict=True):
        for name, w in weight.items():
            y = channels[name]
            if name in ANGLES:
                y = y - np.linspace(y[0], y[-1], y.size)
            spectrum = np.fft.rfft(y) * w
            parts += [spectrum.real, spectrum.imag]
    return np.concatenate(parts)


def misfit_of(
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


def yardstick(rig: Rig, plan: Plan, noise: Noise) -> Yardstick:
    """Simulate the base and what it can absorb."""
    plan = replace(plan, timestep=STEP)
    runs = representatives(plan)
    base = rehearse(rig, plan, (), runs)
    white = whitener(rig, plan, noise, runs, base)
    origin = white(misfit_of(rig, plan, runs, base, base))
    braked_only = all(plan.takes[i].braked for i in runs)
    columns: list[Real] = []
    steps: dict[str, float] = {}
    for name in FREE:
        if (braked_only and name in ("motor_damping", "load_damping")) or getattr(rig.joint, name) <= 0.0:
            continue
        misfit = misfit_of(changed(rig, {name: SHIFT}), plan, runs, base, None)
        columns.append(origin - white(misfit))
        steps[name] = SHIFT
    matrix = np.column_stack(columns)
    nuisance = _scatter(plan, runs, base, white)
    return Yardstick(
        rig=rig, plan=plan, runs=runs, base=base, white=white, origin=origin,
        columns=matrix, steps=steps, tangents=orthonormal(np.column_stack([matrix, *nuisance])),
        scatter=orthonormal(np.column_stack(nuisance)) if nuisance else np.zeros((origin.size, 0)),
    )  # fmt: skip


def _scatter(plan: Plan, runs: Sequence[int], base: Record, white: Whitener) -> list[Real]:
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
            out.append(white(record))
    return out


def orthonormal(columns: Real) -> Real:
    """An orthonormal basis (n, k) of what the columns (n, m) span."""
    scaled = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    left, size, _ = np.linalg.svd(scaled, full_matrices=False)
    return np.asarray(left[:, size > 1e-6 * size[0]])


def off(basis: Real, vector: Real) -> Real:
    """``vector`` (n,) or (n, m) less its projection on the orthonormal ``basis`` (n, k)."""
    return np.asarray(vector - basis @ (basis.T @ vector))
