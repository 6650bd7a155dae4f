"""Does a campaign's paperwork tell what is concealed in it? A classifier on metadata alone should do no better than chance.

Ridge-penalised logistic regression on everything but the samples (names, counts, sizes, time stamps, every number of
campaign.toml), five-fold cross-validated; chance is the same classifier on shuffled labels.
"""

from __future__ import annotations

import hashlib
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Real = NDArray[np.float64]


@dataclass(frozen=True)
class Probe:
    """How well metadata tells.

    Attributes:
        score: Balanced accuracy, cross-validated; 0.5 is chance.
        chance: The same on shuffled labels: mean and 95th percentile.
        p_value: Share of shuffles that score at least as well.
    """

    score: float
    chance: tuple[float, float]
    p_value: float
    cases: int

    @property
    def at_chance(self) -> bool:
        """Whether nothing leaks at the 1 % level."""
        return self.p_value > 0.01


def features(folder: Path) -> Real:
    """Everything a campaign shows but its samples, as numbers, shape (n,)."""
    document = tomllib.loads((folder / "campaign.toml").read_text(encoding="utf-8"))
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    sizes = np.array([file.stat().st_size for file in files], dtype=float)
    stamps = np.array([file.stat().st_mtime for file in files])
    rig = [float(v) for _, v in sorted(document["rig"].items()) if isinstance(v, (int, float))]
    runs = document["run"]
    ids = np.array([_as_number(run["id"]) for run in runs])
    numbers = sorted(_numbers(runs[0]))
    return np.concatenate([
        [_as_number(folder.name), len(files), sizes.sum(), sizes.max(), sizes.min(), np.median(sizes)],
        [stamps.max() - stamps.min(), len(runs), (folder / "campaign.toml").stat().st_size],
        [ids[0], ids[-1], ids.mean(), ids.std(), float(np.mean(np.diff(ids) > 0.0))],
        _padded(np.log10(np.abs(rig) + 1e-12), 16),
        _padded(np.array([np.mean(numbers), np.max(numbers), np.min(numbers), len(numbers), np.std(numbers)]), 5),
        [float(np.mean([len(run["stream"]) for run in runs])), float(np.std([run.get("arm_angle", 0.0) for run in runs]))],
        [float(np.mean([stream["sampling_rate"] for run in runs for stream in run["stream"]]))],
    ])  # fmt: skip


def _as_number(text: str) -> float:
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:2], "big") / 65536.0


def _padded(values: Real, length: int) -> Real:
    return np.pad(values[:length], (0, max(0, length - values.size)))


def _numbers(value: Any) -> list[float]:  # noqa: ANN401  # whatever TOML holds
    if isinstance(value, bool):
        return [float(value)]
    if isinstance(value, (int, float)):
        return [float(value)]
    if isinstance(value, dict):
        return [number for item in value.values() for number in _numbers(item)]
    if isinstance(value, list):
        return [number for item in value for number in _numbers(item)]
    return []


def probe(table: Real, labels: NDArray[np.bool_], rng: np.random.Generator, shuffles: int = 99) -> Probe:
    """How well ``table`` (cases, features) tells ``labels`` (cases,)."""
    score = _cross_validated(table, labels, rng)
    chance = np.array([_cross_validated(table, rng.permutation(labels), rng) for _ in range(shuffles)])
    at_least = float((1 + np.sum(chance >= score)) / (1 + shuffles))
    return Probe(score, (float(chance.mean()), float(np.quantile(chance, 0.95))), at_least, labels.size)


def _cross_validated(table: Real, labels: NDArray[np.bool_], rng: np.random.Generator, folds: int = 5) -> float:
    order = rng.permutation(labels.size)
    said = np.zeros(labels.size, dtype=bool)
    for part in np.array_split(order, folds):
        train = np.setdiff1d(order, part)
        middle, spread = table[train].mean(axis=0), table[train].std(axis=0)
        use = spread > 1e-12 * (1.0 + np.abs(middle))
        scaled = (table[:, use] - middle[use]) / spread[use]
        weights = _logistic(np.column_stack([np.ones(labels.size), scaled])[train], labels[train])
        said[part] = np.column_stack([np.ones(part.size), scaled[part]]) @ weights > 0.0
    rates = [float(np.mean(said[labels == value] == value)) for value in (True, False) if np.any(labels == value)]
    return float(np.mean(rates))


def _logistic(x: Real, labels: NDArray[np.bool_], ridge: float = 1.0, steps: int = 12) -> Real:
    """Class-balanced logistic regression by Newton's method."""
    share = max(float(labels.mean()), 1e-6)
    balance = np.where(labels, 0.5 / share, 0.5 / max(1.0 - share, 1e-6))
    w = np.zeros(x.shape[1])
    penalty = ridge * np.eye(x.shape[1])
    penalty[0, 0] = 1e-6
    for _ in range(steps):
        p = 1.0 / (1.0 + np.exp(-np.clip(x @ w, -30.0, 30.0)))
        slope = x.T @ (balance * (p - labels)) + penalty @ w
        curve = (x * (balance * p * (1.0 - p))[:, None]).T @ x + penalty
        w = w - np.linalg.solve(curve, slope)
    return np.asarray(w)


def probe_draw(folder: Path, names: Sequence[str], concealed: Sequence[bool], seed: int = 0) -> Probe:
    """Whether a draw's metadata tell cases with an effect from those without."""
    table = np.array([features(folder / name) for name in names])
    return probe(table, np.array(concealed, dtype=bool), np.random.default_rng(seed))
