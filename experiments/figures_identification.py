"""What an identification saw and what it fitted: FRF, hits, levels, stabilisation, and the motor bench's responses."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from jointscope.experiments.page import Picture
from jointscope.experiments.plot_style import BAND, MEASURED, PREDICTED, QUIET, THIRD, save, style
from jointscope.identification.direct_parametric import ParametricFit
from jointscope.identification.result import Identification, MatrixFit

Real = NDArray[np.float64]
Complex = NDArray[np.complexfloating[Any, Any]]

_TURN = 180.0 / np.pi


def draw(found: Identification, folder: Path) -> list[Picture]:
    """Every picture that ``found`` has the data for, as PNG in ``folder``."""
    pictures = []
    if found.frf is not None and found.fit is not None:
        pictures.append(_frf(found, folder / "frf.png"))
        pictures.append(_hits(found.fit, found.band, folder / "hits.png"))
    if found.levels:
        pictures.append(_levels(found, folder / "levels.png"))
    if found.selection is not None and len({row.order for row in found.selection.stabilisation}) > 1:
        pictures.append(_stabilisation(found, folder / "stabilisation.png"))
    if found.response is not None:
        pictures.append(_matrix(found.response, folder / "responses.png"))
    return pictures


def _frf(found: Identification, path: Path) -> Picture:
    frf, fit = found.frf, found.fit
    assert frf is not None and fit is not None
    top = min(float(frf.frequency[-1]), 2.0 * found.band[1])
    show = frf.frequency <= top
    frequency, measured = frf.frequency[show], frf.h1[show]
    model = fit.model.response(2j * np.pi * frequency)[0]
    with style():
        figure = Figure(figsize=(8.5, 8.0), layout="constrained")
        size, phase, coherence = figure.subplots(3, 1, sharex=True, height_ratios=[3, 2, 1])
        size.semilogy(frequency, np.abs(measured), color=MEASURED, label="measured (H1)")
        size.semilogy(frequency, np.abs(model), color=PREDICTED, label="fitted")
        size.semilogy(frequency, np.abs(measured - model), color=QUIET, linewidth=0.8, label="measured - fitted")
        if frf.averages > 1:
            noise = np.sqrt(frf.variance[show])
            size.semilogy(frequency, noise, color=THIRD, linewidth=0.8, label="standard deviation of H1")
        size.set_ylabel("|q''/T| [rad/s² per N m]" if not found.refused else "|output/input|")
        size.set_title("Averaged response, the fit, and what the fit leaves over")
        size.legend(ncols=2)
        loud = (
            np.abs(measured) > 5.0 * np.sqrt(frf.variance[show]) if frf.averages > 1 else np.ones(show.sum(), bool)
        )
        phase.plot(
            frequency,
            np.where(loud, np.mod(np.angle(measured) * _TURN + 30.0, 360.0) - 30.0, np.nan),
            color=MEASURED,
        )
        phase.plot(frequency, np.mod(np.angle(model) * _TURN + 30.0, 360.0) - 30.0, color=PREDICTED)
        phase.set_ylabel("phase [deg]")
        phase.set_yticks([0, 90, 180, 270])
        if frf.averages > 1:
            coherence.plot(frequency, frf.coherence[show], color=MEASURED)
        else:
            coherence.text(0.5, 0.5, "one hit: no coherence", transform=coherence.transAxes, ha="center")
        coherence.set_ylim(0.0, 1.05)
        coherence.set_ylabel("coherence")
        coherence.set_xlabel("frequency [Hz]")
        for axes in (size, phase, coherence):
            axes.axvspan(*found.band, color=BAND, alpha=0.25, linewidth=0)
        save(figure, path)
    verdict = (
        found.lack_of_fit.verdict if found.lack_of_fit else "with fewer than three hits its size can't be judged"
    )
    return Picture(path=path, caption=f"Shaded: the fitted band. The residual (grey): {verdict}.")


def _hits(fit: ParametricFit, band: tuple[float, float], path: Path) -> Picture:
    with style():
        figure = Figure(figsize=(8.5, 6.0), layout="constrained")
        force, gain = figure.subplots(2, 1)
        for hit in fit.hits:
            force.loglog(hit.frequency, np.abs(hit.input), color=MEASURED, alpha=0.5, linewidth=0.8)
            response = hit.output[0] / hit.sensor[0] / np.where(np.abs(hit.input) > 0, hit.input, np.nan)
            gain.semilogy(hit.frequency, np.abs(response), color=MEASURED, alpha=0.35, linewidth=0.7)
        frequency = fit.hits[0].frequency
        gain.semilogy(
            frequency, np.abs(fit.model.response(2j * np.pi * frequency)[0]), color=PREDICTED, label="fit"
        )
        force.set_title(f"Spectra of {len(fit.hits)} hits inside the fitted band")
        force.set_ylabel("|T| [N m s] or input")
        gain.set_title("Each hit's own response")
        gain.set_ylabel("|output/input|")
        gain.set_xlabel("frequency [Hz]")
        gain.legend()
        save(figure, path)
    scatter = fit.scatter
    return Picture(
        path=path,
        caption=f"Hit-to-hit scatter beyond noise: gain {100 * scatter.gain:.2f} %, timing {1e6 * scatter.timing:.1f} us; "
        "the intervals contain it.",
    )


def _levels(found: Identification, path: Path) -> Picture:
    with style():
        figure = Figure(figsize=(8.5, 3.4), layout="constrained")
        left, right = figure.subplots(1, 2)
        for axes, name, label in (
            (left, "frequency", "natural frequency [Hz]"),
            (right, "damping_ratio", "damping ratio [%]"),
        ):
            factor = 100.0 if name == "damping_ratio" else 1.0
            _level_points(axes, found, name, factor)
            axes.set_xscale("log")
            axes.set_xlabel("peak of the hits [N m or input unit]")
            axes.set_ylabel(label)
        left.set_title("Hits grouped by level, each group fitted alone")
        save(figure, path)
    chance = found.level_probability if found.level_probability is not None else float("nan")
    said = (
        "the joint depends on the level of excitation" if chance < 0.01 else "no dependence on level beyond chance"
    )
    return Picture(
        path=path, caption=f"Bars: 95 % intervals. Such differences arise by chance with p = {chance:.2g}: {said}."
    )


def _level_points(axes: Axes, found: Identification, name: str, factor: float) -> None:
    for level in found.levels:
        estimate = getattr(level, name)
        at = float(np.sqrt(level.low * level.high))
        value = factor * estimate.value
        bars = [[value - factor * estimate.low], [factor * estimate.high - value]]
        axes.errorbar([at], [value], yerr=bars, xerr=[[at - level.low], [level.high - at]], fmt="o", color=MEASURED,
                      capsize=3)  # fmt: skip


def _stabilisation(found: Identification, path: Path) -> Picture:
    selection = found.selection
    assert selection is not None
    with style():
        figure = Figure(figsize=(8.5, 4.2), layout="constrained")
        axes = figure.subplots()
        for stable, colour, marker, label in ((True, MEASURED, "o", "stable"), (False, QUIET, "x", "not stable")):
            rows = [row for row in selection.stabilisation if row.stable is stable]
            axes.scatter([row.frequency for row in rows], [row.order for row in rows], c=colour, marker=marker, s=16,
                         linewidths=0.8, label=label)  # fmt: skip
        for mode in found.modes:
            axes.axvline(mode.frequency.value, color=PREDICTED, linewidth=0.8, zorder=0)
        if found.frf is not None:
            twin = axes.twinx()
            inside = (found.frf.frequency >= found.band[0]) & (found.frf.frequency <= found.band[1])
            twin.semilogy(
                found.frf.frequency[inside], np.abs(found.frf.h1[inside]), color=THIRD, linewidth=0.6, alpha=0.7
            )
            twin.set_ylabel("|output/input|")
            twin.grid(False)
        axes.set_xlabel("frequency [Hz]")
        axes.set_ylabel("number of poles asked for")
        axes.set_title("Stabilisation: poles of rising order (lines: the modes kept)")
        axes.legend(loc="upper right")
        save(figure, path)
    return Picture(path=path, caption=f"{len(found.modes)} modes are kept by the evidence (BIC).")


def _matrix(response: MatrixFit, path: Path) -> Picture:
    with style():
        figure = Figure(figsize=(8.5, 3.4 * len(response.names)), layout="constrained")
        axes = figure.subplots(len(response.names), 2, squeeze=False)
        for row, (name, measured, fitted, noise) in enumerate(
            zip(response.names, response.measured, response.fitted, response.deviation, strict=True)
        ):
            size, phase = axes[row]
            size.semilogy(
                response.frequency, np.abs(measured), ".", markersize=3, color=MEASURED, label="measured"
            )
            size.semilogy(response.frequency, np.abs(fitted), color=PREDICTED, label="fitted")
            size.semilogy(response.frequency, np.sqrt(2.0) * noise, color=THIRD, linewidth=0.7, label="noise")
            size.set_title(f"{name}: acceleration per input")
            size.legend()
            phase.plot(response.frequency, np.angle(measured) * _TURN, ".", markersize=3, color=MEASURED)
            phase.plot(response.frequency, np.angle(fitted) * _TURN, color=PREDICTED)
            phase.set_ylabel("phase [deg]")
        for bottom in axes[-1]:
            bottom.set_xlabel("frequency [Hz]")
        save(figure, path)
    return Picture(path=path, caption=f"RMS of ln|fitted/measured|: {response.log_error:.3f} over both sides.")
