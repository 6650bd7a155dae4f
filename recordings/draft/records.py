"""What data files hold, as records: columns of one length that one device took at one rate."""

from __future__ import annotations

import re
from collections import defaultdict
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from jointscope.recordings.files import Column, DataFile, open_data_file

Real = NDArray[np.float64]
_TIME_NAME: Final = re.compile(r"^(.*[./])?(t|time|zeit|timestamp|x_value|x)(\b|_|$)", re.IGNORECASE)


@dataclass(frozen=True, kw_only=True, eq=False)
class Record:
    """One device's take.

    Attributes:
        name: The TDMS group, LVM record or struct it is in; empty where the file has only one.
        rate: Sampling rate [Hz], or ``None`` where nothing says it.
        rate_from: What says it, for a comment.
        time: The column of time stamps in seconds, or ``None``.
        uniform: Whether those stamps are uniform, so that they need not be named.
        simultaneous: Whether the file's records are parts of one take: their stamps then give each one's start.
        columns: Everything but the time column.
    """

    file: Path
    name: str
    length: int
    rate: float | None
    rate_from: str
    time: str | None
    uniform: bool
    columns: tuple[Column, ...]
    simultaneous: bool = False


def records_of(path: Path) -> tuple[Record, ...]:
    """The records of one file. FRFs are records of their own, recognised by their frequency axis."""
    data = open_data_file(path)
    groups: dict[tuple[str, int, bool], list[Column]] = defaultdict(list)
    for column in data.columns.values():
        groups[_group(column, data), column.length, column.frequency is not None].append(column)
    lone = len({name for name, _, _ in groups}) == 1
    records = (_record(path, "" if lone else key[0], columns) for key, columns in groups.items())
    return tuple(replace(record, simultaneous=data.simultaneous) for record in records if record.columns)


def _group(column: Column, data: DataFile) -> str:
    """By the clock where the file names one; TDMS groups and LVM records by their first part, structs up to the field."""
    if column.clock is not None:
        return column.clock.rsplit("/", 1)[0]
    if data.path.suffix.lower() in (".tdms", ".lvm"):
        return column.name.split("/", 1)[0] if "/" in column.name else ""
    parts = re.split(r"[./]", re.sub(r"\[\d+\]$", "", column.name))
    return ".".join(parts[:-1])


def _record(path: Path, name: str, columns: list[Column]) -> Record:
    length = columns[0].length
    stated = next((c.rate for c in columns if c.rate is not None), None)
    if columns[0].frequency is not None:
        return Record(
            file=path, name=name, length=length, rate=None, rate_from="", time=None, uniform=True, columns=tuple(columns)
        )  # fmt: skip
    clock, step, uniform = _time_column(columns)
    time = clock
    rate, source = stated, "the file's own rate"
    if rate is None and step is not None:
        seconds, called = _in_seconds(step)
        rate = _rounded(1.0 / seconds)
        source = f"the steps of {time}" + (f", taken as {called}" if called else "")
        time, uniform = (time, uniform) if not called else (None, True)
    return Record(
        file=path, name=name, length=length, rate=rate, rate_from=source if rate else "", time=time, uniform=uniform,
        columns=tuple(c for c in columns if c.name != clock),
    )  # fmt: skip


def _time_column(columns: list[Column]) -> tuple[str | None, float | None, bool]:
    """Name, step [s] and uniformity of a column that counts time: rising, evenly, and called so."""
    clock = next((column for column in columns if column.name == column.clock), None)
    if clock is not None and clock.length >= 3:
        return _clock(clock)
    for column in columns:
        if not _TIME_NAME.match(column.name) or column.length < 3:
            continue
        stamps = np.asarray(column.read(), dtype=np.float64)
        steps = np.diff(stamps[np.isfinite(stamps)])
        if steps.size < 2 or (steps <= 0.0).any():
            continue
        step = float(np.median(steps))
        if (steps < 0.3 * step).any():
            continue
        mean = float(stamps[-1] - stamps[0]) / (stamps.size - 1)
        uniform = bool((steps < 1.5 * step).all()) and float(np.abs(steps - step).max()) < 0.02 * step
        return column.name, mean if uniform else step, uniform
    return None, None, True


def _clock(column: Column) -> tuple[str, float, bool]:
    """The same for stamps that the file ties to its columns: the mean step of those rows that are there."""
    stamps = np.asarray(column.read(), dtype=np.float64)
    steps = np.diff(stamps)
    usual = float(np.median(steps))
    count = np.maximum(1.0, np.rint(steps / usual)) if usual > 0.0 else np.ones_like(steps)
    step = float(stamps[-1] - stamps[0]) / float(count.sum())
    uniform = bool((count == 1.0).all()) and float(np.abs(steps - step).max()) < 0.02 * step
    return column.name, step, uniform


def _in_seconds(step: float) -> tuple[float, str]:
    """A step [s], and the unit that a clock which counts in hundreds must be in; controllers count micro- or milliseconds."""
    if step < 1.0:
        return step, ""
    return (step * 1e-6, "microseconds") if step >= 20.0 else (step * 1e-3, "milliseconds")


def _rounded(rate: float) -> float:
    """A rate that is a whole number but for the print of its time stamps, as that number."""
    return float(round(rate)) if rate >= 10.0 and abs(rate / round(rate) - 1.0) < 1e-4 else rate


def peak(column: Column) -> float:
    """Largest magnitude, gaps left out, in the file's unit."""
    values = np.abs(np.asarray(column.read()))
    known = values[np.isfinite(values)]
    return float(known.max()) if known.size else float("nan")


def listing(records: tuple[Record, ...]) -> list[str]:
    """The lines that tell a user what was found."""
    lines = []
    for record in records:
        rate = f"{record.rate:.6g} Hz from {record.rate_from}" if record.rate else "no sampling rate in the file"
        if record.columns and record.columns[0].frequency is not None:
            axis = record.columns[0].frequency
            rate = f"FRFs, {axis[0]:.4g}-{axis[-1]:.4g} Hz"
        title = f"{record.file.name}{': ' + record.name if record.name else ''}"
        lines.append(f"{title}: {record.length} {'lines' if 'FRFs' in rate else 'samples'}, {rate}")
        if record.time:
            lines.append(f"  {record.time:24s} time{'' if record.uniform else ', not uniform'}")
        for column in record.columns:
            unit = f" {column.unit}" if column.unit else ""
            label = f"  ({column.label})" if column.label else ""
            lines.append(f"  {column.name:24s} peak {peak(column):.4g}{unit}{label}")
    return lines
