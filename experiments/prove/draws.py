"""Draws that were published, one after the other, and their newest ones counted together.

A draw of four dozen cases holds fifteen nulls: one of them named is 6.7 %, none says less than 20 %. What is gated is therefore
counted over the newest draws, each diagnosed blind by the version of its own day.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

from jointscope.atomic import write_text
from jointscope.experiments.prove.measures import wilson

FILE: Final = "draws.json"
FORMAT: Final = "jointscope-proof-draws/1"
NEWEST: Final = 4  # draws that are counted together


def counts(summary: Mapping[str, Any]) -> dict[str, Any]:
    """Seed, commit, and hits and cases of every share in the table of one draw's summary."""
    shares = {row["name"]: row["value"] for row in summary["table"] if isinstance(row["value"], dict)}
    kept = {
        name: {"hits": value["hits"], "cases": value["cases"]}
        for name, value in shares.items()
        if value.get("cases")
    }
    about = {key: summary[key] for key in ("seed", "commit", "cases", "openings")}
    return {**about, "counts": kept}


def together(draws: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """The newest draws' hits and cases added up, with 95 % Wilson intervals."""
    newest = sorted(draws, key=lambda draw: int(draw["seed"]))[-NEWEST:]
    names = dict.fromkeys(name for draw in newest for name in draw["counts"])
    table = []
    for name in names:
        own = [draw["counts"][name] for draw in newest if name in draw["counts"]]
        share = wilson(sum(c["hits"] for c in own), sum(c["cases"] for c in own))
        table.append({"name": name, "value": asdict(share)})
    return {
        "seeds": [draw["seed"] for draw in newest],
        "cases": sum(draw["cases"] for draw in newest),
        "table": table,
    }


def record(summary: Mapping[str, Any], folder: Path) -> None:
    """Add a mixed test draw of the first engine to ``folder``/draws.json; one published anew takes its own place."""
    if (summary["draw"], summary["kind"], summary["engine"]) != ("test", "mixed", "mujoco"):
        return
    file = folder / FILE
    known = json.loads(file.read_text(encoding="utf-8"))["draws"] if file.is_file() else []
    draws = [*(draw for draw in known if draw["seed"] != summary["seed"]), counts(summary)]
    draws.sort(key=lambda draw: int(draw["seed"]))
    whole = {"format": FORMAT, "draws": draws, "newest": together(draws)}
    write_text(file, json.dumps(whole, indent=1, sort_keys=True) + "\n")
