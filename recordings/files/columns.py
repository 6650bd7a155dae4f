"""What every data file looks like from inside: named columns that are read when asked for."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Column:
    """One column, record or dataset of a file.

    Attributes:
        name: As ``column`` in a campaign names it.
        length: Number of samples, or of frequency lines.
        read: Returns the values in the file's unit, shape (length,), real or complex.
        rate: Sampling rate the file states [Hz], or ``None``.
        start: Time of the first sample the file states [s].
        unit: The file's own unit label, or ``None``.
        frequency: Frequency axis of an FRF [Hz], shape (length,); ``None`` for time data.
        coherence: Shape (length,), where the file holds it.
        averages: Number of averages, where the file says it.
        label: What the file calls the column beside its name.
        clock: Name of the column with its time stamps [s], where the file ties one to it.
        meaning: Keys of a campaign's channel that the file's format implies, each with the reason.
        joint: The joint that the file says it is of, or ``None``.
    """

    name: str
    length: int
    read: Callable[[], NDArray[Any]] = field(repr=False)
    rate: float | None = None
    start: float = 0.0
    unit: str | None = None
    frequency: NDArray[np.float64] | None = field(default=None, repr=False)
    coherence: NDArray[np.float64] | None = field(default=None, repr=False)
    averages: int | None = None
    label: str = ""
    clock: str | None = None
    meaning: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    joint: str | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class DataFile:
    """A data file's columns.

    Attributes:
        aliases: Other names of columns: UFF degrees of freedom, matrix columns by their path.
        simultaneous: Whether all its records are parts of one take, their stamps on one clock.
    """

    path: Path
    columns: Mapping[str, Column]
    aliases: Mapping[str, str] = field(default_factory=dict)
    simultaneous: bool = False

    def find(self, name: str) -> Column | None:
        """The column called ``name``, or ``None``."""
        return self.columns.get(self.aliases.get(name, name))


def spread(name: str, values: NDArray[Any]) -> list[tuple[str, NDArray[Any]]]:
    """An array as named columns: a vector as it is, a matrix as ``name[0]``, ``name[1]``, ...

    The longer side of a matrix is time. Scalars and arrays of more than two dimensions give none.
    """
    flat = values.reshape(-1) if values.ndim == 2 and 1 in values.shape else values
    if flat.dtype.kind not in "biufc" or flat.size < 2:
        return []
    if flat.ndim == 1:
        return [(name, flat)]
    if flat.ndim != 2:
        return []
    rows = flat if flat.shape[0] <= flat.shape[1] else flat.T
    return [(f"{name}[{index}]", row) for index, row in enumerate(rows)]


def held(name: str, values: NDArray[Any]) -> Column:
    """A column whose values are in memory already."""
    return Column(name=name, length=values.size, read=lambda: values)
