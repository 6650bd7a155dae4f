"""NumPy archives: one array per column; a matrix is addressed as ``name[3]``."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from jointscope.recordings.files.columns import DataFile, held, spread


def open_file(path: Path) -> DataFile:
    """Open ``path``; pickled objects are refused."""
    with np.load(path, allow_pickle=False) as archive:
        arrays = [column for name in archive.files for column in spread(name, archive[name])]
    return DataFile(path=path, columns={name: held(name, values) for name, values in arrays})
