"""Universal files (UFF, UNV): the data records (58, 58b) among whatever headers (151, 15, 55, 164) come with them.

A record is named by its place among the data records, from 1, or by its degree of freedom: ``101:+Z`` (the
response's), ``101:+Z/5:+Z`` (response and reference) where several share it. Coherence records join their FRF.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from jointscope.recordings.files.columns import Column, DataFile

_DIRECTIONS: Final = {
    0: "S", 1: "+X", -1: "-X", 2: "+Y", -2: "-Y", 3: "+Z", -3: "-Z",
    4: "+RX", -4: "-RX", 5: "+RY", -5: "-RY", 6: "+RZ", -6: "-RZ",
}  # fmt: skip
_TIME, _FRF, _COHERENCE = 1, 4, 6
_SI_BY_CODE: Final = {8: "m", 11: "m/s", 12: "m/s^2", 13: "N", 9: "N m"}  # ordinate data types of record 9


def open_file(path: Path) -> DataFile:
    """Open ``path``: time data and FRFs; other kinds of function are skipped."""
    import pyuff

    file = pyuff.UFF(str(path))
    places = [place for place, kind in enumerate(file.get_set_types()) if int(kind) == 58]
    records: list[dict[str, Any]] = [file.read_sets(place) for place in places]
    coherences = {_pair(r): np.abs(np.asarray(r["data"])) for r in records if int(r["func_type"]) == _COHERENCE}
    kept = {
        str(number): record
        for number, record in enumerate(records, start=1)
        if int(record["func_type"]) in (_TIME, _FRF, 0)
    }
    columns = {name: _column(name, record, coherences) for name, record in kept.items()}
    return DataFile(path=path, columns=columns, aliases=_aliases(kept))


def _dof(record: dict[str, Any], side: str) -> str:
    return f"{int(record[f'{side}_node'])}:{_DIRECTIONS.get(int(record[f'{side}_dir']), 'S')}"


def _pair(record: dict[str, Any]) -> str:
    return f"{_dof(record, 'rsp')}/{_dof(record, 'ref')}"


def _aliases(records: dict[str, dict[str, Any]]) -> dict[str, str]:
    """Degrees of freedom that name one record only."""
    responses = Counter(_dof(record, "rsp") for record in records.values())
    pairs = Counter(_pair(record) for record in records.values())
    aliases = {}
    for number, record in records.items():
        if responses[_dof(record, "rsp")] == 1:
            aliases[_dof(record, "rsp")] = number
        if pairs[_pair(record)] == 1:
            aliases[_pair(record)] = number
    return aliases


def _column(name: str, record: dict[str, Any], coherences: dict[str, NDArray[np.float64]]) -> Column:
    values = np.asarray(record["data"])
    axis = np.asarray(record["x"], dtype=np.float64)
    step = float(record.get("abscissa_inc", 0.0) or (axis[1] - axis[0] if axis.size > 1 else 0.0))
    label = " ".join(str(record.get(key, "")).strip() for key in ("id1", "rsp_ent_name")).strip()
    unit = str(record.get("ordinate_axis_units_lab", "")).strip()
    unit = unit if unit and unit.upper() != "NONE" else ""
    if int(record["func_type"]) == _FRF:
        return Column(
            name=name, length=values.size, read=lambda: values.astype(np.complex128), frequency=axis,
            unit=unit or None, coherence=coherences.get(_pair(record)), label=f"{label} {_pair(record)}".strip(),
        )  # fmt: skip
    unit = unit or _SI_BY_CODE.get(int(record.get("ordinate_spec_data_type", 0)), "")
    return Column(
        name=name, length=values.size, read=lambda: np.real(values).astype(np.float64),
        rate=1.0 / step if step > 0.0 else None, start=float(axis[0]) if axis.size else 0.0,
        unit=unit or None, label=f"{label} {_dof(record, 'rsp')}".strip(),
    )  # fmt: skip
