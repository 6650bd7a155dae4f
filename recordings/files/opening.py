"""Which reader opens which file."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from jointscope.errors import CampaignError, MissingExtraError
from jointscope.recordings.files.columns import DataFile

_READERS: Final = {
    ".csv": "csv_file", ".txt": "csv_file", ".tsv": "csv_file", ".npz": "npz_file", ".h5": "hdf5_file",
    ".hdf5": "hdf5_file", ".mat": "mat_file", ".uff": "uff_file", ".unv": "uff_file", ".tdms": "tdms_file",
    ".lvm": "lvm_file", ".bag": "ros_file", ".mcap": "ros_file", ".db3": "ros_file", ".mf4": "mdf_file", ".mdf": "mdf_file",
}  # fmt: skip
SUFFIXES: Final = tuple(_READERS)


def open_data_file(path: Path) -> DataFile:
    """Open a data file by its suffix; only that format's library is imported.

    Raises:
        CampaignError: The suffix is unknown, or the file isn't what its suffix says.
        MissingExtraError: The library that reads it is an extra that isn't installed.
    """
    name = _READERS.get(path.suffix.lower())
    if name is None:
        raise CampaignError(
            path, None, f"unknown kind of file {path.suffix!r}", fix=f"one of {', '.join(SUFFIXES)}"
        )
    reader = importlib.import_module(f"jointscope.recordings.files.{name}")
    try:
        opened: DataFile = reader.open_file(path)
        columns = {
            name: replace(column, read=_guarded(path, column.read)) for name, column in opened.columns.items()
        }
    except (CampaignError, MissingExtraError):
        raise
    except Exception as problem:  # libraries raise what they like at a broken file; the user needs its name
        raise _unreadable(path, problem) from problem
    return replace(opened, columns=columns)


def _unreadable(path: Path, problem: Exception) -> CampaignError:
    said = " ".join(str(problem).split()) or type(problem).__name__
    return CampaignError(path, None, f"not readable as {path.suffix}: {said}")


def _guarded(path: Path, read: Callable[[], NDArray[Any]]) -> Callable[[], NDArray[Any]]:
    """``read``, for a file that turns out to be broken only once its samples are asked for."""

    def values() -> NDArray[Any]:
        try:
            with np.errstate(all="ignore"):
                return read()
        except (CampaignError, MissingExtraError):
            raise
        except Exception as problem:
            raise _unreadable(path, problem) from problem

    return values
