"""The table of the proof: every measure with what is asked and aimed at, over all bands, each with its interval."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from jointscope.experiments.prove.judging import Judged, family
from jointscope.experiments.prove.measures import (
    GRADED,
    Share,
    calibration_by_chance,
    calibration_error,
    nulls,
    share_of,
    singles,
    stated_by,
)

SEEN: Final = ("trivial", "easy", "medium")  # medium and up


@dataclass(frozen=True)
class Measure:
    """One line of the table.

    Attributes:
        value: A share, or a plain number (NaN without cases).
        least: What must be reached, in the measure's direction; ``None`` where nothing is asked.
        upward: Whether larger is better.
        interval: 95 % bootstrap interval of a plain number; a share has its own.
    """

    name: str
    value: Share | float
    unit: str
    cases: int
    least: float | None
    aim: float | None
    upward: bool
    interval: tuple[float, float] | None = None

    @property
    def number(self) -> float:
        """The value without its interval."""
        return self.value.share if isinstance(self.value, Share) else self.value

    @property
    def reached(self) -> bool | None:
        """Whether the point value reaches ``least``; ``None`` without cases or without a limit."""
        if self.least is None or self.cases == 0 or math.isnan(self.number):
            return None
        return self.number >= self.least if self.upward else self.number <= self.least


def table(judged: Sequence[Judged], *, seed: int = 0, draws: int = 400) -> list[Measure]:
    """The measures of the diagnosis, in the order of their table; bootstrap over ``draws`` draws of the cases."""
    rows = rows_of(judged)
    rng = np.random.default_rng(seed)
    drawn: dict[str, list[float]] = {}
    for _ in range(draws if judged else 0):
        sample = [judged[i] for i in rng.integers(0, len(judged), len(judged))]
        for row in _numbers(sample):
            drawn.setdefault(row.name, []).append(row.number)
    out = []
    for row in rows:
        values = np.array([v for v in drawn.get(row.name, ()) if not math.isnan(v)])
        if values.size and not isinstance(row.value, Share):
            low, high = np.quantile(values, [0.025, 0.975])
            row = replace(row, interval=(float(low), float(high)))
        out.append(row)
    return out


def rows_of(judged: Sequence[Judged]) -> list[Measure]:
    """The same without the bootstrap."""
    return [*_nulls(judged), *_named(judged), *_left_open(judged), *_numbers(judged), *_failures(judged)]


def _least(name: str, value: Share, least: float | None = None, aim: float | None = None) -> Measure:
    return Measure(name, value, "%", value.cases, least, aim, upward=True)


def _most(name: str, value: Share, most: float | None = None, aim: float | None = None) -> Measure:
    return Measure(name, value, "%", value.cases, most, aim, upward=False)


def _nulls(judged: Sequence[Judged]) -> list[Measure]:
    none = nulls(judged)
    hard = [j for j in none if j.hard]
    return [
        _most("false alarms on nulls: any physics named", share_of(none, lambda j: bool(j.said)), 0.03, 0.01),
        _most("false alarms on the hard nulls (rough values far off, coloured noise, scatter, outliers)",
              share_of(hard, lambda j: bool(j.said))),
        _most("nulls not answered none (unknown, crash or time-out included)",
              share_of(none, lambda j: j.verdict != "none")),
        _least("hard nulls answered none that say the parameters were off",
               share_of([j for j in hard if j.verdict == "none"], lambda j: j.shifted)),
    ]  # fmt: skip


def _named(judged: Sequence[Judged]) -> list[Measure]:
    rows = []
    limits = (("exact", (0.85, 0.70, 0.40), (0.95, 0.85, 0.60)), ("place", (0.93, 0.85, 0.65), (0.98, 0.93, 0.80)))
    for what, least, aim in limits:
        for band, a, b in zip(GRADED, least, aim, strict=True):
            cases = singles(judged, band)
            if what == "exact":
                found = share_of(cases, lambda j: j.exact)
                rows.append(_least(f"single, name and location exact: {band}", found, a, b))
            else:
                rows.append(_least(f"location right: {band}", share_of(cases, lambda j: bool(j.location)), a, b))
    trivial = singles(judged, "trivial")
    rows += [
        _least("single, name and location exact: trivial (z_d > 100)", share_of(trivial, lambda j: j.exact)),
        _least("location right: trivial (z_d > 100)", share_of(trivial, lambda j: bool(j.location))),
    ]
    for band in GRADED:
        cases = singles(judged, band)
        rows.append(_least(f"family right: {band}", share_of(cases, _family_right)))
        rows.append(_least(f"seen at all (effects or unknown): {band}",
                           share_of(cases, lambda j: j.verdict in ("effects", "unknown"))))  # fmt: skip
    pairs = [j for j in judged if j.kind == "pair" and j.band != "below"]
    return [
        *rows,
        _least("pairs: both named", share_of(pairs, lambda j: j.exact), 0.45, 0.60),
        _least("pairs: at least one named and none wrong", share_of(pairs, lambda j: j.any_named), 0.80, 0.90),
    ]


def _left_open(judged: Sequence[Judged]) -> list[Measure]:
    outside = [j for j in judged if j.kind == "unlisted" and j.band in SEEN]
    return [
        _least("unlisted answered unknown (medium and up)", share_of(outside, lambda j: j.verdict == "unknown"), 0.70, 0.85),
        _most("listed wrongly unknown (medium and up)",
              share_of(singles(judged, *SEEN), lambda j: j.verdict == "unknown"), 0.15, 0.10),
        _least("can't be told (z_d < 4): set, unknown or right, or none where z < 4",
               share_of(singles(judged, "below"), lambda j: j.exact)),
    ]  # fmt: skip


def _numbers(judged: Sequence[Judged]) -> list[Measure]:
    """The rows that are no shares; the bootstrap draws them again."""
    stated = stated_by(judged)
    probability = np.array([j.probability for j in stated])
    right = np.array([j.exact for j in stated], dtype=bool)
    gains = _known([j.gain for j in judged])
    fitted = _known([j.gain_fitted for j in judged])
    errors = _known([j.error for j in singles(judged, "medium")])
    times = [j.seconds for j in judged]
    brier = float(np.mean((probability - right) ** 2)) if stated else math.nan
    ece = calibration_error(probability, right)
    return [
        Measure("median held-out gain towards the truth without noise", _median(gains), "1", len(gains), 0.93, 0.97,
                upward=True),
        Measure("median held-out gain towards the true structure fitted to the same runs", _median(fitted), "1",
                len(fitted), 0.93, 0.97, upward=True),
        Measure("median error of the main parameter: medium", _median(errors), "%", len(errors), 0.08, 0.05,
                upward=False),
        Measure("calibration error of the stated probability", ece, "1", len(stated), 0.07, 0.04, upward=False),
        Measure("calibration error that true probabilities would have on so few cases", calibration_by_chance(probability),
                "1", len(stated), None, None, upward=False),
        Measure("Brier score of the stated probability", brier, "1", len(stated), None, None, upward=False),
        Measure("wall time per campaign: median", _median(times), "s", len(times), 40.0, 20.0, upward=False),
        Measure("wall time per campaign: worst", max(times, default=math.nan), "s", len(times), 120.0, 60.0,
                upward=False),
    ]  # fmt: skip


def _failures(judged: Sequence[Judged]) -> list[Measure]:
    held = [j for j in judged if j.worse is not None]
    interval = [j for j in judged if j.covered is not None and not j.departs]
    stated = stated_by(judged)
    surest = sorted(stated, key=lambda j: -j.probability)[: round(0.8 * len(stated))]
    return [
        _most("held-out worse than the refitted base", share_of(held, lambda j: bool(j.worse)), 0.02, 0.005),
        _least("90 % intervals of the main parameter cover (textbook laws; 80-97 % asked, 85-95 % aimed at)",
               share_of(interval, lambda j: bool(j.covered)), 0.80, 0.85),
        _least("right where more than 0.9 was stated",
               share_of([j for j in stated if j.probability > 0.9], lambda j: j.exact)),
        _most("wrong among the surest 80 %", share_of(surest, lambda j: not j.exact)),
        _most("crashed or timed out (counted wrong)", share_of(judged, lambda j: j.status != "answered")),
    ]  # fmt: skip


def _family_right(j: Judged) -> bool:
    return bool(j.said) and {family(label) for label in j.said} == {family(label) for label in j.truth}


def _known(values: Sequence[float]) -> list[float]:
    return [value for value in values if not math.isnan(value)]


def _median(values: Sequence[float]) -> float:
    return float(np.median(values)) if values else math.nan
