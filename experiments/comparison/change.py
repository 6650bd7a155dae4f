r"""Whether a figure has changed, or only scattered.

Two estimates with intervals (Zou & Donner 2008, "Construction of confidence limits about effect measures", MOVER; for
two shares with Wilson intervals it is Newcombe's method 10):

    d = b - a,   d_low = d - sqrt((b - l_b)^2 + (u_a - a)^2),   d_high = d + sqrt((u_b - b)^2 + (a - l_a)^2)

It takes the two as independent. Results of the same recordings share their noise, so the true interval of their
difference is narrower: what it calls significant then is, what it does not may be. Numbers measured on the same runs
are paired instead (Student's t of the differences), right-or-wrong marks on the same cases by McNemar's exact test.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from jointscope.experiments.comparison.result import Figure, Goal, Marks, Result, Sample

Judgement = Literal["same", "significant", "within its interval", "no interval", "appeared", "gone", "other unit"]
LEAST_PAIRS = 3  # runs in common below which a paired interval says nothing
SAME = 1e-12  # relative


@dataclass(frozen=True, kw_only=True)
class Change:
    """One figure, old and new.

    Attributes:
        difference: new - old [unit]; ``None`` where one is missing.
        interval: 95 % interval of the difference, or ``None`` where there is none.
        basis: What the interval rests on: "intervals", "7 pairs", "McNemar, 40 cases".
        direction: Whether a significant or interval-free change is for the better; ``None`` where neither way is.
    """

    name: str
    unit: str
    old: Figure | None
    new: Figure | None
    difference: float | None
    interval: tuple[float, float] | None
    judgement: Judgement
    basis: str = ""
    direction: Literal["better", "worse"] | None = None

    @property
    def relative(self) -> float | None:
        """Difference over the old value's magnitude [-]."""
        if self.difference is None or self.old is None or self.old.value == 0.0:
            return None
        return self.difference / abs(self.old.value)


@dataclass(frozen=True, kw_only=True)
class Restated:
    """Something said in words, old and new; ``None`` where it was not said."""

    name: str
    old: str | None
    new: str | None


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """Everything that changed between two results of one kind.

    Attributes:
        changes: Every figure, changed or not, in the results' order.
        restated: Statements that differ.
        came, went: (name of the listing, entry).
    """

    kind: str
    old: Result
    new: Result
    changes: tuple[Change, ...]
    restated: tuple[Restated, ...]
    came: tuple[tuple[str, str], ...]
    went: tuple[tuple[str, str], ...]

    @property
    def significant(self) -> tuple[Change, ...]:
        """Changes beyond their 95 % interval."""
        return tuple(change for change in self.changes if change.judgement == "significant")

    @property
    def tested(self) -> int:
        """How many differences had an interval: one in twenty is expected beyond it by chance."""
        return sum(change.interval is not None for change in self.changes)


def difference_interval(
    a: float, interval_a: tuple[float, float], b: float, interval_b: tuple[float, float]
) -> tuple[float, float]:
    """95 % interval of b - a of two independent estimates with 95 % intervals (MOVER), same unit."""
    (low_a, high_a), (low_b, high_b) = interval_a, interval_b
    difference = b - a
    down = math.hypot(max(b - low_b, 0.0), max(high_a - a, 0.0))
    up = math.hypot(max(high_b - b, 0.0), max(a - low_a, 0.0))
    return difference - down, difference + up


def paired_interval(differences: Sequence[float]) -> tuple[float, float]:
    """95 % interval of the mean of paired differences, Student's t, shape (n,), n >= 2."""
    from scipy.stats import t

    d = np.asarray(differences, dtype=np.float64)
    half = float(t.ppf(0.975, d.size - 1)) * float(d.std(ddof=1)) / math.sqrt(d.size)
    return float(d.mean()) - half, float(d.mean()) + half


def mcnemar(newly_right: int, newly_wrong: int) -> float:
    """Two-sided exact probability of so uneven a split of the cases that changed, if neither result is better [-]."""
    from scipy.stats import binomtest

    if newly_right + newly_wrong == 0:
        return 1.0
    return float(binomtest(newly_right, newly_right + newly_wrong, 0.5).pvalue)


def compare(old: Result, new: Result) -> Comparison:
    """What changed from ``old`` to ``new``, results of the same kind."""
    changes = [*_figures(old, new), *_samples(old, new), *_marks(old, new)]
    before, after = ({s.name: s.said for s in result.statements} for result in (old, new))
    names = list(dict.fromkeys([*before, *after]))
    held, holds = (
        {(listing.name, entry) for listing in result.listings for entry in listing.entries}
        for result in (old, new)
    )
    return Comparison(
        kind=new.kind,
        old=old,
        new=new,
        changes=tuple(changes),
        restated=tuple(
            Restated(name=name, old=before.get(name), new=after.get(name))
            for name in names
            if before.get(name) != after.get(name)
        ),
        came=tuple(sorted(holds - held)),
        went=tuple(sorted(held - holds)),
    )


def _figures(old: Result, new: Result) -> list[Change]:
    before: Mapping[str, Figure] = {figure.name: figure for figure in old.figures}
    after = {figure.name: figure for figure in new.figures}
    return [_of_figure(name, before.get(name), after.get(name)) for name in dict.fromkeys([*before, *after])]


def _of_figure(name: str, old: Figure | None, new: Figure | None) -> Change:
    if old is None or new is None:
        here = old or new
        assert here is not None  # the name came from one of the two
        judgement: Judgement = "gone" if new is None else "appeared"
        return Change(
            name=name, unit=here.unit, old=old, new=new, difference=None, interval=None, judgement=judgement
        )
    if old.unit != new.unit:
        unit = f"{old.unit} -> {new.unit}"
        return Change(
            name=name, unit=unit, old=old, new=new, difference=None, interval=None, judgement="other unit"
        )
    interval = None
    if old.interval is not None and new.interval is not None:
        interval = difference_interval(old.value, old.interval, new.value, new.interval)
    return _change(name, old, new, interval, "intervals" if interval else "")


def _samples(old: Result, new: Result) -> list[Change]:
    before = {sample.name: sample for sample in old.samples}
    after = {sample.name: sample for sample in new.samples}
    changes = []
    for name in dict.fromkeys([*before, *after]):
        a, b = before.get(name), after.get(name)
        shared = [key for key in a.values if key in b.values] if a is not None and b is not None else []
        if a is None or b is None or not shared:
            changes.append(_of_figure(name, _mean(a), _mean(b)))
            continue
        one, two = _mean(a, shared), _mean(b, shared)
        assert one is not None and two is not None  # both samples are there
        differences = [b.values[key] - a.values[key] for key in shared]
        enough = len(shared) >= LEAST_PAIRS
        interval = paired_interval(differences) if enough else None
        changes.append(_change(name, one, two, interval, f"{len(shared)} pairs"))
    return changes


def _mean(sample: Sample | None, keys: Sequence[str] | None = None) -> Figure | None:
    if sample is None:
        return None
    values = [sample.values[key] for key in (keys or sample.values)]
    return Figure(name=sample.name, unit=sample.unit, value=float(np.mean(values)), goal=sample.goal)


def _marks(old: Result, new: Result) -> list[Change]:
    changes = []
    after = {marks.name: marks for marks in new.marks}
    for marks in old.marks:
        other = after.get(marks.name)
        if other is None or other.draw != marks.draw or not marks.cases:
            continue
        changes.append(_of_marks(marks, other))
    return changes


def _of_marks(old: Marks, new: Marks) -> Change:
    """The difference of two shares right on the same cases (Wald interval of paired shares), judged by McNemar's test."""
    right, wrong = len(old.wrong - new.wrong), len(new.wrong - old.wrong)
    n = old.cases
    figures = [
        Figure(name=marks.name, unit="1", value=1.0 - len(marks.wrong) / n, goal="more") for marks in (old, new)
    ]
    probability = mcnemar(right, wrong)
    half = 1.96 * math.sqrt(max(right + wrong - (right - wrong) ** 2 / n, 0.0)) / n
    difference = (right - wrong) / n
    basis = f"McNemar p = {probability:.2g}: {right} newly right, {wrong} newly wrong of {n}"
    judgement: Judgement = "significant" if probability < 0.05 else "within its interval"
    if right == wrong == 0:
        judgement = "same"
    return Change(
        name=old.name, unit="1", old=figures[0], new=figures[1], difference=difference,
        interval=(difference - half, difference + half), judgement=judgement, basis=basis,
        direction=_direction(difference, "more") if judgement == "significant" else None,
    )  # fmt: skip


def _change(name: str, old: Figure, new: Figure, interval: tuple[float, float] | None, basis: str) -> Change:
    difference = new.value - old.value
    judgement: Judgement
    if abs(difference) <= SAME * max(abs(old.value), abs(new.value)):
        judgement = "same"
    elif interval is None:
        judgement = "no interval"
    else:
        judgement = "within its interval" if interval[0] <= 0.0 <= interval[1] else "significant"
    told = judgement in ("significant", "no interval")
    return Change(
        name=name, unit=old.unit, old=old, new=new, difference=difference, interval=interval, judgement=judgement,
        basis=basis, direction=_direction(difference, new.goal or old.goal) if told else None,
    )  # fmt: skip


def _direction(difference: float, goal: Goal | None) -> Literal["better", "worse"] | None:
    if goal is None or difference == 0.0:
        return None
    return "better" if (difference < 0.0) == (goal == "less") else "worse"
