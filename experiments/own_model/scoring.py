"""Errors of a stepped campaign against the recorded one, as the contract defines them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from jointscope.recordings.campaign import Run, Signal

Real = NDArray[np.float64]
Instrument = tuple[object, ...]

ANGULAR = ("angle", "position")
DIVERGED = 100.0  # an error counts no more than this
_TAIL = 8  # samples at the end, where a recorder's filter looks past the run
_SETTLING = 0.4  # s at the start of a run that began in motion


@dataclass(frozen=True, eq=False)
class ChannelError:
    """One output channel of one run.

    Attributes:
        run, experiment: Of the recording.
        channel: ``quantity@location``.
        error: RMS(recorded - predicted) over RMS(recorded), over RMS(recorded - first) for angles [-].
        times: [s], shape (n,).
        recorded, predicted: In SI, shape (n,), scored samples only.
    """

    run: str
    experiment: str
    channel: str
    error: float
    times: Real
    recorded: Real
    predicted: Real


def outputs_of(run: Run) -> list[Signal]:
    """Recorded outputs that a single joint's model has."""
    return [
        signal
        for signal in run.select(role="output")
        if signal.channel.quantity != "frf" and signal.channel.location not in ("base", "neighbour")
    ]


def instrument(signal: Signal) -> Instrument:
    """Outputs that share it are the same instrument at the same place."""
    channel = signal.channel
    return (channel.quantity, channel.location, channel.direction, channel.radius, signal.sampling_rate)


def polarity(pairs: Sequence[tuple[Run, Mapping[str, Real]]]) -> dict[Instrument, float]:
    """-1 for an instrument whose sign is the other way round than a trusted prediction's.

    Args:
        pairs: Recorded runs with the prediction of each output, by column.
    """
    product: dict[Instrument, float] = {}
    for run, predicted in pairs:
        for signal in outputs_of(run):
            if signal.channel.column not in predicted:
                continue
            x = signal.samples - np.nanmean(signal.samples)
            y = predicted[signal.channel.column] - np.mean(predicted[signal.channel.column])
            size = float(np.nansum(x * x) * np.sum(y * y)) ** 0.5
            key = instrument(signal)
            product[key] = product.get(key, 0.0) + (float(np.nansum(x * y)) / size if size > 0.0 else 0.0)
    return {key: -1.0 if value < 0.0 else 1.0 for key, value in product.items()}


def channel_errors(
    recorded: Run, predicted: Mapping[str, Real], signs: Mapping[Instrument, float]
) -> tuple[ChannelError, ...]:
    """Errors of one run, ``predicted`` by column; an angle's zero is the recording's."""
    found = []
    for signal in outputs_of(recorded):
        column = signal.channel.column
        if column not in predicted:
            continue
        samples, angle = signal.samples, signal.channel.quantity in ANGULAR
        scored = np.isfinite(samples)
        if samples.size > 64:
            scored[-_TAIL:] = False
        if recorded.initial == "estimate":
            scored &= signal.times >= signal.times[0] + _SETTLING
        sign = signs.get(instrument(signal), 1.0)
        made = predicted[column]
        made = sign * (made - made[0]) + first_angle(samples) if angle else sign * made
        kept, model = samples[scored], made[scored]
        reference = _rms(kept - kept[0] if angle else kept)
        error = _rms(kept - model) / reference if reference > 0.0 else math.nan
        found.append(
            ChannelError(recorded.id, recorded.experiment, f"{signal.channel.quantity}@{signal.channel.location}",
                         error, signal.times[scored], kept, model)
        )  # fmt: skip
    return tuple(found)


def mean_error(errors: Sequence[ChannelError]) -> float:
    """Mean over channels that are not silent; a diverged one counts as ``DIVERGED``."""
    values = [min(e.error, DIVERGED) if math.isfinite(e.error) else DIVERGED for e in errors if not math.isnan(e.error)
              or not np.all(np.isfinite(e.predicted))]  # fmt: skip
    return float(np.mean(values)) if values else math.nan


def grouped(errors: Sequence[ChannelError]) -> dict[str, dict[str, float]]:
    """Mean error per experiment and channel."""
    table: dict[str, dict[str, list[ChannelError]]] = {}
    for e in errors:
        table.setdefault(e.experiment, {}).setdefault(e.channel, []).append(e)
    return {
        experiment: {channel: mean_error(members) for channel, members in sorted(channels.items())}
        for experiment, channels in sorted(table.items())
    }


def first_angle(samples: Real) -> float:
    """The angle at rest before the motion: the median for as long as it does not move."""
    finite = samples[np.isfinite(samples)][:16]
    steps = float(np.median(np.abs(np.diff(finite)))) if finite.size > 1 else 0.0
    still = int(np.argmax(np.append(np.abs(finite - finite[0]) > 4.0 * steps + 1e-15, True)))
    return float(np.median(finite[:still])) if still >= 5 else float(finite[0])


def _rms(x: Real) -> float:
    return float(np.sqrt(np.mean(np.square(x)))) if x.size else 0.0
