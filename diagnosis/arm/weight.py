r"""A weight that the arm's file lacks or has wrong: a hose package, a tool, a link of other walls.

Link i's own weight takes of joint j, turned to q_j, A cos(q_j + phi): what hangs on it where its own mass hangs adds
(moment/A) of the torques by which that weight is held, at every joint. Its inertia is the base's, which weighs the links.

Facts used as tests: A^2 = w(q_j)^2 + w(q_j + pi/2)^2 for a hinge; about an upright axis nothing has a weight.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from jointscope.diagnosis.arm.law import arm_law
from jointscope.diagnosis.effects.spec import EffectSpec, ParameterSpec, Values

if TYPE_CHECKING:
    from jointscope.diagnosis.arm.predict import ArmAssembly
    from jointscope.diagnosis.arm.problem import ArmProblem

SMALLEST = 1e-3  # of a joint's reach, that a link's own weight takes of it at least
LIGHTEST, HEAVIEST = -0.9, 20.0  # times its own weight, that a link has too much


def weights(problem: ArmProblem, joint: int, reach: float) -> list[EffectSpec]:
    """More weight of the joint's own link, and of the arm's last, where a run drives the joint and gravity acts on it.

    Args:
        joint: Place of the joint in the arm.
        reach: Torque that the joint is seen to carry [N m].
    """
    links = dict.fromkeys((joint, len(problem.facts.joints) - 1))
    found = []
    for variant, link in zip(("own-link", "last-link"), links, strict=False):
        own = own_weight(problem, joint, link)
        if own > SMALLEST * reach:
            found.append(_law(problem.facts.joints[joint], variant, link, own, reach))
    return found


def own_weight(problem: ArmProblem, joint: int, link: int) -> float:
    """A of ``link`` about ``joint`` [N m], the arm elsewhere as in the first run that drives it; 0 without one."""
    driving = [r for r in problem.arm_runs if r.driven == joint]
    if not driving:
        return 0.0
    reference, posture = problem.facts.reference, dict(driving[0].run.posture or {})
    name = problem.facts.joints[joint]
    quarter = {**posture, name: float(posture.get(name, 0.0)) + 0.5 * math.pi}
    return math.hypot(*(float(reference.weights(place)[link, joint]) for place in (posture, quarter)))


def _law(joint: str, variant: str, link: int, own: float, reach: float) -> EffectSpec:
    def put(assembly: ArmAssembly, values: Values) -> None:
        assembly.links = replace(assembly.links, heavier=(link, values[0] / own))

    found = arm_law(
        "gravity", "load", joint, variant, "gravity",
        (ParameterSpec("moment", "N m", LIGHTEST * own, HEAVIEST * own, null=0.0),), put,
        "moment/A times the torques that hold the link's own weight, A its largest at the joint",
        (0.01 * reach, 0.05 * reach, 0.2 * reach), ((),), ("speed-motion", "torque-sweep"),
        ("coulomb-friction", "torque-gain"),
    )  # fmt: skip
    return replace(found, exact=True)
