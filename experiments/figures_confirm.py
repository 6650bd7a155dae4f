"""Recorded, base and augmented in time and frequency, for the held-out channels on which the effect acts most."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from jointscope.experiments.plot_style import MEASURED, PREDICTED, QUIET, THIRD, save, style
from jointscope.prediction.spectra import spectrum

if TYPE_CHECKING:
    from jointscope.experiments.confirm import ChannelCheck, Confirmation

Real = NDArray[np.float64]

_MOST_ROWS = 4
_TOP = 120.0  # Hz
_UNITS = {
    "linear-acceleration": "m/s²", "angular-acceleration": "rad/s²", "acceleration": "m/s²", "angle": "rad",
    "position": "m", "angular-velocity": "rad/s", "velocity": "m/s", "torque": "N m", "force": "N", "current": "A",
}  # fmt: skip


def draw_confirmation(found: Confirmation, path: Path) -> Path:
    """Write the picture to ``path``: one row per channel, the largest gains first, each kind of channel once at most."""
    shown: dict[tuple[str, str], ChannelCheck] = {}
    for check in sorted(found.checks, key=lambda c: c.augmented_error - c.base_error):
        shown.setdefault((check.experiment, check.channel), check)
    rows = list(shown.values())[:_MOST_ROWS]
    with style():
        figure = Figure(figsize=(11.0, 2.8 * len(rows) + 0.7), layout="constrained")
        axes = figure.subplots(len(rows), 2, squeeze=False)
        for (left, right), check in zip(axes, rows, strict=True):
            _time(left, check)
            _frequency(right, check)
        axes[0][0].legend(ncols=3, loc="upper right")
        axes[-1][0].set_xlabel("time [s]")
        axes[-1][1].set_xlabel("frequency [Hz]")
        verdict = "confirmed" if found.confirmed else "NOT confirmed"
        figure.suptitle(
            f"{', '.join(found.effects)} in MuJoCo: error {found.base_error:.4f} without, {found.augmented_error:.4f} with;"
            f" gain {found.ratio:.3f} of the reduced model's: {verdict}",
            fontsize=10,
            x=0.01,
            ha="left",
        )
        return save(figure, path)


def _curves(check: ChannelCheck) -> tuple[tuple[str, str, Real, str], ...]:
    return (
        ("recorded", MEASURED, check.recorded, "-"),
        ("base", QUIET, check.base, "-"),
        ("with the effect", PREDICTED, check.augmented, "--"),
    )


def _time(axis: Axes, check: ChannelCheck) -> None:
    low, high = _lively(check.times, check.recorded)
    for label, colour, values, dash in _curves(check):
        axis.plot(check.times, values, color=colour, ls=dash, lw=1.0, label=label)
    axis.set_xlim(low, high)
    inside = (check.times >= low) & (check.times <= high)
    spread = float(np.max(np.abs(check.recorded[inside] - np.mean(check.recorded[inside])))) or 1.0
    middle = float(np.mean(check.recorded[inside]))
    axis.set_ylim(middle - 1.6 * spread, middle + 1.6 * spread)
    quantity = check.channel.split("@")[0]
    axis.set_ylabel(f"{quantity} [{_UNITS.get(quantity, 'SI')}]")
    axis.set_title(f"{check.run}: error {check.base_error:.3g} without, {check.augmented_error:.3g} with")


def _frequency(axis: Axes, check: ChannelCheck) -> None:
    rate = 1.0 / float(np.median(np.diff(check.times)))
    top = 0.0
    for _, colour, values, dash in _curves(check):
        S = spectrum(values, rate)
        inside = S.band(0.5, min(_TOP, 0.5 * rate))
        axis.semilogy(S.frequency[inside], np.abs(S.amplitude[inside]), color=colour, ls=dash, lw=0.9)
        if colour == MEASURED:
            top = float(np.max(np.abs(S.amplitude[inside])))
    left = spectrum(check.recorded - check.augmented, rate)
    inside = left.band(0.5, min(_TOP, 0.5 * rate))
    axis.semilogy(left.frequency[inside], np.abs(left.amplitude[inside]), color=THIRD, lw=0.7, label="left over")
    if top > 0.0:
        axis.set_ylim(1e-5 * top, 2.0 * top)
    axis.legend(loc="upper right")
    axis.set_ylabel("amplitude")


def _lively(times: Real, recorded: Real) -> tuple[float, float]:
    """The part of the record in which most happens."""
    power = np.cumsum((recorded - np.median(recorded)) ** 2)
    if power[-1] <= 0.0:
        return float(times[0]), float(times[-1])
    first, last = np.searchsorted(power, [0.001 * power[-1], 0.995 * power[-1]])
    span = float(times[last] - times[first])
    return float(max(times[0], times[first] - 0.1 * span)), float(min(times[-1], times[last] + 0.1 * span))
