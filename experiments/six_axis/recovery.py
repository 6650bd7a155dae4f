"""Single joints from hits, over many simulated campaigns: bias, scatter and how often the intervals cover."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from joblib import Parallel, delayed

from jointscope.experiments.six_axis.measure import fit_joints, read_joint_spots
from jointscope.experiments.six_axis.plans import joints_plan
from jointscope.models.arm.build import build_arm
from jointscope.models.arm.linear import joint_values
from jointscope.progress import track
from jointscope.sim.arm.campaign import simulate_arm
from jointscope.sim.arm.plan import ELBOW, JOINT


def recover(seeds: Sequence[int], *, workers: int = 2) -> list[dict[str, tuple[float, bool]]]:
    """One campaign per seed: relative error of K and c of joints 2 and 3, and whether the interval covers."""
    jobs = Parallel(n_jobs=workers, return_as="generator")(delayed(_one)(seed) for seed in seeds)
    return list(track(jobs, "campaigns", len(seeds)))


def summary(rows: Sequence[dict[str, tuple[float, bool]]]) -> dict[str, dict[str, float]]:
    """Bias, standard deviation, largest error [-] and share of intervals that cover, per figure."""
    table = {}
    for name in rows[0]:
        errors = np.array([row[name][0] for row in rows])
        covered = [row[name][1] for row in rows]
        table[name] = {
            "bias": float(errors.mean()), "scatter": float(errors.std(ddof=1)) if errors.size > 1 else 0.0,
            "worst": float(np.max(np.abs(errors))), "coverage": float(np.mean(covered)), "campaigns": float(errors.size),
        }  # fmt: skip
    return table


def _one(seed: int) -> dict[str, tuple[float, bool]]:
    plan = joints_plan()
    truth = build_arm(plan.truth)
    values = joint_values(truth)
    lab = build_arm(plan.lab)
    fit = fit_joints(read_joint_spots(plan, lab, simulate_arm(plan, np.random.default_rng(seed))), lab)
    row: dict[str, Any] = {}
    for symbol, estimates, exact in (("K", fit.stiffness, values.stiffness), ("c", fit.damping, values.damping)):
        for estimate, true in zip(estimates, exact, strict=True):
            if estimate.joint in (JOINT, ELBOW):
                row[f"{estimate.joint} {symbol}"] = (
                    estimate.value / true - 1.0,
                    estimate.low <= true <= estimate.high,
                )
    return row
