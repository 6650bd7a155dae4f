"""How many modes the recordings hold: poles of rising order, which of them are stable, and which the evidence keeps.

A pole is *stable* where the next lower order has it too, within 1 % in frequency and 30 % in damping; poles that three
orders agree on are candidates. The richest order's residual, block by block in frequency, is the noise that any model
is judged by. From all candidates together, modes are taken away one at a time as long as the Bayesian information
criterion (Schwarz 1978) falls; residual lines for what lies outside the band stand the same test.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jointscope.identification.errors_in_variables import HitSpectrum
from jointscope.identification.modal_model import ModalModel
from jointscope.identification.vector_fitting import starting_poles, vector_fit

Real = NDArray[np.float64]
Complex = NDArray[np.complexfloating[Any, Any]]

FAITHFUL = 5e-4  # share of every line that no sensor chain promises; no mode is believed on less
HIGHEST_DAMPING = 0.25  # above it a pole is part of the background
_CLOSE_FREQUENCY, _CLOSE_DAMPING = 0.01, 0.3


@dataclass(frozen=True, kw_only=True)
class StablePole:
    """One pole of the stabilisation diagram.

    Attributes:
        order: Number of modes asked for.
        frequency: sqrt(a2)/2 pi [Hz].
        damping_ratio: [-].
        stable: Whether the next lower order has it too.
    """

    order: int
    frequency: float
    damping_ratio: float
    stable: bool


@dataclass(frozen=True, kw_only=True, eq=False)
class ModeSelection:
    """What the orders gave and which model the evidence picks.

    Attributes:
        model: Start for the likelihood: the kept modes with residues from linear least squares; ``None`` without any.
        stabilisation: Every pole of every order.
        criterion: BIC against the number of modes kept, from all candidates downwards.
        kept: How many modes each entry of ``criterion`` has.
        noise: The richest order's residual, standard deviation per line, shape (n_outputs, n), of the first hit's lines.
    """

    model: ModalModel | None
    stabilisation: tuple[StablePole, ...]
    criterion: tuple[float, ...]
    kept: tuple[int, ...]
    noise: Real


def averaged(hits: Sequence[HitSpectrum]) -> list[HitSpectrum]:
    """One hit that stands for many on the same lines (root mean square input, H1 times it); few or unlike ones as they are."""
    first = hits[0]
    alike = all(
        hit.frequency.shape == first.frequency.shape and np.array_equal(hit.frequency, first.frequency)
        for hit in hits
    )
    if len(hits) < 3 or not alike or any(hit.truncated for hit in hits):
        return list(hits)
    drive = np.sqrt(np.mean([np.abs(hit.input) ** 2 for hit in hits], axis=0))
    cross = np.mean([hit.output * np.conj(hit.input) for hit in hits], axis=0)
    sensor = np.mean([hit.sensor for hit in hits], axis=0)
    return [
        replace(
            first, run="average", input=drive.astype(complex), output=cross / drive, sensor=sensor,
            input_basis=np.zeros((first.frequency.size, 0), dtype=complex),
        )
    ]  # fmt: skip


def _pole_table(
    order: int, poles: Complex, before: Sequence[StablePole], band: tuple[float, float]
) -> list[StablePole]:
    rows = []
    for pole in poles:
        frequency, ratio = abs(pole) / (2.0 * np.pi), -pole.real / abs(pole)
        if not (band[0] <= frequency <= band[1] and 0.0 < ratio <= HIGHEST_DAMPING):
            continue
        stable = any(
            abs(frequency - old.frequency) <= _CLOSE_FREQUENCY * frequency
            and abs(ratio - old.damping_ratio) <= max(_CLOSE_DAMPING * max(ratio, old.damping_ratio), 5e-4)
            for old in before
        )
        rows.append(StablePole(order=order, frequency=float(frequency), damping_ratio=float(ratio), stable=stable))
    return rows


def select_modes(
    hits: Sequence[HitSpectrum],
    band: tuple[float, float],
    *,
    highest: int = 8,
    count: int | None = None,
) -> ModeSelection:
    """Modes inside ``band`` [Hz] from orders 1 to ``highest``; ``count`` of them where that is given, else by evidence."""
    data = averaged([hit.in_band(band) for hit in hits])
    transients = any(hit.truncated for hit in data)
    table: list[StablePole] = []
    before: list[StablePole] = []
    poles: Complex = np.zeros(0, dtype=np.complex128)
    for order in range(1, highest + 1):
        start = starting_poles(band[0], band[1], order)
        poles = vector_fit(data, start, passes=15, transients=transients)
        before = _pole_table(order, poles, before, band)
        table.extend(before)
    noise = _richest_residual(data, poles)
    candidates = _confirmed(table)
    if not candidates:
        return ModeSelection(model=None, stabilisation=tuple(table), criterion=(), kept=(), noise=noise[0])
    return _eliminate(data, noise, candidates, tuple(table), count)


def _confirmed(table: Sequence[StablePole]) -> list[StablePole]:
    """One entry per pole that at least three orders (or all, with fewer) agree on, taken from its highest order."""
    orders = sorted({row.order for row in table}, reverse=True)
    found: list[StablePole] = []
    confirmed: dict[StablePole, int] = {}
    for row in sorted(table, key=lambda row: -row.order):
        if any(_same(row, other) for other in found):
            continue
        seen = {other.order for other in table if _same(row, other)}
        if len(seen) >= min(3, len(orders)):
            found.append(row)
            confirmed[row] = len(seen)
    apart: list[StablePole] = []
    for row in sorted(found, key=lambda row: -confirmed[row]):
        if all(abs(row.frequency - other.frequency) > _width(row) + _width(other) for other in apart):
            apart.append(row)
    return sorted(apart, key=lambda row: row.frequency)


def _width(row: StablePole) -> float:
    """Half of the half-power bandwidth [Hz]: poles nearer than that describe one resonance's shape, not two modes."""
    return row.damping_ratio * row.frequency


def _same(one: StablePole, other: StablePole) -> bool:
    return abs(one.frequency - other.frequency) <= 0.5 * _CLOSE_FREQUENCY * one.frequency and abs(
        one.damping_ratio - other.damping_ratio
    ) <= max(_CLOSE_DAMPING * max(one.damping_ratio, other.damping_ratio), 5e-4)


def _richest_residual(hits: Sequence[HitSpectrum], poles: Complex) -> list[Real]:
    """What the highest order leaves over, rms over blocks of lines: per hit, shape (n_outputs, n)."""
    result = []
    for hit in hits:
        s = 2j * np.pi * hit.frequency
        pairs = np.concatenate([1.0 / (s[:, None] - poles), 1.0 / (s[:, None] - poles.conj())], axis=1)
        left = np.empty(hit.output.shape)
        for o, output in enumerate(hit.output):
            drive = (hit.sensor[o] * hit.input)[:, None]
            columns = [pairs * drive, drive, (s[:, None] / abs(s[-1])) ** 2 * drive]
            if hit.truncated:
                columns += [pairs * np.abs(drive).mean(), np.ones((s.size, 1)), s[:, None] / abs(s[-1])]
            block = np.concatenate(columns, axis=1)
            block = block / np.linalg.norm(block, axis=0)
            left[o] = np.abs(output - block @ np.linalg.lstsq(block, output, rcond=None)[0]) ** 2
        width = max(8, min(48, s.size // 6))
        kernel = np.ones(width)
        mass = np.convolve(np.ones(s.size), kernel, mode="same")
        smooth = np.array([np.convolve(row, kernel, mode="same") / mass for row in left])
        freedom = s.size - 2 * poles.size - 2
        smooth *= s.size / max(freedom, s.size // 4)
        result.append(
            np.sqrt(smooth / 2.0 + (FAITHFUL * np.abs(hit.output)) ** 2) + 1e-12 * np.abs(hit.output).max()
        )
    return result


@dataclass(frozen=True, eq=False)
class _Normal:
    """Normal equations of one output: columns labelled by mode, -1 for residual lines, -2 for what is always there."""

    matrix: Real
    side: Real
    labels: NDArray[np.intp]
    energy: float
    scale: Real


def _normal(hits: Sequence[HitSpectrum], noise: Sequence[Real], o: int, a1: Real, a2: Real) -> _Normal:
    n = a1.size
    top = 2.0 * np.pi * hits[0].frequency[-1]
    blocks, sides, cut = [], [], [index for index, hit in enumerate(hits) if hit.truncated]
    labels = np.concatenate([np.arange(n), [-1, -1], np.tile([*range(n), *range(n), -2, -2], len(cut))]).astype(
        np.intp
    )
    for index, hit in enumerate(hits):
        s = 2j * np.pi * hit.frequency[:, None]
        inverse = 1.0 / (s**2 + a1 * s + a2)
        drive = (hit.sensor[o] * hit.input)[:, None]
        block = np.zeros((s.size, labels.size), dtype=np.complex128)
        block[:, :n], block[:, n : n + 1], block[:, n + 1 : n + 2] = (
            s**2 * inverse * drive,
            drive,
            (s / top) ** 2 * drive,
        )
        if index in cut:
            at = n + 2 + (2 * n + 2) * cut.index(index)
            block[:, at : at + n], block[:, at + n : at + 2 * n] = inverse, s * inverse
            block[:, at + 2 * n], block[:, at + 2 * n + 1] = 1.0, s[:, 0] / top  # what sampling folds back
        weight = noise[index][o][:, None]
        scaled, side = block / weight, hit.output[o] / weight[:, 0]
        blocks.append(np.concatenate([scaled.real, scaled.imag]))
        sides.append(np.concatenate([side.real, side.imag]))
    rows, side = np.concatenate(blocks), np.concatenate(sides)
    scale = np.linalg.norm(rows, axis=0)
    scale[scale == 0.0] = 1.0
    rows = rows / scale
    return _Normal(rows.T @ rows, rows.T @ side, labels, float(side @ side), scale)


def _solve(
    system: _Normal, modes: Sequence[int], lines: bool
) -> tuple[NDArray[np.intp], NDArray[np.floating[Any]], float]:
    allowed = np.array([label in modes or label == -2 or (lines and label == -1) for label in system.labels])
    index = np.flatnonzero(allowed)
    inner = system.matrix[np.ix_(index, index)]
    solution = np.linalg.lstsq(inner, system.side[index], rcond=1e-12)[0]
    return index, solution, system.energy - float(solution @ system.side[index])


def _eliminate(
    hits: Sequence[HitSpectrum],
    noise: Sequence[Real],
    candidates: Sequence[StablePole],
    table: tuple[StablePole, ...],
    count: int | None,
) -> ModeSelection:
    omega = 2.0 * np.pi * np.array([pole.frequency for pole in candidates])
    a1, a2 = 2.0 * np.array([pole.damping_ratio for pole in candidates]) * omega, omega**2
    outputs = hits[0].output.shape[0]
    systems = [_normal(hits, noise, o, a1, a2) for o in range(outputs)]
    price = float(np.log(sum(2 * hit.output.size for hit in hits)))

    def score(modes: Sequence[int], lines: bool) -> float:
        parts = [_solve(system, modes, lines) for system in systems]
        used = sum(part[0].size for part in parts) + 2 * len(modes)
        return sum(part[2] for part in parts) + price * used

    modes = list(range(len(candidates)))
    choices = (False, True)
    current, lines = min((score(modes, line), line) for line in choices)
    criterion, kept = [current], [len(modes)]
    while len(modes) > 1:
        trial = min((score([m for m in modes if m != out], line), out, line) for out in modes for line in choices)
        if trial[0] > current and (count is None or len(modes) <= count):
            break
        current, lines = trial[0], trial[2]
        modes.remove(trial[1])
        criterion.append(current)
        kept.append(len(modes))
    model = _assemble(systems, modes, lines, a1, a2, 2.0 * np.pi * hits[0].frequency[-1])
    return ModeSelection(
        model=model, stabilisation=table, criterion=tuple(criterion), kept=tuple(kept), noise=noise[0]
    )


def _assemble(
    systems: Sequence[_Normal], modes: Sequence[int], lines: bool, a1: Real, a2: Real, top: float
) -> ModalModel:
    n, outputs = a1.size, len(systems)
    b1 = np.zeros((outputs, len(modes)))
    mass, stiff = np.zeros(outputs if lines else 0), np.zeros(outputs if lines else 0)
    for o, system in enumerate(systems):
        index, solution, _ = _solve(system, modes, lines)
        values = np.zeros(system.labels.size)
        values[index] = solution / system.scale[index]
        b1[o] = values[list(modes)]
        if lines:
            mass[o], stiff[o] = values[n], values[n + 1] / top**2
    keep = np.asarray(modes, dtype=np.intp)
    return ModalModel(a1=a1[keep], a2=a2[keep], b1=b1, mass_line=mass, stiffness_line=stiff)
