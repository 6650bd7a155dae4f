r"""How hard a case is, by two numbers computed with the truth and its own simulator; they are sealed with it.

With r what the refitted base leaves of the recordings' outputs, given their inputs, whitened, and P the projection off
what a fit can absorb besides (each hit's gain and timing):

z   = |P r|: how far the best base stays away from the truth, in standard deviations;
z_d = min over the rivals of |P' r|, P' also off the rival's own directions: how far the best wrong name stays away.

The base is refitted by chord steps before r is taken (secant responses, not derivatives, for what is not small).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from jointscope.sim.concealed.law import Effect
from jointscope.sim.concealed.rehearsal import rehearse
from jointscope.sim.concealed.yardstick import (
    SHIFT,
    Record,
    Yardstick,
    changed,
    misfit_of,
    off,
    orthonormal,
)

Real = NDArray[np.float64]


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
    misfit = yard.white(misfit_of(yard.rig, yard.plan, yard.runs, record, yard.base)) - yard.origin
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
            trial = change + share * step * SHIFT
            rig = changed(yard.rig, dict(zip(names, trial, strict=True)))
            try:
                misfit = misfit_of(rig, yard.plan, yard.runs, sight.record, None)
            except FloatingPointError:
                continue
            left = yard.white(misfit) - yard.origin
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
    for channels, weights in zip(truth, yard.white.weights, strict=True):
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


def left_over(r: Real, directions: Real) -> float:
    """|r| off the given directions, shape (n, m) [standard deviations]."""
    if not np.any(directions):
        return float(np.linalg.norm(r))
    return float(np.linalg.norm(off(orthonormal(directions), r)))


def graded(yard: Yardstick, r: Real, record: Record, against: Mapping[str, Real]) -> Strength:
    """z and z_d of what leaves ``r`` of ``record``; ``against`` holds each rival's directions, shape (n, m)."""
    z = float(np.linalg.norm(r))
    nearest, z_d = "", z
    for label, directions in against.items():
        left = left_over(r, directions)
        if left < z_d:
            nearest, z_d = label, left
    return Strength(z=z, z_d=z_d, nearest=nearest, materiality=materiality(yard, r, record))
