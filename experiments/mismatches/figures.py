"""A mismatch's picture: the paper's spectrum with the prediction before and after, and how far each is off."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from jointscope.experiments.mismatches.telling import Told
from jointscope.experiments.plot_style import BAND, MEASURED, PREDICTED, QUIET, THIRD, save, style

Real = NDArray[np.float64]
WIDTH = 1.0  # Hz over which spectra are smoothed for the eye
FAINT = 0.01  # of the band's largest, below which a ratio does not set the scale
RATIO_WIDTH = 4.0  # Hz over which their ratio is: between the lines of a motion there is little to compare


def draw(told: Told, path: Path) -> None:
    """Write the picture."""
    with style():
        figure = Figure(figsize=(9.0, 3.6), layout="constrained")
        left, right = figure.subplots(1, 2)
        _spectra(left, told)
        if told.mismatch.reference is None:
            _ratios(right, told)
        else:
            _damping(right, told)
        save(figure, path)


def _smooth(power: Real, resolution: float, width: float) -> Real:
    n = max(1, round(width / resolution)) | 1
    padded = np.pad(power, n // 2, mode="edge")
    return np.asarray(np.sqrt(np.convolve(padded, np.ones(n) / n, mode="valid")))


def _sizes(told: Told, which: str, width: float) -> tuple[Real, Real]:
    """Frequencies and root mean square over the held-out runs of the magnitude, smoothed over ``width`` [Hz]."""
    curves = told.curves
    f = curves[0].measured.frequency
    power = np.mean([np.abs(getattr(curve, which).amplitude) ** 2 for curve in curves], axis=0)
    return f, _smooth(power, float(f[1]), width)


def _spectra(axes: Axes, told: Told) -> None:
    low, high = told.mismatch.shown
    axes.axvspan(*told.mismatch.band, color=BAND, alpha=0.35, linewidth=0, label="where the paper states it")
    lines = (
        ("measured", "recorded", MEASURED, "-"),
        ("before", "base, refitted", PREDICTED, "--"),
        ("after", "with what was named", THIRD, "-"),
    )
    for which, label, colour, dash in lines:
        f, size = _sizes(told, which, WIDTH)
        keep = (f >= low) & (f <= high)
        axes.semilogy(f[keep], size[keep], color=colour, linestyle=dash, label=label)
    axes.set(xlabel="frequency [Hz]", ylabel="arm acceleration [m/s$^2$]", xlim=(low, high),
             title=f"{told.mismatch.figure}: held-out {told.mismatch.kind} runs")  # fmt: skip
    axes.legend()


def _ratios(axes: Axes, told: Told) -> None:
    low, high = told.mismatch.shown
    f, measured = _sizes(told, "measured", RATIO_WIDTH)
    keep = (f >= low) & (f <= high)
    stated = (f >= told.mismatch.band[0]) & (f <= told.mismatch.band[1])
    stated &= measured > FAINT * np.max(measured[stated])
    axes.axvspan(*told.mismatch.band, color=BAND, alpha=0.35, linewidth=0)
    axes.axhline(0.0, color=QUIET, linewidth=0.8)
    largest = 0.0
    for which, colour, dash in (("before", PREDICTED, "--"), ("after", THIRD, "-")):
        size = _sizes(told, which, RATIO_WIDTH)[1]
        ratio = 20.0 * np.log10(np.maximum(size, 1e-12) / np.maximum(measured, 1e-12))
        largest = max(largest, float(np.max(np.abs(ratio[stated]))))
        axes.plot(
            f[keep],
            ratio[keep],
            color=colour,
            linestyle=dash,
            label=f"{which}: {told.bias(which):+.2f} dB in the band",
        )
    reach = float(np.clip(1.2 * largest, 3.0, 24.0))  # all of the stated band, and no more than says something
    axes.set(xlabel="frequency [Hz]", ylabel="predicted over recorded [dB]", xlim=(low, high), ylim=(-reach, reach),
             title="Prediction against recording")  # fmt: skip
    axes.legend()


def _damping(axes: Axes, told: Told) -> None:
    assert told.identified is not None
    found = told.damping
    rows = [
        ("concealed truth", told.mismatch.rig.joint.damping, None, QUIET),
        ("paper's method", told.identified["value"], told.identified["interval95"], PREDICTED),
        ("diagnosed", found["value"], found["interval95"], THIRD),
    ]
    for place, (_, value, interval, colour) in enumerate(rows):
        axes.barh(place, value, color=colour, height=0.55)
        if interval:
            axes.plot(interval, [place, place], color="black", linewidth=1.2)
        end = max(interval[1], value) if interval else value
        axes.annotate(f"{value:.1f}", (end, place), xytext=(6, 0), textcoords="offset points", va="center")
    axes.margins(x=0.15)
    axes.set_axisbelow(True)
    axes.set_yticks(range(len(rows)), [name for name, *_ in rows])
    axes.invert_yaxis()
    axes.set(xlabel="damping c [N m s/rad], 95 % intervals", title="Table 2: damping")
    axes.grid(visible=False, axis="y")
