"""An arm's campaign as a problem of estimation: which joints it sees, which parameters are free, and where they start.

Nothing is read from titles, notes, ids, file or column names, or from the order of runs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import cast

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.arm import kernel
from jointscope.diagnosis.arm.geometry import ArmFacts, arm_facts
from jointscope.diagnosis.arm.linear import Figures, changes, fitted_start
from jointscope.diagnosis.arm.problem import COMMON, PER_JOINT, ArmProblem, ArmRun, parameter
from jointscope.diagnosis.arm.runs import arm_run
from jointscope.diagnosis.problem import BaseSpec
from jointscope.diagnosis.sizes import unit_scales
from jointscope.errors import RefusedError
from jointscope.recordings.campaign import Campaign, Nameplate
from jointscope.recordings.wild import tamed
from jointscope.recordings.zeroed import zeroed

Vector = NDArray[np.float64]

SEEN = 0.004  # relative change of the sensors' response below which a joint is rigid to these recordings
INFORMED = 0.02  # the same below which its figures stay as stated
UNLIKE = 0.01  # of an inertia, by which a link's part of it differs between runs, to be weighed on its own
APART = 0.002  # the same of what the others, the spring and the inertia about its joint do not already make of it
LEAST_INERTIA = 0.4  # times what the file says
SOFT_DAMPING = 0.02  # of its critical damping, the same
SOFT_HZ = 25.0  # resonance on its own of a joint that is rigid in the model, to ask whether softness would show


def prepare_arm(campaign: Campaign) -> ArmProblem:
    """Read an arm's campaign.

    Raises:
        RefusedError: No run holds an input and an output of the arm, or geometry is missing.
    """
    facts = arm_facts(campaign)
    runs: list[ArmRun] = []
    campaign, wild = tamed(campaign)
    campaign, offsets = zeroed(campaign)
    findings = [*wild, *offsets]
    for run in campaign.runs:
        made = arm_run(run, campaign.rig, facts, len(runs))
        if made is not None:
            runs.append(made[0])
            findings.extend(made[1])
    if not runs:
        raise RefusedError(
            f"{campaign.path}: no run holds a hammer force or a motor torque together with an acceleration or a motor "
            "angle of the arm"
        )
    return _as_problem(campaign.rig, runs, findings, facts)


def _as_problem(rig: Nameplate, runs: list[ArmRun], findings: Sequence[str], facts: ArmFacts) -> ArmProblem:
    """Which joints the runs see, and where the base starts."""
    figures = Figures(
        facts.stiffness, facts.damping, facts.rotor_inertia, facts.rotor_damping, facts.drive_stiffness,
        facts.drive_damping,
    )  # fmt: skip
    visibility = _visibility(runs, facts, figures)
    seen = np.asarray(visibility > SEEN)
    seen[facts.tested] = True
    masks = {run.index: np.asarray(facts.elastic & seen & ~run.locked) for run in runs}
    sought = np.flatnonzero(facts.elastic & (visibility > INFORMED) & ~_always_locked(runs))
    K, c = fitted_start(runs, figures, masks, sought)
    stated, facts = facts, replace(facts, stiffness=K, damping=c)
    weighed = _weighed(runs, sought, facts.tested)
    problem = ArmProblem(
        rig=rig, runs=tuple(runs), base=_base(facts, runs, masks, sought, weighed), scales=unit_scales(),
        findings=tuple(findings), facts=facts, stated=stated, seen=seen, visibility=visibility,
        rotor_speed=np.zeros(len(K)), wind_up=np.zeros(len(K)), torque=np.zeros(len(K)),
        locked_inertia=facts.reference.locked_inertia(runs[0].run.posture), carried=_carried(weighed[1]),
    )  # fmt: skip
    return _with_sizes(problem)


def softened(problem: ArmProblem) -> ArmProblem | None:
    """The arm in which every brake's reducer gives way, where that shows and its file has it rigid; ``None`` without any."""
    stated, runs = problem.stated, list(problem.arm_runs)
    held = np.all([(run.kinds == kernel.BRAKED) & ~run.locked for run in runs], axis=0)
    soft = np.asarray(problem.seen & ~stated.elastic & held)
    if not np.any(soft):
        return None
    inertia = problem.locked_inertia
    stiffness = np.where(soft, inertia * (2.0 * np.pi * SOFT_HZ) ** 2, stated.stiffness)
    damping = np.where(soft, 2.0 * SOFT_DAMPING * np.sqrt(stiffness * inertia), stated.damping)
    facts = replace(stated, elastic=stated.elastic | soft, stiffness=stiffness, damping=damping)
    return _as_problem(problem.rig, runs, problem.findings, facts)


def _always_locked(runs: list[ArmRun]) -> NDArray[np.bool_]:
    return np.asarray(np.all([run.locked for run in runs], axis=0))


def _visibility(runs: list[ArmRun], facts: ArmFacts, figures: Figures) -> Vector:
    """How much every joint's compliance changes what is read, over all runs, shape (n,).

    For a joint that the model has rigid: how much it would with a resonance of its own at ``SOFT_HZ``.
    """
    n = len(facts.joints)
    found = np.zeros(n)
    distinct = {
        (r.run.experiment, tuple(r.kinds), tuple(np.round(r.plant.hit, 4)), tuple(r.locked)): r for r in runs
    }
    for run in distinct.values():
        springs = np.asarray(facts.elastic & ~run.locked)
        for j in range(n):
            with_it, without = springs.copy(), springs.copy()
            with_it[j], without[j] = True, False
            at = figures
            if not springs[j]:
                K, c = figures.stiffness.copy(), figures.damping.copy()
                K[j] = float(run.plant.mass[0, j, j]) * (2.0 * np.pi * SOFT_HZ) ** 2
                c[j] = 2.0 * SOFT_DAMPING * np.sqrt(K[j] * float(run.plant.mass[0, j, j]))
                at = replace(figures, stiffness=K, damping=c)
            braked = replace(run, kinds=np.where(springs, run.kinds, kernel.BRAKED))
            found[j] = max(found[j], changes(braked, at, with_it, without))
    return found


def _weighed(
    runs: list[ArmRun], sought: NDArray[np.int_], tested: int
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Links whose inertia about their own joint, and whose mass, the recordings weigh, shape (n,) each.

    Of every joint that moves the inertia about it; the mass of what hangs on a second one, which is felt beside it at the
    first, and of a link beyond a joint that does not move, where its part of what is felt differs from run to run.
    """
    n = len(runs[0].kinds)
    moving = np.isin(np.arange(n), [*sought, tested])
    massed, carrier = np.zeros(n, dtype=bool), -1
    for i in range(n):
        if carrier >= 0:
            parts = _part(runs, i, carrier)
            massed[i] = moving[i] or bool(np.ptp(parts) > UNLIKE)
        if moving[i]:
            carrier = i
    for joint in map(int, np.flatnonzero(moving)):
        beyond = [i for i in range(joint + 1, n) if not np.any(moving[joint + 1 : i + 1])]
        felt = np.concatenate([r.plant.mass[:, joint, joint] for r in runs])
        known = [np.ones(felt.size), 1.0 / felt]  # the spring's own scale, and inertia about the joint
        massed[beyond] = _apart(known, {i: _part(runs, i, joint) for i in beyond if massed[i]}, beyond)
    return moving, massed


def _part(runs: list[ArmRun], link: int, joint: int) -> Vector:
    """Share of what hangs from ``link`` on in the inertia about ``joint`` that is held, in every run [-]."""
    return np.concatenate(
        [r.plant.shares[:, link:, joint, joint].sum(1) / r.plant.mass[:, joint, joint] for r in runs]
    )


def _apart(known: list[Vector], parts: dict[int, Vector], links: list[int]) -> list[bool]:
    """Which of ``links`` the postures tell from what is known and from each other, those that differ most first."""
    taken: list[int] = []
    span = [np.asarray(column) for column in known]
    while len(taken) < len(parts):
        basis = np.linalg.qr(np.stack(span, axis=1))[0]
        left = {i: float(np.ptp(part - basis @ (basis.T @ part))) for i, part in parts.items() if i not in taken}
        best = max(left, key=lambda i: left[i])
        if left[best] < APART:
            break
        taken.append(best)
        span.append(parts[best])
    return [i in taken for i in links]


def _carried(massed: NDArray[np.bool_]) -> NDArray[np.int_]:
    return np.maximum.accumulate(np.where(massed, np.arange(len(massed)), -1))


def _base(
    facts: ArmFacts,
    runs: list[ArmRun],
    masks: dict[int, NDArray[np.bool_]],
    sought: NDArray[np.int_],
    weighed: tuple[NDArray[np.bool_], NDArray[np.bool_]],
) -> BaseSpec:
    n = len(facts.joints)
    springs = np.any([masks[r.index] for r in runs], axis=0)
    turning = np.any([(r.kinds != kernel.BRAKED) & masks[r.index] for r in runs], axis=0)
    held = np.any([(r.kinds == kernel.HELD) & masks[r.index] for r in runs], axis=0)
    driven = np.any([r.kinds == kernel.DRIVEN for r in runs], axis=0)
    values = np.stack(
        [facts.stiffness, facts.damping, facts.rotor_inertia, facts.rotor_damping, facts.drive_stiffness,
         facts.drive_damping, np.ones(n), np.ones(n), np.where(turning, facts.load_damping, 0.0)]
    )  # fmt: skip
    informed = np.isin(np.arange(n), sought)
    free = np.stack(
        [springs, springs, driven & (facts.rotor_inertia <= 0.0), driven & turning,
         held & informed, held & informed, *weighed,
         driven & turning]
    )  # fmt: skip  # fmt: skip
    if np.any(free[2]):
        values[2] = np.where(facts.rotor_inertia <= 0.0, 5.0, values[2])
    scale = np.where(values > 0.0, values, 1.0)
    scale[[3, 8]] = np.maximum(scale[[3, 8]], 5.0)
    lower = np.stack(
        [0.1 * scale[0], 0.0 * scale[1], 0.02 * scale[2], 0.0 * scale[3], 0.2 * scale[4], 0.1 * scale[5],
         LEAST_INERTIA * scale[6], LEAST_INERTIA * scale[7], 0.0 * scale[8]]
    )  # fmt: skip
    upper = np.stack(
        [10.0 * scale[0], 30.0 * scale[1], 50.0 * scale[2], 100.0 * scale[3], 5.0 * scale[4], 8.0 * scale[5],
         scale[6] / LEAST_INERTIA, scale[7] / LEAST_INERTIA, 100.0 * scale[8]]
    )  # fmt: skip
    moved = [r for r in runs if r.driven >= 0]
    gap = [
        float(r.plant.gravity[_at_start(r), r.driven] - np.mean(r.motor_half[: round(0.1 * r.grid_rate)]))
        for r in moved
    ]
    size = max([float(np.ptp(r.motor_half)) for r in moved], default=1.0)
    names = tuple(parameter(kind, joint) for kind in PER_JOINT for joint in facts.joints) + COMMON
    fixed = [max([r.tie for r in moved], default=1.0), facts.efficiency, 1.0]
    nuisance = np.repeat([False, False, False, False, True, True, False, False, False], n)
    return BaseSpec(
        names=names,
        start=np.append(values.ravel(), [float(np.median(gap)) if gap else 0.0, *fixed]),
        lower=np.append(lower.ravel(), [-size, *fixed]),
        upper=np.append(upper.ravel(), [size, *fixed]),
        scale=np.append(scale.ravel(), [0.05 * size, *fixed]),
        free=np.append(free.ravel(), [bool(moved), False, False, False]),
        nuisance=np.append(nuisance, [True] * len(COMMON)),
    )


def _at_start(run: ArmRun) -> int:
    """Node of the table at which the run begins."""
    return round(-run.plant.low / run.plant.step) if run.plant.moving >= 0 else 0


def _with_sizes(problem: ArmProblem) -> ArmProblem:
    """Typical speeds, wind-ups and torques of every joint under the base's start."""
    from jointscope.diagnosis.arm.predict import peaks

    found = [peaks(cast("ArmRun", run), problem.base.start, problem) for run in problem.runs]
    speed, wind_up, torque = (np.max([f[i] for f in found], axis=0) for i in range(3))
    return replace(problem, rotor_speed=speed, wind_up=wind_up, torque=torque)
