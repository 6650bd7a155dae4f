"""A comparison as text, as JSON, and as a page."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from jointscope.experiments.comparison.change import Change, Comparison
from jointscope.experiments.comparison.result import Figure
from jointscope.experiments.page import Section, Table, page

FORMAT = "jointscope-comparison/1"
SHOWN = 40  # rows of figures in the text; the page and the JSON hold all
LISTED = 6  # entries of one listing in the text
_ORDER = {
    "significant": 0, "other unit": 1, "appeared": 2, "gone": 3, "no interval": 4, "within its interval": 5, "same": 6
}  # fmt: skip


def sentence(found: Comparison) -> str:
    """What changed, in a sentence or two."""
    said = [f"{r.name}: {r.old or 'not said'} -> {r.new or 'not said'}" for r in found.restated if _short(r.name)]
    came = [f"+{entry}" for name, entry in found.came if name == "effect"]
    went = [f"-{entry}" for name, entry in found.went if name == "effect"]
    parts = [*said, *(["effects " + " ".join([*came, *went])] if came or went else [])]
    significant = found.significant
    if found.tested:
        parts.append(
            f"{len(significant)} of {found.tested} differences with an interval exceed it "
            f"({0.05 * found.tested:.1f} would by chance)"
        )
    largest = max(significant, key=lambda change: abs(change.relative or 0.0), default=None)
    if largest is not None and largest.relative is not None:
        parts.append(f"the largest is {largest.name}, {100.0 * largest.relative:+.3g} %")
    if not parts:
        parts.append("nothing in words changed, and no figure has an interval to judge it by")
    return f"{found.kind}: " + "; ".join(parts) + "."


def _short(name: str) -> bool:
    return name in ("verdict", "confirmed", "all gates", "why unknown") or name.startswith("gate: ")


def as_text(found: Comparison) -> str:
    """For a terminal."""
    lines = [sentence(found), f"  old {found.old.file}", f"  new {found.new.file}"]
    for restated in found.restated:
        lines.append(f"  {restated.name}: {restated.old or '(not said)'} -> {restated.new or '(not said)'}")
    lines += [*_listed("new", found.came), *_listed("gone", found.went)]
    rows = [_row(change) for change in ordered(found.changes) if change.judgement != "same"]
    if rows:
        lines += ["", *_aligned([COLUMNS, *rows[:SHOWN]])]
    if len(rows) > SHOWN:
        lines.append(f"  ... and {len(rows) - SHOWN} more; --json or --out DIR shows all")
    same = sum(change.judgement == "same" for change in found.changes)
    if same:
        lines.append(f"{same} figures are the same")
    return "\n".join(lines) + "\n"


def _listed(word: str, entries: Sequence[tuple[str, str]]) -> list[str]:
    lines = []
    for name in dict.fromkeys(name for name, _ in entries):
        held = [entry for other, entry in entries if other == name]
        lines += [f"  {word} {name}: {entry}" for entry in held[:LISTED]]
        if len(held) > LISTED:
            lines.append(f"  ... and {len(held) - LISTED} more of {word} {name}")
    return lines


def ordered(changes: Sequence[Change]) -> list[Change]:
    """What counts most first: significant ones, then what came and went, then the rest."""
    return sorted(changes, key=lambda change: _ORDER[change.judgement])


COLUMNS = ("", "old", "new", "difference", "relative", "unit", "")


def _row(change: Change) -> tuple[str, ...]:
    difference = "" if change.difference is None else f"{change.difference:+.4g}"
    if change.interval is not None:
        difference += f" [{change.interval[0]:+.3g}, {change.interval[1]:+.3g}]"
    relative = "" if change.relative is None else f"{100.0 * change.relative:+.3g} %"
    told = change.judgement + (f" ({change.basis})" if change.basis not in ("", "intervals") else "")
    if change.direction is not None:
        told += f", {change.direction}"
    return change.name, _shown(change.old), _shown(change.new), difference, relative, change.unit, told


def _shown(figure: Figure | None) -> str:
    if figure is None:
        return "-"
    if figure.interval is None:
        return f"{figure.value:.6g}"
    low, high = figure.interval
    if not 0.0 < high - low < math.inf:
        return f"{figure.value:.6g} [{low:.6g}, {high:.6g}]"
    places = 1 - math.floor(math.log10(0.5 * (high - low)))  # two digits of the half width
    if not -6 <= places <= 6:
        return f"{figure.value:.6g} [{low:.6g}, {high:.6g}]"
    return "{} [{}, {}]".format(*(f"{round(end, places):.{max(places, 0)}f}" for end in (figure.value, low, high)))


def _aligned(rows: Sequence[tuple[str, ...]]) -> list[str]:
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    return [
        "  " + "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    ]


def as_json(found: Sequence[Comparison]) -> dict[str, Any]:
    """``compare.json``."""
    return {"format": FORMAT, "comparisons": [_comparison_json(one) for one in found]}


def _comparison_json(found: Comparison) -> dict[str, Any]:
    return {
        "kind": found.kind,
        "old": str(found.old.file),
        "new": str(found.new.file),
        "sentence": sentence(found),
        "differences_tested": found.tested,
        "significant": len(found.significant),
        "statements": [{"name": r.name, "old": r.old, "new": r.new} for r in found.restated],
        "came": [{"name": name, "entry": entry} for name, entry in found.came],
        "went": [{"name": name, "entry": entry} for name, entry in found.went],
        "figures": [_change_json(change) for change in found.changes],
    }


def _change_json(change: Change) -> dict[str, Any]:
    def side(figure: Figure | None) -> dict[str, Any] | None:
        if figure is None:
            return None
        return {"value": figure.value, "interval95": None if figure.interval is None else list(figure.interval)}

    return {
        "name": change.name,
        "unit": change.unit,
        "old": side(change.old),
        "new": side(change.new),
        "difference": change.difference,
        "difference_interval95": None if change.interval is None else list(change.interval),
        "relative": change.relative,
        "judgement": change.judgement,
        "basis": change.basis,
        "direction": change.direction,
    }


def as_page(found: Sequence[Comparison]) -> str:
    """``compare.html``: one page that opens offline."""
    sections = []
    for one in found:
        told = [(r.name, r.old or "(not said)", r.new or "(not said)") for r in one.restated]
        told += [(name, "", entry) for name, entry in one.came]
        told += [(name, entry, "") for name, entry in one.went]
        sections.append(
            Section(
                heading=f"{one.kind.capitalize()}: what is said",
                text=(f"Old: {one.old.file}", f"New: {one.new.file}", *([] if told else ["Nothing has changed."])),
                table=Table(columns=("", "old", "new"), rows=tuple(told)) if told else None,
            )
        )
        sections.append(
            Section(
                heading=f"{one.kind.capitalize()}: figures",
                table=Table(columns=COLUMNS, rows=tuple(_row(change) for change in ordered(one.changes))),
                notes=(
                    "Intervals are 95 %. A difference is significant where its own interval leaves out zero. Old and "
                    "new are taken as independent; where both rest on the same recordings that is cautious. Figures "
                    "measured on the same runs are paired.",
                ),
            )
        )
    return page("What changed", " ".join(sentence(one) for one in found), sections)
