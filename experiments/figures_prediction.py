"""Recorded and predicted, one page per run: each channel in time, and its spectrum where the paper scores it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from jointscope.experiments.plot_style import BAND, MEASURED, PREDICTED, QUIET, save, style
from jointscope.prediction.base_model import ChannelPrediction, RunPrediction
from jointscope.prediction.run_scores import ChannelScore, shifted
from jointscope.prediction.spectra import spectrum
from jointscope.prediction.uncertainty import ChannelBand, magnitude_interval
from jointscope.recordings.units import si_unit

Real = NDArray[np.float64]

_MOST_CHANNELS = 4
_TOP = 100.0  # Hz


def run_figure(
    path: Path,
    prediction: RunPrediction,
    scores: Sequence[ChannelScore],
    bands: Sequence[ChannelBand] | None = None,
) -> Path:
    """One row per scored channel: time on the left; spectrum, or the difference of an angle, on the right.

    Args:
        path: PNG to write.
        prediction: One run's.
        scores: Of its recorded channels.
        bands: What the parameters' uncertainty leaves, one per predicted channel; none are drawn without.
    """
    by_column = {channel.signal.channel.column: place for place, channel in enumerate(prediction.channels)}
    shown = list(scores)[:_MOST_CHANNELS]
    with style():
        figure = Figure(figsize=(10.0, 2.9 * len(shown) + 0.5), layout="constrained")
        axes = figure.subplots(len(shown), 2, squeeze=False)
        for (left, right), score in zip(axes, shown, strict=True):
            place = by_column[score.column]
            _row(left, right, prediction.channels[place], score, None if bands is None else bands[place])
        axes[-1][0].set_xlabel("time [s]")
        loop = "drive's loop closed" if prediction.closed_loop else "inputs replayed"
        figure.suptitle(
            f"{prediction.run.id}  ({prediction.run.experiment}, {loop})", fontsize=11, x=0.01, ha="left"
        )
        return save(figure, path)


def _row(
    left: Axes, right: Axes, channel: ChannelPrediction, score: ChannelScore, band: ChannelBand | None
) -> None:
    declared = channel.signal.channel
    unit = si_unit(declared)
    recorded, predicted = channel.signal.samples, shifted(channel, score.clock_offset)
    sd = None if band is None or band.deviations.size == 0 else band.standard_deviation
    _time(left, channel.times, recorded, predicted, sd)
    left.set_ylabel(f"{declared.quantity} [{unit}]")
    left.set_title(f"{score.column}: error {score.error:.3g} of the recorded RMS")
    if score.bands and np.all(np.isfinite(recorded)):
        _spectra(right, channel, recorded, predicted, score, band)
        right.set_ylabel(f"amplitude [{unit}]")
    else:
        right.plot(channel.times, predicted - recorded, color=PREDICTED, lw=0.8)
        right.axhline(0.0, color=QUIET, lw=0.8)
        right.set_ylabel(f"predicted - recorded [{unit}]")
        right.set_xlabel("time [s]")
        right.set_title("difference")


def _time(axis: Axes, times: Real, recorded: Real, predicted: Real, sd: Real | None) -> None:
    if sd is not None:
        axis.fill_between(times, predicted - 1.96 * sd, predicted + 1.96 * sd, color=BAND, lw=0, label="95 % band")
    axis.plot(times, recorded, color=MEASURED, lw=1.0, label="recorded")
    axis.plot(times, predicted, color=PREDICTED, lw=0.8, ls="--", label="predicted")
    low, high = _lively(times, recorded)
    axis.set_xlim(low, high)
    axis.legend(ncols=3, loc="upper right")


def _lively(times: Real, recorded: Real) -> tuple[float, float]:
    """The part of the record in which most happens, so that a hit does not fill one pixel column."""
    power = np.nancumsum((recorded - np.nanmedian(recorded)) ** 2)
    if power[-1] <= 0.0:
        return float(times[0]), float(times[-1])
    first, last = np.searchsorted(power, [0.001 * power[-1], 0.999 * power[-1]])
    span = times[last] - times[first]
    return float(max(times[0], times[first] - 0.1 * span)), float(min(times[-1], times[last] + 0.1 * span))


def _spectra(
    axis: Axes,
    channel: ChannelPrediction,
    recorded: Real,
    predicted: Real,
    score: ChannelScore,
    band: ChannelBand | None,
) -> None:
    rate = channel.signal.sampling_rate
    R, P = spectrum(recorded, rate), spectrum(predicted, rate)
    inside = R.band(0.5, min(_TOP, 0.5 * rate))
    f = R.frequency[inside]
    if band is not None and band.deviations.size:
        low, high = magnitude_interval(P, band.of_magnitude(predicted, rate))
        axis.fill_between(f, np.maximum(low[inside], 1e-12), high[inside], color=BAND, lw=0)
    axis.semilogy(f, np.abs(R.amplitude[inside]), color=MEASURED, lw=1.0)
    axis.semilogy(f, np.abs(P.amplitude[inside]), color=PREDICTED, lw=0.8, ls="--")
    first = score.bands[0]
    axis.axvspan(first.low, first.high, color="#f4f6f8", zorder=-5)
    top = float(np.max(np.abs(R.amplitude[inside])))
    axis.set_ylim(1e-5 * top, 2.0 * top)
    axis.set_xlim(0.0, float(f[-1]))
    axis.set_xlabel("frequency [Hz]")
    axis.set_title(
        f"{first.low:g}-{first.high:g} Hz: median {first.median_error:.2f} dB, bias {first.bias:+.2f} dB, "
        f"FRAC {first.frac:.4f}"
    )
