"""What the base model's balance of torques leaves in motion: the residual that friction, gravity and cogging make."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from jointscope.diagnosis.assembly import BASE_INDEX
from jointscope.diagnosis.predict import inverse_force
from jointscope.diagnosis.prepare import PreparedRun
from jointscope.experiments.diagnosis_report.traces import Models

Vector = NDArray[np.float64]
_BELOW_RESONANCE = 0.2  # of the resonance: there the arm follows the motor, and the joint is one inertia
_CORNER = 10.0  # Hz, at most
_STANDSTILL = 0.02  # of the peak speed; slower samples have no direction
_EDGE = 0.25  # s at both ends, where the filter rings


@dataclass(frozen=True, eq=False)
class Balance:
    """Samples of the runs that move, standstill left out.

    Attributes:
        speed, position, residual: Shape (n,).
        speed_unit, position_unit, unit: Theirs.
        what: Name of the residual.
        told: A sentence on how it was computed.
    """

    speed: Vector
    position: Vector
    residual: Vector
    speed_unit: str
    position_unit: str
    unit: str
    what: str
    told: str


def balance(models: Models) -> Balance | str:
    """The balance over every run that moves, or the name of what is missing for it."""
    rotational = models.problem.rig.motion == "rotational"
    pieces = []
    moving = [run for run in models.problem.runs if run.run.experiment in ("speed-motion", "free")]
    moving = moving or [run for run in models.problem.runs if run.run.experiment == "torque-sweep"]
    if not moving:
        return "a run in motion (speed-motion, free or torque-sweep)"
    for run in moving:
        piece = _of(run, models)
        if piece is not None:
            pieces.append(piece)
    if not pieces:
        return (
            "an angle or position at the motor or the load, together with the torque or force, in a run in motion"
        )
    position, speed, residual = (np.concatenate(parts) for parts in zip(*pieces, strict=True))
    calibrated = models.problem.torque_calibrated
    unit = ("N m" if rotational else "N") if calibrated else "unit of the input"
    return Balance(
        speed=speed,
        position=position,
        residual=residual,
        speed_unit="rad/s at the output" if rotational else "m/s",
        position_unit="rad at the output" if rotational else "m",
        unit=unit,
        what="torque left by base" if rotational else "force left by base",
        told=(
            f"What the base model's equation of motion leaves of the driving {'torque' if rotational else 'force'} over "
            f"{len(pieces)} run{'s' if len(pieces) > 1 else ''}, along the recorded motion, low-passed below the resonance."
        ),
    )


def _of(run: PreparedRun, models: Models) -> tuple[Vector, Vector, Vector] | None:
    """(position, speed, residual) of one run."""
    if run.observed is None or run.observed.rate_signal:
        return None
    single = inverse_force(run, models.base_theta, (), models.problem)
    half = run.t0 + np.arange(run.steps + 1) / run.grid_rate
    q = run.observed.signal(half)
    if single is not None:
        recorded, model = single
        trim = (q.size - recorded.size) // 2
        corner = 60.0
        residual = recorded - model
        q = _smooth(q, corner, run.grid_rate)
        v = np.gradient(q) * run.grid_rate
        q, v = (x[trim : trim + residual.size] for x in (q, v))
    else:
        if run.motor is None or not run.motor_moves or run.motor_torque is None:
            return None
        corner = min(_CORNER, _BELOW_RESONANCE * models.problem.scales.frequency)
        q, v, residual = _rigid(run, models, q, corner)
    moving = np.abs(v) > _STANDSTILL * np.max(np.abs(v), initial=1e-300)
    step = max(1, int(run.grid_rate / (4.0 * corner)))
    keep = np.flatnonzero(moving)[::step]
    return (q[keep], v[keep], residual[keep]) if keep.size else None


def _rigid(run: PreparedRun, models: Models, q: Vector, corner: float) -> tuple[Vector, Vector, Vector]:
    """tau + T_ext - (J_M + J_L) q'' - (b_m + b_l) q' - G cos q, all low-passed alike with zero phase."""

    def base(name: str) -> float:
        return float(models.base_theta[BASE_INDEX[name]])

    q = _smooth(q, corner, run.grid_rate)
    v = np.gradient(q) * run.grid_rate
    a = np.gradient(v) * run.grid_rate
    torque = base("efficiency") * base("torque_scale") * (np.asarray(run.motor_torque) + base("torque_offset"))
    if run.load_force is not None:
        torque = torque + run.load_force
    inertia = base("motor_inertia") + base("load_inertia")
    damping = base("motor_damping") + base("load_damping")
    gravity = base("gravity_moment") * np.cos(q)
    residual = _smooth(torque - gravity, corner, run.grid_rate) - inertia * a - damping * v
    edge = min(int(_EDGE * run.grid_rate), q.size // 4)
    cut = slice(edge, q.size - edge)
    return q[cut], v[cut], residual[cut]


def _smooth(x: Vector, corner: float, rate: float) -> Vector:
    return np.asarray(sosfiltfilt(butter(4, corner, fs=rate, output="sos"), x))
