"""CSV with one header line: comma, semicolon or tab; an empty cell is a missing sample."""

from __future__ import annotations

import csv
import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jointscope.errors import CampaignError
from jointscope.recordings.files.columns import Column, DataFile

Cells = NDArray[np.float64] | list[list[str]]


def open_file(path: Path) -> DataFile:
    """Open ``path``.

    Raises:
        CampaignError: No header line, a name that occurs twice, or lines of differing length.
    """
    with path.open(encoding="utf-8-sig", newline="") as file:
        header = file.readline()
    separator = max(",;\t", key=header.count)
    names = [name.strip() for name in next(csv.reader([header], delimiter=separator), [])]
    if names and names[0].startswith("#"):
        names[0] = names[0][1:].strip()
    if not any(names):
        raise CampaignError(
            path, "line 1", "no header line", value=header.strip()[:40], fix="name the columns there"
        )
    for name in names:
        if name and names.count(name) > 1:
            raise CampaignError(path, "line 1", "column named twice", value=name, fix="column names are unique")
    load = functools.lru_cache(maxsize=1)(functools.partial(_load, path, separator, len(names)))
    length = _count(path)
    return DataFile(
        path=path,
        columns={
            name: Column(name=name, length=length, read=functools.partial(_column, path, load, name, position))
            for position, name in enumerate(names)
            if name
        },
    )


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _count(path: Path) -> int:
    """Lines that hold data."""
    with path.open("rb") as file:
        return sum(1 for line in file if line.strip()) - 1


def _load(path: Path, separator: str, width: int) -> Cells:
    """All cells, shape (rows, width), as numbers where every cell is one, else as texts."""
    try:
        numbers = np.loadtxt(path, delimiter=separator, skiprows=1, ndmin=2, comments=None, encoding="utf-8-sig")
    except ValueError:
        pass
    else:
        if numbers.shape[1] == width:
            return numbers
    with path.open(encoding="utf-8-sig", newline="") as file:
        lines = [
            line for line in csv.reader(file, delimiter=separator) if any(cell.strip() for cell in line) or line
        ]
    rows = [[cell.strip() for cell in line] for line in lines[1:] if line]
    for number, row in enumerate(rows, start=2):
        if len(row) != width:
            raise CampaignError(
                path, f"line {number}", f"{len(row)} cells where the header has {width}", fix="mend the line"
            )
    return rows


def _column(path: Path, load: Callable[[], Cells], name: str, position: int) -> NDArray[Any]:
    cells = load()
    if isinstance(cells, np.ndarray):
        return cells[:, position]
    return _parse(path, name, [row[position] for row in cells])


def _parse(path: Path, name: str, cells: list[str]) -> NDArray[Any]:
    comma = any("," in cell for cell in cells[:1000])  # decimal comma, as semicolon files from German labs have
    texts = [cell.replace(",", ".") for cell in cells] if comma else cells
    for kind in (float, complex):
        try:
            return np.array([kind(cell) if cell else np.nan for cell in texts])
        except ValueError:
            continue
    bad = next(index for index, cell in enumerate(texts) if cell and not _is_number(cell))
    raise CampaignError(path, name, f"not a number in line {bad + 2}", value=cells[bad], fix="mend the cell")
