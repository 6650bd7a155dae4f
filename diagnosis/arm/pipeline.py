"""An arm's diagnosis from end to end, by the same stages and rules as a single joint's (``jointscope.diagnosis.pipeline``).

Only what drives them differs: the arm's forward model and the catalogue of effects at every joint. A force without a name
and the choice of the next recording belong to the single joint's model and are left out here.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

from jointscope.diagnosis.adjudicate import Judgement, judge
from jointscope.diagnosis.arm.effects import arm_catalogue
from jointscope.diagnosis.arm.predict import free_prediction, predict_outputs
from jointscope.diagnosis.arm.problem import ArmProblem
from jointscope.diagnosis.arm.soft_neighbours import beside_soft_neighbours
from jointscope.diagnosis.base import refit_base
from jointscope.diagnosis.echo import Echo
from jointscope.diagnosis.effects import PAYLOADS
from jointscope.diagnosis.locate import Places
from jointscope.diagnosis.no_worse import handed_on
from jointscope.diagnosis.pipeline import Diagnosis, silent
from jointscope.diagnosis.plain_base import with_plain_base
from jointscope.diagnosis.rounds import Report, explore
from jointscope.diagnosis.search import Effort, Hypothesis, Screening
from jointscope.diagnosis.second_look import second_look
from jointscope.diagnosis.split import split_runs
from jointscope.diagnosis.twins import each_once
from jointscope.diagnosis.two_of_three import answered
from jointscope.diagnosis.unlike_noise import grows_with_signal
from jointscope.diagnosis.verdict import GROWING, Decision, beyond

EFFORT = Effort(
    hits=5,
    others=2,
    screen_hits=3,
    screen_others=1,
    singles=6,
    refine=14,
    pairs=0,
    beam=1,
    children=2,
    size=2,
    fit_simulations=40,
    polished=3,
    brief=False,  # small motion's nonlinear torques are stepped to second order, and a path has tables of its own
)

DRIVEN_RIGHT = (
    0.01  # of a driven run's signal, to which an arm of several bodies and its motor's log are right at best
)
HITS_RIGHT = (
    0.002  # of a hit's, to which the places of hammer and sensors are: half a millimetre in a quarter metre
)


def _as_right_as_arms_are(judgement: Judgement) -> Judgement:
    """What an effect explains of driven runs counts from the last hundredth on: a mode of a second joint is no righter.

    Of hits from the last thousandths on.
    """
    energies = dict(judgement.echo.energies)
    for kind, (_, signal) in judgement.base.energies.items():
        right = HITS_RIGHT if str(kind[0]) == "hammer" else DRIVEN_RIGHT
        energies[kind] = energies.get(kind, 0.0) + right**2 * signal
    return replace(judgement, echo=Echo(energies, {}))


def _within_geometry(judgement: Judgement, decision: Decision) -> Decision:
    """``none`` where what the base leaves is as little as an arm's file is right to.

    Where no two runs are driven alike that is not known; then nothing may be left that grows with the signal either.
    """
    fit = decision.adequacy
    lack = max(fit.base_left / DRIVEN_RIGHT, grows_with_signal(judgement, fit) / GROWING)
    unexplained = decision.verdict == "unknown" and decision.chosen is judgement.base
    if not unexplained or lack > 1.0:
        return decision
    return replace(decision, verdict="none", unknown_reason=None, probability=beyond(1.0 / max(lack, 1e-9)))


def _some_carry(screening: Screening, found: Hypothesis) -> bool:
    """Whether the runs' own inertias part into two groups, and nothing was found that does.

    Who is in which may be seen only beside what else there is.
    """
    payload = PAYLOADS[0].name
    parted = any(t.spec.name == payload and t.spec.run_weights is not None for t in screening.trials)
    return parted and all(spec.name != payload for spec in found.specs)


def diagnose_arm(
    problem: ArmProblem, pool: ThreadPoolExecutor, *, effort: Effort = EFFORT, report: Report = silent
) -> Diagnosis:
    """Diagnose a prepared arm's campaign.

    Args:
        pool: Threads that run the simulations; the answer does not depend on their number.
        report: Told of every stage as it begins.
    """
    split = split_runs(problem)
    report(f"refitting the base model to {len(split.estimate)} runs")
    stage = refit_base(problem, predict_outputs, split.estimate, pool)
    screening, hypotheses = explore(stage, arm_catalogue(problem), effort, report)
    report(f"judging {len(hypotheses)} hypotheses on {len(split.held_out)} held-out runs")
    judgement = _as_right_as_arms_are(judge(stage, hypotheses, split.held_out))
    decision = answered(judgement)

    def beside(further: Sequence[Hypothesis]) -> Judgement:
        everything = (*each_once(judgement.judged[1:]), *further)
        return _as_right_as_arms_are(judge(stage, everything, split.held_out)) if further else judgement

    if _some_carry(screening, decision.chosen.hypothesis):
        report("asking once more which runs carry something")
        judgement = beside(second_look(judgement, decision.chosen, screening, (), effort))
        decision = answered(judgement)
    decision = _within_geometry(judgement, decision)
    if decision.verdict == "unknown":
        judgement = beside(beside_soft_neighbours(stage, pool, effort, report))
        decision = _within_geometry(judgement, answered(judgement))
    nowhere = Places((), {}, None)
    whole = Diagnosis(problem, split, stage, screening, judgement, decision, nowhere, None)
    return handed_on(with_plain_base(whole, free_prediction), free_prediction)
