"""Figures 17-23 of the paper, drawn from results; each is a PNG and the CSV it was drawn from."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from jointscope.atomic import write_text
from jointscope.experiments.plot_style import MEASURED, PREDICTED, QUIET, THIRD, save, style
from jointscope.experiments.six_axis.measure import BAND, parallel_model
from jointscope.experiments.six_axis.results import HammerResult, PredictionResult, SixAxisResult, TorqueResult
from jointscope.identification.modal_physics import with_modes
from jointscope.models.joint import sum_of_modes
from jointscope.prediction.closed_form import acceleration_per_torque
from jointscope.prediction.spectra import spectrum
from jointscope.recordings.campaign import Nameplate

Real = NDArray[np.float64]


def draw_all(out: Path, result: SixAxisResult, rig: Nameplate) -> list[tuple[str, str]]:
    """Draw every figure into ``out``; (file name, caption) of each, in the paper's order."""
    with style():
        drawn = [
            _impact(out, result.hammer),
            _two_systems(out, result.hammer),
            _sum(out, result.hammer),
            _stabilisation(out, result.hammer),
            _mode_shapes(out, result.hammer),
            _currents(out, result),
            _torque(out, result.torque[-1]),
            _transfer(out, result, rig),
            *(_prediction(out, p) for p in result.prediction),
        ]
        if "axes" in result.windup:
            drawn.append(_windup(out, result.windup))
    return drawn


def _impact(out: Path, hammer: HammerResult) -> tuple[str, str]:
    run = hammer.first
    force, acceleration = run.select("force", role="input")[0], run.select("linear-acceleration")[0]
    lever, radius = force.channel.radius or 1.0, acceleration.channel.radius or 1.0
    t = force.times
    torque, angular = lever * force.samples, acceleration.samples / radius
    figure, (top, bottom) = plt.subplots(2, 1, figsize=(7, 4.2), sharex=True, constrained_layout=True)
    top.plot(t, torque, color=MEASURED)
    top.set(ylabel="torque [N m]", title="Figure 17 (a) impact torque about joint 2")
    bottom.plot(t, angular, color=MEASURED)
    bottom.set(
        xlabel="time [s]",
        ylabel="angular acceleration [rad/s²]",
        title="(b) acceleration of its link",
        xlim=(0, 1.5),
    )
    _table(out / "figure-17.csv", {"time_s": t, "torque_Nm": torque, "angular_acceleration_rad_s2": angular})
    return _close(
        out, figure, "figure-17", "One of twenty hits: impact torque and the link's angular acceleration."
    )


def _two_systems(out: Path, hammer: HammerResult) -> tuple[str, str]:
    s = np.asarray(2j * np.pi * hammer.frequency, dtype=np.complex128)
    model = hammer.modes.fit.model
    order = np.argsort(model.a2)
    parts = [with_modes(model, [int(k)]).response(s)[0] for k in order[:2]]
    figure, axes = plt.subplots(figsize=(7, 3.6), constrained_layout=True)
    axes.semilogy(hammer.frequency, np.abs(hammer.measured), color=MEASURED, label="20 hits, averaged")
    for part, mode, colour in zip(parts, hammer.modes.modes, (PREDICTED, THIRD), strict=False):
        axes.semilogy(
            hammer.frequency,
            np.abs(part),
            color=colour,
            label=f"single-mode system at {mode.frequency.value:.2f} Hz",
        )
    _frf_axes(axes, "Figure 18  two single-degree-of-freedom systems")
    _table(out / "figure-18.csv", {"frequency_Hz": hammer.frequency, "measured": np.abs(hammer.measured),
                                   **{f"mode_{k}": np.abs(p) for k, p in enumerate(parts, 1)}})  # fmt: skip
    return _close(out, figure, "figure-18", "Accelerance of joint 2 and the two single-mode systems fitted to it.")


def _sum(out: Path, hammer: HammerResult) -> tuple[str, str]:
    s = np.asarray(2j * np.pi * hammer.frequency, dtype=np.complex128)
    terms = [mode.term for mode in hammer.modes.modes[:2]]
    figure, axes = plt.subplots(figsize=(7, 3.6), constrained_layout=True)
    axes.semilogy(hammer.frequency, np.abs(hammer.measured), color=MEASURED, label="20 hits, averaged")
    axes.semilogy(
        hammer.frequency, np.abs(hammer.summed), color=PREDICTED, ls="--", label="modes and residual terms"
    )
    axes.semilogy(
        hammer.frequency, np.abs(sum_of_modes(terms, s)), color=THIRD, ls=":", label="two modes, no residual terms"
    )
    _frf_axes(axes, "Figure 19  sum of the systems")
    _table(out / "figure-19.csv", {"frequency_Hz": hammer.frequency, "measured": np.abs(hammer.measured),
                                   "exact": np.abs(hammer.exact), "sum": np.abs(hammer.summed)})  # fmt: skip
    return _close(
        out, figure, "figure-19",
        f"Sum of modes against the FRF: at most {hammer.between_peaks:.2f} dB apart between the peaks; fitted over "
        f"{hammer.modes.band[0]:g}-{hammer.modes.band[1]:g} Hz, so the third mode at 74 Hz is a residual term only.",
    )  # fmt: skip


def _stabilisation(out: Path, hammer: HammerResult) -> tuple[str, str]:
    poles = hammer.modes.selection.stabilisation
    figure, axes = plt.subplots(figsize=(7, 3.2), constrained_layout=True)
    for stable, mark, colour in ((False, "x", QUIET), (True, "o", PREDICTED)):
        chosen = [p for p in poles if p.stable == stable]
        axes.plot([p.frequency for p in chosen], [p.order for p in chosen], mark, color=colour, ms=5,
                  label="stable in frequency and damping" if stable else "not stable", ls="none")  # fmt: skip
    behind = axes.twinx()
    behind.semilogy(hammer.frequency, np.abs(hammer.measured), color=MEASURED, lw=0.7, alpha=0.6)
    behind.set(ylabel="|FRF|")
    behind.grid(visible=False)
    axes.set(xlabel="frequency [Hz]", ylabel="modes asked for", xlim=hammer.modes.band,
             title=f"Stabilisation: the evidence keeps {hammer.modes.fit.model.modes} modes",
             yticks=range(1, max((p.order for p in poles), default=1) + 1))  # fmt: skip
    axes.legend(loc="lower right")
    _table(out / "stabilisation.csv", {"order": np.array([p.order for p in poles], float),
                                       "frequency_Hz": np.array([p.frequency for p in poles]),
                                       "damping_ratio": np.array([p.damping_ratio for p in poles]),
                                       "stable": np.array([p.stable for p in poles], float)})  # fmt: skip
    return _close(
        out, figure, "stabilisation", "Poles of rising model order; circles are there in the order below too."
    )


def _mode_shapes(out: Path, hammer: HammerResult) -> tuple[str, str]:
    figure, axes = plt.subplots(
        1, len(hammer.physics), figsize=(7, 3.0), sharey=True, constrained_layout=True, squeeze=False
    )
    columns: dict[str, Real] = {}
    for axis, mode in zip(axes[0], hammer.physics, strict=True):
        names = list(mode.share)
        y = np.arange(len(names))
        axis.barh(y - 0.2, [mode.share[n] for n in names], 0.38, color=MEASURED, label="share of elastic energy")
        axis.barh(
            y + 0.2, [mode.angles[n] for n in names], 0.38, color=PREDICTED, label="link angle (largest = 1)"
        )
        axis.set_yticks(y, [n.removesuffix("_joint") for n in names])
        axis.set(title=f"{mode.measured:.2f} Hz (model {mode.computed:.2f} Hz)", xlim=(-1.05, 1.05))
        columns[f"share_{mode.computed:.1f}Hz"] = np.array([mode.share[n] for n in names])
        columns[f"angle_{mode.computed:.1f}Hz"] = np.array([mode.angles[n] for n in names])
    axes[0][0].legend(loc="lower left")
    _table(out / "mode-shapes.csv", columns)
    return _close(out, figure, "mode-shapes", "; ".join(mode.summary for mode in hammer.physics) + ".")


def _currents(out: Path, result: SixAxisResult) -> tuple[str, str]:
    phases = result.currents.select("phase-current")
    t = phases[0].times
    figure, (top, bottom) = plt.subplots(2, 1, figsize=(7, 4.0), constrained_layout=True)
    for phase, colour in zip(phases, (MEASURED, PREDICTED, THIRD), strict=True):
        top.plot(t, phase.samples, color=colour, lw=0.5, label=phase.channel.column)
        inside = (t > 0.9) & (t < 1.0)
        bottom.plot(t[inside], phase.samples[inside], color=colour)
    top.set(ylabel="current [A]", title=f"Figure 20  three phase currents, {result.currents.id}")
    top.legend(ncols=3)
    bottom.set(xlabel="time [s]", ylabel="current [A]")
    _table(out / "figure-20.csv", {"time_s": t, **{p.channel.column: p.samples for p in phases}})
    return _close(
        out, figure, "figure-20", "Phase currents at 10 kHz while joint 2 moves; below, a tenth of a second."
    )


def _torque(out: Path, torque: TorqueResult) -> tuple[str, str]:
    rate = 1.0 / (torque.times[1] - torque.times[0])
    figure, (top, bottom) = plt.subplots(2, 1, figsize=(7, 4.6), constrained_layout=True)
    top.plot(torque.times, torque.envelope, color=QUIET, lw=0.8, label="|h[i_a]| K_t (28, 29): no sign")
    top.plot(torque.times, torque.true, color=MEASURED, lw=2.4, label="true")
    top.plot(torque.times, torque.vector, color=PREDICTED, lw=0.6, label="signed, from the current vector")
    for start, end in torque.doubts:
        top.axvspan(start, end, color=QUIET, alpha=0.4)
    top.margins(y=0.18)  # the legend stands above the curves
    top.set(xlabel="time [s]", ylabel="torque [N m]", title=f"Figure 21 (a) electromagnetic torque, {torque.run}")
    top.legend(ncols=3)
    spectra = {name: spectrum(getattr(torque, name), rate) for name in ("envelope", "vector", "true")}
    for name, colour, width in (("envelope", QUIET, 0.7), ("true", MEASURED, 2.0), ("vector", PREDICTED, 0.6)):
        found = spectra[name]
        inside = (found.frequency > 0.5) & (found.frequency < 100.0)
        bottom.semilogy(found.frequency[inside], np.abs(found.amplitude[inside]), color=colour, lw=width)
    bottom.set(xlabel="frequency [Hz]", ylabel="torque [N m]", title="(b) its spectrum")
    _table(out / "figure-21.csv", {"time_s": torque.times, "true": torque.true, "vector": torque.vector,
                                   "park": torque.park, "envelope": torque.envelope})  # fmt: skip
    return _close(
        out, figure, "figure-21",
        f"Torque from currents: error {100 * torque.errors['vector']:.2f} % rms from the current vector, "
        f"{100 * torque.errors['envelope']:.0f} % from the envelope, which turns negative torque positive and is wrong "
        "where the motor hardly turns.",
    )  # fmt: skip


def _transfer(out: Path, result: SixAxisResult, rig: Nameplate) -> tuple[str, str]:
    frequency = np.arange(1.0, 100.0, 0.1)
    model = parallel_model(rig, result.hammer.modes)
    from dataclasses import replace

    single = [np.abs(acceleration_per_torque(replace(model, terms=(term,)), frequency)) for term in model.terms]
    both = np.abs(acceleration_per_torque(model, frequency))
    figure, (left, right) = plt.subplots(1, 2, figsize=(7.4, 3.2), sharey=True, constrained_layout=True)
    for part, colour in zip(single, (PREDICTED, THIRD), strict=True):
        left.semilogy(frequency, part, color=colour)
    right.semilogy(frequency, both, color=MEASURED)
    left.set(
        xlabel="frequency [Hz]", ylabel="q''/T_e [rad/s² per N m]", title="Figure 22 (a) two two-inertia systems"
    )
    right.set(xlabel="frequency [Hz]", title="(b) in parallel")
    _table(
        out / "figure-22.csv",
        {"frequency_Hz": frequency, "system_1": single[0], "system_2": single[1], "parallel": both},
    )
    return _close(
        out, figure, "figure-22", "The paper's prediction function: each mode with the motor's parameters, summed."
    )


def _prediction(out: Path, found: PredictionResult) -> tuple[str, str]:
    inside = (found.frequency >= 1.0) & (found.frequency <= 100.0)
    f = found.frequency[inside]
    figure, axes = plt.subplots(figsize=(7.4, 3.6), constrained_layout=True)
    axes.semilogy(f, np.abs(found.measured[inside]), color=MEASURED, lw=1.0, label="measured")
    for name, colour in (("parallel", QUIET), ("multi-joint", PREDICTED)):
        score = found.scores[name]
        axes.semilogy(f, np.abs(found.predicted[name][inside]), color=colour, lw=0.8,
                      label=f"{name}: {score.median_error:.2f} dB, FRAC {score.frac:.3f}")  # fmt: skip
    axes.axvspan(*BAND, color="#f5f6f8", zorder=0)
    axes.set(xlabel="frequency [Hz]", ylabel="acceleration [m/s²]", title=f"Figure 23  {found.run}")
    axes.legend()
    _table(out / f"figure-23-{found.run}.csv", {"frequency_Hz": f, "measured": np.abs(found.measured[inside]),
                                                "true": np.abs(found.true[inside]),
                                                **{n: np.abs(p[inside]) for n, p in found.predicted.items()}})  # fmt: skip
    bias = found.scores["parallel"].bias
    return _close(
        out, figure, f"figure-23-{found.run}",
        f"Predicted and measured acceleration of joint 2's link, {found.run}. Over {BAND[0]:g}-{BAND[1]:g} Hz the "
        f"parallel form is {abs(bias):.1f} dB too {'high' if bias > 0 else 'low'} in the median; scored over "
        f"{100 * found.clear:.0f} % of the bins.",
    )  # fmt: skip


def _windup(out: Path, windup: Mapping[str, Any]) -> tuple[str, str]:
    figure, axes = plt.subplots(2, 3, figsize=(7.6, 4.6), constrained_layout=True)
    for column, axis in enumerate(windup["axes"]):
        record = axis["records"][0]
        w = 1e3 * (record.motor_angle - record.link_angle)
        speed = np.gradient(record.motor_angle) * record.rate
        name = f"kr300-axis-{axis['axis']}.csv"
        axes[0, column].plot(record.torque / 1e3, w, color=MEASURED, lw=0.5)
        axes[0, column].set(xlabel="n T_e [kN m]", title=f"KR300 axis {axis['axis']}")
        axes[1, column].plot(speed, w, color=PREDICTED, lw=0.5)
        axes[1, column].set(xlabel="speed [rad/s]")
        _table(out / name, {"torque_Nm": record.torque, "speed_rad_s": speed, "windup_mrad": w})
    for row in axes:
        row[0].set_ylabel("wind-up [mrad]")
    return _close(
        out, figure, "kr300-windup",
        "Wind-up of the KR300 (trajectory A) against motor torque and against speed: most of it is proportional to speed.",
    )  # fmt: skip


def _frf_axes(axes: Axes, title: str) -> None:
    axes.set(
        xlabel="frequency [Hz]",
        ylabel="q''/T_L [rad/s² per N m]",
        title=title,
        xlim=(2.0, 100.0),
        ylim=(1e-3, 5.0),
    )
    axes.axvspan(4.0, 50.0, color="#f5f6f8", zorder=0)
    axes.legend()


def _close(out: Path, figure: Figure, name: str, caption: str) -> tuple[str, str]:
    save(figure, out / f"{name}.png")
    plt.close(figure)
    return f"{name}.png", caption


def _table(path: Path, columns: Mapping[str, Real]) -> None:
    rows = zip(*(np.asarray(column, dtype=float) for column in columns.values()), strict=True)
    body = "\n".join(",".join(f"{value:.7g}" for value in row) for row in rows)
    write_text(path, ",".join(columns) + "\n" + body + "\n")
