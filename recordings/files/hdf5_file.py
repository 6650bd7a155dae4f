"""HDF5: one dataset per column, addressed by its path ``group/dataset``; a matrix as ``group/dataset[3]``."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from jointscope.recordings.files.columns import Column, DataFile

if TYPE_CHECKING:
    import h5py


def open_file(path: Path) -> DataFile:
    """Open ``path``; datasets are read when asked for."""
    import h5py

    columns: dict[str, Column] = {}

    def visit(name: str, item: object) -> None:
        if isinstance(item, h5py.Dataset) and item.dtype.kind in "biufc":
            for column in _columns(path, name, item):
                columns[column.name] = column

    with h5py.File(path, "r") as file:
        file.visititems(visit)
    return DataFile(path=path, columns=columns, aliases={f"/{name}": name for name in columns})


def _columns(path: Path, name: str, item: h5py.Dataset) -> list[Column]:
    shape = item.shape
    rate = _number(item.attrs.get("sampling_rate"))
    unit = item.attrs.get("unit", item.attrs.get("units"))
    unit = unit.decode() if isinstance(unit, bytes) else unit if isinstance(unit, str) else None
    if len(shape) not in (1, 2) or max(shape) < 2:
        return []
    if len(shape) == 1 or 1 in shape:
        read = functools.partial(_read, path, name, None)
        return [Column(name=name, length=max(shape), read=read, rate=rate, unit=unit)]
    return [
        Column(
            name=f"{name}[{index}]", length=max(shape), read=functools.partial(_read, path, name, index),
            rate=rate, unit=unit,
        )
        for index in range(min(shape))
    ]  # fmt: skip


def _number(value: object) -> float | None:
    return float(value) if isinstance(value, (int, float, np.number)) else None


def _read(path: Path, name: str, index: int | None) -> NDArray[Any]:
    import h5py

    with h5py.File(path, "r") as file:
        item = file[name]
        if index is None:
            return np.asarray(item[()]).reshape(-1)
        return np.asarray(item[index] if item.shape[0] <= item.shape[1] else item[:, index])
