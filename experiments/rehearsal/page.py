"""The rehearsal as a table in words and as a picture, from its saved summary only."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from jointscope.atomic import write_text


def _share(part: Mapping[str, float]) -> str:
    if not part["cases"]:
        return "no case"
    low, high = 100.0 * part["low"], 100.0 * part["high"]
    return f"{part['hits']:.0f} of {part['cases']:.0f} (95 %: {low:.0f} to {high:.0f} %)"


def rows(summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    """What was concealed, and what was said of it, most frequent first."""
    found = []
    for true, said in summary["confusion"].items():
        told = sorted(said.items(), key=lambda item: (-item[1], item[0]))
        found.append((true, ", ".join(name if count == 1 else f"{name} (x{count})" for name, count in told)))
    return found


def text(summary: Mapping[str, Any]) -> str:
    """The table as plain text."""
    lines = rows(summary)
    width = max([len("concealed"), *(len(true) for true, _ in lines)])
    told = [f"{'concealed':<{width}}  said, on your recordings"]
    told += [f"{true:<{width}}  {said}" for true, said in lines]
    told.append(f"named exactly: {_share(summary['named'])}")
    told.append(f"noticed (named or unknown): {_share(summary['noticed'])}")
    told.append(f"named although nothing was concealed: {_share(summary['false_alarms'])}")
    told += [f"left out: {line}" for line in summary["left_out"]]
    return "\n".join(told) + "\n"


def write_page(summary: Mapping[str, Any], out: Path) -> None:
    """``rehearsal.md`` and ``rehearsal.png`` in ``out``."""
    from jointscope.experiments.prove.pictures import confusion_matrix

    size = summary["asked"]["size"]
    lines = [
        "# Rehearsal: what would be said, on your recordings", "",
        "Your runs, levels, channels and measured noise, simulated in MuJoCo with one effect concealed at a time, at "
        f"{size:g} times the size that should just show, and diagnosed blind.", "",
        "| concealed | said |", "|---|---|",
        *(f"| {true} | {said} |" for true, said in rows(summary)), "",
        f"Named exactly: {_share(summary['named'])}. Noticed (named or unknown): {_share(summary['noticed'])}. "
        f"Named although nothing was concealed: {_share(summary['false_alarms'])}.", "",
        *(f"Left out: {line}." for line in summary["left_out"]), "",
        "![concealed against said](rehearsal.png)", "",
    ]  # fmt: skip
    write_text(out / "rehearsal.md", "\n".join(lines))
    confusion_matrix(summary["confusion"], out / "rehearsal.png")
