"""Where the joint itself rings: whatever shakes it, broadband, leaves a peak there."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from jointscope.diagnosis.problem import Problem

Vector = NDArray[np.float64]
Pole = tuple[float, float]  # frequency [Hz] and damping ratio [-]


def joint_poles(problem: Problem, theta: Vector) -> dict[bool, Pole]:
    """Frequency [Hz] and damping ratio [-] at which the joint rings in its runs, by whether its motor moves in them.

    Free: w^2 = K (1/J_M + 1/J_L), 2 zeta w = c (1/J_M + 1/J_L) + what stands outside; the dampers of motor and
    load act with the mode's own shares, (b_m/J_M^2 + b_l/J_L^2) / (1/J_M + 1/J_L). Held: the same with 1/J_M = 0.
    """
    b = dict(zip(problem.base.names, (float(v) for v in theta), strict=True))
    if min(b.get("stiffness", 0.0), b.get("load_inertia", 0.0)) <= 0.0:  # no spring, or several joints
        return {}
    found: dict[bool, Pole] = {}
    for moves in sorted({run.motor_moves for run in problem.runs}):
        if moves and b["motor_inertia"] <= 0.0:
            continue
        by_motor, by_load = 1.0 / b["motor_inertia"] if moves else 0.0, 1.0 / b["load_inertia"]
        both = by_motor + by_load
        w = np.sqrt(b["stiffness"] * both)
        outside = (b["motor_damping"] * by_motor**2 + b["load_damping"] * by_load**2) / both
        zeta = 0.5 * (b["damping"] * both + outside) / w
        found[moves] = (float(w / (2.0 * np.pi)), float(np.clip(zeta, 1e-3, 0.9)))
    return found
