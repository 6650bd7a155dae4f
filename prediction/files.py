"""Predictions on disk: one CSV per run in the channels' own units, and the scores as JSON."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jointscope.atomic import replaced_file
from jointscope.errors import RefusedError
from jointscope.prediction.base_model import ChannelPrediction, RunPrediction
from jointscope.prediction.run_scores import ChannelScore
from jointscope.recordings.units import si_factor

Real = NDArray[np.float64]

_CLOCK = 1e-9  # s: samples closer than this share a row


def write_run(folder: Path, run: str, channels: Sequence[ChannelPrediction]) -> Path:
    """Write ``folder/<run>.csv``: ``time`` [s] and one column per channel, empty where a stream has no sample.

    Raises:
        RefusedError: Two channels share a column name, or the run's id is no file name.
    """
    if "/" in run or "\\" in run or run in ("", ".", ".."):
        raise RefusedError(f"run id {run!r} can't be a file name; rename the run in campaign.toml")
    names = [channel.signal.channel.column for channel in channels]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise RefusedError(
            f"run {run!r}: two output channels are called {twice!r}; column names are unique in a run"
        )
    ticks = [np.rint(channel.times / _CLOCK).astype(np.int64) for channel in channels]
    clock = np.unique(np.concatenate(ticks)) if ticks else np.zeros(0, dtype=np.int64)
    table = np.full((clock.size, len(channels)), np.nan)
    for column, (channel, tick) in enumerate(zip(channels, ticks, strict=True)):
        table[np.searchsorted(clock, tick), column] = channel.values / si_factor(channel.signal.channel)
    path = folder / f"{run}.csv"
    with replaced_file(path) as temporary, temporary.open("w", encoding="utf-8") as file:
        file.write(",".join(["time", *map(_quoted, names)]) + "\n")
        for tick, row in zip(clock.tolist(), table.tolist(), strict=True):
            cells = ["" if cell != cell else f"{cell:.9g}" for cell in row]
            file.write(f"{tick * _CLOCK:.9f}".rstrip("0").rstrip(".") + "," + ",".join(cells) + "\n")
    return path


def scores_json(
    predictions: Sequence[RunPrediction], scores: Mapping[str, Sequence[ChannelScore]]
) -> dict[str, Any]:
    """What ``scores.json`` holds: per run, per channel, and the mean per experiment, all with their units."""
    runs = {}
    for prediction in predictions:
        low, high = prediction.legitimate
        runs[prediction.run.id] = {
            "experiment": prediction.run.experiment,
            "role": prediction.run.role,
            "closed_loop": prediction.closed_loop,
            "legitimate_band_hz": [low, high],
            "notes": list(prediction.notes),
            "channels": {
                score.column: {
                    "quantity": score.quantity,
                    "error": _finite(score.error),
                    "clock_offset_s": score.clock_offset,
                    "bands": [
                        {_WITH_UNIT.get(key, key): _finite(value) for key, value in asdict(band).items()}
                        for band in score.bands
                    ],
                }
                for score in scores.get(prediction.run.id, ())
            },
        }
    return {"format": "jointscope-prediction/1", "runs": runs, "mean_error": mean_errors(predictions, scores)}


def mean_errors(
    predictions: Sequence[RunPrediction], scores: Mapping[str, Sequence[ChannelScore]]
) -> dict[str, float]:
    """Mean contract error per experiment over its runs' channels, each weighted the same [-]."""
    collected: dict[str, list[float]] = {}
    for prediction in predictions:
        for score in scores.get(prediction.run.id, ()):
            if np.isfinite(score.error):
                collected.setdefault(prediction.run.experiment, []).append(score.error)
    return {experiment: float(np.mean(errors)) for experiment, errors in collected.items()}


_WITH_UNIT = {
    "low": "low_hz",
    "high": "high_hz",
    "median_error": "median_error_db",
    "error_95": "error_95_db",
    "bias": "bias_db",
    "peak_frequency": "peak_frequency_hz",
    "peak_frequency_error": "peak_frequency_error_hz",
    "peak_amplitude_error": "peak_amplitude_error_db",
}


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None


def _quoted(name: str) -> str:
    return '"' + name.replace('"', '""') + '"' if any(mark in name for mark in ',"\n') else name
