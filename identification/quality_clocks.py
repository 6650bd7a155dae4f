"""Clocks of different devices: one motion that two of them recorded, or a signal that both did (``sync``)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from jointscope.identification.quality_relations import as_motion, as_sensed, trimmed
from jointscope.identification.quality_signals import (
    ORDER,
    Grid,
    common_grid,
    motions,
    on_grid,
    rigid_band,
)
from jointscope.recordings.campaign import Nameplate, Run, Signal
from jointscope.recordings.finding import Finding

Real = NDArray[np.float64]
SMALLEST: Final = 1.5e-3  # s; what two elastically joined shafts may lag by themselves stays below
LONGEST: Final = 0.25  # s


@dataclass(frozen=True)
class Lag:
    """How late ``second`` is against ``first`` [s], with its standard deviation."""

    seconds: float
    sigma: float


def clock_findings(run: Run, rig: Nameplate, named: set[str]) -> Iterator[Finding]:
    """``clock-skew`` between devices whose start is claimed to be known."""
    seen: set[tuple[int, int]] = set()
    for first, second, band in _pairs(run, rig):
        devices = (first.device, second.device)
        if devices in seen or {first.channel.column, second.channel.column} & named:
            continue
        spread = math.hypot(first.stream.start_uncertainty, second.stream.start_uncertainty)
        lag = None if math.isinf(spread) else _measured(first, second, run, rig, band)
        if lag is None:
            continue
        seen.add(devices)
        smallest = 0.25 / min(first.sampling_rate, second.sampling_rate) if band is None else SMALLEST
        if abs(lag.seconds) > max(smallest, 5.0 * lag.sigma, 4.0 * spread):
            late = f"{abs(1e3 * lag.seconds):.3g} ms {'late' if lag.seconds > 0.0 else 'early'}"
            start = second.stream.start - lag.seconds
            detail = f"{late} against {first.channel.column} ({first.stream.file}), +-{2e3 * lag.sigma:.2g} ms"
            yield Finding("clock-skew", run.id, second.channel.column, detail, f"start = {start:.6g}")


def _pairs(run: Run, rig: Nameplate) -> Iterator[tuple[Signal, Signal, float | None]]:
    """Signals of different devices that show one thing, and the band in which they do (``None``: any)."""
    shared = [
        signal
        for signal in run.signals
        if signal.stream.sync == signal.channel.column and signal.channel.samples is not None
    ]
    for place, first in enumerate(shared):
        for second in shared[place + 1 :]:
            yield first, second, None
    band = None if run.brake else rigid_band(run)
    if band is None:
        return
    moved = [s for place in ("motor", "arm", "load") for s in motions(run, rig, place)]
    for place, first in enumerate(moved):
        for second in moved[place + 1 :]:
            if first.device != second.device:
                yield (*sorted((first, second), key=lambda s: ORDER[s.channel.quantity]), band)  # type: ignore[misc]


def _measured(first: Signal, second: Signal, run: Run, rig: Nameplate, band: float | None) -> Lag | None:
    grid = common_grid([first, second])
    if grid is None:
        return None
    if band is None:
        # differences, because a slow signal's correlation leans towards no lag at all
        return lag_between(np.diff(on_grid(first, grid)), np.diff(on_grid(second, grid)), grid)
    if band > 0.4 * grid.rate:
        return None
    order = max(ORDER[first.channel.quantity], ORDER[second.channel.quantity])
    a, b = as_motion(first, grid, rig, band, order), as_motion(second, grid, rig, band, order)
    a = as_sensed(a, first, second, run, rig, grid, band)
    return lag_between(trimmed(a, grid, band), trimmed(b, grid, band), grid, band)


def lag_between(first: Real, second: Real, grid: Grid, band: float | None = None) -> Lag | None:
    """Where the cross-correlation peaks (its sign aside), or ``None`` where the two have too little in common.

    The deviation is that of a delay estimated from a record with ``2 band T`` independent values and the residual
    that remains: sigma = sqrt((1 - rho^2)/(2 band T))/(rho omega_rms).
    """
    from scipy.signal import correlate

    x, y = first - first.mean(), second - second.mean()
    norm = float(np.linalg.norm(x) * np.linalg.norm(y))
    if norm == 0.0:
        return None
    reach = min(round(LONGEST * grid.rate), x.size // 4)
    rho = correlate(y, x, mode="full", method="fft")[x.size - 1 - reach : x.size + reach] / norm
    at = int(np.argmax(np.abs(rho)))
    peak = abs(float(rho[at]))
    if peak < 0.95 or at in (0, rho.size - 1):
        return None
    left, mid, right = np.abs(rho[at - 1 : at + 2])
    bend = left - 2.0 * mid + right
    fraction = 0.5 * (left - right) / bend if bend != 0.0 else 0.0
    slope = float(np.linalg.norm(np.gradient(x, 1.0 / grid.rate)) / np.linalg.norm(x))  # omega_rms
    independent = max(4.0, 2.0 * (band or 0.25 * grid.rate) * x.size / grid.rate)
    sigma = math.sqrt(max(1.0 - min(peak, 1.0) ** 2, 1e-12) / independent) / (peak * slope)
    return Lag((at - reach + float(fraction)) / grid.rate, sigma)
