"""Which hypothesis the recordings carry: evidence on the fitted runs, prediction of the held-out ones, materiality.

All hypotheses are judged by one noise model, that of the best one's residual, so that structured misfit which no
hypothesis explains counts as noise (overdispersion; B.2, stage 7). A child stands over its parent only where it
 - is real: its likelihood gain exceeds the parameters' Occam cost and a margin for the number of candidates tried,
 - carries over: runs that were not fitted gain in proportion, and not by one run alone,
 - is material: it lowers some channel's relative error by more than a stated amount.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.base import Stage, rewhiten
from jointscope.diagnosis.excitation import asked_only, below_excitation
from jointscope.diagnosis.noise import MAX_ORDER, NoiseModel, dynamic_level
from jointscope.diagnosis.objective import Objective, Predictions, whitened
from jointscope.diagnosis.per_run import labelling_cost
from jointscope.diagnosis.refit import Fit, least_squares
from jointscope.diagnosis.search import Hypothesis

if TYPE_CHECKING:
    from jointscope.diagnosis.prepare import PreparedRun

Vector = NDArray[np.float64]

REAL = 8.0  # nats beyond the Occam cost, ~ ln of the candidates tried plus odds of 20 to 1
REAL_FURTHER = 20.0  # the same of any further effect, which has the rest of an imperfect law to feed on
OF_PARENT = 0.005  # and of the parent's own gain over the base
CARRIES_OVER = 0.35  # held-out gain per sample over fitted gain per sample
MATERIAL = 0.002  # drop of RMS error over RMS signal, in the channel and experiment that show it most
SHARES = (
    0.02,
    0.08,
    0.15,
)  # of the parent's error that a first, second, third effect must remove, where it removes most
PRIOR_SIZE = (math.log(0.5), math.log(0.35), math.log(0.12), math.log(0.03))
POLISHED = 4  # leading hypotheses that are refitted under the final noise


@dataclass(frozen=True, eq=False)
class Judged:
    """A hypothesis with its evidence under the common noise model.

    Attributes:
        chi2: w'w over the fitted runs.
        held_out: w'w of every held-out run, shape (n_held,).
        samples_held: Scored samples of each.
        occam: k/2 ln(nu) of its effects' parameters [nats].
        predictions: Of the fitted runs.
        predictions_held: Of the held-out runs.
    """

    hypothesis: Hypothesis
    chi2: float
    held_out: Vector
    occam: float
    predictions: Predictions
    predictions_held: Predictions

    @property
    def names(self) -> tuple[str, ...]:
        """``effect@location``, sorted; empty for the base."""
        return self.hypothesis.names

    @property
    def fit(self) -> Fit:
        """The fit under the common noise."""
        return self.hypothesis.fit


@dataclass(frozen=True, eq=False)
class Comparison:
    """A child against a parent.

    Attributes:
        gain: Likelihood gain on the fitted runs net of Occam [nats].
        held_gain: On the held-out runs [nats]; ``nan`` without any.
        expected_held: What the fitted gain would make of it in proportion to the samples [nats].
        share_of_runs: Held-out runs that gain.
        material: Largest drop of relative error over channels and experiments [-].
        share: Largest drop of error relative to the parent's [-].
        parents: Effects of the parent: a further effect must explain more of what is left, since what a law of
            the right name but the wrong form leaves is always explained by something.
        parent_gain: The parent's gain over the base [nats].
    """

    gain: float
    held_gain: float
    expected_held: float
    share_of_runs: float
    material: float
    share: float
    parents: int
    parent_gain: float

    @property
    def real(self) -> bool:
        """Beyond chance on the fitted runs."""
        return self.gain > (REAL if self.parents == 0 else max(REAL_FURTHER, OF_PARENT * self.parent_gain))

    @property
    def carries_over(self) -> bool:
        """Held-out runs agree; vacuous without any."""
        if math.isnan(self.held_gain):
            return True
        return self.held_gain > max(2.0, CARRIES_OVER * self.expected_held) and self.share_of_runs >= 0.5

    @property
    def stands(self) -> bool:
        """Real, carried over and material."""
        needed = SHARES[min(self.parents, len(SHARES) - 1)]
        return self.real and self.carries_over and self.material > MATERIAL and self.share > needed


@dataclass(frozen=True, eq=False)
class Judgement:
    """All hypotheses under one noise model, the base first.

    Attributes:
        objective: The fitted runs, whitened.
        held: The held-out runs, whitened likewise.
    """

    judged: tuple[Judged, ...]
    objective: Objective
    held: Objective
    noise: NoiseModel

    @property
    def base(self) -> Judged:
        """The base alone."""
        return self.judged[0]


def judge(stage: Stage, hypotheses: Sequence[Hypothesis], held_runs: tuple[int, ...]) -> Judgement:
    """Put the base and every hypothesis on the noise of the best, refit the leading ones, predict the held-out runs."""
    everything = [Hypothesis((), stage.fit, 0.0), *hypotheses]
    objective, noise = stage.objective, stage.noise
    best = min(everything[1:], key=lambda h: h.loss, default=everything[0])
    for _ in range(2):
        objective, noise, _ = rewhiten(objective, best.fit, noise, MAX_ORDER)
        everything = [_viewed(objective, h) for h in everything]
        leading = sorted(everything[1:], key=lambda h: h.loss)[:POLISHED]
        parts = [h for h in everything if any(set(h.names) < set(lead.names) for lead in leading)]
        again = {id(h) for h in (*leading, *parts)}
        everything = [_polished(objective, h) if id(h) in again else h for h in everything]
        before, best = best, min(everything, key=lambda h: h.loss)
        if best.names == before.names:
            break
    held = replace(objective, runs=held_runs, whiteners=())
    held = whitened(held, noise, held.predictions(*best.fit.coordinates.unpack(best.fit.x)))
    judged = tuple(evidence(h, objective, held) for h in everything)
    return Judgement(judged, objective, held, noise)


def _viewed(objective: Objective, hypothesis: Hypothesis) -> Hypothesis:
    w = objective.residual(hypothesis.fit.x, hypothesis.fit.coordinates)
    fit = replace(hypothesis.fit, w=w, fresh=False)
    return replace(hypothesis, fit=fit, loss=0.5 * fit.chi2 + _occam(hypothesis, len(w)))


def _polished(objective: Objective, hypothesis: Hypothesis) -> Hypothesis:
    fit = least_squares(objective, hypothesis.fit.coordinates, hypothesis.fit.x, iterations=8)
    return replace(hypothesis, fit=fit, loss=0.5 * fit.chi2 + _occam(hypothesis, len(fit.w)))


def _occam(hypothesis: Hypothesis, samples: int) -> float:
    where = hypothesis.fit.coordinates
    chosen_runs = sum(labelling_cost(spec) for spec in where.effects)
    return 0.5 * (where.n - where.n_base) * math.log(max(samples, 2)) + chosen_runs


def evidence(hypothesis: Hypothesis, objective: Objective, held: Objective) -> Judged:
    """A hypothesis as it stands, under the noise of ``objective`` and ``held``."""
    theta, effects = hypothesis.fit.coordinates.unpack(hypothesis.fit.x)
    predictions = objective.predictions(theta, effects)
    w = np.concatenate([objective.whiten_run(i, p) for i, p in enumerate(predictions)])
    held_predictions = held.predictions(theta, effects)
    held_chi2 = np.array([float(np.sum(np.square(held.whiten_run(i, p)))) for i, p in enumerate(held_predictions)])
    return Judged(hypothesis, float(w @ w), held_chi2, _occam(hypothesis, len(w)), predictions, held_predictions)


def improvement(runs: Sequence[PreparedRun], before: Predictions, after: Predictions) -> tuple[float, float]:
    """Largest drop of RMS error, over the signal's RMS and over the error before, of any experiment and channel [-].

    An angle's signal is what it does within a quarter second: slower than that the observer follows the recording.
    """
    pooled: dict[tuple[object, ...], list[float]] = {}
    for run, a, b in zip(runs, before, after, strict=True):
        for output, ya, yb in zip(run.outputs, a, b, strict=True):
            key = (run.run.experiment, output.quantity, output.location, output.direction)
            total = pooled.setdefault(key, [0.0, 0.0, 0.0])
            cut = below_excitation(run, output)
            for k, y in enumerate((ya, yb)):
                x = asked_only(output.data - y, cut)[output.mask]
                total[k] += float(x @ x)
            total[2] += dynamic_level(output) ** 2 * int(output.mask.sum())
    drops = [
        ((math.sqrt(p) - math.sqrt(c)) / math.sqrt(s), 1.0 - math.sqrt(c / p))
        for p, c, s in pooled.values()
        if s > 0.0 and p > 0.0
    ]
    absolute = max((a for a, _ in drops), default=0.0)
    return absolute, max((r for a, r in drops if a > MATERIAL), default=0.0)


def compare(judgement: Judgement, parent: Judged, child: Judged) -> Comparison:
    """The child's case against the parent."""
    samples = max(len(parent.fit.w), 1)
    overdispersion = max(1.0, min(parent.chi2, child.chi2) / samples)
    raw = 0.5 * (parent.chi2 - child.chi2) / overdispersion
    parent_gain = 0.5 * (judgement.base.chi2 - parent.chi2) / overdispersion
    runs = (*judgement.objective.prepared, *judgement.held.prepared)
    material, share = improvement(
        runs, (*parent.predictions, *parent.predictions_held), (*child.predictions, *child.predictions_held)
    )
    if child.held_out.size == 0:
        return Comparison(
            raw - child.occam + parent.occam,
            math.nan,
            math.nan,
            math.nan,
            material,
            share,
            len(parent.names),
            parent_gain,
        )
    held = 0.5 * (parent.held_out - child.held_out) / overdispersion
    sizes = sum(sum(w.sizes) for w in judgement.held.whiteners)
    return Comparison(
        raw - child.occam + parent.occam,
        float(np.sum(held)),
        raw * sizes / samples,
        float(np.mean(held > 0.0)),
        material,
        share,
        len(parent.names),
        parent_gain,
    )


def score(judgement: Judgement, candidate: Judged) -> float:
    """ln evidence relative to the base: fitted gain net of Occam, held-out gain, prior of the number of effects [nats]."""
    against = compare(judgement, judgement.base, candidate)
    held = 0.0 if math.isnan(against.held_gain) else against.held_gain
    return against.gain + held + PRIOR_SIZE[min(len(candidate.names), 3)]


def standing(judgement: Judgement) -> list[Judged]:
    """Hypotheses that stand over the base and over every fitted part of themselves, best score first."""
    found = []
    for child in judgement.judged[1:]:
        parts = [p for p in judgement.judged if set(p.names) < set(child.names)]
        if parts and all(compare(judgement, part, child).stands for part in parts):
            found.append(child)
    return sorted(found, key=lambda j: -score(judgement, j))
