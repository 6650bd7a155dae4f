"""Gate outcomes as JSON, JUnit XML and Markdown."""

from __future__ import annotations

import json
from dataclasses import asdict
from xml.etree import ElementTree

from jointscope import __version__
from jointscope.experiments.gates.judge import Outcome, verdict


def _shown(figure: object) -> str:
    if isinstance(figure, float):
        return f"{figure:.6g}"
    if isinstance(figure, list):
        return "[" + ", ".join(_shown(entry) for entry in figure) + "]"
    return "" if figure is None else str(figure)


def as_json(outcomes: tuple[Outcome, ...]) -> str:
    """``gates.json``."""
    rows = [
        {
            "claim": o.gate.claim,
            "status": o.status,
            "figure": o.figure,
            "bound": o.gate.bound,
            "margin": o.margin,
            "detail": o.detail,
            "gate": {key: value for key, value in asdict(o.gate).items() if value is not None},
        }
        for o in outcomes
    ]
    return json.dumps(
        {
            "format": "jointscope-gates-result/1",
            "version": __version__,
            "passed": verdict(outcomes),
            "gates": rows,
        },
        indent=1,
    )


def as_junit(outcomes: tuple[Outcome, ...]) -> str:
    """JUnit XML, as CI services read it."""
    failed = sum(o.status == "FAIL" or (o.status == "NOT-TESTED" and not o.gate.optional) for o in outcomes)
    skipped = sum(o.status == "NOT-TESTED" and o.gate.optional for o in outcomes)
    suite = ElementTree.Element(
        "testsuite", name="jointscope gates", tests=str(len(outcomes)), failures=str(failed), skipped=str(skipped)
    )
    for o in outcomes:
        case = ElementTree.SubElement(suite, "testcase", classname=f"gates.{o.gate.measure}", name=o.gate.claim)
        message = f"{_shown(o.figure)} against {o.gate.bound}. {o.detail}".strip()
        if o.status == "NOT-TESTED" and o.gate.optional:
            ElementTree.SubElement(case, "skipped", message=message)
        elif o.status != "PASS":
            ElementTree.SubElement(case, "failure", message=message)
    return ElementTree.tostring(suite, encoding="unicode", xml_declaration=True) + "\n"


def as_markdown(outcomes: tuple[Outcome, ...]) -> str:
    """A table for a job summary or a terminal."""
    lines = ["| | claim | measured | bound | margin |", "|---|---|---|---|---|"]
    for o in outcomes:
        margin = "" if o.margin is None else f"{100 * o.margin:+.0f} %"
        lines.append(
            f"| {o.status} | {o.gate.claim} | {_shown(o.figure) or o.detail} | {o.gate.bound} | {margin} |"
        )
    counts = {status: sum(o.status == status for o in outcomes) for status in ("PASS", "FAIL", "NOT-TESTED")}
    lines += ["", ", ".join(f"{count} {status}" for status, count in counts.items())]
    if not any(o.status == "PASS" for o in outcomes):
        lines.append("Nothing was tested: that is a failure.")
    return "\n".join(lines) + "\n"
