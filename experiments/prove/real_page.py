"""The page and the picture of the real recordings, from their saved summary only."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

FIGURES = {
    "inverse_error": "force error along the recorded motion",
    "wind_up_error": "wind-up error",
    "error": "error of the prediction from inputs alone",
}


def _number(x: float | None, digits: int = 4) -> str:
    return "-" if x is None or not math.isfinite(x) else f"{x:.{digits}g}"


def _with_unit(entry: Mapping[str, Any]) -> str:
    low, high = entry["interval95"]
    return f"{_number(entry['value'])} {entry['unit']} ({_number(low)} to {_number(high)})"


def page(summary: Mapping[str, Any]) -> str:
    """``real.md``."""
    lines = [
        "# Real recordings",
        "",
        "Every set is imported by `jointscope import` and diagnosed by `jointscope diagnose` like any campaign; the",
        "diagnosis has no branch that knows a set. Errors are relative, on takes that were kept back from the fit.",
        "",
        "| set | base handed over | verdict | effects | held-out figure, base | with the answer | asked and met |",
        "|---|---|---|---|---|---|---|",
    ]
    lines += [_line(row) for row in summary["sets"]]
    lines += ["", "![held-out figures](real.png)"]
    for row in summary["sets"]:
        if row["status"] == "answered":
            lines += ["", f"## {row['set']}", "", *_details(row)]
    return "\n".join(lines) + "\n"


def _line(row: Mapping[str, Any]) -> str:
    if row["status"] != "answered":
        return f"| {row['set']} | {row['base']} | {row['status']} | | | | |"
    said = ", ".join(f"{e['effect']}@{e['location']}" for e in row["effects"]) or "-"
    met = sum(check["met"] for check in row["checks"])
    shown = row["figure"]
    return (
        f"| {row['set']} | {row['base']} | {row['verdict']} ({row['probability']:.2f}) | {said} | "
        f"{_number(shown['base'])} | {_number(shown['answer'])} | {met} of {len(row['checks'])} |"
    )


def _details(row: Mapping[str, Any]) -> list[str]:
    lines = [f"Figure: {FIGURES[row['figure']['what']]}. Location: {row['where'] or '-'}.", ""]
    for effect in row["effects"]:
        parameters = ", ".join(f"{name} {_with_unit(entry)}" for name, entry in effect["parameters"].items())
        lines.append(f"- {effect['effect']} at {effect['location']} ({effect['probability']:.2f}): {parameters}")
    lines += [f"- {name}: {_with_unit(entry)}" for name, entry in row["parameters"].items()]
    lines += [f"- found on the way: {finding}" for finding in row["findings"]]
    for channel, error in (row["position_error"] or {}).items():
        factor, unit = (1e3, "mm") if error["unit"] == "m" else (1.0, error["unit"])
        lines.append(
            f"- {channel} predicted from inputs alone, RMS error: {_number(factor * error['base'])} {unit} with the "
            f"base, {_number(factor * error['augmented'])} {unit} with the answer"
        )
    if row["published"]:
        lines += ["", "| figure | published | here | source |", "|---|---|---|---|"]
        lines += [
            f"| {p['what']} | {_number(p['published'], 6)} | {_number(p['here'], 6)} | {p['source']} |"
            for p in row["published"]
        ]
    lines += ["", "| asked | found | met |", "|---|---|---|"]
    lines += [f"| {c['asked']} | {c['found']} | {'yes' if c['met'] else '**no**'} |" for c in row["checks"]]
    lines += [
        "",
        "| copy | verdict | effects | main parameter, copy over original | same |",
        "|---|---|---|---|---|",
    ]
    lines += [_copy_line(copy["copy"], copy, copy["same"], _number(copy["ratio"])) for copy in row["copies"]]
    control = row["control"]
    if control is None:
        lines += ["", "No control: the answer names no friction that could be taken off the logged force."]
    else:
        lines.append(_copy_line("friction taken out (must be none)", control, control["none"], "-"))
    return lines


def _copy_line(name: str, copy: Mapping[str, Any], good: bool, ratio: str) -> str:
    said = ", ".join(copy.get("effects", [])) or "-"
    return f"| {name} | {copy.get('verdict', copy['status'])} | {said} | {ratio} | {'yes' if good else '**no**'} |"


def picture(summary: Mapping[str, Any], path: Path) -> None:
    """Held-out figure with the base and with the answer, of every set, its copies and its control."""
    from matplotlib.figure import Figure

    rows = [row for row in summary["sets"] if row["status"] == "answered"]
    drawing = Figure(figsize=(6.4, 1.2 + 2.3 * max(len(rows), 1)), layout="constrained")
    panels = drawing.subplots(max(len(rows), 1), 1, squeeze=False)[:, 0]
    for axes, row in zip(panels, rows, strict=False):
        labels, before, after = _bars(row)
        at = range(len(labels))
        axes.bar([x - 0.2 for x in at], before, width=0.38, color="0.65", label="base")
        axes.bar([x + 0.2 for x in at], after, width=0.38, color="C0", label="with the answer")
        published = [p["published"] for p in row["published"] if "error" in p["what"]]
        for height in published:
            axes.axhline(height, color="C3", linewidth=1.0, linestyle="--", label="published")
        axes.set_xticks(list(at), labels, fontsize=8)
        axes.set_title(f"{row['set']}: {FIGURES[row['figure']['what']]}", fontsize=9)
        axes.set_ylabel("relative error [-]", fontsize=8)
        axes.legend(fontsize=7)
    if not rows:
        panels[0].set_axis_off()
        panels[0].text(0.5, 0.5, "no recordings were there", ha="center")
    drawing.savefig(path, dpi=130)


def _bars(row: Mapping[str, Any]) -> tuple[list[str], list[float], list[float]]:
    entries: list[tuple[str, Mapping[str, Any]]] = [("as recorded", row["figure"])]
    entries += [(copy["copy"], copy["figure"]) for copy in row["copies"] if "figure" in copy]
    if row["control"] is not None and "figure" in row["control"]:
        entries.append(("friction out", row["control"]["figure"]))
    return [name for name, _ in entries], _finite(entries, "base"), _finite(entries, "answer")


def _finite(entries: Sequence[tuple[str, Mapping[str, Any]]], key: str) -> list[float]:
    values = [entry[key] for _, entry in entries]
    return [0.0 if v is None or not math.isfinite(v) else v for v in values]
