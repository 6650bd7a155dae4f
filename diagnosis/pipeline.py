"""A campaign's diagnosis from end to end: prepare, split, refit the base, screen, fit, extend, judge, decide.

This is the file to read first. Every stage returns a new frozen object; nothing here touches a file.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from jointscope.diagnosis.adjudicate import Judged, Judgement, judge
from jointscope.diagnosis.alignment import inexact, realigned
from jointscope.diagnosis.base import Stage, refit_base
from jointscope.diagnosis.between_runs import Varying, varying, with_varying
from jointscope.diagnosis.constancy import Change, changes
from jointscope.diagnosis.effects import STRANGERS, at_rig
from jointscope.diagnosis.encoder_lines import without_encoder_lines
from jointscope.diagnosis.force_left import force_left
from jointscope.diagnosis.locate import Places, judged_table, places
from jointscope.diagnosis.logged_hum import without_logged_hum
from jointscope.diagnosis.main_order import in_main_order
from jointscope.diagnosis.mains import without_hum
from jointscope.diagnosis.memory import Memory
from jointscope.diagnosis.next_experiment import Suggestion, suggest
from jointscope.diagnosis.no_worse import between_devices, handed_on
from jointscope.diagnosis.objective import Predict
from jointscope.diagnosis.one_place import in_one_place
from jointscope.diagnosis.outside import far_ahead
from jointscope.diagnosis.overtones import overtones
from jointscope.diagnosis.plain_base import with_plain_base
from jointscope.diagnosis.power import Unseen, unseen
from jointscope.diagnosis.predict import free_prediction
from jointscope.diagnosis.remainder import Remainder, remainders
from jointscope.diagnosis.repeats import with_what_repeats
from jointscope.diagnosis.rounds import Report, explore
from jointscope.diagnosis.search import Effort, Screening
from jointscope.diagnosis.second_look import second_look
from jointscope.diagnosis.seen_weight import as_seen
from jointscope.diagnosis.sizes import typical_sizes
from jointscope.diagnosis.split import Split, split_runs
from jointscope.diagnosis.turning import repeating
from jointscope.diagnosis.twins import each_once
from jointscope.diagnosis.two_of_three import answered
from jointscope.diagnosis.unscaled import in_si, unscaled
from jointscope.diagnosis.verdict import (
    Decision,
    with_changes,
    with_followed_input,
    with_force_left,
    with_remainder,
    with_unknown_force,
)

if TYPE_CHECKING:
    from jointscope.diagnosis.effects import EffectSpec
    from jointscope.diagnosis.prepare import Problem

SLOPES = (
    250_000_000  # bytes of predictions beside the hypotheses' optima, which the noise of every judging weighs anew
)
LOOKS = 2  # times that further effects are sought on top of what was decided
REALIGNED = 2  # times that inexact starts are found anew at the refitted base


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
        places: Forces without a name, place by place, on top of the base.
        black_box: The best of them fitted: what flexibility alone buys.
        suggestion: The recording to make next, where one is needed.
        not_seen: Effects that were not found, and the size that would have shown.
        remainder: What the chosen model leaves that still follows the input, repeats with the turn, or sits at one place,
            per kind of channel.
        changes: How far the size of named effects moves within runs.
        differing: How far the joint's own parameters differ between runs, where nothing was named.
    """

    problem: Problem
    split: Split
    stage: Stage
    screening: Screening
    judgement: Judgement
    decision: Decision
    places: Places
    black_box: Judged | None
    suggestion: Suggestion | None = None
    not_seen: tuple[Unseen, ...] = ()
    remainder: tuple[Remainder, ...] = ()
    changes: tuple[Change, ...] = ()
    differing: tuple[Varying, ...] = ()


def _at_size(problem: Problem, stage: Stage) -> tuple[Problem, Stage]:
    """The problem with the sizes of its motion at the refitted base: a drive that follows better goes further."""
    theta, _ = stage.fit.coordinates.unpack(stage.fit.x)
    problem = replace(problem, scales=typical_sizes(problem, theta))
    return problem, replace(stage, objective=replace(stage.objective, problem=problem))


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
    for _ in range(REALIGNED if inexact(problem) or unscaled(problem.runs) else 0):
        theta, _ = stage.fit.coordinates.unpack(stage.fit.x)
        problem = in_si(realigned(problem, theta), theta, exact=True)
        stage = refit_base(problem, predict, split.estimate, pool)
    for righted in (as_seen, without_hum):
        found = righted(problem, stage.fit.coordinates.unpack(stage.fit.x)[0], predict)
        if found is not problem:
            problem = found
            stage = refit_base(problem, predict, split.estimate, pool)
    read = without_encoder_lines(problem, stage)
    if read is not problem:
        problem = read
        stage = refit_base(problem, predict, split.estimate, pool)
    problem, stage = _at_size(problem, stage)
    specs = tuple(at_rig(spec, problem) for spec in specs)
    outside = tuple(at_rig(spec, problem) for spec in STRANGERS)
    screening, hypotheses = explore(stage, specs, effort, report, outside)
    stage = replace(stage, objective=replace(stage.objective, slopes=Memory(SLOPES)))
    report(f"judging {len(hypotheses)} hypotheses on {len(split.held_out)} held-out runs")
    judgement = judge(stage, hypotheses, split.held_out)
    lines = in_main_order(judgement, specs)
    if lines:
        hypotheses = (*each_once(judgement.judged[1:]), *lines)
        judgement = judge(stage, hypotheses, split.held_out)
    decision = answered(judgement)
    report("looking once more under the noise that is left")
    for _ in range(LOOKS):
        if far_ahead(decision):
            break
        further = second_look(judgement, decision.chosen, screening, specs, effort)
        if not further:
            break
        hypotheses = (*each_once(judgement.judged[1:]), *further)
        judgement = judge(stage, hypotheses, split.held_out)
        before, decision = decision, answered(judgement)
        if decision.chosen.names == before.chosen.names:
            break
    repeats = repeating(judgement, decision.chosen)
    richer = overtones(judgement, decision.chosen, repeats, specs, effort)
    if richer:
        judgement = judge(stage, (*each_once(judgement.judged[1:]), *richer), split.held_out)
        decision = answered(judgement)
        repeats = repeating(judgement, decision.chosen)
    following = remainders(judgement, decision.chosen)
    placed = in_one_place(judgement, decision.chosen) if decision.verdict == "none" else ()
    left = (*following, *repeats, *placed)
    changing: tuple[Change, ...] = ()
    decision = with_remainder(decision, left)
    forces = force_left(judgement) if decision.verdict == "none" else None
    decision = with_force_left(decision, 0.0 if forces is None else forces.lack)
    differing = varying(judgement, decision.chosen) if decision.verdict == "none" else ()
    decision = with_varying(decision, differing)
    if decision.verdict == "effects":
        changing = changes(judgement, decision.chosen)
        at_base = remainders(judgement, judgement.base) if any(r.stands for r in following) else ()
        decision = with_followed_input(decision, following, at_base)
        decision = with_changes(decision, changing)
    report("locating what is left without a name")
    where = places(judgement, judgement.base)
    black_box = judged_table(judgement, where.tables[0]) if where.tables and where.tables[0].score > 0.0 else None
    if (decision.verdict == "none" or decision.unknown_reason == "outside-catalogue") and black_box is not None:
        decision = with_unknown_force(judgement, decision, black_box)
    if not between_devices(problem, split.held_out, judgement.base, decision.chosen):
        decision = with_what_repeats(judgement, decision)
    whole = Diagnosis(
        problem,
        split,
        stage,
        screening,
        judgement,
        decision,
        where,
        black_box,
        remainder=left,
        changes=changing,
        differing=differing,
    )
    whole = without_logged_hum(handed_on(with_plain_base(whole, free_prediction), free_prediction))
    problem = whole.problem
    judgement = whole.judgement
    report("weighing what to record next")
    suggestion = suggest(problem, judgement, whole.decision, pool)
    report("weighing what could not have been seen")
    named = whole.decision.chosen if whole.decision.verdict == "effects" else judgement.base
    return replace(whole, suggestion=suggestion, not_seen=unseen(problem, judgement, named, specs, pool))
