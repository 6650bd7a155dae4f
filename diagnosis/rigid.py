"""Start values from slow motion: the rigid body's balance, and the wind-up between two encoders."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from jointscope.diagnosis.assembly import BASE_INDEX
from jointscope.diagnosis.parameters import zero_near
from jointscope.recordings.campaign import gearing

if TYPE_CHECKING:
    from jointscope.diagnosis.problem import BaseSpec, Output, PreparedRun

Vector = NDArray[np.float64]

_CORNER = 8.0  # Hz; below a joint's resonance
_TURNED = 0.1  # change of cos q below which a constant torque can't be told from the weight
_STILL = 0.02  # of the top speed, below which dry friction is undecided


def rigid_start(
    base: BaseSpec, runs: tuple[PreparedRun, ...], start: Vector, known_inertia: float
) -> Vector | None:
    """``start`` with inertia, damping, weight and stiffness from the slow part of the runs that travel.

    tau = J q'' + b q' + T sgn(q') + const + M cos q, by least squares over the observed angle; Delta = T_S / K where
    both encoders were recorded. Dry friction and the constant are there to keep the other terms unbiased and are
    dropped. ``known_inertia``: what the nameplate has of the motor side's [kg m^2].
    """
    rows = [part for run in runs for part in (_rows(run, start),) if part is not None]
    if not rows:
        return None
    A, tau = np.concatenate([a for a, _ in rows]), np.concatenate([t for _, t in rows])
    weighing = bool(base.free[BASE_INDEX["gravity_moment"]])
    if not weighing:
        tau = tau - A[:, 4] * start[BASE_INDEX["gravity_moment"]]
        A = A[:, :4]
    elif np.ptp(A[:, 4]) < _TURNED:
        A = A * np.array([1.0, 1.0, 1.0, 0.0, 1.0])  # over a small travel a constant and the weight are one
    size = np.linalg.norm(A, axis=0)
    size[size == 0.0] = 1.0
    x = np.linalg.lstsq(A / size, tau, rcond=1e-8)[0] / size
    if not np.isfinite(x).all() or x[0] <= 0.0:
        return None
    found = start.copy()
    moving = any(run.motor_moves for run in runs)
    J_M = start[BASE_INDEX["motor_inertia"]] if moving else 0.0
    if moving and base.free[BASE_INDEX["motor_inertia"]]:
        J_M = known_inertia if 0.0 < known_inertia < 0.95 * x[0] else 0.5 * x[0]
        found[BASE_INDEX["motor_inertia"]] = J_M
    found[BASE_INDEX["load_inertia"]] = max(x[0] - J_M, 0.05 * x[0])
    names = ("motor_damping", "load_damping") if moving else ("load_damping",)
    for name in names:
        found[BASE_INDEX[name]] = max(x[1], 0.0) / len(names)
    if base.free[BASE_INDEX["torque_offset"]] and not zero_near(runs):
        found[BASE_INDEX["torque_offset"]] = -x[3]
    if weighing:
        found[BASE_INDEX["gravity_moment"]] = x[4]
    _stiffness(found, runs)
    return found


def _smooth(x: Vector, rate: float) -> Vector:
    return np.asarray(sosfiltfilt(butter(3, _CORNER, fs=rate, output="sos"), x))


def _rows(run: PreparedRun, start: Vector) -> tuple[NDArray[np.float64], Vector] | None:
    """Regressors (q'', q', sgn, 1, cos q) and torque of one run, thinned to a few samples per corner period."""
    if run.observed is None:
        return None
    step = max(1, int(run.grid_rate / (8.0 * _CORNER)))
    if run.observed.rate_signal:
        v = _smooth(run.observed_half[::2], run.grid_rate)
        q = run.initial_angle + np.cumsum(v) / run.grid_rate
    else:
        q = _smooth(run.observed_half[::2], run.grid_rate)
        v = np.gradient(q) * run.grid_rate
    if np.ptp(q) < 1e-4:
        return None
    a = np.gradient(v) * run.grid_rate
    tau = run.load_half[::2].copy()
    if run.motor is not None:
        tau += run.motor_half[::2] * start[BASE_INDEX["efficiency"]] * start[BASE_INDEX["torque_scale"]]
    tau = _smooth(tau, run.grid_rate)
    top = np.max(np.abs(v))
    moving = np.abs(v) > _STILL * top
    moving[: int(0.1 * run.grid_rate)] = False
    moving[-int(0.1 * run.grid_rate) :] = False
    rows = np.stack([a, v, np.sign(v), np.ones(q.size), np.cos(q)], axis=1)[::step]
    keep = moving[::step]
    return (rows[keep], tau[::step][keep]) if keep.sum() > 20 else None


def _angles(run: PreparedRun) -> tuple[Output, Output] | None:
    motor = [o for o in run.outputs if o.quantity in ("angle", "position") and o.location == "motor"]
    arm = [o for o in run.outputs if o.quantity in ("angle", "position") and o.location != "motor"]
    return (motor[0], arm[0]) if motor and arm else None


def _stiffness(found: Vector, runs: tuple[PreparedRun, ...]) -> None:
    """K from the slow wind-up between two encoders against the load's torque, written into ``found``."""
    deltas, torques, signs = [], [], []
    for run in runs:
        pair = _angles(run)
        if pair is None or not run.motor_moves:
            continue
        motor, arm = pair
        q_s = np.interp(run.time, motor.times, motor.data / gearing(motor.quantity, motor.location, run.ratio))
        q = np.interp(run.time, arm.times, arm.data) * _same_sense(motor, arm)
        q = _smooth(q, run.grid_rate)
        v = np.gradient(q) * run.grid_rate
        a = np.gradient(v) * run.grid_rate
        torque = found[BASE_INDEX["load_inertia"]] * a + found[BASE_INDEX["load_damping"]] * v
        torque += found[BASE_INDEX["gravity_moment"]] * (np.cos(q) - np.cos(q[0]))
        deltas.append(_smooth(q_s, run.grid_rate) - q)
        torques.append(torque)
        signs.append(np.sign(v) * (np.abs(v) > _STILL * np.max(np.abs(v))))
    if not deltas:
        return
    delta, torque, sign = np.concatenate(deltas), np.concatenate(torques), np.concatenate(signs)
    A = np.stack([torque, sign, np.ones(delta.size)], axis=1)
    size = np.linalg.norm(A, axis=0)
    size[size == 0.0] = 1.0
    compliance = (np.linalg.lstsq(A / size, delta, rcond=1e-10)[0] / size)[0]
    if compliance > 0.0:
        found[BASE_INDEX["stiffness"]] = 1.0 / compliance
        inertia = found[BASE_INDEX["load_inertia"]]
        found[BASE_INDEX["damping"]] = 2.0 * 0.03 * np.sqrt(inertia / compliance)


def _same_sense(motor: Output, arm: Output) -> float:
    """-1 where the two encoders count in opposite senses."""
    n = min(motor.data.size, arm.data.size)
    a = np.interp(np.linspace(0, 1, n), np.linspace(0, 1, motor.data.size), motor.data - motor.data.mean())
    b = np.interp(np.linspace(0, 1, n), np.linspace(0, 1, arm.data.size), arm.data - arm.data.mean())
    return -1.0 if float(a @ b) < 0.0 else 1.0
