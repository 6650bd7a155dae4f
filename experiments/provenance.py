"""Where a page's numbers come from: versions, command, seeds, and a hash of every file that was read."""

from __future__ import annotations

import hashlib
import platform
import tomllib
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from jointscope import __version__
from jointscope.experiments.page import Section, Table

_PACKAGES = ("numpy", "scipy", "mujoco")
_MOST = 400  # files listed


def provenance_section(
    source: Path | None, command: str, *, seed: int | None = None, further: tuple[tuple[str, str], ...] = ()
) -> Section:
    """The page's last section.

    Args:
        source: Folder or file that was read; None where everything was simulated.
        command: What was run, folders by name only.
        seed: Of every random draw, where there were any.
        further: Names and hashes of other files that were read.
    """
    rows = [("jointscope", __version__), ("python", platform.python_version())]
    rows += [(name, found) for name in _PACKAGES if (found := _version(name)) is not None]
    rows.append(("command", command))
    if seed is not None:
        rows.append(("seed", str(seed)))
    rows += further
    if source is not None:
        said = _title_and_notes(source)
        rows += said
        files = _files(source)
        rows += [(name, digest) for name, digest in files[:_MOST]]
        if len(files) > _MOST:
            rows.append((f"{len(files) - _MOST} more files", "not listed"))
    return Section(
        heading="Provenance",
        table=Table(columns=("what", "version, or SHA-256 (first 16 digits)"), rows=tuple(rows)),
    )


def digest(path: Path) -> str:
    """``sha256:`` and the first 16 hexadecimal digits of a file's hash."""
    with path.open("rb") as stream:
        return f"sha256:{hashlib.file_digest(stream, 'sha256').hexdigest()[:16]}"


def _files(source: Path) -> list[tuple[str, str]]:
    if source.is_file():
        return [(source.name, digest(source))]
    files = sorted(p for p in source.rglob("*") if p.is_file() and not p.name.startswith("."))
    return [(p.relative_to(source).as_posix(), digest(p)) for p in files[: _MOST + 1]] + [
        (p.name, "") for p in files[_MOST + 1 :]
    ]


def _title_and_notes(source: Path) -> list[tuple[str, str]]:
    """What the campaign says of itself; a simulated one names its seed there."""
    file = source / "campaign.toml" if source.is_dir() else source
    if file.suffix != ".toml" or not file.is_file():
        return []
    content = tomllib.loads(file.read_text(encoding="utf-8"))
    return [(f"campaign's {key}", str(content[key])) for key in ("title", "notes") if content.get(key)]


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None
