"""Does a campaign's paperwork tell what is concealed in it? Classifiers on metadata alone should do no better than chance.

They see everything but the samples: names, counts, sizes, array lengths, rates, time stamps, how well campaign.toml
compresses, how its numbers are written, every number of it. Two of them, for what is linear and for what isn't:
ridge-penalised logistic regression and gradient-boosted stumps, five-fold cross-validated; chance is the same
classifier on shuffled labels. How samples compress is left out: a clipped or a held channel compresses better because
of what was concealed, and that is what a diagnosis is to find.
"""

from __future__ import annotations

import hashlib
import re
import tomllib
import zlib
from collections.abc import Callable, Sequence
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
    text = (folder / "campaign.toml").read_text(encoding="utf-8")
    document = tomllib.loads(text)
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    sizes = np.array([file.stat().st_size for file in files], dtype=float)
    stamps = np.array([file.stat().st_mtime for file in files])
    rig = [float(v) for _, v in sorted(document["rig"].items()) if isinstance(v, (int, float))]
    runs = document["run"]
    ids = np.array([_as_number(run["id"]) for run in runs])
    numbers = sorted(_numbers(runs[0]))
    return np.concatenate([
        [_as_number(folder.name), len(files), sizes.sum(), sizes.max(), sizes.min(), np.median(sizes)],
        [stamps.max() - stamps.min(), len(runs), len(text), len(zlib.compress(text.encode(), 9)) / len(text)],
        _written(text),
        _spread_of([float(size) for size in sizes[1:]]),
        _spread_of([stream["sampling_rate"] for run in runs for stream in run["stream"]]),
        _spread_of([len(stream["channels"]) for run in runs for stream in run["stream"]]),
        [_as_number(",".join(sorted(document["rig"]))), _as_number(",".join(sorted(runs[0])))],
        _places(runs),
        [ids[0], ids[-1], ids.mean(), ids.std(), float(np.sum(np.diff(ids) > 0.0) / max(ids.size - 1, 1))],
        _padded(np.log10(np.abs(rig) + 1e-12), 16),
        _padded(np.array([np.mean(numbers), np.max(numbers), np.min(numbers), len(numbers), np.std(numbers)]), 5),
        [float(np.mean([len(run["stream"]) for run in runs])), float(np.std([run.get("arm_angle", 0.0) for run in runs]))],
    ])  # fmt: skip


def _written(text: str) -> list[float]:
    """How numbers are written: their count, mean number of characters, share with an exponent, share of whole ones."""
    numbers = re.findall(r"(?<![\w.])-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?(?![\w.])", text)
    count = max(len(numbers), 1)
    return [
        float(len(numbers)),
        sum(map(len, numbers)) / count,
        sum("e" in word.lower() for word in numbers) / count,
        sum("." not in word for word in numbers) / count,
    ]


def _spread_of(values: Sequence[float]) -> list[float]:
    found = np.array(values, dtype=float) if values else np.zeros(1)
    return [float(found.mean()), float(found.min()), float(found.max()), float(found.std())]


def _places(runs: Sequence[dict[str, Any]]) -> list[float]:
    """Where in the order of the runs each experiment stands, on average."""
    out = []
    for kind in ("hammer", "torque-sweep", "speed-motion"):
        places = [i for i, run in enumerate(runs) if run.get("experiment") == kind]
        out += [float(len(places)), float(np.mean(places)) if places else 0.0]
    return out


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


Classifier = Callable[[Real, NDArray[np.bool_], Real], NDArray[np.bool_]]  # train, labels, test -> said


def probe(
    table: Real, labels: NDArray[np.bool_], rng: np.random.Generator, shuffles: int = 99, *,
    classifier: Classifier | None = None,
) -> Probe:  # fmt: skip
    """How well ``table`` (cases, features) tells ``labels`` (cases,); by logistic regression unless told otherwise."""
    use = classifier or logistic
    score = _cross_validated(table, labels, rng, use)
    chance = np.array([_cross_validated(table, rng.permutation(labels), rng, use) for _ in range(shuffles)])
    at_least = float((1 + np.sum(chance >= score)) / (1 + shuffles))
    return Probe(score, (float(chance.mean()), float(np.quantile(chance, 0.95))), at_least, labels.size)


def _cross_validated(
    table: Real, labels: NDArray[np.bool_], rng: np.random.Generator, classifier: Classifier, folds: int = 5
) -> float:
    order = rng.permutation(labels.size)
    said = np.zeros(labels.size, dtype=bool)
    for part in np.array_split(order, folds):
        train = np.setdiff1d(order, part)
        said[part] = classifier(table[train], labels[train], table[part])
    rates = [float(np.mean(said[labels == value] == value)) for value in (True, False) if np.any(labels == value)]
    return float(np.mean(rates))


def logistic(train: Real, labels: NDArray[np.bool_], test: Real) -> NDArray[np.bool_]:
    """Class-balanced ridge logistic regression on standardised features."""
    middle, spread = train.mean(axis=0), train.std(axis=0)
    use = spread > 1e-12 * (1.0 + np.abs(middle))

    def columns(x: Real) -> Real:
        return np.column_stack([np.ones(len(x)), (x[:, use] - middle[use]) / spread[use]])

    return np.asarray(columns(test) @ _logistic(columns(train), labels) > 0.0)


def boosted(
    train: Real, labels: NDArray[np.bool_], test: Real, rounds: int = 40, rate: float = 0.3
) -> NDArray[np.bool_]:
    """Class-balanced gradient boosting of stumps (Friedman 2001), splits at the training set's octiles."""
    at = np.quantile(train, np.linspace(0.125, 0.875, 7), axis=0)

    def stumps(x: Real) -> Real:
        return np.where(x[:, None, :] > at[None], 1.0, -1.0).reshape(len(x), -1)

    inside, outside = stumps(train), stumps(test)
    share = min(max(float(labels.mean()), 1e-6), 1.0 - 1e-6)
    weight = np.where(labels, 0.5 / share, 0.5 / (1.0 - share))
    score, said = np.zeros(len(train)), np.zeros(len(test))
    for _ in range(rounds):
        p = 1.0 / (1.0 + np.exp(-score))
        slope = inside.T @ (weight * (labels - p))
        best = int(np.argmax(np.abs(slope)))
        step = rate * float(slope[best]) / max(float(np.sum(weight * p * (1.0 - p))), 1e-9)
        score, said = score + step * inside[:, best], said + step * outside[:, best]
    return said > 0.0


CLASSIFIERS: dict[str, Classifier] = {"logistic regression": logistic, "boosted stumps": boosted}


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


def probe_draw(
    folder: Path, names: Sequence[str], labels: Sequence[bool], seed: int = 0, shuffles: int = 99
) -> dict[str, Probe]:
    """Whether a draw's metadata tell ``labels`` (an effect or none), by every classifier."""
    table = np.array([features(folder / name) for name in names])
    told = np.array(labels, dtype=bool)
    return {
        name: probe(table, told, np.random.default_rng(seed), shuffles, classifier=classifier)
        for name, classifier in CLASSIFIERS.items()
    }
