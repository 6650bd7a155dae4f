"""First screens of the pages that are no campaign's: reproductions, the concealed proof, sensitivity studies."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from jointscope.experiments.diagnosis_report.drawing import joint_drawing
from jointscope.experiments.page import FirstScreen

_PLACES = {
    "stiffness": "transmission",
    "damping": "transmission",
    "motor_inertia": "motor",
    "reducer_inertia": "motor",
    "motor_damping": "motor",
    "reduction_ratio": "motor",
    "ratio": "motor",
    "efficiency": "motor",
    "load_inertia": "load",
    "load_damping": "load",
}
"""Where on the drawing a parameter sits."""


def _joint(lit: Mapping[str, str] | None = None, values: Mapping[str, str] | None = None) -> str:
    return joint_drawing(
        lit or {}, topology="two-inertia", motion="rotational", spring=True, sure=True, values=values
    )


def single_joint(results: Mapping[str, Any]) -> FirstScreen:
    """Of ``reproduce single-joint``, from its results.json."""
    scored = results["accuracy"]
    missed = [entry["run"] for entry in scored if not entry["holds"]]
    worst = max(entry["median_error"] for entry in scored)
    p = results["parameters"]
    verdict = (
        f"The paper's single joint, identified from simulated hits, predicts {len(scored) - len(missed)} of {len(scored)} "
        f"driven runs within their bounds (largest median error {worst:.3f} dB); the paper's tables follow from its own "
        f"equations within {results['printed_agreement_percent']:.2f} %."
    )
    stiffness, inertia = p["stiffness"], p["inertia"]
    values = {"transmission": f"K {stiffness['value']:.0f} N m/rad", "load": f"J {inertia['value']:.4g} kg m²"}
    facts = tuple((name.replace("_", " "), f"{e['value']:.5g} {e['unit']}") for name, e in p.items())[:4]
    return FirstScreen(
        verdict=verdict,
        facts=facts,
        next_step=f"Look at the runs outside their bounds: {', '.join(missed)}." if missed
        else "Nothing to repair here. To do the same with your bench: jointscope identify, then jointscope predict.",
        markup=(_joint(values=values),),
    )  # fmt: skip


def claims(text: str) -> FirstScreen:
    """Of a reproduction whose Markdown page marks its claims with yes and NO; without any, its opening words."""
    missed, held = len(re.findall(r"\*\*NO\*\*", text)), len(re.findall(r"\| yes \|", text))
    total = held + missed
    opening = next((p for p in re.split(r"\n\s*\n", text) if p.strip() and p[0] not in "#|!-"), "")
    said = f"{held} of {total} claims hold." if total else re.sub(r"\*\*|`|\s+", " ", opening).strip()
    return FirstScreen(
        verdict=said,
        next_step="Look at the claims marked NO." if missed else "Nothing to repair here.",
        markup=(_joint(),),
    )


def proof(summary: Mapping[str, Any]) -> FirstScreen:
    """Of ``prove``, from its summary.json."""
    judged = [row for row in summary["table"] if row["reached"] is not None]
    short = [row["name"] for row in judged if row["reached"] is False]
    openings = summary["openings"]
    times = openings["times"] if isinstance(openings, Mapping) else openings
    said = (
        f"{len(judged) - len(short)} of {len(judged)} measures reach what was asked"
        if judged
        else "No measure has a bound"
    )
    return FirstScreen(
        verdict=f"{summary['cases']} campaigns with concealed effects were diagnosed before the seal was opened: {said}"
        + (f", {len(short)} fall short (listed at the end)." if short else "."),
        facts=(
            *_headlines(summary),
            ("draw", f"{summary['draw']}, {summary['kind']}"),
            ("seed", str(summary["seed"])),
            ("seal", str(summary["seal"])[:16]),
            ("times opened", str(times)),
        ),
        next_step="Read the wrong answers one by one: each names the case, what was true and what was said." if short
        else "Nothing fell short on this draw.",
    )  # fmt: skip


_HEADLINES = (  # measures of the proof that a reader asks for first
    "false alarms on nulls: any physics named", "single, name and location exact: easy",
    "single, name and location exact: medium", "single, name and location exact: hard", "pairs: both named",
)  # fmt: skip


def _headlines(summary: Mapping[str, Any]) -> tuple[tuple[str, str], ...]:
    rows = {row["name"]: row["value"] for row in summary["table"]}
    return tuple(
        (name, f"{rows[name]['hits']} of {rows[name]['cases']}")
        for name in _HEADLINES
        if isinstance(rows.get(name), Mapping) and rows[name]["cases"]
    )


def sensitivity(result: Mapping[str, Any]) -> FirstScreen:
    """Of ``sensitivity``, from its sensitivity.json: the parameter that each output follows most is lit."""
    strongest: dict[str, tuple[str, float]] = {}
    for index in result["indices"]:
        best = strongest.get(index["output"])
        if best is None or abs(index["total"]) > abs(best[1]):
            strongest[index["output"]] = (index["factor"], index["total"])
    moved: dict[str, list[str]] = {}
    for output, (factor, _) in strongest.items():
        moved.setdefault(factor, []).append(output.replace("_", " "))
    lit: dict[str, str] = {}
    for factor, seen in moved.items():
        place = _PLACES.get(factor)
        if place is not None:
            said = f"{factor.replace('_', ' ')}, for {len(seen)} of {len(strongest)} outputs"
            lit[place] = f"{lit[place]}; {said}" if place in lit else said
    study = result["study"]
    factors = study["factors"]
    sentences = list(result["sentences"].values())
    first = next(iter(strongest.values()), ("", 0.0))[0].replace("_", " ")
    return FirstScreen(
        verdict=sentences[0] if sentences else "Nothing was watched.",
        facts=(("method", f"{study['method']}, {study['engine']}"), ("parameters", str(len(factors))),
               ("evaluations", str(result["evaluations"])), ("seed", str(study["seed"]))),
        next_step=f"Measure the {first} best; parameters that explain less than 1 % may stay rough.",
        markup=(_joint(lit),),
    )  # fmt: skip
