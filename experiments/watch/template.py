"""Which take a file belongs to: its columns are laid over those of a campaign's runs.

Two devices make two files of a take. They are put together when every stream of the run they resemble has its file;
of several that would fit, those whose names begin alike, then those that came first.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

Table = Mapping[str, Any]


@dataclass(frozen=True, eq=False)
class Kind:
    """A kind of take.

    Attributes:
        run: The newest run of the template that is of this kind; its keys stand for those of a new take.
        columns: Per stream, the columns that its file must have.
        stems: File names (without suffix) of the template's own runs of this kind.
    """

    run: Table
    columns: tuple[frozenset[str], ...]
    stems: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Arrived:
    """A file that no run has yet.

    Attributes:
        columns: Names and aliases that it can be addressed by.
    """

    path: Path
    columns: frozenset[str]


@dataclass(frozen=True, eq=False)
class Assembled:
    """A take: its run table, ready for a campaign, and its files in the order of the streams."""

    kind: Kind
    run: Table
    files: tuple[Arrived, ...]


def kinds_of(document: Table) -> tuple[Kind, ...]:
    """The kinds of take in a campaign's document, in the order of their first runs."""
    found: dict[tuple[object, ...], list[Table]] = {}
    for run in document["run"]:
        columns = tuple(_columns(stream) for stream in run["stream"])
        key = (run["experiment"], run.get("brake", False), run.get("joint"), str(run.get("hold")), columns)
        found.setdefault(key, []).append(run)
    return tuple(
        Kind(
            run=runs[-1],
            columns=tuple(_columns(stream) for stream in runs[-1]["stream"]),
            stems=tuple(Path(stream["file"]).stem for run in runs for stream in run["stream"]),
        )
        for runs in found.values()
    )


def _columns(stream: Table) -> frozenset[str]:
    names = {channel["column"] for channel in stream["channels"]}
    return frozenset(names | ({stream["time"]} if "time" in stream else set()))


def fits(file: Arrived, kinds: Sequence[Kind]) -> list[tuple[Kind, int]]:
    """Streams whose columns the file has, of those with the most columns."""
    found = [
        (kind, index)
        for kind in kinds
        for index, columns in enumerate(kind.columns)
        if columns and columns <= file.columns
    ]
    most = max((len(kind.columns[index]) for kind, index in found), default=0)
    return [(kind, index) for kind, index in found if len(kind.columns[index]) == most]


def lacking(file: Arrived, kinds: Sequence[Kind]) -> frozenset[str]:
    """What the stream that comes nearest has and the file hasn't."""
    streams = [columns for kind in kinds for columns in kind.columns]
    return min((columns - file.columns for columns in streams), key=len, default=frozenset())


def assemble(pool: Sequence[Arrived], kinds: Sequence[Kind]) -> tuple[list[Assembled], list[Arrived]]:
    """Takes whose files are all there, and the files that still wait for another device's."""
    waiting = list(pool)
    takes: list[Assembled] = []
    while True:
        complete = [option for file in waiting for option in _options(file, waiting, kinds)]
        if not complete:
            return takes, waiting
        _, kind, files = max(complete, key=lambda option: option[0])
        takes.append(Assembled(kind, _run(kind, files), files))
        waiting = [file for file in waiting if file not in files]


def _options(
    first: Arrived, pool: Sequence[Arrived], kinds: Sequence[Kind]
) -> Iterator[tuple[tuple[float, ...], Kind, tuple[Arrived, ...]]]:
    """Complete sets in which ``first`` is the first stream's file, with how well they go together."""
    for kind, index in fits(first, kinds):
        if index != 0:
            continue
        files, alike = [first], 0
        for other in range(1, len(kind.columns)):
            free = [f for f in pool if f not in files and any(k is kind and i == other for k, i in fits(f, kinds))]
            if not free:
                break
            partner = max(free, key=lambda file: (_alike(first.path.stem, file.path.stem), -pool.index(file)))
            alike += _alike(first.path.stem, partner.path.stem)
            files.append(partner)
        else:
            like_template = max((_alike(first.path.stem, stem) for stem in kind.stems), default=0)
            # a take with all its devices before one that makes do with a single file; then the names, then the order
            yield (len(files), alike, like_template, -pool.index(first)), kind, tuple(files)


def _alike(one: str, other: str) -> int:
    """Letters that two names begin with in common."""
    pairs = zip(one.lower(), other.lower(), strict=False)
    return next((count for count, (a, b) in enumerate(pairs) if a != b), min(len(one), len(other)))


def _run(kind: Kind, files: Sequence[Arrived]) -> Table:
    streams = []
    for stream, file in zip(kind.run["stream"], files, strict=True):
        own = {key: value for key, value in stream.items() if key != "window"}
        streams.append({**own, "file": file.path.name})
    dropped = ("id", "repeat_of", "role", "stream")
    return {
        "id": files[0].path.stem,
        **{key: value for key, value in kind.run.items() if key not in dropped},
        "stream": streams,
    }
