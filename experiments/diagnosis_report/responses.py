"""Evidence 2: the frequency response as recorded at each level, and what either model makes of the same inputs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import csd, welch

from jointscope.experiments.charts.chart import Chart, Missing, Panel, Series, Span
from jointscope.experiments.charts.looks import level_look
from jointscope.experiments.diagnosis_report.hits import Hit, usable_band
from jointscope.experiments.diagnosis_report.levels import level_groups
from jointscope.experiments.diagnosis_report.traces import UNITS, Models, Trace

Vector = NDArray[np.float64]
Complex = NDArray[np.complex128]
_QUANTITIES = (
    "linear-acceleration",
    "acceleration",
    "angular-acceleration",
    "angle",
    "position",
    "angular-velocity",
)
_SEGMENT = 2.0  # [s] of one average in a sweep
_LINES_OF_SWEEP = 0.02  # of the input's largest amplitude: below, a sweep drives nothing


@dataclass(frozen=True, eq=False)
class Response:
    """H1 from several records.

    Attributes:
        frequency: [Hz], shape (n,).
        h: Output per input, shape (n,).
        coherence: [-], shape (n,); NaN from a single record.
        input: RMS amplitude of the input, shape (n,).
    """

    frequency: Vector
    h: Complex
    coherence: Vector
    input: Vector


def h1(inputs: Sequence[Vector], outputs: Sequence[Vector], rate: float, segment: int) -> Response:
    """H1 = S_uy / S_uu over all records, each cut into segments of ``segment`` samples (whole records: no window)."""
    whole = segment >= min(u.size for u in inputs)
    n = min(u.size for u in inputs) if whole else segment
    options: dict[str, Any] = {
        "fs": rate, "nperseg": n, "window": "boxcar" if whole else "hann", "detrend": "constant",
    }  # fmt: skip
    f, suu, syy, suy = np.zeros(0), np.zeros(1), np.zeros(1), np.zeros(1, dtype=np.complex128)
    count = 0
    for u, y in zip(inputs, outputs, strict=True):
        part = slice(0, n if whole else u.size)
        f, p = welch(u[part], **options)
        suu = suu + p
        syy = syy + welch(y[part], **options)[1]
        suy = suy + csd(u[part], y[part], **options)[1]
        count += 1 if whole else u.size // n
    keep = slice(1, None)
    suu, syy, suy = suu[keep], syy[keep], suy[keep]
    tiny = np.finfo(float).tiny
    coherence = np.abs(suy) ** 2 / np.maximum(suu * syy, tiny) if count > 1 else np.full(suu.size, np.nan)
    return Response(f[keep], suy / np.maximum(suu, tiny), coherence, np.sqrt(suu))


def response_chart(models: Models, traces: Sequence[Trace], experiment: str) -> Chart | Missing:
    """Magnitude, phase and coherence over all runs of ``experiment``, recorded level by level."""
    label = {"hammer": "Hammer response", "torque-sweep": "Response to the swept torque"}[experiment]
    chosen = _chosen(traces, experiment)
    driven = [(t, u) for t in chosen if (u := _input(models, t)) is not None]
    if not driven:
        side = "force on the arm" if experiment == "hammer" else "motor torque or current"
        return Missing(label, f"{side} together with a response channel, in {experiment} runs")
    rate = driven[0][0].rate
    driven = [(t, u) for t, u in driven if t.rate == rate]
    segment = 10**9 if experiment == "hammer" else int(_SEGMENT * rate)
    hits = tuple(Hit(t.run, t.rate, u) for t, u in driven)
    all_recorded = h1([u for _, u in driven], [t.recorded for t, _ in driven], rate, segment)
    if experiment == "hammer":
        low, high = usable_band(hits)
        low = max(low, 1.0)
    else:
        strong = all_recorded.input > _LINES_OF_SWEEP * all_recorded.input.max()
        low, high = (
            float(all_recorded.frequency[k]) for k in (np.flatnonzero(strong)[0], np.flatnonzero(strong)[-1])
        )
    groups = level_groups(np.array([t.level for t, _ in driven]))
    measured = []
    for rank, group in enumerate(groups):
        own = [driven[k] for k in group]
        found = h1([u for _, u in own], [t.recorded for t, _ in own], rate, segment)
        name = f"recorded, level {rank + 1}" if len(groups) > 1 else "recorded"
        measured.append((name, level_look(rank) if len(groups) > 1 else "recorded", found))
    models_shown = [("base", "base", h1([u for _, u in driven], [t.base for t, _ in driven], rate, segment))]
    if models.effects:
        corrected = h1([u for _, u in driven], [t.corrected for t, _ in driven], rate, segment)
        models_shown.append(("corrected", "corrected", corrected))
    return _drawn(
        label, experiment, driven[0][0], measured, models_shown, all_recorded, (low, min(high, 0.45 * rate))
    )


def _chosen(traces: Sequence[Trace], experiment: str) -> list[Trace]:
    own = [t for t in traces if t.experiment == experiment]
    for quantity in _QUANTITIES:
        for location in ("arm", "load", "motor"):
            found = [t for t in own if (t.quantity, t.location) == (quantity, location)]
            if found and experiment == "hammer" and location == "motor":
                continue
            if found:
                return found
    return []


def _input(models: Models, trace: Trace) -> Vector | None:
    """What drives the run, at the trace's samples."""
    run = models.problem.runs[trace.position]
    force = run.load_force if trace.experiment == "hammer" else run.motor_torque
    if force is None or not np.any(force):
        return None
    return np.interp(trace.time, run.time, force)


def _drawn(
    label: str,
    experiment: str,
    trace: Trace,
    measured: list[tuple[str, str, Response]],
    models: list[tuple[str, str, Response]],
    everything: Response,
    band: tuple[float, float],
) -> Chart:
    low, high = band
    top = min(1.3 * high, float(everything.frequency[-1]))
    size, phase, coherence = [], [], []
    for name, look, r in (*measured, *models):
        part = (r.frequency >= 0.7 * low) & (r.frequency <= top)
        f, h = r.frequency[part], r.h[part]
        size.append(Series(name=name, x=f, y=np.abs(h), look=look))
        known = np.where(r.coherence[part] < 0.5, np.nan, 1.0)
        phase.append(Series(name=name, x=f, y=turned(h) * known, look=look))
        if (name, look, r) in measured and np.any(np.isfinite(r.coherence)):
            coherence.append(Series(name=name, x=f, y=r.coherence[part], look=look))
    part = (everything.frequency >= 0.7 * low) & (everything.frequency <= top)
    for name, _, r in models[-1:]:
        left = np.abs(everything.h - r.h)[part]
        size.append(Series(name=f"left by {name}", x=everything.frequency[part], y=left, look="noise"))
    spans = (Span(low, high, "usable band"),)
    unit = UNITS.get(trace.quantity, "SI")
    against = "per N m on the arm" if experiment == "hammer" else "per N m of motor torque at the output"
    panels = [
        Panel(title="Magnitude", x_label="frequency [Hz]", y_label=f"{trace.quantity} [{unit}] {against}",
              series=tuple(size), y_log=True, spans=spans, link="f", height=300),
        Panel(title="Phase", x_label="frequency [Hz]", y_label="[deg]", series=tuple(phase), spans=spans, link="f",
              y_range=(-100.0, 280.0), height=190),
    ]  # fmt: skip
    if coherence:
        panels.append(Panel(title="Coherence", x_label="frequency [Hz]", y_label="[-]", series=tuple(coherence),
                            spans=spans, link="f", y_range=(0.0, 1.05), height=160))  # fmt: skip
    return Chart(
        stem=f"response-{experiment}",
        label=label,
        shows=f"{trace.quantity.replace('-', ' ')} at the {trace.location} per input, H1 over all runs of a level; the "
        "models are replayed on the same inputs and estimated alike; shaded: usable band; dotted: recorded less the "
        f"{'corrected' if len(models) > 1 else 'base'} model.",
        reading="levels that lie on one another belong to a linear joint; a peak that moves or widens with the level is "
        "friction, play or a stiffness that changes; a peak only the recording has is a mode that the model lacks; a "
        "phase that drifts off in proportion to frequency is a delay; low coherence is noise, leakage or non-linearity.",
        panels=tuple(panels),
    )


def turned(h: Complex) -> Vector:
    """Phase between -90 and 270 [deg], broken where it would wrap: an accelerance starts at 180."""
    angle = np.mod(np.degrees(np.angle(h)) + 90.0, 360.0) - 90.0
    wraps = np.concatenate([[False], np.abs(np.diff(angle)) > 180.0])
    return np.where(wraps, np.nan, angle)
