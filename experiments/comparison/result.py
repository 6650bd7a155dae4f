"""What every kind of result is made of, seen as figures with intervals and statements in words."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

Goal = Literal["less", "more"]


@dataclass(frozen=True, kw_only=True)
class Figure:
    """One number of a result.

    Attributes:
        name: The same in both results, e.g. ``"stiffness"`` or ``"held-out error, hammer, base"``.
        value: In ``unit``.
        interval: 95 % interval, or ``None`` where the result gives none.
        goal: Which way is better; ``None`` where neither is.
    """

    name: str
    unit: str
    value: float
    interval: tuple[float, float] | None = None
    goal: Goal | None = None


@dataclass(frozen=True, kw_only=True)
class Sample:
    """One number measured again in each run, channel or case, so that two results can be paired.

    Attributes:
        values: By what it was measured on.
        goal: Which way is better.
    """

    name: str
    unit: str
    values: dict[str, float]
    goal: Goal | None = None


@dataclass(frozen=True, kw_only=True)
class Marks:
    """Right or wrong for each case of one sealed draw.

    Attributes:
        draw: What the cases belong to; only marks of the same draw can be paired.
        wrong: The cases that were answered wrongly.
        cases: How many there were.
    """

    name: str
    draw: str
    wrong: frozenset[str]
    cases: int


@dataclass(frozen=True, kw_only=True)
class Statement:
    """A verdict, a status, a setting: something said in words.

    Attributes:
        name: The same in both results.
        said: The words.
    """

    name: str
    said: str


@dataclass(frozen=True, kw_only=True)
class Listing:
    """A set of things said, of which each may come or go: effects, findings, refusals."""

    name: str
    entries: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class Result:
    """One result file.

    Attributes:
        kind: In words: "identification", "diagnosis", ...
        file: Where it was read.
        headline: The first sentence somebody would read of it.
    """

    kind: str
    file: Path
    figures: tuple[Figure, ...] = ()
    samples: tuple[Sample, ...] = ()
    marks: tuple[Marks, ...] = ()
    statements: tuple[Statement, ...] = ()
    listings: tuple[Listing, ...] = ()
