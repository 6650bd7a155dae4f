"""Which files of a folder have arrived: those whose size and date have stopped changing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from jointscope.recordings.files import SUFFIXES

_UNFINISHED: Final = (".part", ".tmp", ".crdownload", ".swp", "~")


@dataclass(frozen=True)
class Stamp:
    """A file as last seen.

    Attributes:
        size: [bytes].
        modified: [ns].
        since: When it was first seen like this [s, any steady clock].
    """

    size: int
    modified: int
    since: float

    def same(self, other: Stamp | None) -> bool:
        """Whether nothing was written in between."""
        return other is not None and (self.size, self.modified) == (other.size, other.modified)


def look(folder: Path, before: Mapping[Path, Stamp], now: float) -> dict[Path, Stamp]:
    """Every data file in ``folder`` and its ``campaign.toml``; a file that changed since ``before`` starts anew."""
    seen: dict[Path, Stamp] = {}
    for path in sorted(folder.iterdir()):
        if not _wanted(path):
            continue
        try:
            status = path.stat()
        except OSError:  # gone again, as temporary files are
            continue
        stamp = Stamp(status.st_size, status.st_mtime_ns, now)
        known = before.get(path)
        seen[path] = known if known is not None and stamp.same(known) else stamp
    return seen


def settled(seen: Mapping[Path, Stamp], now: float, quiet: float) -> list[Path]:
    """Files that have not changed for ``quiet`` [s] and hold something, the oldest first."""
    done = [path for path, stamp in seen.items() if stamp.size > 0 and now - stamp.since >= quiet]
    return sorted(done, key=lambda path: (seen[path].modified, path.name))


def _wanted(path: Path) -> bool:
    name = path.name
    if name.startswith(".") or name.lower().endswith(_UNFINISHED):
        return False
    return name == "campaign.toml" or path.suffix.lower() in SUFFIXES
