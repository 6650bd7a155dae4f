"""The evidence, plot by plot: each a PNG and a CSV of the plotted numbers beside it."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from jointscope.atomic import write_text
from jointscope.experiments import plot_style
from jointscope.experiments.diagnosis_report.balance import Balance
from jointscope.experiments.diagnosis_report.traces import Trace

Vector = NDArray[np.float64]
UNITS = {
    "linear-acceleration": "m/s²", "acceleration": "m/s²", "angular-acceleration": "rad/s²", "angle": "rad",
    "angular-velocity": "rad/s", "position": "m", "velocity": "m/s", "force": "N", "torque": "N m",
}  # fmt: skip
_PERIODS = 14.0  # of the strongest frequency, shown in time
_FORWARD, _REVERSE = ("o", plot_style.MEASURED), ("x", plot_style.PREDICTED)
_DECADE = 10.0  # beyond this span errors are drawn on a logarithmic axis
_DOTS = 1500  # marks per direction: enough to see the law, few enough to print


@dataclass(frozen=True)
class Plot:
    """A figure on disk.

    Attributes:
        path: The PNG; the CSV of its numbers has the same stem.
        caption: What is drawn, and how to read it.
    """

    path: Path
    caption: str


def save(figure: Figure, path: Path, columns: Mapping[str, Vector]) -> None:
    """Picture and numbers; columns of unequal length are filled with empty cells."""
    figure.tight_layout()
    plot_style.save(figure, path)
    length = max(c.size for c in columns.values())
    rows = [
        ",".join(f"{c[i]:.7g}" if i < c.size and np.isfinite(c[i]) else "" for c in columns.values())
        for i in range(length)
    ]
    write_text(path.with_suffix(".csv"), "\n".join([",".join(columns), *rows]) + "\n")


def density(x: Vector, rate: float) -> tuple[Vector, Vector]:
    """Amplitude spectral density of ``x`` less its mean [unit/sqrt(Hz)] by Welch's method, without the zero line."""
    from scipy.signal import welch

    f, power = welch(x, rate, nperseg=min(x.size, max(64, int(2.0 * rate))), detrend="constant")
    return f[1:], np.sqrt(power[1:])


def bands(x: Vector, rate: float, per_octave: int = 3) -> tuple[Vector, Vector]:
    """Centres [Hz] and RMS of ``x`` in fractions of an octave, from its periodogram."""
    from scipy.signal import periodogram

    f, power = periodogram(x, rate, window="hann", detrend="constant")
    step = f[1]
    count = int(np.floor(per_octave * np.log2(f[-1] / (4.0 * step)))) if f[-1] > 8.0 * step else 1
    edges = 4.0 * step * 2.0 ** (np.arange(count + 1) / per_octave)
    total = np.array([np.sqrt(step * np.sum(power[(f >= a) & (f < b)])) for a, b in itertools.pairwise(edges)])
    return np.sqrt(edges[:-1] * edges[1:]), total


def window(trace: Trace) -> slice:
    """The stretch drawn in time: all of an angle, else some periods where the base model's error is largest."""
    n = trace.time.size
    if trace.quantity in ("angle", "position"):
        return slice(0, n)
    f, amplitude = density(trace.recorded, trace.rate)
    strongest = max(f[int(np.argmax(amplitude))], 1.0)
    length = int(min(n, max(32.0, _PERIODS / strongest * trace.rate)))
    energy = np.concatenate([[0.0], np.cumsum((trace.recorded - trace.base) ** 2)])
    gain = energy[length:] - energy[:-length]
    begin = int(np.argmax(gain >= 0.999 * gain.max()))
    return slice(begin, begin + length)


def time_and_band(trace: Trace, path: Path, *, corrected: bool) -> Plot:
    """Recorded, base and corrected in time, what each leaves, and all of it by third of an octave."""
    unit = UNITS.get(trace.quantity, "SI")
    part = window(trace)
    t = trace.time[part]
    series = {"recorded": trace.recorded, "base": trace.base}
    if corrected:
        series["corrected"] = trace.corrected
    look = {
        "recorded": (plot_style.MEASURED, "-"),
        "base": (plot_style.PREDICTED, "--"),
        "corrected": (plot_style.THIRD, "-."),
    }
    columns: dict[str, Vector] = {"time_s": t}
    with plot_style.style():
        figure = Figure(figsize=(9.2, 4.4))
        grid = figure.add_gridspec(2, 2, width_ratios=(1.7, 1.0))
        signal, left = figure.add_subplot(grid[0, 0]), figure.add_subplot(grid[1, 0])
        spectrum = figure.add_subplot(grid[:, 1])
        for name, values in series.items():
            colour, line = look[name]
            signal.plot(t, values[part], line, color=colour, label=name)
            columns[name] = values[part]
            if name != "recorded":
                left.plot(t, (trace.recorded - values)[part], line, color=colour, label=f"recorded - {name}")
            shown = values if name == "recorded" else trace.recorded - values
            centres, size = bands(shown, trace.rate)
            label = "recorded" if name == "recorded" else f"left by {name}"
            spectrum.step(centres, np.maximum(size, 1e-300), line, where="mid", color=colour, label=label)
            columns["band_hz"] = centres
            columns[f"band_{label.replace(' ', '_')}"] = size
        sizes = np.concatenate([v for k, v in columns.items() if k.startswith("band_") and k != "band_hz"])
        top = float(np.max(sizes)) or 1.0
        spectrum.set(xscale="log", yscale="log", xlabel="frequency [Hz]", ylabel=f"RMS per third octave [{unit}]")
        spectrum.set_ylim(bottom=max(1e-6 * top, 0.5 * float(np.min(sizes[sizes > 0.0], initial=top))))
        signal.set(title=f"{trace.experiment}: {trace.quantity} at {trace.location}", ylabel=unit)
        left.set(xlabel="time [s]", ylabel=f"error [{unit}]")
        for axes in (signal, spectrum):
            axes.legend()
        save(figure, path, columns)
    which = "a held-out run" if trace.held_out else "a fitted run (none was held out)"
    with_effect = f", {100.0 * trace.corrected_error:.3g} % corrected" if corrected else ""
    how = (
        "where the corrected error lies below the base error, the effect explains it"
        if corrected
        else "an error without structure, far below the signal in every band, is noise"
    )
    return Plot(
        path,
        f"Run {trace.run}, {which}, from the inputs alone: error {100.0 * trace.base_error:.3g} % with the base model"
        f"{with_effect}. How to read it: {how}.",
    )


def against_frequency(shown: Mapping[str, Trace], path: Path, *, corrected: bool) -> Plot:
    """What the base model leaves, relative to the signal, line by line."""
    columns: dict[str, Vector] = {}
    with plot_style.style():
        figure = Figure(figsize=(9.2, 2.9))
        panels = figure.subplots(1, len(shown), squeeze=False)[0]
        for axes, (experiment, t) in zip(panels, shown.items(), strict=True):
            f, signal = density(t.recorded, t.rate)
            _, base = density(t.recorded - t.base, t.rate)
            axes.loglog(f, signal, color=plot_style.QUIET, label="recorded")
            axes.loglog(f, base, "--", color=plot_style.PREDICTED, label="left by base")
            key = experiment.replace("-", "_")
            columns |= {f"{key}_frequency_hz": f, f"{key}_recorded": signal, f"{key}_left_by_base": base}
            if corrected:
                _, after = density(t.recorded - t.corrected, t.rate)
                axes.loglog(f, after, "-.", color=plot_style.THIRD, label="left by corrected")
                columns[f"{key}_left_by_corrected"] = after
            axes.set_ylim(bottom=max(1e-6 * signal.max(), 0.3 * base[base > 0.0].min(initial=signal.max())))
            axes.set(title=experiment, xlabel="frequency [Hz]", ylabel=f"{UNITS.get(t.quantity, 'SI')}/√Hz")
        panels[0].legend()
        save(figure, path, columns)
    return Plot(
        path,
        "The residual against frequency, for the runs above. How to read it: a hump at the resonance is stiffness, "
        "damping or friction; a separate peak is a further mode or a disturbance; a residual that grows in proportion to "
        "the signal is a gain or a delay; a flat one is noise.",
    )


def against_level(traces: Sequence[Trace], path: Path, *, corrected: bool) -> Plot:
    """Relative error of every run against how hard it was driven."""
    columns: dict[str, Vector] = {}
    hits = [t for t in traces if t.experiment == "hammer"]
    with plot_style.style():
        figure = Figure(figsize=(6.4, 3.0))
        axes = figure.subplots()
        for (channel, held), mark in zip(
            sorted({(t.channel, t.held_out) for t in hits}), ("o", "s", "^", "D", "v", "P") * 4, strict=False
        ):
            own = sorted((t for t in hits if (t.channel, t.held_out) == (channel, held)), key=lambda t: t.level)
            x = np.array([t.level for t in own])
            name = f"{channel.replace('@', ' at ')}, {'held out' if held else 'fitted'}"
            rows = {"base": np.array([t.base_error for t in own])}
            if corrected:
                rows["corrected"] = np.array([t.corrected_error for t in own])
            columns[f"{channel}_{held}_level".replace("@", "_")] = x
            for which, y in rows.items():
                colour = plot_style.PREDICTED if which == "base" else plot_style.THIRD
                filled = colour if held else "none"
                axes.plot(x, 100 * y, mark, color=colour, markerfacecolor=filled, label=f"{which}: {name}")
                columns[f"{channel}_{held}_{which}_error".replace("@", "_")] = y
        axes.set(xlabel="level: RMS torque of the hit [N m]", ylabel="error [% of the signal]")
        errors = np.concatenate([c for name, c in columns.items() if name.endswith("_error")])
        if errors.max() > _DECADE * errors.min() > 0.0:
            axes.set_yscale("log")
        else:
            axes.set_ylim(bottom=0.0)
        axes.legend(fontsize=7)
        save(figure, path, columns)
    return Plot(
        path,
        "The residual of every hit against its level. How to read it: a linear model's error is the same share at every "
        "level; a share that falls with the level points to friction or backlash, one that rises to drag, a stiffness "
        "that hardens, or clipping; one that falls like 1/level is noise.",
    )


def against_motion(balance: Balance, path: Path) -> Plot:
    """What the base model's balance of torques leaves, against speed and position, by direction."""
    generator = np.random.default_rng(0)
    columns: dict[str, Vector] = {}
    with plot_style.style():
        figure = Figure(figsize=(9.2, 3.3))
        panels = figure.subplots(1, 2, sharey=True)
        directions = (("forward", balance.speed > 0.0, _FORWARD), ("reverse", balance.speed < 0.0, _REVERSE))
        for name, chosen, (mark, colour) in directions:
            index = np.flatnonzero(chosen)
            if index.size > _DOTS:
                index = np.sort(generator.choice(index, _DOTS, replace=False))
            for axes, x, label in (
                (panels[0], balance.speed, "speed"),
                (panels[1], balance.position, "position"),
            ):
                axes.plot(
                    x[index],
                    balance.residual[index],
                    mark,
                    color=colour,
                    ms=3.2,
                    mew=0.7,
                    mfc="none",
                    ls="",
                    label=name,
                )
                columns[f"{name}_{label}"] = x[index]
            columns[f"{name}_residual"] = balance.residual[index]
        panels[0].set(xlabel=f"speed [{balance.speed_unit}]", ylabel=f"{balance.what} [{balance.unit}]")
        panels[1].set(xlabel=f"position [{balance.position_unit}]")
        panels[0].legend(markerscale=2.0)
        save(figure, path, columns)
    return Plot(
        path,
        f"{balance.told} How to read it: a step at zero speed, from one level to another, is dry friction (a peak "
        "there: breakaway; a slope back beside the step: what the base model took for viscous damping); "
        "a slope in speed is viscous, a parabola is drag; a wave in position is a transmission error or "
        "cogging; a cosine or a slope in position that both directions share is gravity; a flat band about zero is noise.",
    )
