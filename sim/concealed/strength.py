r"""How hard a case is, by two numbers computed with the truth and its own simulator; they are sealed with it.

With r the whitened difference between the recordings' clean channels with and without the effect, and P the projection
off everything that a fit of the base can absorb: base parameters, each hit's gain and timing, and in driven runs
whatever torque the drive chose (only the consistency of torque, angles and acceleration counts, bin by bin):

z   = |P r|: how far the best base stays away from the truth, in standard deviations;
z_d = min over the rivals of |P' r|, P' also off the rival's own directions: how far the best wrong name stays away.

The base is refitted by chord steps before r is taken (secant responses, not derivatives, for what is not small).
The runs used are a share of the case's; the sums are scaled up to all.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from jointscope.models.joint import load_acceleration_per_torque, motor_acceleration_per_torque
from jointscope.models.parameters import Joint, Rig
from jointscope.sim.concealed.law import Effect
from jointscope.sim.concealed.measurement import Noise, noise_spectrum
from jointscope.sim.concealed.rehearsal import Plan, rehearse

Real = NDArray[np.float64]
Record = list[dict[str, Real]]

FREE = ("stiffness", "damping", "load_inertia", "motor_damping", "load_damping")
_STEP = 0.02


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
        runs: Which runs stand for all.
        base: Clean channels without any effect.
        tangents: Orthonormal basis of what the base absorbs, whitened, shape (n, k).
    """

    rig: Rig
    plan: Plan
    noise: Noise
    runs: tuple[int, ...]
    scale: float
    base: Record = field(repr=False)
    scales: Sequence[_Scale] = field(repr=False)
    whitener: Callable[[Record], Real] = field(repr=False)
    columns: Real = field(repr=False)
    steps: Mapping[str, float] = field(repr=False)
    tangents: Real = field(repr=False)


def changed(rig: Rig, changes: Mapping[str, float]) -> Rig:
    """The rig with joint parameters multiplied by exp(change)."""
    joint: Joint = rig.joint
    values = {name: getattr(joint, name) * float(np.exp(change)) for name, change in changes.items()}
    if "load_inertia" in values:  # the arm's mass and its place are known, so this much inertia is there
        values["load_inertia"] = max(values["load_inertia"], 1.02 * rig.arm_mass * rig.arm_com_radius**2)
    return replace(rig, joint=replace(joint, **values))


def representatives(plan: Plan) -> tuple[int, ...]:
    """Four hits over the levels, two sweeps, two motions, spread over the session."""
    chosen: list[int] = []
    for kind, count in (("hammer", 4), ("torque-sweep", 2), ("speed-motion", 2)):
        of_kind = [i for i, take in enumerate(plan.takes) if take.kind == kind]
        by_size = sorted(
            of_kind, key=lambda i: plan.takes[i].force + plan.takes[i].amplitude + plan.takes[i].travel
        )
        places = np.unique(np.linspace(0, len(by_size) - 1, min(count, len(by_size))).round().astype(int))
        chosen += [by_size[i] for i in places]
    return tuple(sorted(chosen))


@dataclass(frozen=True, eq=False)
class _Scale:
    """How one run is whitened: each channel's weight per bin, and the direction in which the drive is free.

    Attributes:
        weights: By channel, shape (n // 2 + 1,).
        drive: By channel, what an arbitrary torque of the drive does, whitened and of unit length per bin; empty for
            a braked run. Taking it out leaves what the physics says and nothing of what the drive chose.
    """

    weights: Mapping[str, Real]
    drive: Mapping[str, NDArray[np.complex128]]


def _scales(rig: Rig, plan: Plan, noise: Noise, runs: Sequence[int], base: Record) -> list[_Scale]:
    scales = []
    for place, run in enumerate(runs):
        weights: dict[str, Real] = {}
        for name, y in base[place].items():
            if name in ("force", "command"):
                continue
            rate = plan.devices.daq_rate if name in ("acceleration", "arm") else plan.devices.log_rate
            power = noise_spectrum(name, float(np.std(y)), y.size, rate, plan.devices, noise)
            bins = np.arange(power.size)
            two_sided = np.where((bins == 0) | (2 * bins == y.size), 1.0, 2.0)
            weights[name] = np.where(bins / y.size <= 0.40, np.sqrt(two_sided / (power * y.size)), 0.0)
        free = {} if plan.takes[run].braked else _drive_direction(rig, plan, weights, plan.takes[run].duration)
        scales.append(_Scale(weights, free))
    return scales


def _drive_direction(
    rig: Rig, plan: Plan, weights: Mapping[str, Real], duration: float
) -> dict[str, NDArray[np.complex128]]:
    joint = rig.joint
    bins = max(w.size for w in weights.values())
    s = np.asarray(2j * np.pi * np.arange(1, bins) / duration, dtype=np.complex128)
    ratio = joint.efficiency * joint.reduction_ratio
    arm = ratio * load_acceleration_per_torque(joint, s)
    high_pass = s / (s + 2.0 * np.pi * plan.devices.low_cutoff)
    response = {
        "torque": np.ones_like(s),
        "acceleration": rig.accelerometer_radius * arm * high_pass,
        "arm": arm / s**2,
        "motor": joint.reduction_ratio * ratio * motor_acceleration_per_torque(joint, s) / s**2,
    }
    sizes = {"torque": plan.devices.log_rate, "motor": plan.devices.log_rate}
    directions = {}
    for name, weight in weights.items():
        rate = sizes.get(name, plan.devices.daq_rate)  # an rfft grows with the rate
        g = np.zeros(bins, dtype=np.complex128)
        g[1 : weight.size] = response[name][: weight.size - 1] * weight[1:] * rate
        directions[name] = g
    if "motor" in directions:
        directions["motor"][0] = 1.0  # where the rig stands is the drive's affair
    length = np.sqrt(sum(np.abs(g) ** 2 for g in directions.values()))
    return {name: (g / np.maximum(length, 1e-300))[: weights[name].size] for name, g in directions.items()}


def _whiten(record: Record, scales: Sequence[_Scale]) -> Real:
    parts: list[Real] = []
    for channels, scale in zip(record, scales, strict=True):
        spectra = {name: np.fft.rfft(channels[name]) * w for name, w in scale.weights.items()}
        if scale.drive:
            bins = max(spectrum.size for spectrum in spectra.values())
            chosen = np.zeros(bins, dtype=np.complex128)
            for name, g in scale.drive.items():
                chosen[: g.size] += np.conj(g) * spectra[name]
            spectra = {name: spectra[name] - g * chosen[: g.size] for name, g in scale.drive.items()}
        for spectrum in spectra.values():
            parts += [spectrum.real, spectrum.imag]
    return np.concatenate(parts)


def yardstick(rig: Rig, plan: Plan, noise: Noise) -> Yardstick:
    """Simulate the base and what it can absorb."""
    runs = representatives(plan)
    base = rehearse(rig, plan, (), runs)
    scales = _scales(rig, plan, noise, runs, base)

    def whiten(record: Record) -> Real:
        return _whiten(record, scales)

    origin = whiten(base)
    braked_only = all(plan.takes[i].braked for i in runs)
    columns: list[Real] = []
    steps: dict[str, float] = {}
    for name in FREE:
        if (braked_only and name in ("motor_damping", "load_damping")) or getattr(rig.joint, name) <= 0.0:
            continue
        columns.append(whiten(rehearse(changed(rig, {name: _STEP}), plan, (), runs)) - origin)
        steps[name] = _STEP
    nuisance = _scatter(plan, noise, runs, base, whiten)
    matrix = np.column_stack(columns)
    return Yardstick(
        rig=rig, plan=plan, noise=noise, runs=runs, scale=len(plan.takes) / len(runs), base=base, scales=scales, whitener=whiten,
        columns=matrix, steps=steps, tangents=_orthonormal(np.column_stack([matrix, *nuisance])),
    )  # fmt: skip


def _scatter(
    plan: Plan, noise: Noise, runs: Sequence[int], base: Record, whiten: Callable[[Record], Real]
) -> list[Real]:
    """Each hit's gain and timing, as directions that are free (their scatter is far above what a hit resolves)."""
    out: list[Real] = []
    for place, run in enumerate(runs):
        if plan.takes[run].kind != "hammer":
            continue
        for derivative in (False, True):
            record = [{name: np.zeros_like(y) for name, y in channels.items()} for channels in base]
            for name in ("acceleration", "arm"):
                if name in base[place]:
                    y = base[place][name] - base[place][name][0]
                    record[place][name] = np.gradient(y) * plan.devices.daq_rate * 1e-4 if derivative else 0.01 * y
            out.append(whiten(record))
    return out


def _orthonormal(columns: Real) -> Real:
    scaled = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    left, size, _ = np.linalg.svd(scaled, full_matrices=False)
    return np.asarray(left[:, size > 1e-6 * size[0]])


def off(basis: Real, vector: Real) -> Real:
    """``vector`` (n,) or (n, m) less its projection on the orthonormal ``basis`` (n, k)."""
    return np.asarray(vector - basis @ (basis.T @ vector))


def residual(yard: Yardstick, effects: Sequence[Effect]) -> tuple[Real, float]:
    """What the refitted base can't follow, whitened, and its materiality.

    Two chord steps move the base to where it fits best, so that a large effect is not judged at the wrong parameters.
    """
    truth_record = rehearse(yard.rig, yard.plan, effects, yard.runs)
    truth = yard.whitener(truth_record)
    names = list(yard.steps)
    change = np.zeros(len(names))
    best = truth - yard.whitener(yard.base)
    size = float(np.linalg.norm(off(yard.tangents, best)))
    free = np.column_stack([yard.columns, yard.tangents])
    for _ in range(2):
        step = np.linalg.lstsq(free, best, rcond=1e-9)[0][: change.size]
        for share in (1.0, 0.4, 0.15):
            trial = np.clip(change + share * step, -40.0, 40.0)
            rig = changed(yard.rig, {n: yard.steps[n] * c for n, c in zip(names, trial, strict=True)})
            left = truth - yard.whitener(rehearse(rig, yard.plan, (), yard.runs))
            new = float(np.linalg.norm(off(yard.tangents, left)))
            if new < size:
                break
        else:
            break
        change, best, gained, size = trial, left, size - new, new
        if gained < 0.05 * size:
            break
    r = off(yard.tangents, best)
    return r, _materiality(yard, r, truth_record)


def _materiality(yard: Yardstick, r: Real, truth: Record) -> float:
    """NRMSE of the acceleration that the refitted base leaves, over the runs."""
    missed, whole, place = 0.0, 0.0, 0
    for channels, scale in zip(truth, yard.scales, strict=True):
        for name, weight in scale.weights.items():
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
    """What a rival of ordinary size would add, off the base's tangents."""
    record = rehearse(yard.rig, yard.plan, (rival,), yard.runs)
    return off(yard.tangents, yard.whitener(record) - yard.whitener(yard.base))


def measure(yard: Yardstick, effects: Sequence[Effect], against: Mapping[str, Real]) -> Strength:
    """z and z_d of ``effects``; ``against`` holds each rival's directions, shape (n, m)."""
    r, materiality = residual(yard, effects)
    factor = np.sqrt(yard.scale)
    z = float(np.linalg.norm(r) * factor)
    nearest, z_d = "", z
    for label, directions in against.items():
        left = float(np.linalg.norm(off(_orthonormal(directions), r)) * factor)
        if left < z_d:
            nearest, z_d = label, left
    return Strength(z=z, z_d=z_d, nearest=nearest, materiality=materiality)
