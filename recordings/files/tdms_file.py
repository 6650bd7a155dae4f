"""TDMS files: ``group/channel``; rate and unit from the waveform's properties."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from jointscope.recordings.files.columns import Column, DataFile

if TYPE_CHECKING:
    from nptdms import TdmsChannel


def open_file(path: Path) -> DataFile:
    """Open ``path``; samples are read when asked for."""
    from nptdms import TdmsFile

    file = TdmsFile.read_metadata(path)
    columns = [_column(path, group.name, channel) for group in file.groups() for channel in group.channels()]
    return DataFile(path=path, columns={column.name: column for column in columns if column is not None})


def _column(path: Path, group: str, channel: TdmsChannel) -> Column | None:
    if channel.dtype is None or np.dtype(channel.dtype).kind not in "biufc" or not len(channel):
        return None
    step = float(channel.properties.get("wf_increment", 0.0) or 0.0)
    unit = channel.properties.get("unit_string") or channel.properties.get("NI_UnitDescription")
    return Column(
        name=f"{group}/{channel.name}",
        length=len(channel),
        read=functools.partial(_read, path, group, channel.name),
        rate=1.0 / step if step > 0.0 else None,
        start=float(channel.properties.get("wf_start_offset", 0.0) or 0.0),
        unit=str(unit) if unit else None,
    )


def _read(path: Path, group: str, channel: str) -> NDArray[Any]:
    from nptdms import TdmsFile

    with TdmsFile.open(path) as file:
        return np.asarray(file[group][channel][:])
