"""Learn the map from stated to true probabilities on a proved calibration draw, and the range in which it holds."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jointscope.atomic import write_text
from jointscope.diagnosis.calibration import FORMAT, INPUTS, RANGES, SETS, kind_of
from jointscope.errors import InputError
from jointscope.experiments.prove.diagnosing import load
from jointscope.experiments.prove.measures import calibration_error

Real = NDArray[np.float64]

LEAST = 60  # answers of one kind below which it gets the map of all: on 64 answers, maps of their own were worse
RIDGE = 0.3  # standard deviations of prior on the slopes, per standardised input: the likeliest of 340 answers left out
FEWEST = 10  # answers of a kind of verdict that make a level of its own
FOLDS = 5


def fit_logistic(x: Real, right: NDArray[np.bool_], ridge: float = RIDGE) -> tuple[float, Real]:
    """(intercept, slopes) by penalised likelihood, Newton's method; ``x`` (n, k), ``right`` (n,).

    Platt's targets (Platt 1999) keep the intercept finite where all answers are right, or all are wrong.
    """
    centre, size = x.mean(axis=0), np.maximum(x.std(axis=0), 1e-9)
    design = np.column_stack([np.ones(len(x)), (x - centre) / size])
    hits, misses = int(right.sum()), int((~right).sum())
    target = np.where(right, (hits + 1.0) / (hits + 2.0), 1.0 / (misses + 2.0))
    penalty = np.diag([0.0, *([1.0 / ridge**2] * x.shape[1])])
    beta = np.zeros(design.shape[1])
    for _ in range(60):
        p = 1.0 / (1.0 + np.exp(-np.clip(design @ beta, -30.0, 30.0)))
        weight = np.maximum(p * (1.0 - p), 1e-9)
        gradient = design.T @ (target - p) - penalty @ beta
        step = np.linalg.solve((design * weight[:, None]).T @ design + penalty, gradient)
        beta = beta + np.clip(step, -2.0, 2.0)
        if float(np.max(np.abs(step))) < 1e-9:
            break
    slopes = beta[1:] / size
    return float(beta[0] - slopes @ centre), slopes


def rows_of(proof: Path, *, spent: bool = False) -> list[tuple[str, Mapping[str, Any], bool]]:
    """(kind of verdict, features, right) of every answered case of a proof.

    Args:
        spent: Whether a test draw will do: one that was opened, and that development has looked into since. Its answers
            were given before that.

    Raises:
        InputError: No finished proof, one of a test draw, or answers of another version.
    """
    file, summary = proof / "judged.json", proof / "summary.json"
    if not file.is_file() or not summary.is_file():
        raise InputError(file, None, "isn't there", fix="prove the calibration draw first")
    draw = json.loads(summary.read_text(encoding="utf-8"))["draw"]
    if draw == "test" and not spent:
        raise InputError(
            summary, "draw", "nothing is learnt from test cases", value=draw, fix="conceal --draw calibration"
        )
    rows = []
    for judged in json.loads(file.read_text(encoding="utf-8")):
        said = load(proof, judged["case"]).diagnosis
        found = ((said or {}).get("calibration") or {}).get("features")
        if said is not None and found is not None:
            rows.append((kind_of(said["verdict"], said.get("unknown_reason")), found, bool(judged["exact"])))
    if not rows:
        raise InputError(
            proof, None, "holds no answer with calibration.features", fix="prove the draw with this version"
        )
    return rows


def learn(rows: Sequence[tuple[str, Mapping[str, Any], bool]]) -> dict[str, Any]:
    """The map and its range, as JSON, with the error of calibration of cases that the map was not fitted to."""
    x = np.array([[float(found[name]) for name in INPUTS] for _, found, _ in rows])
    right = np.array([r for _, _, r in rows], dtype=bool)
    kinds = np.array([kind for kind, _, _ in rows])
    stated = 1.0 / (1.0 + np.exp(-x[:, 0]))
    maps = _maps(x, right, kinds)
    held = np.zeros(len(rows))
    fold = np.random.default_rng(1).permutation(len(rows)) % FOLDS
    for k in range(FOLDS):
        others = _maps(x[fold != k], right[fold != k], kinds[fold != k])
        for i in np.flatnonzero(fold == k):
            intercept, slopes, _ = others.get(str(kinds[i]), others[""])
            held[i] = 1.0 / (1.0 + math.exp(-float(np.clip(intercept + slopes @ x[i], -30.0, 30.0))))
    return {
        "format": FORMAT,
        "inputs": list(INPUTS),
        "maps": {
            kind: {"intercept": a, "weights": [float(v) for v in b], "cases": n}
            for kind, (a, b, n) in maps.items()
            if kind
        },
        "ranges": {name: _range([float(found[name]) for _, found, _ in rows]) for name in RANGES},
        "sets": {name: sorted({str(found[name]) for _, found, _ in rows}) for name in SETS},
        "cases": len(rows),
        "calibration_error": {
            "stated": calibration_error(stated, right),
            "mapped, cross-validated": calibration_error(held, right),
        },
    }


def _range(values: Sequence[float]) -> list[float]:
    return [min(values), max(values)]


def _maps(x: Real, right: NDArray[np.bool_], kinds: NDArray[np.str_]) -> dict[str, tuple[float, Real, int]]:
    """Per kind of verdict, under ``""`` that of all.

    A kind with few answers gets the slopes of all with its own count, at a level of its own where it has some answers.
    """
    names, counts = np.unique(kinds, return_counts=True)
    known = [str(name) for name, count in zip(names, counts, strict=True) if count >= FEWEST]
    levels = np.stack([kinds == kind for kind in known], axis=1).astype(float) if known else np.zeros((len(x), 0))
    intercept, slopes = fit_logistic(np.hstack([x, levels]), right)
    slopes, offsets = slopes[: x.shape[1]], dict(zip(known, slopes[x.shape[1] :], strict=True))
    maps = {"": (intercept, slopes, len(x))}
    for name, number in zip(names, counts, strict=True):
        kind, of_kind = str(name), kinds == name
        if number >= LEAST:
            maps[kind] = (*fit_logistic(x[of_kind], right[of_kind]), int(number))
        else:
            maps[kind] = (intercept + float(offsets.get(kind, 0.0)), slopes, int(number))
    return maps


def learn_map(proofs: Sequence[Path], file: Path, spent: Sequence[Path] = ()) -> dict[str, Any]:
    """Learn from proofs of calibration draws and of ``spent`` test draws, and write ``file``; the map as JSON.

    What ``file`` holds of campaigns beyond any draw's range (``beyond``) stays.
    """
    learnt = [row for proof in proofs for row in rows_of(proof, spent=proof in spent)]
    learnt.extend(row for proof in spent if proof not in proofs for row in rows_of(proof, spent=True))
    content = learn(learnt)
    before = json.loads(file.read_text(encoding="utf-8")) if file.is_file() else {}
    if "beyond" in before:
        content["beyond"] = before["beyond"]
    write_text(file, json.dumps(content, indent=1, sort_keys=True) + "\n")
    return content
