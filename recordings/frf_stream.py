"""A stream of measured frequency response functions: complex lines over one frequency axis, coherence where known."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from jointscope.errors import CampaignError
from jointscope.recordings.campaign import Channel, Stream
from jointscope.recordings.files import Column, DataFile
from jointscope.recordings.stream_columns import Table, believable, channel_of, find_columns, find_named, frozen


def read_frf_stream(stream: Table, where: str, file: Path, data: DataFile) -> Stream:
    """The stream with its axis, either the file's own (UFF) or the column that ``frequency`` names.

    Raises:
        CampaignError: No frequency axis, several, or a line that isn't finite.
    """
    columns = find_columns(stream, where, file, data, "refuse")
    named = stream.get("frequency")
    axis = None if named is None else find_named("frequency", named, where, file, data)
    channels = []
    for declared in stream["channels"]:
        column = columns[declared["column"]]
        axis = _axis(column, axis, where, file, data.path)
        channels.append(_channel(declared, column, axis, where, file, data))
    assert axis is not None
    return Stream(
        file=stream["file"],
        sampling_rate=float(stream.get("sampling_rate", 2.0 * axis[-1])),
        length=axis.size,
        channels=tuple(channels),
        frequency=frozen(axis),
    )


def _axis(
    column: Column, known: NDArray[np.float64] | None, where: str, file: Path, path: Path
) -> NDArray[np.float64]:
    own = column.frequency if column.frequency is not None else known
    if own is None:
        fix = "name the column that holds it"
        raise CampaignError(file, f"{where}.frequency", f"no frequency axis for {column.name}", fix=fix)
    if known is not None and not np.array_equal(own, known):
        raise CampaignError(path, column.name, "another frequency axis", fix="one stream per axis")
    if own.size != column.length:
        raise CampaignError(path, column.name, f"{column.length} lines over {own.size} frequencies", fix="mend it")
    if not (np.isfinite(own).all() and (np.diff(own) > 0.0).all()):
        raise CampaignError(path, column.name, "frequencies that do not increase", fix="sort the lines")
    return own


def _channel(
    declared: Table, column: Column, axis: NDArray[np.float64], where: str, file: Path, data: DataFile
) -> Channel:
    values = np.asarray(column.read(), dtype=np.complex128)
    bad = np.flatnonzero(~np.isfinite(values))
    if bad.size:
        raise CampaignError(
            data.path, column.name, f"line {bad[0]} is not finite", value=complex(values[bad[0]]), fix="mend it"
        )
    coherence = column.coherence
    if "coherence" in declared:
        key = f"channels[{declared['column']}].coherence"
        coherence = find_named(key, declared["coherence"], where, file, data)
    if coherence is not None and coherence.size != axis.size:
        raise CampaignError(data.path, f"coherence of {column.name}", f"{coherence.size} lines, not {axis.size}")
    channel = channel_of(
        {**declared, "averages": declared.get("averages", column.averages)}, values, coherence, column.unit
    )
    return believable(channel, data.path)
