"""Typical sizes of motion, torque and wind-up in a campaign, from the base model."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from jointscope.diagnosis import kernel
from jointscope.diagnosis.assembly import BASE_INDEX, OBSERVER_HZ
from jointscope.diagnosis.channels import ACCELERATIONS
from jointscope.diagnosis.predict import build, integrate
from jointscope.diagnosis.problem import Scales
from jointscope.recordings.drift import drift_free

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from jointscope.diagnosis.problem import PreparedRun, Problem

    Vector = NDArray[np.float64]


def unit_scales() -> Scales:
    return Scales(1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 30.0, 0.0, 0.0, 0.0, 0.0, -1.0, 1.0, 1.0)


def _where_known(run: PreparedRun, q: Vector) -> Vector:
    """The arm's angle; in an open sweep whose angles nobody recorded without the drift that a model invents, same shape."""
    adrift = run.run.experiment == "torque-sweep" and run.motor_moves and run.observed is None
    return drift_free(q, OBSERVER_HZ, run.grid_rate) if adrift else q


def _driving(run: PreparedRun) -> float:
    """What drives a rigid axis at most [N m or N]: as recorded, where its motion is what was prescribed."""
    if run.mode == "prescribed-load":
        forces = [(o.radius or 1.0) * np.max(np.abs(o.data)) for o in run.outputs if run.takes(o)]
        return float(max(forces, default=0.0))
    return float(np.max(np.abs(run.load_half + run.motor_half)))


def typical_sizes(problem: Problem, base: Vector) -> Scales:
    """Typical sizes over all runs, from the base model at the parameters ``base``, shape (n_theta,)."""
    peak = dict.fromkeys(
        ("torque", "wind_up", "rate", "speed", "motor_speed", "travel", "motor", "load", "acc", "time"), 1e-12
    )
    low, high = math.inf, -math.inf
    held_low, held_high = math.inf, -math.inf
    soft, hard = math.inf, -math.inf
    for run in problem.runs:
        states = integrate(build(run, base, (), problem))
        if not np.all(np.isfinite(states)):
            continue
        spring = states[:, kernel.X_TS]
        delta = states[:, kernel.X_QS] - states[:, kernel.X_Q]
        q = _where_known(run, states[:, kernel.X_Q])
        found = {
            "torque": np.ptp(spring) / 2.0 if run.spring else _driving(run),
            "wind_up": np.ptp(delta) / 2.0,
            "rate": np.max(np.abs(states[:, kernel.X_VS] - states[:, kernel.X_V])),
            "speed": np.max(np.abs(states[:, kernel.X_V])),
            "motor_speed": np.max(np.abs(states[:, kernel.X_VS])),
            "travel": np.ptp(q),
            "motor": np.max(np.abs(run.motor_half)) if run.motor is not None else 0.0,
            "load": np.max(np.abs(run.load_half)),
            "acc": max((np.max(np.abs(o.data)) for o in run.outputs if o.quantity in ACCELERATIONS), default=0.0),
            "time": run.steps / run.grid_rate,
        }
        peak = {name: max(peak[name], float(value)) for name, value in found.items()}
        low, high = min(low, float(q.min())), max(high, float(q.max()))
        if run.spring and not run.motor_moves:
            held_low, held_high = min(held_low, float(q.min())), max(held_high, float(q.max()))
        if run.spring:
            soft, hard = min(soft, float(delta.min())), max(hard, float(delta.max()))
    frequency = math.sqrt(base[BASE_INDEX["stiffness"]] / base[BASE_INDEX["load_inertia"]]) / (2.0 * math.pi)
    return Scales(
        torque=peak["torque"],
        wind_up=peak["wind_up"],
        wind_up_rate=peak["rate"],
        speed=peak["speed"],
        motor_speed=peak["motor_speed"],
        travel=peak["travel"],
        motor_torque=peak["motor"] if peak["motor"] > 1e-12 else 0.0,
        load_torque=peak["load"] if peak["load"] > 1e-12 else 0.0,
        acceleration=peak["acc"] if peak["acc"] > 1e-12 else 0.0,
        frequency=frequency,
        angle_low=low if math.isfinite(low) else 0.0,
        angle_high=high if math.isfinite(high) else 0.0,
        held_low=held_low if math.isfinite(held_low) else 0.0,
        held_high=held_high if math.isfinite(held_high) else 0.0,
        wind_up_low=soft if math.isfinite(soft) else 0.0,
        wind_up_high=hard if math.isfinite(hard) else 0.0,
        duration=peak["time"],
    )
