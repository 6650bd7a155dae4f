"""Which hypothesis the recordings carry: evidence on the fitted runs, prediction of the held-out ones, materiality.

All hypotheses are judged by one noise model, that of the best one's residual, so that structured misfit which no
hypothesis explains counts as noise (overdispersion; B.2, stage 7). A child stands over its parent only where it
 - is real: its likelihood gain exceeds the parameters' Occam cost and a margin for the number of candidates tried,
 - carries over: runs that were not fitted gain in proportion to what it changes in them, and not by one run alone,
 - is material: it lowers some channel's relative error by more than a stated amount.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.absence import of_its_own, shown_in_absence
from jointscope.diagnosis.base import Stage, of_further_runs, rewhiten
from jointscope.diagnosis.echo import Echo, echoes, from_noise_alone, redriven, relogs
from jointscope.diagnosis.effects.spec import made_to_show
from jointscope.diagnosis.energies import (
    Energies,
    by_experiment,
    drowned,
    error_energies,
    heard,
    improvement,
    in_proportion,
)
from jointscope.diagnosis.forms_left import beyond_forms
from jointscope.diagnosis.gates import AS_FORETOLD, REAL, TELLING, WITNESSES, Comparison
from jointscope.diagnosis.intervals import like_nothing
from jointscope.diagnosis.noise import MAX_ORDER, NoiseModel
from jointscope.diagnosis.objective import DIVERGED, Objective, Predictions
from jointscope.diagnosis.polish import (
    anew,
    from_elsewhere,
    leaders_polished,
    no_part_below_the_base,
    occam,
    parts_of,
)
from jointscope.diagnosis.refit import Fit
from jointscope.diagnosis.resonant import only_at_resonance
from jointscope.diagnosis.search import Hypothesis
from jointscope.diagnosis.silent_bands import silent_bands
from jointscope.diagnosis.struck import modes, unheard
from jointscope.diagnosis.twins import twins

Vector = NDArray[np.float64]
REAL_RESONANT = 200.0  # of a line from outside that falls onto the joint's own resonance, where everything rings
PROFILED = 1.0  # nats that a number fitted anew in every run gains from noise alone
REAL_SORTED = 60.0  # of effects whose runs were sorted by what all runs say, held-out ones too
REAL_PICKED = 60.0  # of an order that was picked out of all orders
REAL_PLACE = 120.0  # of a stop's place, which is sought in all of a travel and once more to either side
REAL_UNREVEALED = 300.0  # of an effect that these experiments are not made to show
REAL_TOGETHER = 150.0  # per effect of a set no part of which explains anything by itself
PRIOR_SIZE = (math.log(0.5), math.log(0.35), math.log(0.12), math.log(0.03))
ELSEWHERE = 2  # of them whose base parameters the base is refitted from
ASKED = 3  # sets that are asked what no other form of their parts could do
FORETELLING = 8  # leading hypotheses that are asked what is left of held-out runs, where the likeliest goes astray
MORE = 30.0  # nats by which one effect that is too small to matter must lead what stands
UNREACHED = 0.02  # of the gain in proportion, below which the held-out runs are foretold to show nothing of it
UNREACHED_PLACE = 0.1  # the same of an effect of one place or level: the base, which moves too, foretells that
APART = 2  # fitted runs that must each show what no held-out run can
VOTES = 0.5  # nats that are foretold of a held-out run, below which it can't say whether it gains


@dataclass(frozen=True, eq=False)
class Judged:
    """A hypothesis with its evidence under the common noise model.

    Attributes:
        fitted: w'w of every fitted run, shape (n_fitted,).
        held_out: w'w of every held-out run, shape (n_held,).
        left_held: w of every held-out run.
        occam: k/2 ln(nu) of its effects' parameters, and what their runs' own numbers gain by chance [nats].
        occam_held: The latter on the held-out runs [nats].
        energies: Per experiment and channel: squared error of all runs, and squared signal.
        predictions: Of the fitted runs.
        predictions_held: Of the held-out runs.
    """

    hypothesis: Hypothesis
    fitted: Vector
    held_out: Vector
    left_held: tuple[Vector, ...]
    occam: float
    occam_held: float
    energies: Energies
    predictions: Predictions
    predictions_held: Predictions

    @property
    def chi2(self) -> float:
        """w'w over the fitted runs."""
        return float(np.sum(self.fitted))

    @property
    def names(self) -> tuple[str, ...]:
        """``effect@location``, sorted; empty for the base."""
        return self.hypothesis.names

    @property
    def fit(self) -> Fit:
        """The fit under the common noise."""
        return self.hypothesis.fit


@dataclass(frozen=True, eq=False)
class Judgement:
    """All hypotheses under one noise model, the base first.

    Attributes:
        objective: The fitted runs, whitened.
        held: The held-out runs, whitened likewise.
        echo: What the noise of a torque log makes the leading hypothesis do, over fitted and held-out runs.
        noisy: What further noises make any of them do, see :func:`echo.redriven`; found when first asked for.
    """

    judged: tuple[Judged, ...]
    objective: Objective
    held: Objective
    noise: NoiseModel
    echo: Echo
    noisy: Callable[[Judged], dict[int, Vector]]

    @property
    def base(self) -> Judged:
        """The base alone."""
        return self.judged[0]


def _bounded(objective: Objective, hypotheses: Sequence[Hypothesis]) -> list[Hypothesis]:
    """Without leading ones that diverge on runs they were not searched on."""
    kept = list(hypotheses)
    while kept:
        best = min(kept, key=lambda h: h.loss)
        if DIVERGED not in objective.residual(best.fit.x, best.fit.coordinates):
            break
        kept.remove(best)
    return kept


def judge(stage: Stage, hypotheses: Sequence[Hypothesis], held_runs: tuple[int, ...]) -> Judgement:
    """Put the base and every hypothesis on the noise of the best, refit the leading ones, predict the held-out runs."""
    objective, noise = stage.objective, stage.noise
    everything = [Hypothesis((), stage.fit, 0.0), *_bounded(objective, hypotheses)]
    best = min(everything[1:], key=lambda h: h.loss, default=everything[0])
    for _ in range(2):
        objective, noise, _ = rewhiten(objective, best.fit, noise, MAX_ORDER)
        everything = anew(objective, everything)
        everything = leaders_polished(objective, everything)
        before, best = best, min(everything, key=lambda h: h.loss)
        if best.names == before.names:
            break
    leading = sorted(everything[1:], key=lambda h: h.loss)[:ELSEWHERE]
    everything[0] = from_elsewhere(objective, everything[0], leading)
    everything.extend(parts_of(objective, min(everything, key=lambda h: h.loss)))
    alone = min((h.loss for h in everything if len(h.names) == 1), default=math.inf)
    for pair in [h for h in everything if len(h.names) == 2 and h.loss < alone]:
        everything.extend(parts_of(objective, pair, {h.names for h in everything}))
    everything = no_part_below_the_base(objective, everything)
    everything.extend(twins(objective.problem, everything))
    known = (best, everything[0], *sorted(everything[1:], key=lambda h: h.loss)[:FORETELLING])
    models = [h.fit.coordinates.unpack(h.fit.x) for h in known]
    held, noise, _ = of_further_runs(objective, held_runs, noise, MAX_ORDER, models)
    judged = tuple(evidence(h, objective, held) for h in everything)
    whole = replace(
        objective, runs=(*objective.runs, *held_runs), whiteners=(*objective.whiteners, *held.whiteners)
    )
    logs = relogs(whole)
    echo = echoes(whole, logs, *best.fit.coordinates.unpack(best.fit.x))

    @functools.cache
    def noisy(judged: Judged) -> dict[int, Vector]:
        return redriven(whole, logs, *judged.fit.coordinates.unpack(judged.fit.x))

    return Judgement(judged, objective, held, noise, echo, noisy)


def profiled(hypothesis: Hypothesis) -> int:
    """Numbers of a hypothesis that every run has for itself."""
    return sum(spec.profiled for spec in hypothesis.fit.coordinates.effects)


def evidence(hypothesis: Hypothesis, objective: Objective, held: Objective) -> Judged:
    """A hypothesis as it stands, under the noise of ``objective`` and ``held``."""
    theta, effects = hypothesis.fit.coordinates.unpack(hypothesis.fit.x)
    predictions, held_predictions = objective.predictions(theta, effects), held.predictions(theta, effects)
    fitted = _energy(_per_run(objective, predictions))
    left_held = _per_run(held, held_predictions)
    samples = sum(sum(w.sizes) for w in objective.whiteners)
    energies = error_energies(
        (*objective.prepared, *held.prepared),
        (*predictions, *held_predictions),
        (*objective.whiteners, *held.whiteners),
    )
    return Judged(
        hypothesis,
        fitted,
        _energy(left_held),
        left_held,
        occam(hypothesis, samples) + PROFILED * len(objective.runs) * profiled(hypothesis),
        PROFILED * len(held.runs) * profiled(hypothesis),
        energies,
        predictions,
        held_predictions,
    )


def _per_run(objective: Objective, predictions: Predictions) -> tuple[Vector, ...]:
    return tuple(objective.whiten_run(i, p) for i, p in enumerate(predictions))


def _energy(left: Sequence[Vector]) -> Vector:
    return np.array([float(w @ w) for w in left])


def differences(judgement: Judgement, one: Judged, other: Judged) -> list[Vector]:
    """What two hypotheses predict differently, whitened, per fitted and held-out run."""
    fitted = [(one.fit.w - other.fit.w)[rows] for rows in judgement.objective.slices]
    return [*fitted, *(a - b for a, b in zip(one.left_held, other.left_held, strict=True))]


def compare(judgement: Judgement, parent: Judged, child: Judged) -> Comparison:
    """The child's case against the parent."""
    sizes = np.array([sum(w.sizes) for w in judgement.objective.whiteners])
    overdispersion = max(1.0, min(parent.chi2, child.chi2) / max(int(sizes.sum()), 1))
    fitted = 0.5 * (parent.fitted - child.fitted) / overdispersion
    held = 0.5 * (parent.held_out - child.held_out) / overdispersion
    runs = (*judgement.objective.prepared, *judgement.held.prepared)
    gained = by_experiment(np.concatenate([fitted, held]), runs)
    along = judgement.echo.along(runs, differences(judgement, parent, child))
    silent = drowned(
        judgement.echo,
        parent.energies,
        child.energies,
        gained,
        along,
        lambda: from_noise_alone(runs, judgement.noisy(parent), judgement.noisy(child)),
    )
    silent |= silent_bands(judgement.objective, parent.fit.w, child.fit.w, gained)
    raw = heard(fitted, judgement.objective.prepared, silent)
    parent_gain = 0.5 * (judgement.base.chi2 - parent.chi2) / overdispersion
    parent_gain += 0.5 * float(np.sum(judgement.base.held_out - parent.held_out)) / overdispersion
    followed = {kind: energy for kind, energy in judgement.echo.energies.items() if str(kind[0]) in silent}
    material, share, rest = improvement(judgement.base.energies, parent.energies, child.energies, followed)
    held_gain, expected, foretold, agreeing, lost, votes = math.nan, math.nan, math.nan, math.nan, math.nan, 0
    if child.held_out.size:
        held = heard(held, judgement.held.prepared, silent)
        held_gain = float(np.sum(held)) - child.occam_held + parent.occam_held
        lost = float(-np.sum(held[held < 0.0]))
        moved = _energy([p - c for p, c in zip(parent.left_held, child.left_held, strict=True)])
        told = 0.5 * moved / overdispersion
        foretold = float(np.sum(told))
        voters = told > VOTES if np.any(told > VOTES) else np.ones(told.shape, dtype=bool)
        agreeing, votes = float(np.mean(held[voters] > 0.0)), int(np.sum(voters))
        expected = in_proportion(judgement.objective, judgement.held, raw)
    gain = float(np.sum(raw)) - child.occam + parent.occam
    added = [s for s in child.hypothesis.specs if f"{s.name}@{s.location}" not in parent.names]
    elsewhere = any(s.local for s in added) and foretold < UNREACHED_PLACE * expected
    # Nor do held-out runs of other experiments alone show what several fitted runs do.
    apart = int(np.sum(raw > REAL)) >= APART and foretold < UNREACHED * gain
    return Comparison(
        gain=gain,
        held_gain=held_gain,
        expected_held=expected,
        foretold_held=foretold,
        share_of_runs=agreeing,
        votes=votes,
        lost=lost,
        material=material,
        share=share,
        parents=len(parent.names),
        parent_gain=parent_gain,
        unreached=elsewhere or apart,
        rest=rest,
        exact=all(spec.exact for spec in parent.hypothesis.specs),
        from_outside=bool(added) and all(s.profiled for s in added),
    )


def score(judgement: Judgement, candidate: Judged) -> float:
    """ln evidence relative to the base: fitted gain net of Occam, held-out gain, prior of the number of effects [nats]."""
    against = compare(judgement, judgement.base, candidate)
    held = 0.0 if math.isnan(against.held_gain) else against.held_gain
    return against.gain + held + PRIOR_SIZE[min(len(candidate.names), 3)]


def _rings(judgement: Judgement, child: Judged, parent: Judged) -> bool:
    """Whether the child adds a line at the joint's own resonance, which broadband noise leaves there as well.

    Noise rings at another size in every run: there a line must be what was foretold of it.
    """
    if not only_at_resonance(judgement, child, parent):
        return False
    found = compare(judgement, parent, child)
    return found.gain < REAL_RESONANT or found.held_gain < AS_FORETOLD * found.foretold_held


def _unheard(judgement: Judgement, child: Judged, parent: Judged) -> bool:
    """Whether the child adds a mode that the hits do not show."""
    if not modes(child.hypothesis) - set(parent.names):
        return False
    gains = 0.5 * np.concatenate([parent.fitted - child.fitted, parent.held_out - child.held_out])
    return unheard((*judgement.objective.prepared, *judgement.held.prepared), gains)


def _beyond_the_search(judgement: Judgement, child: Judged, parts: Sequence[Judged]) -> bool:
    """Whether an order picked out of hundreds, or a place out of all of a travel, gains more than the best by chance.

    An order's gain on fitted and held-out runs counts together; a place's, which many of them never come to, does not.
    """
    asked = {f"{s.name}@{s.location}": REAL_PICKED for s in child.hypothesis.specs if s.family == "periodic"}
    asked |= {f"{s.name}@{s.location}": REAL_PLACE for s in child.hypothesis.specs if s.local}
    for part in parts:
        picked = [least for name, least in asked.items() if name not in part.names]
        if not picked:
            continue
        found, most = compare(judgement, part, child), max(picked)
        unseen = found.held_gain  # by runs that no search saw
        told = unseen > most or (most == REAL_PICKED and unseen > TELLING and found.gain + unseen > most)
        if found.gain <= most and not (found.gain > REAL and told):
            return False
    return True


def _revealed(judgement: Judgement, child: Judged, parts: Sequence[Judged]) -> bool:
    """Whether an effect that none of these experiments is made for gains more than what is left of another one does."""
    runs = (*judgement.objective.prepared, *judgement.held.prepared)
    hardly = {f"{s.name}@{s.location}" for s in child.hypothesis.specs if not made_to_show(s, runs)}
    without = [part for part in parts if hardly - set(part.names)]
    return not hardly or all(compare(judgement, part, child).gain > REAL_UNREVEALED for part in without)


def standing(judgement: Judgement) -> list[Judged]:
    """Hypotheses that stand over the base and over the best law of every fitted part of themselves, best score first."""
    found: list[Judged] = []
    small: list[Judged] = []
    asked: list[tuple[Judged, list[tuple[Judged, Comparison]]]] = []
    best = {j.names: j for j in sorted(judgement.judged, key=lambda j: score(judgement, j))}
    for child in judgement.judged[1:]:
        parts = [part for names, part in best.items() if set(names) < set(child.names)]
        alone = max((len(p.names) for p in parts), default=0) + 1 < len(child.names)
        if alone and compare(judgement, judgement.base, child).gain < len(child.names) * REAL_TOGETHER:
            continue  # no part of it was worth fitting by itself
        over = [compare(judgement, part, child) for part in parts]
        slight = not all(c.stands or c.perhaps_beside for c in over)
        if slight and not (len(child.names) == 1 and all(c.stands_but_for_size for c in over)):
            continue
        if any(_rings(judgement, child, part) or _unheard(judgement, child, part) for part in parts):
            continue
        if not child.hypothesis.sensible:
            continue
        sorted_runs = [spec.name for spec in child.hypothesis.specs if spec.run_weights is not None]
        without = [p for p in parts if not any(n.partition("@")[0] in sorted_runs for n in p.names)]
        if sorted_runs and not all(compare(judgement, part, child).beyond(REAL_SORTED) for part in without):
            continue
        if not _beyond_the_search(judgement, child, parts) or not _revealed(judgement, child, parts):
            continue
        seen_by_all = all(c.votes >= WITNESSES and c.evident and c.share_of_runs == 1.0 for c in over)
        nothing = like_nothing(judgement.objective, child.fit)
        if nothing and not (seen_by_all and all(len(spec.parameters) > 1 for spec in nothing)):
            continue  # of an amplitude that its own shape can undo an interval says nothing
        weak = [(part, c) for part, c in zip(parts, over, strict=True) if not c.stands]
        if slight:
            small.append(child)
        elif weak:
            asked.append((child, weak))
        elif parts:
            found.append(child)
    found.extend(_of_their_own(judgement, asked, max((score(judgement, j) for j in found), default=0.0)))
    least = max((score(judgement, j) for j in found), default=math.inf) + MORE
    found.extend(j for j in small if score(judgement, j) > least)  # not given up for what explains less by more
    return sorted(found, key=lambda j: -score(judgement, j))


def _of_their_own(
    judgement: Judgement, asked: Sequence[tuple[Judged, list[tuple[Judged, Comparison]]]], lead: float
) -> list[Judged]:
    """Of sets that would lead, those that show beside each part what no other form of it could: the best few are asked."""
    found: list[Judged] = []
    would = sorted((a for a in asked if score(judgement, a[0]) > lead), key=lambda a: -score(judgement, a[0]))
    for agreeing, shown in ((True, of_its_own), (False, shown_in_absence)):
        leading: dict[tuple[str, ...], tuple[Judged, list[tuple[Judged, Comparison]]]] = {}
        for child, weak in would:
            if all(c.beside for _, c in weak) is agreeing:
                leading.setdefault(child.names, (child, weak))
        for child, weak in list(leading.values())[:ASKED]:
            left = [part for part, c in weak if not (agreeing and beyond_forms(judgement.judged, part, c))]
            if all(shown(judgement, part, child) for part in left):
                found.append(child)
    return found
