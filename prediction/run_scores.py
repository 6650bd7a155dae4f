"""The scores of one predicted run against what it recorded."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import optimize
from scipy import signal as dsp

from jointscope.prediction.base_model import ChannelPrediction, RunPrediction
from jointscope.prediction.scores import PAPER_BANDS, BandScore, band_score, contract_error
from jointscope.prediction.spectra import spectrum
from jointscope.recordings.bandlimited import bandlimited
from jointscope.recordings.campaign import Quantity, Run

Real = NDArray[np.float64]

SPECTRAL: frozenset[Quantity] = frozenset(
    {"linear-acceleration", "angular-acceleration", "acceleration", "force", "torque"}
)
_UNKNOWN_CLOCK = 0.25  # s: how far an unknown start is searched


@dataclass(frozen=True, kw_only=True)
class ChannelScore:
    """One channel.

    Attributes:
        column: Its name.
        quantity: What it measures.
        error: The contract's error [-] (``scores.contract_error``).
        bands: Spectral scores in the paper's bands, as far as the prediction is legitimate there; empty for angles and speeds.
        clock_offset: By how much the device's clock was taken to be late [s]; 0 where its start is exact.
    """

    column: str
    quantity: Quantity
    error: float
    bands: tuple[BandScore, ...]
    clock_offset: float = 0.0


def score_run(prediction: RunPrediction, further: Sequence[tuple[float, float]] = ()) -> tuple[ChannelScore, ...]:
    """Score every channel of ``prediction`` that was recorded, in the paper's bands and those ``further`` ones [Hz].

    Where a device's start is uncertain its offset is a nuisance: one value per device, found within three standard
    deviations (0.25 s where unknown). With ``initial = "estimate"`` the first fifth of the run does not count.
    """
    scores = []
    offsets = {
        device: clock_offset([c for c in prediction.channels if c.signal.device == device], prediction.run)
        for device in {c.signal.device for c in prediction.channels}
    }
    for channel in prediction.channels:
        if channel.signal.channel.samples is None:
            continue
        offset = offsets[channel.signal.device]
        predicted = shifted(channel, offset)
        first = channel.values.size // 5 if prediction.run.initial == "estimate" else 0
        scores.append(_score(channel, predicted, prediction, first, offset, tuple(further)))
    return tuple(scores)


def shifted(channel: ChannelPrediction, offset: float) -> Real:
    """The prediction as a device reads it whose clock is ``offset`` [s] late, shape (n,)."""
    if offset == 0.0:
        return channel.values
    curve = bandlimited(channel.values, channel.signal.sampling_rate, float(channel.times[0]))
    return curve(channel.times - offset)


def clock_offset(channels: list[ChannelPrediction], run: Run) -> float:
    """Offset of one device against the run's inputs [s]; 0 where both starts are exact."""
    recorded = [c for c in channels if c.signal.channel.samples is not None]
    inputs = {s.device for s in run.select(role="input")}
    if not recorded or recorded[0].signal.device in inputs:
        return 0.0
    uncertainty = math.hypot(
        recorded[0].signal.stream.start_uncertainty, *(run.streams[d].start_uncertainty for d in inputs)
    )
    if uncertainty == 0.0:
        return 0.0
    reach = min(3.0 * uncertainty, _UNKNOWN_CLOCK)
    curves = [bandlimited(c.values, c.signal.sampling_rate, float(c.times[0])) for c in recorded]
    scales = [max(float(np.nanstd(c.signal.samples)), 1e-300) for c in recorded]

    def misfit(offset: float) -> float:
        return sum(
            float(np.nanmean(((c.signal.samples - curve(c.times - offset)) / scale) ** 2))
            for c, curve, scale in zip(recorded, curves, scales, strict=True)
        )

    # one cross-correlation finds the valley, a bounded search its bottom
    lead = recorded[0]
    actual = np.nan_to_num(lead.signal.samples - np.nanmean(lead.signal.samples))
    lags = np.asarray(dsp.correlation_lags(actual.size, actual.size)) / lead.signal.sampling_rate
    correlation = np.asarray(dsp.correlate(actual, lead.values - lead.values.mean()))
    near = np.abs(lags) <= reach
    coarse = float(lags[near][np.argmax(correlation[near])]) if near.any() else 0.0
    step = 1.0 / lead.signal.sampling_rate
    low, high = max(coarse - 2.0 * step, -reach), min(coarse + 2.0 * step, reach)
    found = optimize.minimize_scalar(misfit, bounds=(low, high), method="bounded", options={"xatol": 1e-7})
    return float(found.x)


def _score(
    channel: ChannelPrediction,
    predicted: Real,
    prediction: RunPrediction,
    first: int,
    offset: float,
    further: tuple[tuple[float, float], ...],
) -> ChannelScore:
    declared = channel.signal.channel
    recorded = channel.signal.samples
    bands: list[BandScore] = []
    clean = bool(np.all(np.isfinite(recorded)))
    if declared.quantity in SPECTRAL and clean and recorded.size - first >= 64:
        rate = channel.signal.sampling_rate
        R, P = spectrum(recorded[first:], rate), spectrum(predicted[first:], rate)
        for low, high in dict.fromkeys((*PAPER_BANDS[prediction.run.experiment], *further)):
            bottom, top = max(low, prediction.legitimate[0]), min(high, 0.5 * rate)
            if np.any(R.band(bottom, top)):
                bands.append(band_score(R, P, bottom, top))
    return ChannelScore(
        column=declared.column,
        quantity=declared.quantity,
        error=contract_error(recorded[first:], predicted[first:], declared.quantity),
        bands=tuple(bands),
        clock_offset=offset,
    )
