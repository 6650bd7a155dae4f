"""``DIR/patch/``: a unified diff for each of the user's files, and ``changes.csv``."""

from __future__ import annotations

import csv
import difflib
import io
from pathlib import Path

from jointscope.atomic import write_text
from jointscope.experiments.own_model.study import OwnModelStudy

COLUMNS = (
    "element", "attribute", "old", "new", "interval95_low", "interval95_high", "held_out_gain_of_this_line_alone",
    "share", "change", "file", "line", "reason",
)  # fmt: skip


def unified_diff(study: OwnModelStudy) -> str:
    """What ``patch -p1`` takes in the directory that holds the model (and all files it includes); empty for no change."""
    pieces: list[str] = []
    for number, (before, after) in enumerate(zip(study.sources.texts, study.texts, strict=True)):
        name = study.sources.relative(number)
        pieces += difflib.unified_diff(
            _lines(before.decode("utf-8")), _lines(after.decode("utf-8")), f"a/{name}", f"b/{name}", lineterm="\n"
        )
    return "".join(line if line.endswith("\n") else line + "\n\\ No newline at end of file\n" for line in pieces)


def _lines(text: str) -> list[str]:
    """Lines with their own ends; a bare carriage return ends none, as for patch."""
    found = text.split("\n")
    return [line + "\n" for line in found[:-1]] + ([found[-1]] if found[-1] else [])


def changes_csv(study: OwnModelStudy) -> str:
    """One row per attribute; the gain of a change of several lines is that of them together."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(COLUMNS)
    for kept in study.kept:
        change = kept.change
        low, high = ("", "") if change.interval is None else (f"{v:.6g}" for v in change.interval)
        for row in kept.lines:
            writer.writerow((row.element, row.attribute, row.old, row.new, low, high, f"{kept.gain_alone:.6g}",
                             change.share, change.key, row.file, row.line, change.reason))  # fmt: skip
    return out.getvalue()


def write_patch(study: OwnModelStudy, directory: Path) -> Path:
    """Write ``changes.csv`` and one diff per run into ``directory``/patch; an empty diff says that nothing must change.

    Returns:
        The folder.
    """
    folder = directory / "patch"
    write_text(folder / f"{study.model.stem}.patch", unified_diff(study))
    write_text(folder / "changes.csv", changes_csv(study))
    return folder
