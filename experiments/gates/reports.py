"""Gate outcomes as JSON, JUnit XML and Markdown."""

from __future__ import annotations

import json
import math
import re
from dataclasses import asdict
from xml.etree import ElementTree

from jointscope import __version__
from jointscope.experiments.gates.judge import Outcome, verdict

_NOT_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def _shown(figure: object) -> str:
    if isinstance(figure, float):
        return f"{figure:.6g}"
    if isinstance(figure, list):
        return "[" + ", ".join(_shown(entry) for entry in figure) + "]"
    return "" if figure is None else str(figure)


def _finite(figure: object) -> object:
    """``figure`` for strict JSON, which knows no NaN and no infinity."""
    if isinstance(figure, float) and not math.isfinite(figure):
        return str(figure)
    return [_finite(entry) for entry in figure] if isinstance(figure, list) else figure


def as_json(outcomes: tuple[Outcome, ...]) -> str:
    """``gates.json``."""
    rows = [
        {
            "claim": o.gate.claim,
            "status": o.status,
            "figure": _finite(o.figure),
            "bound": o.gate.bound,
            "margin": o.margin,
            "detail": o.detail,
            "excused": o.excused,
            "seconds": round(o.seconds, 3),
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
        allow_nan=False,
        default=str,
    )


def as_junit(outcomes: tuple[Outcome, ...]) -> str:
    """JUnit XML, as CI services read it; a file that tested nothing holds a failure of its own."""
    root = ElementTree.Element("testsuites", name="jointscope gates")
    suite = ElementTree.SubElement(root, "testsuite", name="gates")
    for o in outcomes:
        case = ElementTree.SubElement(
            suite, "testcase",
            classname=_text(".".join(["gates", *([o.gate.group] if o.gate.group else []), o.gate.measure])),
            name=_text(o.gate.claim), time=f"{o.seconds:.3f}",
        )  # fmt: skip
        message = _text(f"{_shown(o.figure) or 'nothing measured'} against {o.gate.bound}. {o.detail}".strip())
        if o.red:
            ElementTree.SubElement(case, "failure", message=message, type=o.status)
        elif o.status != "PASS":
            ElementTree.SubElement(case, "skipped", message=message)
        else:
            ElementTree.SubElement(case, "system-out").text = message
    if not any(o.status == "PASS" for o in outcomes):
        case = ElementTree.SubElement(
            suite, "testcase", classname="gates", name="something was tested", time="0.000"
        )
        ElementTree.SubElement(case, "failure", message="no claim was tested", type="NOT-TESTED")
    counts = {
        "tests": len(suite), "failures": len(suite.findall("testcase/failure")), "errors": 0,
        "skipped": len(suite.findall("testcase/skipped")),
    }  # fmt: skip
    seconds = f"{sum(o.seconds for o in outcomes):.3f}"
    for element in (root, suite):
        for key, count in counts.items():
            element.set(key, str(count))
        element.set("time", seconds)
    root.attrib.pop("skipped")  # of the suites' element no schema has it
    ElementTree.indent(root, " ")
    return ElementTree.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def _text(text: str) -> str:
    """Without the control characters that XML can't hold."""
    return _NOT_XML.sub("?", text)


def as_markdown(outcomes: tuple[Outcome, ...]) -> str:
    """A table for a job summary or a terminal."""
    lines = ["| | claim | measured | bound | margin |", "|---|---|---|---|---|"]
    for o in outcomes:
        margin = "" if o.margin is None else f"{100 * o.margin:+.0f} %"
        said = o.detail if not o.detail.startswith("the worst of") else f"({o.detail})"
        measured = " ".join(part for part in (_shown(o.figure), said) if part)
        status = f"**{o.status}**" if o.red else o.status
        lines.append(
            f"| {status} | {_cell(o.gate.claim)} | {_cell(measured)} | {_cell(o.gate.bound)} | {margin} |"
        )
    counts = {status: sum(o.status == status for o in outcomes) for status in ("PASS", "FAIL", "NOT-TESTED")}
    lines += ["", ", ".join(f"{count} {status}" for status, count in counts.items())]
    if not any(o.status == "PASS" for o in outcomes):
        lines.append("Nothing was tested: that is a failure.")
    return "\n".join(lines) + "\n"


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")
