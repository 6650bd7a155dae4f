"""A campaign's diagnosis from end to end: prepare, split, refit the base, screen, fit, extend, judge, decide.

This is the file to read first. Every stage returns a new frozen object; nothing here touches a file.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from jointscope.diagnosis.adjudicate import Judgement, compare, judge
from jointscope.diagnosis.base import EARLY_ORDER, Stage, refit_base, rewhiten
from jointscope.diagnosis.objective import Predict
from jointscope.diagnosis.refit import least_squares
from jointscope.diagnosis.search import (
    Effort,
    Hypothesis,
    Screening,
    candidates_for,
    extend,
    fit_pairs,
    fit_singles,
    profile_loss,
    screen_on,
)
from jointscope.diagnosis.split import Split, split_runs
from jointscope.diagnosis.verdict import Decision, decide

if TYPE_CHECKING:
    from jointscope.diagnosis.effects import EffectSpec
    from jointscope.diagnosis.prepare import Problem

Report = Callable[[str], None]


def silent(_: str) -> None:
    """Report nothing."""


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """Everything that was concluded, and what it rests on.

    Attributes:
        stage: The refitted base.
        screening: The score tests on top of it.
        judgement: Every fitted hypothesis under one noise model.
        decision: Verdict, ranking and probabilities.
    """

    problem: Problem
    split: Split
    stage: Stage
    screening: Screening
    judgement: Judgement
    decision: Decision


def _restaged(stage: Stage, parent: Hypothesis) -> tuple[Stage, Hypothesis]:
    """The parent refitted, Jacobian fresh, under the noise of its own residual."""
    objective, noise, predictions = rewhiten(stage.objective, parent.fit, stage.noise, EARLY_ORDER)
    fit = least_squares(objective, parent.fit.coordinates, parent.fit.x, iterations=8, tolerance=1e-3)
    return replace(stage, objective=objective, noise=noise, predictions=predictions), replace(
        parent, fit=fit, loss=profile_loss(objective, fit.w)
    )


def explore(
    stage: Stage, specs: Sequence[EffectSpec], effort: Effort, report: Report
) -> tuple[Screening, list[Hypothesis]]:
    """Every hypothesis worth judging, fitted to the runs of ``stage``."""
    candidates = candidates_for(stage.objective.problem, specs)
    report(f"screening {len(candidates)} candidate laws")
    screening = screen_on(stage.objective, stage.fit, candidates, effort)
    report("fitting single effects")
    singles = fit_singles(stage.objective, stage.fit, screening, effort)
    found = list(singles)
    if not singles:
        return screening, found
    report("fitting pairs")
    base_loss = profile_loss(stage.objective, stage.fit.w)
    parents = [s for s in singles[: effort.beam] if s.loss < base_loss]
    for size in range(2, effort.size + 1):
        children: list[Hypothesis] = []
        for parent in parents:
            restaged, refitted = _restaged(stage, parent)
            found.append(refitted)
            children.extend(extend(restaged.objective, refitted, candidates, effort))
        if size == 2:
            children.extend(fit_pairs(stage.objective, stage.fit, screening, [c.names for c in children], effort))
        found.extend(children)
        ordered = sorted(children, key=lambda h: h.loss)
        parents = ordered[:1]
        if not parents or not _promising(stage, parents[0]):
            break
        report(f"fitting sets of {size + 1}")
    return screening, found


def _promising(stage: Stage, child: Hypothesis) -> bool:
    """Whether a set is worth extending: it must beat the base by more than its parameters cost."""
    k = child.fit.coordinates.n - child.fit.coordinates.n_base
    return profile_loss(stage.objective, stage.fit.w) - child.loss > 10.0 * k


def diagnose(
    problem: Problem,
    predict: Predict,
    specs: Sequence[EffectSpec],
    pool: ThreadPoolExecutor,
    *,
    effort: Effort | None = None,
    report: Report = silent,
) -> Diagnosis:
    """Diagnose a prepared campaign.

    Args:
        predict: The forward model, ``channels.predict_outputs`` in production.
        specs: The catalogue with the bounds of this rig.
        pool: Threads that run the simulations; the answer does not depend on their number.
        report: Told of every stage as it begins.
    """
    effort = effort or Effort()
    split = split_runs(problem)
    report(f"refitting the base model to {len(split.estimate)} runs")
    stage = refit_base(problem, predict, split.estimate, pool)
    screening, hypotheses = explore(stage, specs, effort, report)
    report(f"judging {len(hypotheses)} hypotheses on {len(split.held_out)} held-out runs")
    judgement = judge(stage, hypotheses, split.held_out)
    decision = decide(judgement)
    return Diagnosis(problem, split, stage, screening, judgement, decision)


__all__ = ["Diagnosis", "compare", "diagnose", "explore"]
