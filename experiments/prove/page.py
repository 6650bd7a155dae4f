"""The proof as a Markdown page, from its saved summary only."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def percent(share: Mapping[str, Any]) -> str:
    """A share as per cent with its interval and counts."""
    if not share["cases"]:
        return "no case"
    return (
        f"{100 * share['share']:.1f} % [{100 * share['low']:.1f}, {100 * share['high']:.1f}]"
        f" ({share['hits']} of {share['cases']})"
    )


def number(value: float | None, unit: str) -> str:
    """A plain number with its unit."""
    if value is None:
        return "no case"
    if unit == "%":
        return f"{100 * value:.1f} %"
    return f"{value:.3g}" + ("" if unit == "1" else f" {unit}")


def _compared(summary: Mapping[str, Any]) -> list[str]:
    ways = {"diagnose": summary["short"], **{k: v for k, v in summary["baselines"].items() if k != "chance"}}
    lines = ["", "## Beside simpler ways, on the same cases", "", "| measure | " + " | ".join(ways) + " |",
             "|---" * (len(ways) + 1) + "|"]  # fmt: skip
    lines += [
        f"| {name} | " + " | ".join(percent(way[name]) for way in ways.values()) + " |"
        for name in summary["short"]
    ]
    guess = number(summary["baselines"]["chance"]["named"], "%")
    return [*lines, "", f"Guessing among all names and places names {guess} of single effects."]


def page(summary: Mapping[str, Any]) -> str:
    """The whole page."""
    lines = [
        "# Diagnosis on concealed recordings",
        "",
        f"{summary['cases']} cases ({summary['draw']} draw, seed {summary['seed']}, kind {summary['kind']}); the truth"
        f" was sealed with SHA-256 `{summary['seal']}` and opened {summary['openings']} time(s), this one included.",
        f"Version {summary['version']}. Every share has its 95 % Wilson interval. Crashes and time-outs count as wrong.",
        "Bands are of z_d, the distance of the truth from the nearest look-alike in standard deviations, the base and",
        "the look-alike refitted: easy 30-100, medium 10-30, hard 4-10.",
        "",
        "| measure | value | at least | aim | reached |",
        "|---|---|---|---|---|",
    ]
    for row in summary["table"]:
        value = row["value"]
        shown = (
            percent(value) if isinstance(value, dict) else f"{number(value, row['unit'])} ({row['cases']} cases)"
        )
        sign = "" if row["upward"] else "<= "
        least = "-" if row["least"] is None else sign + number(row["least"], row["unit"])
        aim = "-" if row["aim"] is None else sign + number(row["aim"], row["unit"])
        reached = {True: "yes", False: "**no**", None: "-"}[row["reached"]]
        lines.append(f"| {row['name']} | {shown} | {least} | {aim} | {reached} |")
    lines += ["", "## Textbook laws against laws that depart from them", ""]
    lines += [f"- {name}: {percent(share)}" for name, share in summary["law_gap"].items()]
    if summary.get("baselines"):
        lines += _compared(summary)
    leak = summary.get("leak")
    if leak:
        lines += ["", "## Does the paperwork tell?", "",
                  f"A classifier on metadata alone tells cases with an effect from those without at a balanced accuracy of"
                  f" {leak['score']:.2f}; on shuffled labels {leak['chance'][0]:.2f}, 95 % of shuffles below"
                  f" {leak['chance'][1]:.2f} (p = {leak['p_value']:.2f}):"
                  f" {'at chance' if leak['at_chance'] else '**above chance**'}."]  # fmt: skip
    lines += ["", "## Single effects named exactly, by experiments", "", "| experiments | easy | medium | hard |",
              "|---|---|---|---|"]  # fmt: skip
    for name, bands in summary["by_experiments"].items():
        lines.append(
            f"| {name} | " + " | ".join(percent(bands[band]) for band in ("easy", "medium", "hard")) + " |"
        )
    lines += ["", "H hammer, S torque sweep, M speed-controlled motion.", "", "![reliability](reliability.png)",
              "![power](power.png)", "![confusion of families](confusion-family.png)",
              "![confusion of locations](confusion-location.png)", "![confusion of names](confusion-name.png)", "",
              "## Wrong answers", "", "| case | experiments | band | true | said | stated probability |",
              "|---|---|---|---|---|---|"]  # fmt: skip
    for wrong in summary["wrong"]:
        said = ", ".join(wrong["said"]) or wrong["verdict"]
        stated = "-" if wrong["probability"] is None else f"{wrong['probability']:.2f}"
        truth = ", ".join(wrong["truth"]) or "none"
        lines.append(
            f"| {wrong['case']} | {wrong['experiments']} | {wrong['band']} | {truth} | {said} | {stated} |"
        )
    return "\n".join(lines) + "\n"
