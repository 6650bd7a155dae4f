"""NumPy archives: one array per column; a matrix is addressed as ``name[3]``."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from jointscope.recordings.files.columns import DataFile, held, spread


def open_file(path: Path) -> DataFile:
    """Open ``path``; pickled objects are refused."""
    # opened here: np.load leaves a file open that turns out to be half a zip
    with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
        arrays = [column for name in archive.files for column in spread(name, archive[name])]
    return DataFile(path=path, columns={name: held(name, values) for name, values in arrays})
