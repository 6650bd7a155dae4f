"""LabVIEW measurement files (LVM): text records under repeating headers.

A file of one record calls its columns by their names; of several, ``1/name``, ``2/name``, ... Records begin where a
header repeats, or, where the file says ``Multi_Headings No``, after as many rows as the header's ``Samples``.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from jointscope.errors import CampaignError
from jointscope.recordings.files.columns import Column, DataFile

_END = "***End_of_Header***"


@dataclass
class _Segment:
    """A header and the rows under it."""

    header: dict[str, list[str]]
    names: list[str]
    rows: list[list[str]] = field(default_factory=list)


def open_file(path: Path) -> DataFile:
    """Open ``path``.

    Raises:
        CampaignError: It doesn't begin as an LVM file does, or a cell isn't a number.
    """
    lines = path.read_text(encoding="utf-8-sig", errors="replace").splitlines()
    if not lines or not lines[0].startswith("LabVIEW Measurement"):
        raise CampaignError(path, "line 1", "not an LVM file", value=(lines or [""])[0][:40])
    general, body = _general(lines)
    separator = "," if general.get("Separator", "Tab").lower() == "comma" else "\t"
    comma = general.get("Decimal_Separator", ".") == "," or separator == "\t"
    x_columns = general.get("X_Columns", "One")
    records = [
        columns for segment in _segments(body, separator) for columns in _records(segment, x_columns, comma, path)
    ]
    if len(records) == 1:
        return DataFile(path=path, columns={column.name: column for column in records[0]})
    return DataFile(
        path=path,
        columns={
            f"{number}/{column.name}": _renamed(column, f"{number}/{column.name}")
            for number, columns in enumerate(records, start=1)
            for column in columns
        },
    )


def _renamed(column: Column, name: str) -> Column:
    from dataclasses import replace

    return replace(column, name=name)


def _general(lines: list[str]) -> tuple[dict[str, str], list[str]]:
    """Keys of the file's own header, and the lines after it."""
    end = next((i for i, line in enumerate(lines) if line.startswith(_END)), len(lines))
    keys = {}
    for line in lines[1:end]:
        cells = line.replace(",", "\t", 1).split("\t") if "\t" not in line else line.split("\t")
        if len(cells) > 1:
            keys[cells[0].strip()] = cells[1].strip()
    return keys, lines[end + 1 :]


def _segments(lines: list[str], separator: str) -> list[_Segment]:
    segments: list[_Segment] = []
    header: dict[str, list[str]] = {}
    position = 0
    while position < len(lines):
        line = lines[position]
        cells = line.split(separator)
        if line.startswith(_END):
            position += 1
            segments.append(_Segment(header, lines[position].split(separator) if position < len(lines) else []))
            header = {}
        elif line.strip() and _starts_header(cells):
            header[cells[0].strip()] = cells[1:]
        elif line.strip() and segments:
            segments[-1].rows.append(cells)
        position += 1
    return segments


def _starts_header(cells: list[str]) -> bool:
    word = cells[0].strip()
    return word[:1].isalpha() and word.lower() not in ("nan", "inf")


def _records(segment: _Segment, x_columns: str, comma: bool, path: Path) -> list[list[Column]]:
    """The segment's columns, once per record stacked under its header."""
    count = int((segment.header.get("Channels") or ["0"])[0] or 0) or len([n for n in segment.names[1:] if n])
    stride = 2 if x_columns == "Multi" else 1
    names = [segment.names[1 + stride * k].strip() for k in range(count)]
    values = np.array([[_number(row, 1 + stride * k, comma, path) for k in range(count)] for row in segment.rows])
    if not len(values):
        return []
    times = None
    if x_columns != "No" and segment.rows[0][0].strip():
        times = np.array([_number(row, 0, comma, path) for row in segment.rows])
    samples = int(_header_number(segment, "Samples", 0, float(len(values)), comma))
    stacked = [values[i : i + samples] for i in range(0, len(values), max(samples, 1))]
    return [
        [
            _column(segment, name, k, record[:, k], comma, times if len(stacked) == 1 else None)
            for k, name in enumerate(names)
        ]
        for record in stacked
    ]


def _number(row: list[str], position: int, comma: bool, path: Path) -> float:
    text = row[position].strip() if position < len(row) else ""
    try:
        return float(text.replace(",", ".") if comma else text) if text else float("nan")
    except ValueError:
        raise CampaignError(path, f"column {position}", "not a number", value=text, fix="mend the cell") from None


def _header_number(segment: _Segment, key: str, position: int, default: float, comma: bool) -> float:
    cells = segment.header.get(key, [])
    text = cells[position].strip() if position < len(cells) else ""
    try:
        return float(text.replace(",", ".") if comma else text)
    except ValueError:
        return default


def _column(
    segment: _Segment,
    name: str,
    position: int,
    values: NDArray[np.float64],
    comma: bool,
    times: NDArray[np.float64] | None,
) -> Column:
    step = _header_number(segment, "Delta_X", position, 0.0, comma)
    if step <= 0.0 and times is not None and times.size > 1:
        step = float(np.median(np.diff(times)))
    units = segment.header.get("Y_Unit_Label", [])
    return Column(
        name=name,
        length=values.size,
        read=lambda: values,
        rate=1.0 / step if step > 0.0 else None,
        start=_header_number(segment, "X0", position, 0.0, comma),
        unit=(units[position].strip() or None) if position < len(units) else None,
    )
