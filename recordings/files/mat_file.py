"""MATLAB files: ``a.b[3]`` is column (counted from 0) 3 of field b of struct a; struct and cell arrays likewise.

Version 7.3 files are HDF5 inside and are walked with h5py, older ones read by SciPy. MATLAB's own objects are skipped.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from jointscope.recordings.files.columns import DataFile, held, spread

if TYPE_CHECKING:
    import h5py

Named = tuple[str, NDArray[Any]]


def open_file(path: Path) -> DataFile:
    """Open ``path``, whichever version it is."""
    with path.open("rb") as file:
        head = file.read(128)
        at_512 = file.seek(512) and file.read(8)
    modern = b"MATLAB 7.3" in head or head.startswith(b"\x89HDF") or at_512 == b"\x89HDF\r\n\x1a\n"
    arrays = list(_modern(path) if modern else _classic(path))
    return DataFile(path=path, columns={name: held(name, values) for name, values in arrays})


def _classic(path: Path) -> Iterator[Named]:
    from scipy.io import loadmat

    with warnings.catch_warnings():  # MATLAB's own objects can't be read; the rest of the file can
        warnings.simplefilter("ignore")
        variables = loadmat(path, struct_as_record=False, squeeze_me=True)
    for name, value in variables.items():
        if not name.startswith("__") and name != "None":
            yield from _walk(name, value)


def _walk(name: str, value: object) -> Iterator[Named]:
    fields = getattr(value, "_fieldnames", None)
    if fields is not None:
        for field in fields:
            yield from _walk(f"{name}.{field}", getattr(value, field))
    elif isinstance(value, np.ndarray) and value.dtype == object:
        for index, item in enumerate(value.reshape(-1)):
            yield from _walk(f"{name}[{index}]", item)
    elif isinstance(value, np.ndarray) and value.dtype.names is None:
        yield from spread(name, value)


def _modern(path: Path) -> Iterator[Named]:
    import h5py

    with h5py.File(path, "r") as file:
        for name, item in file.items():
            if not name.startswith("#"):
                yield from _walk_modern(name, item, file)


def _walk_modern(name: str, item: h5py.Group | h5py.Dataset, file: h5py.File) -> Iterator[Named]:
    import h5py

    if isinstance(item, h5py.Group):
        for field, inner in item.items():
            yield from _walk_modern(f"{name}.{field}", inner, file)
    elif item.dtype == h5py.ref_dtype:
        for index, reference in enumerate(item[()].reshape(-1)):
            yield from _walk_modern(f"{name}[{index}]", file[reference], file)
    elif not item.attrs.get("MATLAB_empty", 0) and item.attrs.get("MATLAB_class", b"double") != b"char":
        values = item[()]
        if values.dtype.names == ("real", "imag"):
            values = values["real"] + 1j * values["imag"]
        yield from spread(name, np.asarray(values))
