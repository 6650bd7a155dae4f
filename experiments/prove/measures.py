"""All answers together: the measures of the proof, each with its interval, by band and experiment set."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, is_dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from jointscope.experiments.prove.judging import Judged, family

Real = NDArray[np.float64]
GRADED: Final = ("easy", "medium", "hard")


@dataclass(frozen=True)
class Share:
    """A share of cases with its 95 % Wilson interval."""

    hits: int
    cases: int
    share: float
    low: float
    high: float


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
    """Single listed effects of the given bands; what was made to be undecidable and isn't counts by its band too."""
    return [j for j in judged if j.kind in ("single", "undecidable") and (not bands or j.band in bands)]


def stated_by(judged: Iterable[Judged]) -> list[Judged]:
    """Cases whose answer states a probability."""
    return [j for j in judged if not math.isnan(j.probability)]


def calibration_error(probabilities: Real, right: NDArray[np.bool_], bins: int = 15) -> float:
    """Expected calibration error over ``bins`` of equal mass: mean |share right - mean probability| (fewer bins for
    fewer cases, at least ten cases each)."""
    if probabilities.size == 0:
        return math.nan
    groups = _equal_mass(probabilities, bins)
    return float(sum(g.size * abs(right[g].mean() - probabilities[g].mean()) for g in groups) / probabilities.size)


def calibration_by_chance(probabilities: Real, bins: int = 15) -> float:
    """What :func:`calibration_error` is on average where every probability is true: so few cases scatter by themselves.

    The sum over bins of E|x| = sqrt(2/pi) sigma, sigma^2 = sum p (1 - p), over the number of cases.
    """
    if probabilities.size == 0:
        return math.nan
    spreads = [
        float(np.sum(probabilities[g] * (1.0 - probabilities[g]))) for g in _equal_mass(probabilities, bins)
    ]
    return math.sqrt(2.0 / math.pi) * sum(math.sqrt(s) for s in spreads) / probabilities.size


def _equal_mass(probabilities: Real, bins: int) -> list[NDArray[np.intp]]:
    order = np.argsort(probabilities, kind="stable")
    return np.array_split(order, max(1, min(bins, probabilities.size // 10)))


def reliability(judged: Sequence[Judged], bins: int = 8) -> list[dict[str, float]]:
    """Stated probability against share right, in bins of equal mass."""
    order = sorted(stated_by(judged), key=lambda j: j.probability)
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


def short_table(judged: Sequence[Judged]) -> dict[str, Share]:
    """The few measures in which ways of answering are compared."""
    return {
        "false alarms": share_of(nulls(judged), lambda j: bool(j.said)),
        **{f"exact: {band}": share_of(singles(judged, band), lambda j: j.exact) for band in GRADED},
        "location: easy to hard": share_of(singles(judged, *GRADED), lambda j: bool(j.location)),
        "pairs: both named": share_of(
            [j for j in judged if j.kind == "pair" and j.band != "below"], lambda j: j.exact
        ),
        "unlisted answered unknown": share_of([j for j in judged if j.kind == "unlisted"], lambda j: j.exact),
        "right as a whole, all cases": share_of(judged, lambda j: j.exact),
    }


def law_gap(judged: Sequence[Judged]) -> dict[str, dict[str, Any]]:
    """Naming of single effects by whether their law is the textbook's, and the gap [points] with its 95 % interval.

    The interval is Newcombe's (1998, method 10), from the two Wilson intervals.
    """
    out: dict[str, dict[str, Any]] = {}
    for name, bands in {"easy to hard": GRADED, **{band: (band,) for band in GRADED}}.items():
        cases = singles(judged, *bands)
        near = share_of([j for j in cases if not j.departs], lambda j: j.exact)
        far = share_of([j for j in cases if j.departs], lambda j: j.exact)
        gap = near.share - far.share
        below = math.hypot(near.share - near.low, far.high - far.share)
        above = math.hypot(near.high - near.share, far.share - far.low)
        out[name] = {
            "matched": near, "mismatched": far, "gap": 100.0 * gap, "low": 100.0 * (gap - below),
            "high": 100.0 * (gap + above),
        }  # fmt: skip
    return out


def by_experiments(judged: Sequence[Judged]) -> dict[str, dict[str, Share]]:
    """The measures that are shares, by experiment set."""
    out = {}
    for name in sorted({j.experiments for j in judged}):
        part = [j for j in judged if j.experiments == name]
        out[name] = short_table(part) | {
            f"location: {band}": share_of(singles(part, band), lambda j: bool(j.location)) for band in GRADED
        }
    return out


def confusion(judged: Sequence[Judged], level: str) -> dict[str, dict[str, int]]:
    """Counts of what was said (inner) for what was true (outer), for nulls, singles and unlisted effects.

    Args:
        judged: All cases.
        level: ``name``, ``location`` or ``family``.
    """
    rows: dict[str, Counter[str]] = {}
    for j in judged:
        if j.kind == "pair":
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


def power_curve(
    judged: Sequence[Judged], right: Callable[[Judged], bool] = lambda j: j.exact, groups: int = 6
) -> list[dict[str, float]]:
    """Share of single effects that are ``right`` against discriminability z_d, in groups of equal size."""
    cases = sorted(singles(judged), key=lambda j: j.z_d)
    rows = []
    for group in np.array_split(np.arange(len(cases)), max(1, min(groups, len(cases) // 5))):
        if group.size:
            part = [cases[i] for i in group]
            found = share_of(part, right)
            middle = float(np.exp(np.mean(np.log([max(j.z_d, 0.1) for j in part]))))
            rows.append({"z_d": middle, "right": found.share, "low": found.low, "high": found.high})
    return rows


def as_json(value: object) -> Any:  # noqa: ANN401  # whatever JSON holds
    """Measures as plain JSON: NaN becomes null."""
    if isinstance(value, float):
        return None if not math.isfinite(value) else value
    if is_dataclass(value) and not isinstance(value, type):
        return as_json(asdict(value))
    if isinstance(value, dict):
        return {key: as_json(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [as_json(item) for item in value]
    return value
