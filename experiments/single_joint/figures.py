"""The paper's Figures 8-15 from simulated recordings, each as PNG and CSV."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from jointscope.atomic import write_text
from jointscope.experiments.plot_style import BAND, MEASURED, PREDICTED, QUIET, THIRD, save, style
from jointscope.experiments.single_joint.accuracy import Accuracy, LogCost
from jointscope.experiments.single_joint.bench import Bench
from jointscope.identification.result import Identification
from jointscope.models.joint import DirectForm, antiresonance, load_acceleration_per_torque, torsion_frequency
from jointscope.models.paper import paper
from jointscope.models.parameters import Joint
from jointscope.prediction.spectra import spectrum
from jointscope.recordings.campaign import Run

Real = NDArray[np.float64]

TOP = 100.0  # [Hz] of every spectrum


def write_csv(path: Path, columns: Mapping[str, Real]) -> None:
    """Columns of one length, named with their units."""
    rows = np.column_stack([np.asarray(column, dtype=float) for column in columns.values()])
    lines = [",".join(columns), *(",".join(f"{value:.9g}" for value in row) for row in rows)]
    write_text(path, "\n".join(lines) + "\n")


def _turned(response: NDArray[np.complexfloating]) -> Real:
    """Phase from -90 to 270 [deg]: an accelerance starts at 180 and its noise must not wrap."""
    return np.asarray(np.mod(np.degrees(np.angle(response)) + 90.0, 360.0) - 90.0)


def figure8(bench: Bench, out: Path) -> None:
    """A hit: torque and angular acceleration."""
    run = next(r for r in reversed(bench.recorded.runs) if r.experiment == "hammer")
    force, acceleration = run.select("force")[0], run.select("linear-acceleration")[0]
    torque = force.samples * bench.rig.hammer_radius
    angular = acceleration.samples / bench.rig.accelerometer_radius
    write_csv(out / "figure-08.csv", {"time_s": force.times, "torque_Nm": torque, "acceleration_rad_s2": angular})
    with style():
        figure = Figure(figsize=(9.0, 4.6), layout="constrained")
        top, bottom = figure.subplots(2, 1, sharex=True)
        top.plot(force.times, torque, color=MEASURED)
        top.set_ylabel("impact torque [N m]")
        top.set_title("Figure 8: one impact, as recorded at 1024 Hz")
        inset = top.inset_axes((0.62, 0.25, 0.35, 0.7))
        near = np.abs(force.times - force.times[int(np.argmax(torque))]) < 0.012
        inset.plot(1e3 * force.times[near], torque[near], color=MEASURED, marker=".", ms=4)
        inset.set_xlabel("time [ms]", fontsize=7)
        inset.tick_params(labelsize=7)
        bottom.plot(acceleration.times, angular, color=MEASURED)
        bottom.set_ylabel("arm acceleration [rad/s^2]")
        bottom.set_xlabel("time [s]")
        save(figure, out / "figure-08.png")


def figure9(found: Identification, out: Path) -> None:
    """Measured FRF and fit, beside the paper's fit (26)."""
    assert found.frf is not None
    f = found.frf.frequency
    shown = (f >= 1.0) & (f <= TOP)
    s = np.asarray(2j * np.pi * f[shown], dtype=np.complex128)
    values = {name: found.parameters[name].value for name in ("inertia", "stiffness", "damping_total")}
    fitted = s**2 / (values["inertia"] * s**2 + values["damping_total"] * s + values["stiffness"])
    printed = paper().equation26
    without = DirectForm(b1=printed.b1, b2=0.0, b3=0.0, a1=printed.a1, a2=printed.a2).response(s)
    measured, coherence = found.frf.h1[shown], found.frf.coherence[shown]
    write_csv(
        out / "figure-09.csv",
        {
            "frequency_Hz": f[shown], "measured": np.abs(measured), "fitted": np.abs(fitted),
            "measured_phase_deg": _turned(measured), "fitted_phase_deg": _turned(fitted),
            "coherence": coherence, "equation_26": np.abs(printed.response(s)),
        },
    )  # fmt: skip
    with style():
        figure = Figure(figsize=(9.0, 6.8), layout="constrained")
        top, middle, bottom = figure.subplots(3, 1, sharex=True, height_ratios=(3, 1.6, 1))
        top.semilogy(f[shown], np.abs(measured), color=MEASURED, lw=2.0, label="measured, mean of the hits (H1)")
        top.semilogy(
            f[shown], np.abs(fitted), color=PREDICTED, ls="--", label="fitted here, b1 s^2 / (s^2 + a1 s + a2)"
        )
        top.semilogy(f[shown], np.abs(printed.response(s)), color=QUIET, label="paper's fit (26) as printed")
        top.semilogy(f[shown], np.abs(without), color=THIRD, ls=":", label="(26) with b2 = b3 = 0")
        top.axvspan(*found.band, color=BAND, alpha=0.25, lw=0)
        top.set_ylim(1e-4, 10.0)
        top.set_ylabel("|q'' / T_L| [rad/s^2 per N m]")
        top.set_title("Figure 9: impact response of the arm, motor braked (band fitted shaded)")
        top.legend(loc="lower right")
        middle.plot(f[shown], _turned(measured), color=MEASURED, lw=2.0)
        middle.plot(f[shown], _turned(fitted), color=PREDICTED, ls="--")
        middle.set_ylabel("phase [deg]")
        bottom.plot(f[shown], coherence, color=MEASURED)
        bottom.set_ylim(0.0, 1.05)
        bottom.set_ylabel("coherence [-]")
        bottom.set_xlabel("frequency [Hz]")
        save(figure, out / "figure-09.png")


def figure10(joint: Joint, truth: Joint, out: Path) -> None:
    """Amplitude of G_a (7) with both frequencies (8), (9)."""
    f = np.linspace(0.5, TOP, 1200)
    s = np.asarray(2j * np.pi * f, dtype=np.complex128)
    identified, true = (np.abs(load_acceleration_per_torque(j, s)) for j in (joint, truth))
    write_csv(out / "figure-10.csv", {"frequency_Hz": f, "identified": identified, "truth": true})
    with style():
        figure = Figure(figsize=(9.0, 3.8), layout="constrained")
        axis = figure.subplots()
        axis.semilogy(f, true, color=MEASURED, lw=2.4, label="true parameters")
        axis.semilogy(f, identified, color=PREDICTED, ls="--", label="identified from the hits")
        for w, name, side in (
            (antiresonance(joint), "ARF (8)", "right"),
            (torsion_frequency(joint), "NTF (9)", "left"),
        ):
            axis.axvline(w / (2 * np.pi), color=QUIET, lw=0.9)
            nudge = -0.4 if side == "right" else 0.4
            label = f"{name} {w / (2 * np.pi):.1f} Hz"
            axis.text(w / (2 * np.pi) + nudge, float(identified.min()) * 1.4, label, fontsize=8, ha=side)
        axis.set_xlabel("frequency [Hz]")
        axis.set_ylabel("|q'' / (n T_e)| [rad/s^2 per N m]")
        axis.set_title("Figure 10: motor torque to arm acceleration, G_a (7)")
        axis.legend()
        save(figure, out / "figure-10.png")


def torque_figure(run: Run, number: int, what: str, out: Path) -> None:
    """Figures 11 and 14: the logged torque in time, and its spectrum."""
    torque = run.select("torque", location="motor")[0]
    S = spectrum(torque.samples, torque.sampling_rate)
    shown = S.frequency <= TOP
    write_csv(out / f"figure-{number}-time.csv", {"time_s": torque.times, "torque_Nm": torque.samples})
    write_csv(
        out / f"figure-{number}-spectrum.csv",
        {"frequency_Hz": S.frequency[shown], "torque_Nm": np.abs(S.amplitude[shown])},
    )
    with style():
        figure = Figure(figsize=(9.0, 4.8), layout="constrained")
        top, bottom = figure.subplots(2, 1)
        top.plot(torque.times, torque.samples, color=MEASURED, lw=0.8)
        top.set_xlabel("time [s]")
        top.set_ylabel("T_e [N m]")
        top.set_title(f"Figure {number}: electromagnetic torque, {what}, logged at {torque.sampling_rate:g} Hz")
        bottom.semilogy(S.frequency[shown], np.abs(S.amplitude[shown]), color=MEASURED, lw=0.9)
        bottom.set_xlabel("frequency [Hz]")
        bottom.set_ylabel("|T_e| [N m]")
        save(figure, out / f"figure-{number}.png")


def figure13(run: Run, out: Path) -> None:
    """The speed command."""
    command = run.select("speed-command")[0]
    write_csv(out / "figure-13.csv", {"time_s": command.times, "speed_rad_s": command.samples})
    with style():
        figure = Figure(figsize=(9.0, 2.8), layout="constrained")
        axis = figure.subplots()
        axis.plot(command.times, command.samples, color=MEASURED)
        axis.set_xlabel("time [s]")
        axis.set_ylabel("motor speed [rad/s]")
        axis.set_title(
            f"Figure 13: speed command, at most {np.max(np.abs(command.samples)):.0f} rad/s at the motor"
        )
        save(figure, out / "figure-13.png")


def vibration_figure(found: Accuracy, deviation: Real, number: int, what: str, out: Path) -> None:
    """Figures 12 and 15: predicted, measured and true acceleration spectra, their difference, and the noise carried in.

    ``deviation``: of the predicted magnitude from the parameters' covariance [m/s^2], shape of the frequency axis.
    """
    f = found.truth.frequency
    shown = (f >= 0.5) & (f <= TOP)
    truth, predicted = np.abs(found.truth.amplitude[shown]), np.abs(found.predicted.amplitude[shown])
    measured, product = np.abs(found.measured.amplitude[shown]), np.abs(found.product.amplitude[shown])
    error, product_error = (
        20.0 * np.log10(np.maximum(p, 1e-300) / np.maximum(truth, 1e-300)) for p in (predicted, product)
    )
    sd = 1.96 * deviation[shown]
    write_csv(
        out / f"figure-{number}.csv",
        {
            "frequency_Hz": f[shown], "true_m_s2": truth, "measured_m_s2": measured, "predicted_m_s2": predicted,
            "error_dB": error, "parameter_sd_m_s2": deviation[shown], "product_11_m_s2": product,
            "carried_noise_m_s2": found.noise[shown],
        },
    )  # fmt: skip
    s = found.score
    with style():
        figure = Figure(figsize=(9.0, 5.4), layout="constrained")
        top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(2.4, 1))
        top.semilogy(f[shown], measured, color=QUIET, lw=0.7, label="measured")
        top.semilogy(f[shown], truth, color=MEASURED, lw=2.0, label="truth, free of noise")
        top.semilogy(f[shown], product, color=THIRD, lw=0.8, label="torque's spectrum times G_a (11)")
        top.semilogy(f[shown], predicted, color=PREDICTED, ls="--", lw=1.0, label="predicted, motion integrated")
        top.semilogy(
            f[shown], found.noise[shown], color=QUIET, lw=0.8, ls=":", label="noise that the log carries in"
        )
        top.axvspan(s.low, s.high, color=BAND, alpha=0.2, lw=0)
        top.set_ylabel("arm acceleration [m/s^2]")
        top.set_title(
            f"Figure {number}: {what}; {s.low:g}-{s.high:g} Hz: median error {s.median_error:.3f} dB, "
            f"FRAC {s.frac:.5f}, over {100 * s.share:.0f} % of the bins"
        )
        top.legend(ncols=3)
        relative = 20.0 / np.log(10.0) * sd / np.maximum(predicted, 1e-300)
        bottom.fill_between(
            f[shown], -relative, relative, color=BAND, lw=0, label="95 % from the parameters alone"
        )
        bottom.plot(f[shown], product_error, color=THIRD, lw=0.6)
        bottom.plot(f[shown], error, color=PREDICTED, lw=0.8)
        bottom.legend(loc="upper left")
        bottom.axhline(0.0, color=QUIET, lw=0.8)
        bottom.set_ylim(-3.0, 3.0)
        bottom.set_ylabel("error [dB]")
        bottom.set_xlabel("frequency [Hz]")
        save(figure, out / f"figure-{number}.png")


def log_figure(costs: tuple[LogCost, ...], out: Path) -> None:
    """What each kind of torque log does to the prediction near the band's top."""
    labels = [f"{cost.kind},\nread as {cost.read_as}" for cost in costs]
    with style():
        figure = Figure(figsize=(9.0, 3.2), layout="constrained")
        axis = figure.subplots()
        at = np.arange(len(costs))
        axis.bar(
            at - 0.18,
            [cost.error_at_top for cost in costs],
            width=0.34,
            color=PREDICTED,
            label="error at 70-75 Hz [dB]",
        )
        axis.bar(
            at + 0.18,
            [-100.0 * (1.0 - cost.frac) for cost in costs],
            width=0.34,
            color=THIRD,
            label="FRAC - 1 [%]",
        )
        axis.set_xticks(at, labels, fontsize=7.5)
        axis.axhline(0.0, color=QUIET, lw=0.8)
        axis.set_title(
            "what the PLC's 500 Hz log does to the predicted sweep, and what is left once its kind is known"
        )
        axis.legend()
        save(figure, out / "torque-log.png")
