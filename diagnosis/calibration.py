"""Stated probabilities made honest: a logistic map per kind of verdict, learnt on concealed campaigns, and where it holds.

The map and its range are one small file, ``calibration.json``, written by ``jointscope prove DRAW --calibrate`` from a
calibration draw. Outside the range (other experiments, channels, rates, signal-to-noise ratios or rigs than the draw
held) the answer is a ranking: its probabilities are given but not vouched for.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from importlib.resources import files
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from jointscope.diagnosis.assembly import BASE_INDEX
from jointscope.diagnosis.noise import block_key, dynamic_level

if TYPE_CHECKING:
    from jointscope.diagnosis.pipeline import Diagnosis
    from jointscope.diagnosis.verdict import Decision

FORMAT: Final = "jointscope-calibration/1"
NAME: Final = "calibration.json"
INPUTS: Final = (
    "stated",
    "margin",
    "base_left",
    "model_left",
    "explained",
    "further",
)  # what the logistic map sees
RANGES: Final = (
    "runs",
    "slowest_rate_hz",
    "fastest_rate_hz",
    "snr_db",
    "resonance_hz",
)  # numbers that must lie inside
SETS: Final = ("experiments", "channels", "topology", "motion")  # words that the draw must have held
SLACK: Final = 0.1  # of a range's width, allowed beyond either end


@dataclass(frozen=True)
class Logistic:
    """P(right) = 1/(1 + exp(-(intercept + weights . x)))."""

    intercept: float
    weights: tuple[float, ...]
    cases: int

    def __call__(self, x: Mapping[str, float]) -> float:
        total = self.intercept + sum(w * x[name] for w, name in zip(self.weights, INPUTS, strict=True))
        return 1.0 / (1.0 + math.exp(-float(np.clip(total, -30.0, 30.0))))


@dataclass(frozen=True)
class CalibrationMap:
    """What a calibration draw taught.

    Attributes:
        maps: Per kind of verdict.
        ranges: Per number, its least and greatest value in the draw.
        sets: Per word, the values that the draw held.
        beyond: Per kind of verdict what the logit loses outside the range, learnt on other hands' campaigns.
    """

    maps: dict[str, Logistic]
    ranges: dict[str, tuple[float, float]]
    sets: dict[str, tuple[str, ...]]
    beyond: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Calibrated:
    """A verdict's probability, and whether it may be taken as one.

    Attributes:
        probability: By the map where there is one for this verdict; outside its range less sure, by what is known there; as
            stated without a map.
        in_domain: Whether the campaign lies in the calibrated range.
        reason: What lies outside, else ``None``.
    """

    probability: float
    in_domain: bool
    reason: str | None


def kind_of(verdict: str, reason: str | None) -> str:
    """none, effects, outside-catalogue or not-identifiable."""
    return str(reason) if verdict == "unknown" else verdict


def features(diagnosis: Diagnosis) -> dict[str, Any]:
    """What the map and its range look at, as plain data (``calibration.features``)."""
    problem, decision = diagnosis.problem, diagnosis.decision
    outputs = [(run, output) for run in problem.runs for output in run.outputs]
    noise = diagnosis.judgement.noise
    ratios = [
        dynamic_level(o) / noise.blocks[block_key(r, o)].marginal
        for r, o in outputs
        if block_key(r, o) in noise.blocks and noise.blocks[block_key(r, o)].marginal > 0.0
    ]
    rates = [o.rate for _, o in outputs]
    theta, _ = diagnosis.judgement.base.fit.coordinates.unpack(diagnosis.judgement.base.fit.x)
    stiffness, inertia = float(theta[BASE_INDEX["stiffness"]]), float(theta[BASE_INDEX["load_inertia"]])
    resonance = math.sqrt(stiffness / inertia) / (2.0 * math.pi) if min(stiffness, inertia) > 0.0 else 0.0
    ranking = decision.ranking
    margin = ranking[0].score - ranking[1].score if len(ranking) > 1 else 50.0
    stated = float(np.clip(decision.probability, 1e-4, 1.0 - 1e-4))
    return {
        "stated": math.log(stated / (1.0 - stated)),
        "margin": math.log1p(max(margin, 0.0)),
        "base_left": math.log(max(decision.adequacy.base_left, 1e-4)),
        "model_left": math.log(max(decision.adequacy.model_left, 1e-4)),
        "explained": float(np.clip(np.nan_to_num(decision.adequacy.explained, nan=1.0), 0.0, 1.0)),
        "further": float(max(len(ranking[0].names) - 1, 0)),
        "runs": len(problem.runs),
        "slowest_rate_hz": min(rates, default=0.0),
        "fastest_rate_hz": max(rates, default=0.0),
        "snr_db": 20.0 * math.log10(max(float(np.median(ratios)), 1e-6)) if ratios else 0.0,
        "resonance_hz": resonance,
        "experiments": " + ".join(sorted({run.run.experiment for run in problem.runs})),
        "channels": " + ".join(sorted({f"{o.quantity} at {o.location}" for _, o in outputs})),
        "topology": problem.rig.topology,
        "motion": problem.rig.motion,
    }


def outside(found: Mapping[str, Any], learnt: CalibrationMap) -> str | None:
    """What of a campaign lies outside the calibrated range, in words; ``None`` inside."""
    for name in SETS:
        if found[name] not in learnt.sets.get(name, ()):
            return f"{name}: {found[name]} did not occur in the calibration"
    for name in RANGES:
        low, high = learnt.ranges[name]
        slack = SLACK * max(high - low, 0.0)
        if not low - slack <= found[name] <= high + slack:
            return f"{name}: {found[name]:.4g} lies outside the calibrated {low:.4g} to {high:.4g}"
    return None


def calibrate(found: Mapping[str, Any], kind: str, stated: float, learnt: CalibrationMap | None) -> Calibrated:
    """The verdict's probability by what was learnt."""
    if learnt is None:
        return Calibrated(stated, False, "no calibration has been learnt")
    reason = outside(found, learnt)
    if reason is None and kind not in learnt.maps:
        reason = f"too few answers of the kind {kind} in the calibration"
    if kind not in learnt.maps:
        return Calibrated(stated, False, reason)
    if reason is not None:
        return Calibrated(shifted(learnt.maps[kind](found), learnt.beyond.get(kind, 0.0)), False, reason)
    return Calibrated(learnt.maps[kind](found), True, None)


def shifted(probability: float, by: float) -> float:
    """The probability whose logit is larger ``by`` that much."""
    odds = probability / max(1.0 - probability, 1e-12) * math.exp(by)
    return odds / (1.0 + odds)


def as_known(decision: Decision, known: float) -> Decision:
    """The decision whose ranking says what is known of the answer: the chosen set has its probability, the others what is left.

    Without a name for what is there, all named sets together have what the verdict leaves them.
    """
    if decision.unknown_reason == "not-identifiable":
        return decision
    unnamed = decision.verdict == "unknown"
    chosen = None if unnamed else decision.chosen.names
    others = sum(r.probability for r in decision.ranking if r.names != chosen)
    share = min(1.0, (1.0 - known) / others) if others > 0.0 else 1.0
    ranking = tuple(
        replace(r, probability=known if r.names == chosen else share * r.probability) for r in decision.ranking
    )
    return replace(decision, ranking=ranking)


def read_map(text: str) -> CalibrationMap:
    """The map from its file's text."""
    content = json.loads(text)
    if content.get("format") != FORMAT or tuple(content["inputs"]) != INPUTS:
        raise ValueError(f"{NAME}: written for other inputs than {', '.join(INPUTS)}; calibrate anew")
    return CalibrationMap(
        {k: Logistic(m["intercept"], tuple(m["weights"]), m["cases"]) for k, m in content["maps"].items()},
        {k: (float(v[0]), float(v[1])) for k, v in content["ranges"].items()},
        {k: tuple(v) for k, v in content["sets"].items()},
        {k: float(v) for k, v in content.get("beyond", {}).items()},
    )


@lru_cache(maxsize=1)
def learnt_map() -> CalibrationMap | None:
    """The map that came with the package; ``None`` without one."""
    file = files("jointscope.diagnosis").joinpath(NAME)
    return read_map(file.read_text(encoding="utf-8")) if file.is_file() else None
