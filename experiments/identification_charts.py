"""What an identification saw and what it fitted: response, hits, levels, stabilisation, and the motor bench's responses."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from jointscope.experiments.charts.chart import Chart, Panel, Series, Span
from jointscope.experiments.charts.looks import level_look
from jointscope.experiments.diagnosis_report.levels import level_groups
from jointscope.identification.direct_parametric import ParametricFit
from jointscope.identification.frf import Frf
from jointscope.identification.result import Identification, MatrixFit

Real = NDArray[np.float64]
Complex = NDArray[np.complexfloating[Any, Any]]
_LOUD = 5.0  # deviations: a phase below is noise
_F = "frequency [Hz]"


def identification_charts(found: Identification) -> list[Chart]:
    """Every chart that ``found`` has the data for."""
    charts = []
    if found.frf is not None and found.fit is not None:
        charts.append(response_chart(found, found.frf, found.fit))
    if found.levels:
        charts.append(levels_chart(found))
    if found.selection is not None and len({row.order for row in found.selection.stabilisation}) > 1:
        charts.append(stabilisation_chart(found))
    if found.response is not None:
        charts.append(matrix_chart(found.response))
    return charts


def _degrees(response: Complex) -> Real:
    """Phase between -90 and 270 [deg], broken where it would wrap."""
    angle = np.mod(np.degrees(np.angle(response)) + 90.0, 360.0) - 90.0
    wraps = np.concatenate([[False], np.abs(np.diff(angle)) > 180.0])
    return np.where(wraps, np.nan, angle)


def level_responses(fit: ParametricFit) -> list[tuple[str, str, Real, Complex]]:
    """(name, look, frequency, H1) of the hits of each level, weakest first."""
    found = []
    groups = level_groups(np.array([hit.level for hit in fit.hits]))
    for rank, group in enumerate(groups):
        hits = [fit.hits[k] for k in group if fit.hits[k].frequency.shape == fit.hits[group[0]].frequency.shape]
        power = sum(np.abs(hit.input) ** 2 for hit in hits)
        cross = sum(np.conj(hit.input) * hit.output[0] / hit.sensor[0] for hit in hits)
        peaks = [hit.level for hit in hits]
        name = f"level {rank + 1}: {min(peaks):.3g} to {max(peaks):.3g}"
        found.append((name, level_look(rank), hits[0].frequency, cross / np.maximum(power, 1e-300)))
    return found if len(found) > 1 else []


def response_chart(found: Identification, frf: Frf, fit: ParametricFit) -> Chart:
    """Magnitude with levels, fit and residual; phase; coherence."""
    show = frf.frequency <= min(float(frf.frequency[-1]), 2.0 * found.band[1])
    f, measured = frf.frequency[show], frf.h1[show]
    model = fit.model.response(2j * np.pi * f)[0]
    size = [
        Series(name="recorded (H1, all hits)", x=f, y=np.abs(measured), look="recorded"),
        Series(name="fitted", x=f, y=np.abs(model), look="base"),
        Series(name="recorded less fitted", x=f, y=np.abs(measured - model), look="quiet"),
    ]
    known = np.ones(f.size)
    several = frf.averages > 1
    if several:
        deviation = np.sqrt(frf.variance[show])
        size.append(Series(name="standard deviation of H1", x=f, y=deviation, look="noise"))
        known = np.where(np.abs(measured) > _LOUD * deviation, 1.0, np.nan)
    size += [Series(name=name, x=g, y=np.abs(h), look=look) for name, look, g, h in level_responses(fit)]
    phase = (
        Series(name="recorded (H1, all hits)", x=f, y=_degrees(measured) * known, look="recorded"),
        Series(name="fitted", x=f, y=_degrees(model), look="base"),
    )
    span = (Span(*found.band, "fitted band"),)
    unit = "[rad/s² per N m]" if not found.refused else "[output per input]"
    panels = [
        Panel(title="Magnitude", x_label=_F, y_label=f"|q''/T| {unit}", series=tuple(size), y_log=True, spans=span,
              link="f", height=320),
        Panel(title="Phase", x_label=_F, y_label="[deg]", series=phase, spans=span, link="f", y_range=(-100.0, 280.0),
              height=190),
    ]  # fmt: skip
    if several:
        coherence = Series(name="recorded (H1, all hits)", x=f, y=frf.coherence[show], look="recorded")
        panels.append(Panel(title="Coherence", x_label=_F, y_label="[-]", series=(coherence,), spans=span, link="f",
                            y_range=(0.0, 1.05), height=160))  # fmt: skip
    fitted = (
        found.lack_of_fit.verdict if found.lack_of_fit else "with fewer than three hits its size can't be judged"
    )
    return Chart(
        stem="frf",
        label="Frequency response",
        shows=f"Averaged response of {frf.averages} hit{'s' if several else ''}, the fit, what the fit leaves, and each "
        f"level's own response (peaks in N m or the input's unit); shaded: the fitted band. The residual: {fitted}."
        + ("" if several else " One hit alone has no coherence."),
        reading="a residual at the standard deviation's height is noise; one that stands above it at the peak is friction, "
        "play or a changing stiffness, one elsewhere a further mode; levels that differ at the peak say the same.",
        panels=tuple(panels),
    )


def levels_chart(found: Identification) -> Chart:
    """Frequency and damping of each level's hits fitted alone."""
    panels = []
    for name, title, factor in (
        ("frequency", "natural frequency [Hz]", 1.0),
        ("damping_ratio", "damping ratio [%]", 100.0),
    ):
        at, value, bars_x, bars_y = [], [], [], []
        for level in found.levels:
            estimate = getattr(level, name)
            x = float(np.sqrt(level.low * level.high))
            at.append(x)
            value.append(factor * estimate.value)
            bars_x += [x, x, np.nan, level.low, level.high, np.nan]
            bars_y += [factor * estimate.low, factor * estimate.high, np.nan, value[-1], value[-1], np.nan]
        panels.append(
            Panel(
                title=title.partition(" [")[0].capitalize(),
                x_label="peak of the hits [N m or input unit]",
                y_label=title,
                x_log=True,
                series=(
                    Series(
                        name="95 % interval, range of peaks", x=np.array(bars_x), y=np.array(bars_y), look="quiet"
                    ),
                    Series(name="hits of one level", x=np.array(at), y=np.array(value), look="recorded", mark="o"),
                ),
            )
        )
    chance = found.level_probability if found.level_probability is not None else float("nan")
    said = (
        "the joint depends on the level of excitation" if chance < 0.01 else "no dependence on level beyond chance"
    )
    return Chart(
        stem="levels",
        label="By level",
        shows=f"Hits grouped by level, each group fitted alone. Such differences arise by chance with p = {chance:.2g}: {said}.",
        reading="a frequency that rises with the level is backlash being closed or a spring that hardens; damping that "
        "falls with the level is friction.",
        panels=tuple(panels),
        columns=2,
    )


def stabilisation_chart(found: Identification) -> Chart:
    """Poles of rising order over frequency, with the response in the background."""
    assert found.selection is not None
    rows = found.selection.stabilisation
    series = []
    for stable, look, mark in ((True, "recorded", "o"), (False, "base", "x")):
        own = [row for row in rows if row.stable is stable]
        series.append(
            Series(
                name="stable" if stable else "not stable",
                x=np.array([row.frequency for row in own]),
                y=np.array([float(row.order) for row in own]),
                look=look,
                mark="o" if mark == "o" else "x",
            )
        )
    top = max(float(row.order) for row in rows)
    kept = np.concatenate(
        [[mode.frequency.value, mode.frequency.value, np.nan] for mode in found.modes] or [[np.nan]]
    )
    heights = np.concatenate([[0.0, top + 1.0, np.nan] for _ in found.modes] or [[np.nan]])
    series.append(Series(name="modes kept", x=kept, y=heights, look="corrected"))
    return Chart(
        stem="stabilisation",
        label="Number of modes",
        shows=f"Poles found when more and more are asked for. {len(found.modes)} modes are kept by the evidence (BIC).",
        reading="a column of stable marks is a mode of the structure; marks that wander are noise.",
        panels=(
            Panel(title="Stabilisation", x_label=_F, y_label="number of poles asked for [-]", series=tuple(series),
                  y_range=(0.0, top + 1.0), height=280),
        ),
    )  # fmt: skip


def matrix_chart(response: MatrixFit) -> Chart:
    """Measured and fitted responses of a motor bench, one row per output."""
    panels = []
    for name, measured, fitted, noise in zip(
        response.names, response.measured, response.fitted, response.deviation, strict=True
    ):
        f = response.frequency
        panels.append(
            Panel(
                title=f"{name}: magnitude",
                x_label=_F,
                y_label="acceleration per input",
                y_log=True,
                link="f",
                series=(
                    Series(name="recorded", x=f, y=np.abs(measured), look="recorded"),
                    Series(name="fitted", x=f, y=np.abs(fitted), look="base"),
                    Series(name="noise", x=f, y=np.sqrt(2.0) * noise, look="noise"),
                ),
            )
        )
        panels.append(
            Panel(
                title=f"{name}: phase",
                x_label=_F,
                y_label="[deg]",
                y_range=(-100.0, 280.0),
                link="f",
                series=(
                    Series(name="recorded", x=f, y=_degrees(measured), look="recorded"),
                    Series(name="fitted", x=f, y=_degrees(fitted), look="base"),
                ),
            )
        )
    return Chart(
        stem="responses",
        label="Responses of the bench",
        shows=f"Acceleration per input at either side. RMS of ln|fitted/measured|: {response.log_error:.3f} over both sides.",
        reading="the dip of the motor's response is the anti-resonance (the arm's own frequency on the held motor), the "
        "common peak the resonance of both inertias; a fit that misses one of them belongs to another model.",
        panels=tuple(panels),
        columns=2,
    )
