"""From a file's columns to a stream's channels: found by name, of one length, in SI, read-only."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from jointscope.errors import CampaignError
from jointscope.recordings.campaign import Channel
from jointscope.recordings.files import Column, DataFile
from jointscope.recordings.schema import channel_key
from jointscope.recordings.units import si_factor

Table = Mapping[str, Any]
Number = TypeVar("Number", bound=np.generic)
LARGEST = 1e50  # SI: beyond it no unit leads, and squares and products would overflow
MissingOutputs = Literal["refuse", "allow"]


def find_columns(
    stream: Table, where: str, file: Path, data: DataFile, missing: MissingOutputs
) -> dict[str, Column]:
    """The columns that the channels name, as far as the file has them; all of one length."""
    found: dict[str, Column] = {}
    for position, channel in enumerate(stream["channels"]):
        name = channel["column"]
        column = data.find(name)
        if column is None and (channel["role"] == "input" or missing == "refuse"):
            key = f"{where}.{channel_key(channel, position)}.column"
            raise CampaignError(file, key, f"no such column in {stream['file']}", value=name, fix=offer(data))
        if column is not None:
            found[name] = column
    lengths = {column.length for column in found.values()}
    if len(lengths) > 1:
        shown = ", ".join(f"{name} {column.length}" for name, column in found.items())
        raise CampaignError(data.path, shown, "samples of differing number", fix="one stream per device")
    return found


def find_named(key: str, name: str, where: str, file: Path, data: DataFile) -> NDArray[np.float64]:
    """Values of the column that a stream's own key (``time``, ``frequency``) names."""
    column = data.find(name)
    if column is None:
        raise CampaignError(
            file, f"{where}.{key}", f"no such column in {data.path.name}", value=name, fix=offer(data)
        )
    return real_values(column, data.path)


def offer(data: DataFile) -> str:
    """What a file holds, for a message."""
    names = list(data.columns)
    if names and all(name.lstrip("-").replace(".", "", 1).isdigit() and "." in name for name in names):
        return "its first line holds numbers; it needs a header line with the columns' names"
    return f"it has {', '.join(names[:12])}{f' and {len(names) - 12} more' if len(names) > 12 else ''}"


def real_values(column: Column, path: Path) -> NDArray[np.float64]:
    """A column's values, shape (n,), refused where they are complex."""
    values = column.read()
    if np.iscomplexobj(values):
        raise CampaignError(path, column.name, "complex values in time data", fix="quantity = 'frf' takes them")
    return np.asarray(values, dtype=np.float64)


def frozen(values: NDArray[Number]) -> NDArray[Number]:
    """A read-only copy."""
    copy = values.copy()
    copy.setflags(write=False)
    return copy


def believable(channel: Channel, path: Path) -> Channel:
    """The channel as it is.

    Raises:
        CampaignError: A sample is larger than anything that is measured.
    """
    samples = channel.samples
    if samples is not None and np.any(np.abs(samples) > LARGEST):
        place = int(np.argmax(np.abs(samples) > LARGEST))
        raise CampaignError(
            path, channel.column, f"sample {place} is {abs(samples[place]):.3g} in SI, beyond any measurement",
            fix="mend the file, or the channel's unit or scale",
        )  # fmt: skip
    return channel


def vector(value: list[float] | None) -> tuple[float, float, float] | None:
    """A TOML list of three numbers."""
    return None if value is None else (float(value[0]), float(value[1]), float(value[2]))


def channel_of(
    declared: Table,
    raw: NDArray[Any] | None,
    coherence: NDArray[np.float64] | None = None,
    file_unit: str | None = None,
) -> Channel:
    """The channel with its samples in SI, from ``raw`` in the file's unit."""
    keys = {key: value for key, value in declared.items() if key not in ("point", "axis", "coherence")}
    places = {"point": vector(declared.get("point")), "axis": vector(declared.get("axis"))}
    bare = Channel(**keys, **places)  # type: ignore[arg-type]
    samples = None if raw is None else frozen(np.asarray(raw * si_factor(bare)))
    kept = None if coherence is None else frozen(coherence)
    return Channel(**keys, **places, samples=samples, coherence=kept, file_unit=file_unit)  # type: ignore[arg-type]
