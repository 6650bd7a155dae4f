"""Recorded and predicted, one chart per run: each channel in time, and its spectrum where the paper scores it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from jointscope.experiments.charts.chart import Chart, Panel, Series, Span
from jointscope.experiments.page import pretty
from jointscope.prediction.base_model import ChannelPrediction, RunPrediction
from jointscope.prediction.run_scores import ChannelScore, shifted
from jointscope.prediction.spectra import spectrum
from jointscope.prediction.uncertainty import ChannelBand, magnitude_interval
from jointscope.recordings.units import si_unit

Real = NDArray[np.float64]

_MOST_CHANNELS = 4
_TOP = 100.0  # Hz


def run_chart(
    prediction: RunPrediction,
    scores: Sequence[ChannelScore],
    bands: Sequence[ChannelBand] | None = None,
) -> Chart:
    """Two panels per scored channel: time; then spectrum, or the difference of an angle.

    Args:
        prediction: One run's.
        scores: Of its recorded channels.
        bands: What the parameters' uncertainty leaves, one per predicted channel; none are drawn without.
    """
    by_column = {channel.signal.channel.column: place for place, channel in enumerate(prediction.channels)}
    panels: list[Panel] = []
    for score in scores[:_MOST_CHANNELS]:
        place = by_column[score.column]
        panels += _row(prediction.channels[place], score, None if bands is None else bands[place])
    loop = "the drive's loop closed" if prediction.closed_loop else "inputs replayed"
    said = "; ".join(f"{score.column}: {_told(score)}" for score in scores[:_MOST_CHANNELS])
    return Chart(
        stem=prediction.run.id,
        label=f"{prediction.run.id} ({prediction.run.experiment})",
        shows=f"From the inputs alone, {loop}. {said}.",
        reading="where the dashed line covers the solid one the model holds; the filled band is what the parameters' own "
        "uncertainty leaves, so a difference outside it is physics, not parameters; shaded: the band that is scored.",
        panels=tuple(panels),
        columns=2,
    )


def _told(score: ChannelScore) -> str:
    text = f"error {100.0 * score.error:.3g} % of the recorded RMS (fit {100.0 * (1.0 - score.error):.4g} %)"
    if score.bands:
        b = score.bands[0]
        text += (
            f", {b.low:g}-{b.high:g} Hz: median {b.median_error:.2f} dB, bias {b.bias:+.2f} dB, FRAC {b.frac:.4f}"
        )
    return text


def _row(channel: ChannelPrediction, score: ChannelScore, band: ChannelBand | None) -> list[Panel]:
    declared = channel.signal.channel
    unit = pretty(si_unit(declared))
    recorded, predicted = channel.signal.samples, shifted(channel, score.clock_offset)
    title = f"{score.column}: {declared.quantity.replace('-', ' ')} at the {declared.location}"
    t = channel.times
    series = []
    if band is not None and band.deviations.size:
        half = 1.96 * band.standard_deviation
        series.append(Series(name="95 % band", x=t, y=predicted + half, low=predicted - half, look="band"))
    series.append(Series(name="recorded", x=t, y=recorded, look="recorded"))
    series.append(Series(name="predicted", x=t, y=predicted, look="base"))
    panels = [
        Panel(
            title=title,
            x_label="time [s]",
            y_label=f"[{unit}]",
            series=tuple(series),
            x_range=_lively(t, recorded),
        )
    ]
    if score.bands and np.all(np.isfinite(recorded)):
        panels.append(_spectra(channel, recorded, predicted, score, band, unit))
    else:
        difference = Series(name="predicted less recorded", x=t, y=predicted - recorded, look="quiet")
        panels.append(Panel(title="Difference", x_label="time [s]", y_label=f"[{unit}]", series=(difference,)))
    return panels


def _lively(times: Real, recorded: Real) -> tuple[float, float]:
    """The part of the record in which most happens, so that a hit does not fill one pixel column."""
    power = np.nancumsum((recorded - np.nanmedian(recorded)) ** 2)
    if power[-1] <= 0.0:
        return float(times[0]), float(times[-1])
    first, last = np.searchsorted(power, [0.001 * power[-1], 0.999 * power[-1]])
    span = times[last] - times[first]
    return float(max(times[0], times[first] - 0.1 * span)), float(min(times[-1], times[last] + 0.1 * span))


def _spectra(
    channel: ChannelPrediction,
    recorded: Real,
    predicted: Real,
    score: ChannelScore,
    band: ChannelBand | None,
    unit: str,
) -> Panel:
    rate = channel.signal.sampling_rate
    R, P = spectrum(recorded, rate), spectrum(predicted, rate)
    inside = R.band(0.5, min(_TOP, 0.5 * rate))
    f = R.frequency[inside]
    top = float(np.max(np.abs(R.amplitude[inside])))
    series = []
    if band is not None and band.deviations.size:
        low, high = magnitude_interval(P, band.of_magnitude(predicted, rate))
        series.append(
            Series(name="95 % band", x=f, y=high[inside], low=np.maximum(low[inside], 1e-9 * top), look="band")
        )
    series.append(Series(name="recorded", x=f, y=np.abs(R.amplitude[inside]), look="recorded"))
    series.append(Series(name="predicted", x=f, y=np.abs(P.amplitude[inside]), look="base"))
    scored = score.bands[0]
    return Panel(
        title="Spectrum",
        x_label="frequency [Hz]",
        y_label=f"amplitude [{unit}]",
        series=tuple(series),
        y_log=True,
        y_range=(1e-5 * top, 2.0 * top),
        spans=(Span(scored.low, scored.high, "scored band"),),
    )
