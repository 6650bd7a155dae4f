"""Which results a folder holds."""

from __future__ import annotations

import json
from pathlib import Path

from jointscope.errors import InputError, RefusedError
from jointscope.experiments.comparison.kinds import READERS
from jointscope.experiments.comparison.result import Result

LARGEST = 200_000_000  # bytes: a JSON file beyond this is no result


def read_results(place: Path) -> dict[str, Result]:
    """The results in a folder (or of one file), by kind; other JSON files in it are left alone.

    Raises:
        InputError: No such place, none of the known formats in it, or a file of one that can't be read as such.
    """
    if not place.exists():
        raise InputError(place, None, "no such folder")
    files = sorted(place.glob("*.json")) if place.is_dir() else [place]
    found: dict[str, Result] = {}
    for file in files:
        result = _read(file, named=not place.is_dir())
        if result is not None:
            found.setdefault(result.kind, result)
    if not found:
        known = ", ".join(name.removeprefix("jointscope-").partition("/")[0] for name in READERS)
        raise InputError(place, None, "holds no result that can be compared", fix=f"one of: {known}")
    return found


def read_pair(old: Path, new: Path) -> list[tuple[Result, Result]]:
    """The results of every kind that both places hold.

    Raises:
        RefusedError: They hold different kinds.
        InputError: As for :func:`read_results`.
    """
    before, after = read_results(old), read_results(new)
    shared = [kind for kind in before if kind in after]
    if not shared:
        raise RefusedError(
            f"{old} holds {_list(before)}, {new} holds {_list(after)}: only results of one kind can be compared"
        )
    return [(before[kind], after[kind]) for kind in shared]


def _list(found: dict[str, Result]) -> str:
    kinds = list(found)
    return " and ".join(f"{'an' if kind[0] in 'aeiou' else 'a'} {kind} result" for kind in kinds)


def _read(file: Path, *, named: bool) -> Result | None:
    """``named``: whether the user gave this very file, so that anything wrong with it is an error."""
    if file.stat().st_size > LARGEST:
        return None
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except (json.JSONDecodeError, UnicodeDecodeError, RecursionError) as problem:
        if named:
            raise InputError(file, None, f"not JSON: {problem}") from problem
        return None
    form = content.get("format") if isinstance(content, dict) else None
    reader = READERS.get(form) if isinstance(form, str) else None
    if reader is None:
        return None
    try:
        return reader(content, file)
    except (KeyError, TypeError, AttributeError, ValueError) as problem:
        raise InputError(
            file, "format", f"says {form!r}, but the file isn't built like one: {problem}"
        ) from problem
