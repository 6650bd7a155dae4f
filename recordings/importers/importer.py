"""What an importer is, and how one is run: the set's own files go into the campaign unchanged, described by its TOML."""

from __future__ import annotations

import importlib
import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from jointscope.atomic import new_directory
from jointscope.errors import InputError
from jointscope.recordings.reader import read_campaign


@dataclass(frozen=True, kw_only=True)
class Importer:
    """A public data set.

    Attributes:
        summary: One line on the rig and the recordings.
        source: Where the files are to be had, and their licence.
        files: Names of the files the campaign is made of.
        campaign: The text of ``campaign.toml`` for one of ``axes`` (or for axis 0, where the set has none), given the
            folder that holds the files.
        axes: Robot axes that can be imported, each as its own campaign; empty for a single axis.
    """

    summary: str
    source: str
    files: tuple[str, ...]
    campaign: Callable[[Path, int], str]
    axes: tuple[int, ...] = ()


_MODULES: Final = {
    "emps": "emps",
    "hammer-lvm": "hammer_lvm",
    "kr300-weigand2021": "kr300_weigand2021",
    "motor-bench-flexcoupling": "motor_bench_flexcoupling",
}
IMPORTERS: Final = tuple(_MODULES)


def importer(name: str) -> Importer:
    """The importer called ``name``.

    Raises:
        InputError: There is none.
    """
    if name not in _MODULES:
        raise InputError(name, None, "no such data set", fix=f"one of {', '.join(IMPORTERS)}")
    found: Importer = importlib.import_module(f"jointscope.recordings.importers.{_MODULES[name]}").IMPORTER
    return found


def import_data_set(name: str, files: Sequence[Path], out: Path, *, axis: int | None = None) -> Path:
    """Make a campaign of a public data set.

    Args:
        name: One of ``IMPORTERS``.
        files: The set's files, or folders that hold them.
        out: The campaign's directory, new or empty.
        axis: Robot axis, for sets that have several; the first where silent.

    Returns:
        ``out``.

    Raises:
        InputError: A file of the set is missing, or there is no such axis.
        FileExistsError: ``out`` is there already.
    """
    chosen = importer(name)
    if axis is not None and axis not in chosen.axes:
        known = ", ".join(map(str, chosen.axes)) or "none; leave --axis out"
        raise InputError(name, "axis", "no such axis", value=axis, fix=f"it has {known}")
    number = axis if axis is not None else (chosen.axes or (0,))[0]
    with new_directory(out) as folder:
        for wanted, source in _located(name, chosen.files, files).items():
            shutil.copyfile(source, folder / wanted)
        (folder / "campaign.toml").write_text(chosen.campaign(folder, number), encoding="utf-8")
        read_campaign(folder)
    return out


def _located(name: str, wanted: tuple[str, ...], given: Sequence[Path]) -> dict[str, Path]:
    held = {path.name.lower(): path for item in given for path in (item.iterdir() if item.is_dir() else [item])}
    missing = [file for file in wanted if file.lower() not in held]
    if missing:
        raise InputError(
            missing[0], None, f"not among the files given for {name}", fix=f"it needs {', '.join(wanted)}"
        )
    paths = {file: held[file.lower()] for file in wanted}
    for path in paths.values():
        if not path.is_file():
            raise InputError(path, None, "no such file")
    return paths
