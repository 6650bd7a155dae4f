"""The user's simulation on the report: the table of shares first, then the changes; from ``diagnosis.json`` alone."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from jointscope.experiments.page import Section, Table

_ROWS = (
    ("numerics", "its own numerics", "step, integrator and friction solver, its physics and numbers as they are"),
    ("parameters", "its parameter values", "the same laws with the recording's numbers"),
    ("left_out", "physics it leaves out", "the effects that the recording shows"),
    ("contradicted", "physics it holds and the recording contradicts", "taken out of the model"),
)


def simulation_sections(answer: Mapping[str, Any]) -> tuple[Section, ...]:
    """Sections for the head of the report; none where no simulation was given."""
    simulation = answer.get("simulation")
    if not simulation:
        return ()
    found = [_shares(simulation)]
    if simulation["kind"] == "model":
        found.append(_changes(simulation))
    else:
        found.append(_behaviour(simulation))
    return tuple(found)


def _percent(value: float | None) -> str:
    if value is None or not math.isfinite(value):
        return "can't be told"
    return f"{100.0 * value:.2f} %"


def _shares(simulation: Mapping[str, Any]) -> Section:
    total = simulation["error"]
    rows = []
    for key, name, meaning in _ROWS:
        share = simulation["shares"].get(key)
        part = "" if share is None or total <= 0.0 else f"{100.0 * share / total:.0f} %"
        rows.append((name, _percent(share), part, meaning))
    unsplit = simulation.get("unsplit")
    if unsplit is not None:
        part = f"{100.0 * unsplit / total:.0f} %" if total > 0.0 else ""
        rows.append(
            ("not told apart", _percent(unsplit), part, "numerics, or physics that the reduced model lacks")
        )
    rows.append(("what remains", _percent(simulation["remaining"]), f"{100.0 * simulation['remaining'] / total:.0f} %"
                 if total > 0.0 else "", "noise, and what no candidate explains"))  # fmt: skip
    rows.append(("your simulation, unchanged", _percent(total), "100 %", ""))
    which = "held-out" if simulation["held_out"] else "fitted"
    return Section(
        heading="Your simulation",
        text=(_sentence(simulation),),
        table=Table(columns=("part of the error", "error", "of the whole", "what it is"), rows=tuple(rows)),
        notes=(
            f"Error: RMS of recorded minus simulated over the RMS recorded, mean over the output channels of "
            f"{len(simulation['runs'])} {which} runs. Shares: mean over all orders in which the parts can be mended "
            "(Shapley value), so they add up; a negative share means that two mistakes had cancelled.",
            *simulation["notes"],
        ),
    )


def _sentence(simulation: Mapping[str, Any]) -> str:
    shares = {k: v for k, v in simulation["shares"].items() if v is not None}
    gain = simulation["error"] - simulation["remaining"]
    if gain <= max(5e-4, 0.02 * simulation["error"]):
        off = _percent(simulation["error"])
        return f"Nothing to change: your simulation is {off} off, and nothing that was tried lowers that."
    largest = max(shares, key=lambda k: shares[k])
    name = next(n for k, n, _ in _ROWS if k == largest)
    return (
        f"Your simulation is {_percent(simulation['error'])} off; the largest part is {name}. "
        f"With everything below put right {_percent(simulation['remaining'])} remain."
    )


def _changes(simulation: Mapping[str, Any]) -> Section:
    rows = []
    for change in simulation["changes"]:
        low_high = change["interval95"]
        interval = "" if low_high is None else f"{low_high[0]:.4g} to {low_high[1]:.4g}"
        for line in change["lines"]:
            rows.append((line["element"], line["attribute"], line["old"], line["new"], interval,
                         f"{100.0 * change['gain_alone']:.2f} %", f"{line['file']}:{line['line']}"))  # fmt: skip
    if not rows:
        return Section(heading="Changes of your file", notes=("None: the patch is empty.",))
    return Section(
        heading="Changes of your file",
        text=tuple(dict.fromkeys(f"{c['reason'][:1].upper()}{c['reason'][1:]}." for c in simulation["changes"])),
        table=Table(
            columns=(
                "element",
                "attribute",
                "old",
                "new",
                "95 % interval",
                "error taken off by this alone",
                "where",
            ),
            rows=tuple(rows),
        ),
        notes=(
            f"patch/ holds them as a unified diff (patch -p1 beside your model) and as changes.csv. With the patch alone "
            f"the error is {_percent(simulation['patched_error'])}.",
        ),
    )


def _behaviour(simulation: Mapping[str, Any]) -> Section:
    rows = tuple(
        (name.replace("_", " "), _figure(row["simulated"]), _figure(row["recorded"]), row["unit"], row["verdict"])
        for name, row in simulation["behaves_like"].items()
    )
    return Section(
        heading="What your simulation behaves like",
        table=Table(columns=("parameter", "simulated", "recorded", "unit", ""), rows=rows),
        notes=tuple(simulation["not_told"]),
    )


def _figure(value: float | None) -> str:
    return "not determined" if value is None else f"{value:.5g}"
