"""What else there is where every brake's reducer gives way a little.

An arm that hangs on its brakes hangs on as many springs. Effects of the joint under test are sought beside one of them, or
two; beside three they are lost in what the others do. So where the search ends without a name for what is left, it is made
again on an arm in which every brake's reducer is a spring that the base fits, and what it finds is put beside those springs:
each ``neighbour-flexibility`` as it would be named, on the arm as its file has it.
"""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.arm.effects import arm_catalogue, neighbour_laws
from jointscope.diagnosis.arm.predict import predict_outputs
from jointscope.diagnosis.arm.prepare import softened
from jointscope.diagnosis.arm.problem import ArmProblem
from jointscope.diagnosis.base import Stage, refit_base
from jointscope.diagnosis.coordinates import coordinates
from jointscope.diagnosis.effects import ActiveEffect
from jointscope.diagnosis.refit import least_squares
from jointscope.diagnosis.rounds import Report, explore
from jointscope.diagnosis.search import Effort, Hypothesis, profile_loss

Vector = NDArray[np.float64]

LEADING = 4  # sets of names found on the softer arm that are taken back
SPENT = 80  # simulations that each may take there


def beside_soft_neighbours(
    stage: Stage, pool: ThreadPoolExecutor, effort: Effort, report: Report
) -> list[Hypothesis]:
    """Hypotheses of ``stage`` that hold every brake's spring and what was found beside them; none where all are rigid."""
    problem = stage.objective.problem
    assert isinstance(problem, ArmProblem)
    soft = softened(problem)
    if soft is None:
        return []
    report("refitting the base with every brake's reducer a spring")
    there = refit_base(soft, predict_outputs, stage.objective.runs, pool)
    _, found = explore(there, arm_catalogue(soft), effort, report)
    leading: dict[tuple[str, ...], Hypothesis] = {}
    for hypothesis in found:
        leading.setdefault(hypothesis.names, hypothesis)
    springs = np.flatnonzero(soft.facts.elastic & ~problem.facts.elastic)
    base = Hypothesis((), there.fit, 0.0)
    taken = [base, *list(leading.values())[:LEADING]]
    return [_taken_back(stage, problem, soft, h, springs) for h in taken]


def _taken_back(
    stage: Stage, problem: ArmProblem, soft: ArmProblem, hypothesis: Hypothesis, springs: NDArray[np.intp]
) -> Hypothesis:
    """``hypothesis`` on the arm as its file has it: the springs that it lacks are effects."""
    theta, effects = hypothesis.fit.coordinates.unpack(hypothesis.fit.x)
    actives = (*(spring(problem, soft, theta, int(j)) for j in springs), *effects)
    where = coordinates(problem, tuple(a.spec for a in actives))
    fit = least_squares(
        stage.objective, where, where.pack(theta, actives), iterations=14, tolerance=3e-3, simulations=SPENT
    )
    return Hypothesis(where.effects, fit, profile_loss(stage.objective, fit.w))


def spring(problem: ArmProblem, soft: ArmProblem, theta: Vector, j: int) -> ActiveEffect:
    """The spring of joint j that the softened arm has at ``theta``, as the effect that it is of the other."""
    K, c, of_file = (float(theta[soft.place(kind, j)]) for kind in ("stiffness", "damping", "link_inertia"))
    own = float(problem.locked_inertia[j]) * of_file
    spec = neighbour_laws(problem, j)[0]
    return ActiveEffect(spec, (math.sqrt(K / own) / (2.0 * math.pi), 0.5 * c / math.sqrt(K * own), of_file))
