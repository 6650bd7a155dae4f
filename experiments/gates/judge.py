"""Measure every claim and judge it; a gate that could not be measured never passes."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from jointscope.errors import JointscopeError
from jointscope.experiments.gates.claims import NEEDS, Gate

Status = Literal["PASS", "FAIL", "NOT-TESTED"]
Runner = Callable[[Gate], dict[str, Any]]


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """A judged claim.

    Attributes:
        figure: What was measured; ``None`` when nothing was.
        margin: Distance to the bound as a share of it, negative when missed; ``None`` where it has no meaning.
        detail: Why, in a line.
    """

    gate: Gate
    status: Status
    figure: object = None
    margin: float | None = None
    detail: str = ""


def pick(document: object, path: str) -> object:
    """The entry of a JSON document under a dotted path; list positions are numbers, counted from 0.

    Raises:
        KeyError: The path leads nowhere; the message says where it ends and what is there.
    """
    at = document
    walked: list[str] = []
    for part in path.split("."):
        if isinstance(at, dict) and part in at:
            at = at[part]
        elif isinstance(at, list) and part.lstrip("-").isdigit() and -len(at) <= int(part) < len(at):
            at = at[int(part)]
        else:
            there = ", ".join(map(str, at)) if isinstance(at, dict) else f"{type(at).__name__}"
            raise KeyError(f"{'.'.join(walked) or 'the top'} holds no {part!r}, only: {there}")
        walked.append(part)
    return at


def judge(gate: Gate, figure: object) -> Outcome:
    """Compare one figure with its bound."""
    if gate.equals is not None:
        passed = figure == gate.equals
        return Outcome(gate=gate, status="PASS" if passed else "FAIL", figure=figure)
    if gate.covers is not None:
        if not (isinstance(figure, list) and len(figure) == 2):
            return Outcome(gate=gate, status="FAIL", figure=figure, detail="not an interval [low, high]")
        low, high = figure
        passed = low <= gate.covers <= high
        half = 0.5 * (high - low)
        margin = 1.0 - abs(gate.covers - 0.5 * (low + high)) / half if half > 0 else None
        return Outcome(gate=gate, status="PASS" if passed else "FAIL", figure=figure, margin=margin)
    if isinstance(figure, bool) or not isinstance(figure, (int, float)) or not math.isfinite(figure):
        return Outcome(gate=gate, status="FAIL", figure=figure, detail="not a finite number")
    if gate.within is not None:
        assert gate.target is not None
        deviation = abs(figure / gate.target - 1.0)
        margin = 1.0 - deviation / gate.within if gate.within > 0 else None
        return Outcome(
            gate=gate,
            status="PASS" if deviation <= gate.within * (1.0 + 1e-12) else "FAIL",
            figure=figure,
            margin=margin,
        )
    bound = gate.below if gate.below is not None else gate.above
    assert bound is not None
    room = bound - figure if gate.below is not None else figure - bound
    margin = room / abs(bound) if bound else None
    return Outcome(gate=gate, status="PASS" if room >= 0 else "FAIL", figure=figure, margin=margin)


def run_gate(gate: Gate, folder: Path, runner: Runner) -> Outcome:
    """Measure one claim through ``runner`` and judge it.

    Args:
        gate: The claim; its paths are relative to ``folder``.
        folder: Where the gates file lies.
        runner: Turns a gate into the JSON document that its measure writes.
    """
    for key in NEEDS[gate.measure]:
        path = folder / getattr(gate, key)
        if not path.exists():
            status: Status = "NOT-TESTED" if gate.optional else "FAIL"
            return Outcome(gate=gate, status=status, detail=f"{key} {path} does not exist")
    try:
        figure = pick(runner(gate), gate.figure)
    except KeyError as problem:
        return Outcome(gate=gate, status="FAIL", detail=str(problem.args[0]))
    except JointscopeError as problem:
        return Outcome(gate=gate, status="FAIL", detail=str(problem))
    if figure is None:
        return Outcome(gate=gate, status="NOT-TESTED", detail=f"{gate.figure} is null: it could not be measured")
    return judge(gate, figure)


def verdict(outcomes: tuple[Outcome, ...]) -> bool:
    """Whether everything holds: no FAIL, no NOT-TESTED but optional ones, and at least one PASS."""
    bad = any(o.status == "FAIL" or (o.status == "NOT-TESTED" and not o.gate.optional) for o in outcomes)
    return not bad and any(o.status == "PASS" for o in outcomes)
