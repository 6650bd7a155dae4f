"""Write a campaign: one data file per stream and the ``campaign.toml`` that describes them, whole or not at all."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from jointscope.atomic import new_directory
from jointscope.recordings.campaign import Campaign, Run, Stream
from jointscope.recordings.toml_text import campaign_text, coherence_column, frequency_column
from jointscope.recordings.units import si_factor

FileFormat = Literal["csv", "npz", "h5"]
Columns = dict[str, NDArray[Any]]


def write_campaign(campaign: Campaign, directory: Path, *, file_format: FileFormat = "csv") -> Path:
    """Write ``campaign`` into a new ``directory``.

    Samples are written in each channel's own unit, with all their digits, as they stand: cut to their windows and on
    their uniform grids, so the written campaign has neither ``window`` nor ``time``.

    Returns:
        ``directory``.

    Raises:
        FileExistsError: ``directory`` exists already and is not empty.
    """
    names = _file_names(campaign, file_format)
    with new_directory(Path(directory)) as folder:
        for run in campaign.runs:
            for index, stream in enumerate(run.streams):
                target = folder / names[run.id, index]
                target.parent.mkdir(parents=True, exist_ok=True)
                _WRITERS[file_format](target, stream_columns(stream))
        for model in (campaign.mjcf, campaign.urdf):
            if model is not None and (campaign.path / model).is_file():
                (folder / model).parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(campaign.path / model, folder / model)
        (folder / "campaign.toml").write_text(campaign_text(campaign, names), encoding="utf-8")
    return Path(directory)


def _file_names(campaign: Campaign, file_format: FileFormat) -> dict[tuple[str, int], str]:
    """One file per stream, after the stream's own file where no other stream has that name."""
    names: dict[tuple[str, int], str] = {}
    taken: set[str] = set()
    for run in campaign.runs:
        for index, stream in enumerate(run.streams):
            stem = Path(stream.file).with_suffix("").as_posix() or "recording"
            name, count = f"{stem}.{file_format}", 1
            while name.lower() in taken:
                count += 1
                name = f"{stem}-{count}.{file_format}"
            taken.add(name.lower())
            names[run.id, index] = name
    return names


def stream_columns(stream: Stream) -> Columns:
    """What a stream's file holds: per recorded channel its values in the file's unit, shape (n,).

    An FRF's ``frequency`` axis and coherences are columns too; where nothing was recorded a ``time`` column says
    how long the stream is.
    """
    columns: Columns = {}
    if stream.frequency is not None:
        columns[frequency_column(stream)] = stream.frequency
    for channel in stream.channels:
        if channel.samples is not None:
            columns[channel.column] = np.asarray(channel.samples) / si_factor(channel)
        if channel.coherence is not None:
            columns[coherence_column(channel)] = channel.coherence
    if not columns and stream.length:
        columns["time"] = stream.times
    return columns


def _write_csv(path: Path, columns: Columns) -> None:
    missing = "" if len(columns) > 1 else "nan"  # a line without any sign would be no line
    cells = [_cells(values, missing) for values in columns.values()]
    with path.open("w", encoding="utf-8", newline="\n") as file:
        file.write(",".join(_header(name) for name in columns) + "\n")
        file.writelines(",".join(row) + "\n" for row in zip(*cells, strict=True))


def _header(name: str) -> str:
    quoted = any(sign in name for sign in ',"\n;\t')
    return '"' + name.replace('"', '""') + '"' if quoted else name


def _cells(values: NDArray[Any], missing: str) -> list[str]:
    """Shortest digits that read back to the same number; ``missing`` for a missing sample."""
    texts = [repr(value) for value in values.tolist()]
    if np.isrealobj(values) and np.isnan(values).any():
        texts = [missing if text == "nan" else text for text in texts]
    return texts


def _write_npz(path: Path, columns: Columns) -> None:
    np.savez_compressed(path, **columns)  # type: ignore[arg-type]


def _write_h5(path: Path, columns: Columns) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        for name, values in columns.items():
            file.create_dataset(name, data=values)


_WRITERS = {"csv": _write_csv, "npz": _write_npz, "h5": _write_h5}


def only_inputs(campaign: Campaign) -> Campaign:
    """The campaign with every output channel declared but not recorded, as it is given for prediction."""

    def bare(stream: Stream) -> Stream:
        return replace(
            stream,
            channels=tuple(c if c.role == "input" else replace(c, samples=None) for c in stream.channels),
        )

    def blind(run: Run) -> Run:
        return replace(run, streams=tuple(bare(stream) for stream in run.streams))

    return replace(campaign, runs=tuple(blind(run) for run in campaign.runs))
