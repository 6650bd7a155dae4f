"""MDF 3 and 4 measurement files (``.mf4``, ``.mdf``): ``group/channel`` with each group's own time stamps.

A group is named after its acquisition, or ``group0``, ``group1``, ... where it has no name of its own. Samples that the
file marks as invalid are missing ones.
"""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jointscope.errors import MissingExtraError
from jointscope.recordings.files.columns import Column, DataFile


def open_file(path: Path) -> DataFile:
    """Open ``path``; samples are read when asked for.

    Raises:
        MissingExtraError: asammdf is not installed.
    """
    columns: dict[str, Column] = {}
    with _opened(path) as mdf:
        taken: set[str] = set()
        for index, group in enumerate(mdf.groups):
            name = str(getattr(group.channel_group, "acq_name", "") or f"group{index}").replace("/", "_")
            name = name if name not in taken else f"{name}-{index}"
            taken.add(name)
            columns.update({column.name: column for column in _group(path, mdf, index, name)})
    return DataFile(path=path, columns=columns, simultaneous=True)


def _opened(path: Path) -> Any:  # noqa: ANN401  # absent without the extra, and its groups are untyped
    try:
        from asammdf import MDF
    except ImportError:
        raise MissingExtraError(f"{path.name}: reading an MDF file", "mdf") from None
    return MDF(path)


def _group(path: Path, mdf: Any, index: int, name: str) -> list[Column]:  # noqa: ANN401
    group, length = mdf.groups[index], int(mdf.groups[index].channel_group.cycles_nr)
    master = mdf.masters_db.get(index)
    if length < 2 or master is None:
        return []
    clock = f"{name}/time"
    found = [
        Column(name=clock, length=length, read=functools.partial(_stamps, path, index), unit="s", clock=clock)
    ]
    names: set[str] = set()
    for position, channel in enumerate(group.channels):
        if position == master or channel.name in names:
            continue
        signal = mdf.get(group=index, index=position, record_count=1)
        if signal.samples.dtype.kind not in "biuf" or signal.samples.ndim != 1:
            continue
        names.add(channel.name)
        found.append(
            Column(
                name=f"{name}/{channel.name}", length=length, unit=signal.unit or None, clock=clock,
                read=functools.partial(_read, path, index, position), label=signal.comment or "",
            )
        )  # fmt: skip
    return found


def _stamps(path: Path, group: int) -> NDArray[Any]:
    with _opened(path) as mdf:
        return np.asarray(mdf.get_master(group), dtype=np.float64)


def _read(path: Path, group: int, position: int) -> NDArray[Any]:
    with _opened(path) as mdf:
        signal = mdf.get(group=group, index=position, ignore_invalidation_bits=True)
        values = np.asarray(signal.samples, dtype=np.float64)
        invalid = signal.invalidation_bits
        return values if invalid is None else np.where(np.asarray(invalid, dtype=bool), np.nan, values)
