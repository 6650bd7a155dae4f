"""Levels: a channel without a signal, cut off, beyond its sensor's range, or coarser than its signal needs."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from jointscope.recordings.campaign import Run, Signal
from jointscope.recordings.finding import Finding
from jointscope.recordings.units import si_unit

Real = NDArray[np.float64]
SENSED: Final = ("force", "linear-acceleration", "acceleration", "angular-acceleration", "phase-current")
COARSE = 64  # steps of a converter
COARSE_ENCODER = 8  # steps of an encoder: a vibration it can't resolve


def level_findings(run: Run, signal: Signal) -> Iterator[Finding]:
    """``dead-channel``, or else ``clipping``, ``overload`` and ``quantisation``."""
    x = signal.samples[np.isfinite(signal.samples)]
    channel, unit = signal.channel, _unit(signal)
    span = float(np.ptp(x))
    if span <= 1e-12 * float(np.max(np.abs(x))):
        if not _may_stand_still(run, signal):
            yield Finding("dead-channel", run.id, channel.column, f"constant at {x[0]:.4g} {unit}")
        return
    plateau = longest_plateau(x) if channel.quantity in SENSED else 0
    if plateau >= 3:
        at = x[int(np.argmax(np.abs(x)))]
        detail = f"{plateau} samples in a row at the extreme of {at:.4g} {unit}: cut off there"
        yield Finding("clipping", run.id, channel.column, detail)
    elif channel.full_scale is not None and float(np.max(np.abs(x))) >= 0.98 * channel.full_scale:
        peak = float(np.max(np.abs(x)))
        detail = f"peak {peak:.4g} {unit} at a full scale of {channel.full_scale:.4g} {unit}: use a wider range"
        yield Finding("overload", run.id, channel.column, detail)
    step = resolution(x)
    coarse = COARSE_ENCODER if channel.quantity in ("angle", "position") else COARSE
    if 0.0 < span < coarse * step and _on_a_lattice(x, step):
        detail = f"spans {span / step:.0f} steps of {step:.3g} {unit}: {np.log2(span / step):.1f} bits"
        yield Finding("quantisation", run.id, channel.column, detail)


def _unit(signal: Signal) -> str:
    unit = si_unit(signal.channel)
    return "" if unit == "1" else unit


def _may_stand_still(run: Run, signal: Signal) -> bool:
    held = run.brake or any(hold in ("brake", "locked") for hold in run.hold.values())
    idle_drive = signal.channel.location == "motor" and (held or run.experiment in ("free", "hammer"))
    return idle_drive or (signal.channel.role == "input" and run.experiment == "free")


def resolution(x: Real) -> float:
    """The smallest step between values that occur, numerical noise aside; 0 for a constant."""
    steps = np.diff(np.unique(x))
    steps = steps[steps > 1e-9 * float(np.ptp(x))]
    return float(steps.min()) if steps.size else 0.0


def _on_a_lattice(x: Real, step: float) -> bool:
    """Whether values are whole steps apart: those of a converter are, those of a short clean pulse aren't."""
    apart = np.diff(np.unique(x)) / step
    return bool(np.mean(np.abs(apart - np.rint(apart)) < 0.05) > 0.95)


def longest_plateau(x: Real) -> int:
    """Samples in a row at either extreme, where the signal runs into it too steeply to have turned there by itself.

    A smooth turning point of a coarse record holds its last step too; but then the step before it is a small one.
    """
    step = resolution(x)
    longest = 0
    for y in (x, -x):
        flat = y >= y.max() - 1e-9 * np.ptp(y)
        edges = np.flatnonzero(np.diff(np.concatenate([[0], flat.astype(np.int8), [0]])))
        for first, end in zip(edges[::2], edges[1::2], strict=True):
            if end - first < 3 or first == 0 or end == y.size:
                continue
            approach = min(y[first] - y[first - 1], y[end - 1] - y[end])
            expected = 4.0 * max(step, 1e-3 * float(np.ptp(y)))
            # a parabola that turns within the plateau rises by its curvature only: k^2 of the step next to it
            if approach > expected and max(y[first] - y[first - 1], y[end - 1] - y[end]) * (
                end - first
            ) > 0.05 * np.ptp(y):
                longest = max(longest, int(end - first))
    return longest
