"""Evidence 1: every hit on top of the others, and how far its force reaches in frequency."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from jointscope.experiments.charts.chart import Chart, Missing, Panel, Series, Span
from jointscope.experiments.charts.looks import level_look
from jointscope.experiments.diagnosis_report.levels import level_groups
from jointscope.recordings.campaign import Run

Vector = NDArray[np.float64]
DROP = 10.0  # [-], 20 dB: a force spectrum is usable down to a tenth of its largest value (ISO 7626-5)
_AFTER = 4.0  # contact times shown after the peak
_BEFORE = 2.0
_DRIVEN_BY: tuple[tuple[Literal["force", "torque"], str], ...] = (("force", "N"), ("torque", "N m"))
_GAP = np.array([np.nan])


@dataclass(frozen=True, eq=False)
class Hit:
    """One hit as recorded.

    Attributes:
        rate: Sampling rate [Hz].
        force: Force or torque, shape (n,).
    """

    run: str
    rate: float
    force: Vector


def hit_of(run: Run) -> Hit | None:
    """The force of a hammer run; None of another run, or where it was not recorded."""
    if run.experiment != "hammer":
        return None
    for quantity, _ in _DRIVEN_BY:
        for signal in run.select(quantity, role="input"):
            samples = signal.channel.samples
            if samples is not None:
                force = np.asarray(samples, dtype=np.float64)
                return Hit(run.id, signal.sampling_rate, force[np.isfinite(force)])
    return None


def hits_unit(runs: Sequence[Run]) -> str:
    """Unit of what hits the arm; without one where the force is not calibrated."""
    for run in runs:
        for quantity, unit in _DRIVEN_BY:
            for signal in run.select(quantity, role="input") if run.experiment == "hammer" else ():
                return (
                    unit if signal.channel.unit != "1" or signal.channel.scale is not None else "units of the file"
                )
    return "N"


def spectrum(hit: Hit) -> tuple[Vector, Vector]:
    """Frequencies [Hz] and amplitude [unit s] of the hit less its median."""
    x = hit.force - np.median(hit.force)
    frequency = np.asarray(np.fft.rfftfreq(x.size, 1.0 / hit.rate)[1:], dtype=np.float64)
    return frequency, np.asarray(np.abs(np.fft.rfft(x))[1:] / hit.rate, dtype=np.float64)


def usable_band(hits: tuple[Hit, ...]) -> tuple[float, float]:
    """From the first line to where the median hit's force spectrum falls below a tenth of its largest value [Hz]."""
    ends = []
    lowest = np.inf
    for hit in hits:
        f, amplitude = spectrum(hit)
        peak = int(np.argmax(amplitude))
        below = np.flatnonzero(amplitude[peak:] < amplitude[peak] / DROP)
        ends.append(f[peak + below[0]] if below.size else f[-1])
        lowest = min(lowest, f[0])
    return float(lowest), float(np.median(ends))


def hits_chart(hits: tuple[Hit, ...], unit: str, stem: str = "hits") -> Chart | Missing:
    """Force in time about its peak, and its spectrum with the usable band shaded."""
    if not hits:
        return Missing("Hits and force spectra", "a force (or torque) of hammer hits")
    groups = level_groups(np.array([np.max(np.abs(h.force - np.median(h.force))) for h in hits]))
    time, spectra = [], []
    contact = 1e-3
    for rank, group in enumerate(groups):
        x: list[Vector] = []
        y: list[Vector] = []
        f: list[Vector] = []
        a: list[Vector] = []
        for hit in (hits[k] for k in group):
            force = hit.force - np.median(hit.force)
            peak = int(np.argmax(np.abs(force)))
            contact = max(contact, np.count_nonzero(np.abs(force) > 0.1 * abs(force[peak])) / hit.rate)
            t = (np.arange(force.size) - peak) / hit.rate
            near = (t > -_BEFORE * contact) & (t < _AFTER * contact)
            x += [1e3 * t[near], _GAP]
            y += [force[near], _GAP]
            lines, amplitude = spectrum(hit)
            f += [lines, _GAP]
            a += [amplitude, _GAP]
        name = _named(hits, group, rank, len(groups), unit)
        look = level_look(rank)
        time.append(Series(name=name, x=np.concatenate(x), y=np.concatenate(y), look=look))
        spectra.append(Series(name=name, x=np.concatenate(f), y=np.concatenate(a), look=look))
    low, high = usable_band(hits)
    top = min(3.0 * high, 0.5 * hits[0].rate)
    largest = max(float(np.nanmax(s.y)) for s in spectra)
    return Chart(
        stem=stem,
        label="Hits and force spectra",
        shows=f"{len(hits)} hits laid over each other at their peaks; shaded: where the median hit's force stays within "
        f"20 dB of its largest, {low:.2g} to {high:.3g} Hz.",
        reading="pulses of one shape are good hits; a second bump is a double hit, a flat top is clipping; a response is "
        "measured only as far as the force reaches, so nothing is to be read above the shaded band.",
        columns=2,
        panels=(
            Panel(
                title="Hits in time", x_label="time about the peak [ms]", y_label=f"[{unit}]", series=tuple(time)
            ),
            Panel(
                title="Their spectra",
                x_label="frequency [Hz]",
                y_label=f"[{unit} s]",
                series=tuple(spectra),
                y_log=True,
                x_range=(0.0, top),
                y_range=(1e-3 * largest, 1.5 * largest),
                spans=(Span(low, high, "usable band"),),
            ),
        ),
    )


def _named(hits: tuple[Hit, ...], group: NDArray[np.int64], rank: int, count: int, unit: str) -> str:
    peaks = [float(np.max(np.abs(hits[k].force - np.median(hits[k].force)))) for k in group]
    size = f"{min(peaks):.3g} to {max(peaks):.3g} {unit}" if len(peaks) > 1 else f"{peaks[0]:.3g} {unit}"
    return f"level {rank + 1}: {size}" if count > 1 else f"hits, {size}"
