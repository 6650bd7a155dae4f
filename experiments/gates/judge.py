"""Measure every claim and judge it; a gate that could not be measured never passes."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

from jointscope.errors import JointscopeError
from jointscope.experiments.gates.claims import PATHS, Gate, GatesFile, made_names

Status = Literal["PASS", "FAIL", "NOT-TESTED"]
Runner = Callable[[Gate], tuple[dict[str, Any], float]]


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """A judged claim.

    Attributes:
        figure: What was measured; ``None`` when nothing was. Of several figures the one nearest to, or furthest
            beyond, its bound.
        margin: Distance to the bound as a share of it, negative when missed; ``None`` where it has no meaning.
        detail: Why, in a line.
        excused: Whether it is NOT-TESTED because an optional gate's material is absent; only that is no failure.
        seconds: What the measurement took [s]; nothing where another gate's is the same.
    """

    gate: Gate
    status: Status
    figure: object = None
    margin: float | None = None
    detail: str = ""
    excused: bool = False
    seconds: float = 0.0

    @property
    def red(self) -> bool:
        """Whether it counts against the whole: failed, or not tested without an excuse."""
        return self.status == "FAIL" or (self.status == "NOT-TESTED" and not self.excused)


def select(document: object, parts: tuple[str, ...]) -> tuple[list[object], bool]:
    """The entries of a JSON document under a path, and whether the path may select several.

    A part is a key, a list position counted from 0, ``*`` for every entry, ``[key=value]`` for every entry that is a
    table with that value, or ``#`` for the number of entries.

    Raises:
        KeyError: The path leads nowhere; the message says where it ends and what is there.
    """
    found, several = [document], False
    for position, part in enumerate(parts):
        where = ".".join(parts[:position]) or "the top"
        if part == "*" or part.startswith("["):
            several = True
            entries = [entry for at in found for entry in _children(at, where, part)]
            found = entries if part == "*" else [entry for entry in entries if _holds(entry, part)]
            if not found:
                raise KeyError(f"{where} holds nothing that {part!r} selects")
        else:
            found = [_child(at, where, part) for at in found]
    return found, several


def _children(at: object, where: str, part: str) -> list[object]:
    if isinstance(at, dict):
        return list(at.values())
    if isinstance(at, list):
        return list(at)
    raise KeyError(f"{where} is a {type(at).__name__}, {part!r} selects from a table or a list")


def _holds(entry: object, part: str) -> bool:
    key, _, wanted = part.strip("[]").partition("=")
    if not isinstance(entry, dict) or key not in entry:
        return False
    value = entry[key]
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        try:
            return math.isclose(float(wanted), value)
        except ValueError:
            return False
    return str(value) == wanted


def _child(at: object, where: str, part: str) -> object:
    if part == "#" and isinstance(at, (dict, list)):
        return len(at)
    if isinstance(at, dict) and part in at:
        return at[part]
    if isinstance(at, list) and part.lstrip("-").isdigit() and -len(at) <= int(part) < len(at):
        return at[int(part)]
    there = ", ".join(map(str, at)) if isinstance(at, dict) else f"a {type(at).__name__}"
    if isinstance(at, list):
        there += f" of {len(at)}"
    raise KeyError(f"{where} holds no {part!r}, only: {there or 'nothing'}")


def judge(gate: Gate, figure: object) -> Outcome:
    """Compare one figure with its bound."""
    if gate.equals is not None:
        passed = figure == gate.equals and isinstance(figure, bool) == isinstance(gate.equals, bool)
        return Outcome(gate=gate, status="PASS" if passed else "FAIL", figure=figure)
    if gate.covers is not None:
        return _covers(gate, gate.covers, figure)
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


def _covers(gate: Gate, target: float, figure: object) -> Outcome:
    ends = figure if isinstance(figure, list) and len(figure) == 2 else ()
    if not ends or not all(type(end) in (int, float) and math.isfinite(end) for end in ends):
        return Outcome(gate=gate, status="FAIL", figure=figure, detail="not an interval [low, high]")
    low, high = ends
    half = 0.5 * (high - low)
    margin = 1.0 - abs(target - 0.5 * (low + high)) / half if half > 0 else None
    return Outcome(gate=gate, status="PASS" if low <= target <= high else "FAIL", figure=figure, margin=margin)


def judge_all(gate: Gate, figures: list[object]) -> Outcome:
    """Every figure must keep the bound; the outcome is that of the worst."""
    outcomes = [judge(gate, figure) for figure in figures]
    worst = min(outcomes, key=lambda o: (o.status == "PASS", math.inf if o.margin is None else o.margin))
    missed = sum(o.status == "FAIL" for o in outcomes)
    said = f"the worst of {len(outcomes)}" + (f", {missed} beyond the bound" if missed else "")
    return replace(worst, detail=f"{worst.detail}; {said}" if worst.detail else said)


def run_gate(
    gate: Gate, file: GatesFile, made: Path, runner: Runner, unmade: Mapping[str, str | None] | None = None
) -> Outcome:
    """Measure one claim through ``runner`` and judge it.

    Args:
        gate: The claim.
        file: Its gates file, which knows the paths' places.
        made: Where the made things are.
        runner: Turns a gate into the JSON document that its measure writes, and the time that took [s].
        unmade: Why something could not be made, by its name; ``None`` where its own needs are absent.
    """
    unmade = unmade or {}
    for name in made_names(gate):
        if unmade.get(name) is not None:
            return Outcome(gate=gate, status="FAIL", detail=f"{name} could not be made: {unmade[name]}")
        if name in unmade:
            return _absent(gate, f"{name} was not made, what it needs is absent")
    for key in PATHS:
        if (text := getattr(gate, key)) is not None and not file.path(text, made).exists():
            return _absent(gate, f"{key} {text} does not exist")
    try:
        document, seconds = runner(gate)
        figures, several = select(document, gate.parts)
    except KeyError as problem:
        return Outcome(gate=gate, status="FAIL", detail=str(problem.args[0]))
    except JointscopeError as problem:
        return Outcome(gate=gate, status="FAIL", detail=str(problem))
    except Exception as problem:  # a measure that crashed is red, and the other claims are still measured
        return Outcome(gate=gate, status="FAIL", detail=f"crashed: {type(problem).__name__}: {problem}")
    if any(figure is None for figure in figures):
        return Outcome(
            gate=gate, status="NOT-TESTED", detail=f"{'.'.join(gate.parts)} is null: it could not be measured"
        )
    return replace(judge_all(gate, figures) if several else judge(gate, figures[0]), seconds=seconds)


def _absent(gate: Gate, why: str) -> Outcome:
    return Outcome(gate=gate, status="NOT-TESTED" if gate.optional else "FAIL", detail=why, excused=gate.optional)


def verdict(outcomes: tuple[Outcome, ...]) -> bool:
    """Whether everything holds: nothing red, and at least one PASS."""
    return not any(o.red for o in outcomes) and any(o.status == "PASS" for o in outcomes)
