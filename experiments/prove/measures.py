"""All answers together: the measures of the proof, each with its interval, by band and experiment set."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from jointscope.experiments.prove.judging import Judged, family

Real = NDArray[np.float64]
GRADED: Final = ("easy", "medium", "hard")
GAPS: Final = ("matched", "mismatched")


@dataclass(frozen=True)
class Share:
    """A share of cases with its 95 % Wilson interval."""

    hits: int
    cases: int
    share: float
    low: float
    high: float


@dataclass(frozen=True)
class Measure:
    """One line of the table.

    Attributes:
        least: What must be reached, in the measure's direction; ``None`` where nothing is asked.
        upward: Whether larger is better.
    """

    name: str
    value: Share | float
    unit: str
    cases: int
    least: float | None
    aim: float | None
    upward: bool

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


def wilson(hits: int, cases: int, quantile: float = 1.959964) -> Share:
    """Wilson's score interval (Wilson 1927) of a share."""
    if cases == 0:
        return Share(0, 0, math.nan, 0.0, 1.0)
    p, z2 = hits / cases, quantile**2
    middle = (p + z2 / (2 * cases)) / (1 + z2 / cases)
    half = quantile / (1 + z2 / cases) * math.sqrt(p * (1 - p) / cases + z2 / (4 * cases**2))
    return Share(hits, cases, p, max(0.0, middle - half), min(1.0, middle + half))


def share_of(judged: Iterable[Judged], right: Callable[[Judged], bool]) -> Share:
    """Share of ``judged`` for which ``right`` holds."""
    cases = list(judged)
    return wilson(sum(map(right, cases)), len(cases))


def nulls(judged: Iterable[Judged]) -> list[Judged]:
    """Cases in which nothing is concealed."""
    return [j for j in judged if j.kind == "null"]


def singles(judged: Iterable[Judged], *bands: str) -> list[Judged]:
    """Single listed effects of the given bands."""
    return [j for j in judged if j.kind == "single" and (not bands or j.band in bands)]


def calibration_error(probabilities: Real, right: NDArray[np.bool_], bins: int = 15) -> float:
    """Expected calibration error over ``bins`` of equal mass: mean |share right - mean probability| (fewer bins for
    fewer cases, at least ten cases each)."""
    if probabilities.size == 0:
        return math.nan
    order = np.argsort(probabilities, kind="stable")
    groups = np.array_split(order, max(1, min(bins, probabilities.size // 10)))
    return float(sum(g.size * abs(right[g].mean() - probabilities[g].mean()) for g in groups) / probabilities.size)


def reliability(judged: Sequence[Judged], bins: int = 8) -> list[dict[str, float]]:
    """Stated probability against share right, in bins of equal mass."""
    stated = [j for j in judged if not math.isnan(j.probability)]
    order = sorted(stated, key=lambda j: j.probability)
    rows = []
    for group in np.array_split(np.arange(len(order)), max(1, min(bins, len(order) // 8))):
        if group.size:
            part = [order[i] for i in group]
            right = wilson(sum(j.exact for j in part), len(part))
            rows.append({
                "stated": float(np.mean([j.probability for j in part])), "right": right.share, "low": right.low,
                "high": right.high, "cases": float(len(part)),
            })  # fmt: skip
    return rows


def table(judged: Sequence[Judged]) -> list[Measure]:
    """The measures of the diagnosis, in the order of their table."""
    rows: list[Measure] = []

    def add(
        name: str, value: Share | float, least: float | None, aim: float | None, *, upward: bool = True,
        unit: str = "%", cases: int | None = None,
    ) -> None:  # fmt: skip
        count = value.cases if isinstance(value, Share) else (cases or 0)
        rows.append(Measure(name, value, unit, count, least, aim, upward))

    none = nulls(judged)
    add(
        "false alarms on nulls: any physics named",
        share_of(none, lambda j: bool(j.said)),
        0.03,
        0.01,
        upward=False,
    )
    add("nulls not answered none (unknown, crash or time-out included)",
        share_of(none, lambda j: j.verdict != "none"), None, None, upward=False)  # fmt: skip
    for band, least, aim in zip(GRADED, (0.85, 0.70, 0.40), (0.95, 0.85, 0.60), strict=True):
        add(
            f"single, name and location exact: {band}",
            share_of(singles(judged, band), lambda j: j.exact),
            least,
            aim,
        )
    add("single, name and location exact: trivial (z_d > 100)",
        share_of(singles(judged, "trivial"), lambda j: j.exact), None, None)  # fmt: skip
    for band, least, aim in zip(GRADED, (0.93, 0.85, 0.65), (0.98, 0.93, 0.80), strict=True):
        add(f"location right: {band}", share_of(singles(judged, band), lambda j: bool(j.location)), least, aim)
    below = [j for j in judged if j.kind == "undecidable" or (j.kind == "single" and j.band == "below")]
    add("can't be told (z_d < 4): set, unknown or right", share_of(below, lambda j: j.exact), None, None)
    pairs = [j for j in judged if j.kind == "pair" and j.band != "below"]
    add("pairs: both named", share_of(pairs, lambda j: j.exact), 0.45, 0.60)
    add("pairs: at least one named and none wrong", share_of(pairs, lambda j: j.any_named), 0.80, 0.90)
    outside = [j for j in judged if j.kind == "unlisted" and j.band in ("trivial", "easy", "medium")]
    add(
        "unlisted answered unknown (medium and up)",
        share_of(outside, lambda j: j.verdict == "unknown"),
        0.70,
        0.85,
    )
    seen = singles(judged, "trivial", "easy", "medium")
    add("listed wrongly unknown (medium and up)", share_of(seen, lambda j: j.verdict == "unknown"), 0.15, 0.10,
        upward=False)  # fmt: skip
    gains = [j.gain for j in judged if not math.isnan(j.gain)]
    add("median held-out gain towards a perfect model", _median(gains), 0.93, 0.97, unit="1", cases=len(gains))
    harmed = [j for j in judged if j.worse is not None]
    add(
        "held-out worse than the refitted base",
        share_of(harmed, lambda j: bool(j.worse)),
        0.02,
        0.005,
        upward=False,
    )
    errors = [j.error for j in singles(judged, "medium") if not math.isnan(j.error)]
    add("median error of the main parameter: medium", _median(errors), 0.08, 0.05, upward=False, cases=len(errors))
    interval = [j for j in judged if j.covered is not None and not j.departs]
    add("95 % intervals cover (textbook laws)", share_of(interval, lambda j: bool(j.covered)), 0.80, 0.85)
    stated = [j for j in judged if not math.isnan(j.probability)]
    ece = calibration_error(
        np.array([j.probability for j in stated]), np.array([j.exact for j in stated], dtype=bool)
    )
    add("calibration error of the stated probability", ece, 0.07, 0.04, upward=False, unit="1", cases=len(stated))
    times = [j.seconds for j in judged]
    add("wall time per campaign: median", _median(times), 40.0, 20.0, upward=False, unit="s", cases=len(times))
    add("wall time per campaign: worst", max(times, default=math.nan), 120.0, 60.0, upward=False, unit="s",
        cases=len(times))  # fmt: skip
    failed = share_of(judged, lambda j: j.status != "answered")
    add("crashed or timed out (counted wrong)", failed, None, None, upward=False)
    return rows


def _median(values: Sequence[float]) -> float:
    return float(np.median(values)) if values else math.nan


def short_table(judged: Sequence[Judged]) -> dict[str, Share]:
    """The few measures in which ways of answering are compared."""
    return {
        "false alarms": share_of(nulls(judged), lambda j: bool(j.said)),
        **{f"exact: {band}": share_of(singles(judged, band), lambda j: j.exact) for band in GRADED},
        "location: all": share_of(singles(judged, *GRADED), lambda j: bool(j.location)),
        "unlisted answered unknown": share_of([j for j in judged if j.kind == "unlisted"], lambda j: j.exact),
    }


def law_gap(judged: Sequence[Judged]) -> dict[str, Share]:
    """Naming of single effects whose law is the textbook's, and of those whose law departs from it."""
    seen = singles(judged, *GRADED)
    return {
        "matched": share_of([j for j in seen if not j.departs], lambda j: j.exact),
        "mismatched": share_of([j for j in seen if j.departs], lambda j: j.exact),
    }


def by_experiments(judged: Sequence[Judged]) -> dict[str, dict[str, Share]]:
    """Naming of single effects by experiment set and band."""
    return {
        name: {
            band: share_of([j for j in singles(judged, band) if j.experiments == name], lambda j: j.exact)
            for band in GRADED
        }
        for name in sorted({j.experiments for j in judged})
    }


def confusion(judged: Sequence[Judged], level: str) -> dict[str, dict[str, int]]:
    """Counts of what was said (inner) for what was true (outer), for nulls, singles and unlisted effects.

    Args:
        judged: All cases.
        level: ``name``, ``location`` or ``family``.
    """
    rows: dict[str, Counter[str]] = {}
    for j in judged:
        if j.kind in ("pair", "undecidable"):
            continue
        true = _at(j.truth[0], level, listed=j.listed) if j.truth else "none"
        rows.setdefault(true, Counter())[_answer_at(j, level)] += 1
    return {true: dict(sorted(counts.items())) for true, counts in sorted(rows.items())}


def _at(label: str, level: str, *, listed: bool = True) -> str:
    if level == "location":
        return label.split("@")[1]
    if level == "family":
        return family(label)
    return label if listed else "unlisted"


def _answer_at(j: Judged, level: str) -> str:
    if j.status != "answered":
        return "failed"
    if j.verdict != "effects":
        return j.verdict
    parts = sorted({_at(label, level) for label in j.said})
    return parts[0] if len(parts) == 1 else "several"


def power_curve(judged: Sequence[Judged], groups: int = 6) -> list[dict[str, float]]:
    """Share named exactly against discriminability z_d, in groups of equal size."""
    cases = sorted(singles(judged), key=lambda j: j.z_d)
    rows = []
    for group in np.array_split(np.arange(len(cases)), max(1, min(groups, len(cases) // 5))):
        if group.size:
            part = [cases[i] for i in group]
            right = wilson(sum(j.exact for j in part), len(part))
            middle = float(np.exp(np.mean(np.log([max(j.z_d, 0.1) for j in part]))))
            rows.append({"z_d": middle, "right": right.share, "low": right.low, "high": right.high})
    return rows


def as_json(value: object) -> Any:  # noqa: ANN401  # whatever JSON holds
    """Measures as plain JSON: NaN becomes null."""
    if isinstance(value, float):
        return None if not math.isfinite(value) else value
    if isinstance(value, (Share, Measure, Judged)):
        return as_json(asdict(value))
    if isinstance(value, dict):
        return {key: as_json(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [as_json(item) for item in value]
    return value
