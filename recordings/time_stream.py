"""A stream of samples: cut to its window, put on its uniform grid, checked for gaps, in SI."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from jointscope.errors import CampaignError
from jointscope.recordings.campaign import Stream
from jointscope.recordings.files import Column, DataFile
from jointscope.recordings.stream_columns import (
    MissingOutputs,
    Table,
    believable,
    channel_of,
    find_columns,
    find_named,
    real_values,
)
from jointscope.recordings.time_stamps import on_uniform_grid

MINIMUM_SAMPLES = 64


def read_time_stream(stream: Table, where: str, file: Path, data: DataFile, missing: MissingOutputs) -> Stream:
    """The stream's channels in SI.

    Without ``start``, a stream with time stamps begins at its first stamp, any other at 0 s.

    Raises:
        CampaignError: A column or a part of it that isn't there, gaps not admitted, samples that aren't finite.
    """
    path, rate = data.path, float(stream["sampling_rate"])
    columns = find_columns(stream, where, file, data, missing)
    _check_rate(columns, rate, f"{where}.sampling_rate", file)
    stamps = find_named("time", stream["time"], where, file, data) if "time" in stream else None
    raw = {name: real_values(column, path) for name, column in columns.items()}
    length = _length(raw, stamps, stream, data)
    part = _part(stream, where, file, stamps, rate, length)
    raw = {name: values[part] for name, values in raw.items()}
    length, jitter, first = part.stop - part.start, 0.0, 0.0
    masked = stream.get("gaps") == "mask"
    if stamps is not None:
        grid = on_uniform_grid(
            stamps[part], raw, rate, masked=masked, file=path, column=stream["time"], key=f"{where}.time"
        )
        raw, length, jitter, first = grid.samples, grid.length, grid.jitter, float(stamps[part][0])
    for name, values in raw.items():
        _check_samples(values, masked, path, name)
    start = stream.get("start", first)
    window = stream.get("window")
    return Stream(
        file=stream["file"],
        sampling_rate=rate,
        start=0.0 if start == "unknown" else float(start),
        start_uncertainty=math.inf if start == "unknown" else float(stream.get("start_uncertainty", 0.0)),
        length=length,
        channels=tuple(
            believable(
                channel_of(channel, raw.get(name), None, columns[name].unit if name in columns else None), path
            )
            for channel in stream["channels"]
            for name in (channel["column"],)
        ),
        time=stream.get("time"),
        window=None if window is None else (float(window[0]), float(window[1])),
        gaps=stream.get("gaps", "refuse"),
        sync=stream.get("sync"),
        jitter=jitter,
    )


def _check_rate(columns: dict[str, Column], rate: float, key: str, file: Path) -> None:
    for column in columns.values():
        if column.rate is not None and abs(column.rate / rate - 1.0) > 0.01:
            raise CampaignError(
                file, key, f"the file itself says {column.rate:.6g} Hz for {column.name}", value=rate,
                fix="correct the one that is wrong",
            )  # fmt: skip


def _length(
    raw: dict[str, NDArray[np.float64]], stamps: NDArray[np.float64] | None, stream: Table, data: DataFile
) -> int:
    """Rows of the file: those of the channels, of the time stamps, or of whatever it holds."""
    if stamps is None:
        held = next((values.size for values in raw.values()), None)
        return held if held is not None else max((c.length for c in data.columns.values()), default=0)
    for name, values in raw.items():
        if values.size != stamps.size:
            problem = f"{values.size} samples, but {stream['time']} has {stamps.size}"
            raise CampaignError(data.path, name, problem, fix="mend the file")
    return stamps.size


def _part(
    stream: Table, where: str, file: Path, stamps: NDArray[np.float64] | None, rate: float, length: int
) -> slice:
    """Samples inside ``window``, [t0, t1) in the file's own time: its stamps, or seconds after its first sample."""
    if "window" not in stream:
        return slice(0, length)
    begin, end = stream["window"]
    if stamps is not None:
        chosen = slice(int(np.searchsorted(stamps, begin)), int(np.searchsorted(stamps, end)))
        held = (float(stamps[0]), float(stamps[-1]) + 1.0 / rate)
    else:
        chosen = slice(round(max(0.0, min(begin * rate, length))), round(max(0.0, min(end * rate, length))))
        held = (0.0, length / rate)
    slack = 1.5 / rate
    if begin < held[0] - slack or end > held[1] + slack or chosen.stop <= chosen.start:
        raise CampaignError(
            file, f"{where}.window", f"outside the file, which holds {held[0]:.6g} to {held[1]:.6g} s",
            value=list(stream["window"]), fix="choose a part inside",
        )  # fmt: skip
    return chosen


def _check_samples(values: NDArray[np.float64], masked: bool, path: Path, name: str) -> None:
    infinite = np.flatnonzero(np.isinf(values))
    missing = np.flatnonzero(np.isnan(values))
    if infinite.size:
        at = infinite[0]
        raise CampaignError(path, name, f"infinite sample {at}", value=float(values[at]), fix="mend the file")
    if missing.size and not masked:
        raise CampaignError(
            path, name, f"{missing.size} missing samples, the first is sample {missing[0]}", value=math.nan,
            fix="say gaps = 'mask' on the stream to leave them unscored",
        )  # fmt: skip
    held = values.size - missing.size
    if held < MINIMUM_SAMPLES:
        raise CampaignError(path, name, f"{held} samples", fix=f"a channel needs at least {MINIMUM_SAMPLES}")
