"""The base model of one run: which side moves how, and the numbers its equations of motion need.

Two-inertia rig (campaign format; paper, Equation 4)::

    J_M q_s'' + b_m q_s' = eta n T_e - T_S
    J_L q''   + b_l q'   = T_S + T_ext - m g r cos(q)
    T_S = K (q_s - q) + c (q_s' - q')

With the brake on q_s stands still, and the load equation alone is left (paper, Equation 14). A single-dof rig has one
inertia, on a ground spring (``held``) or on nothing (``rigid``), and eta n T_e acts on it directly; a rigid axis turns its
motor with it, so there J_M and b_m (0 where unknown) add to J_L and b_l.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from jointscope.errors import RefusedError
from jointscope.identification.model_file import BaseModel
from jointscope.models.parameters import STANDARD_GRAVITY
from jointscope.recordings.campaign import Run, Signal

MotorSide = Literal["free", "held", "moves", "rigid"]


@dataclass(frozen=True, kw_only=True)
class Plant:
    """Equations of motion of one run, everything at the joint output (rotational: N m, rad; translational: N, m).

    Attributes:
        motor: Whether the motor side follows its torque (``free``), stands still (``held``: brake or ground spring),
            is moved as recorded (``moves``), or is one body with the load (``rigid``).
        load_moves: Whether the load's motion is prescribed.
        motor_inertia: J_M, reflected [kg m^2].
        load_inertia: J_L [kg m^2].
        stiffness: K [N m/rad].
        damping: c [N m s/rad].
        motor_damping: b_m [N m s/rad].
        load_damping: b_l [N m s/rad].
        gravity_moment: m g r [N m]; 0 where gravity does not act.
        ratio: n [-].
        gain: eta n, torque at the output per torque on the motor shaft [-].
    """

    motor: MotorSide
    load_moves: bool = False
    motor_inertia: float = 0.0
    load_inertia: float
    stiffness: float = 0.0
    damping: float = 0.0
    motor_damping: float = 0.0
    load_damping: float = 0.0
    gravity_moment: float = 0.0
    ratio: float = 1.0
    gain: float = 1.0

    def gravity_torque(self, angle: NDArray[np.float64]) -> NDArray[np.float64]:
        """-m g r cos(q) [N m] at ``angle`` [rad], same shape."""
        return -self.gravity_moment * np.cos(angle)

    def resting_motor_angle(self, arm_angle: float) -> float:
        """q_s at rest, at the output [rad]: the spring carries gravity."""
        if self.stiffness == 0.0:
            return arm_angle
        return arm_angle + self.gravity_moment * math.cos(arm_angle) / self.stiffness

    def holding_torque(self, arm_angle: float) -> float:
        """T_e that holds the arm at rest [N m, motor shaft]."""
        return self.gravity_moment * math.cos(arm_angle) / self.gain

    def fastest_rate(self) -> float:
        """Largest magnitude among the eigenvalues of the linear part [rad/s]."""
        K, c = self.stiffness, self.damping
        if self.motor == "rigid":
            return self.load_damping / self.load_inertia
        load = np.array([[0.0, 1.0], [-K / self.load_inertia, -(c + self.load_damping) / self.load_inertia]])
        if self.motor != "free":
            return float(np.max(np.abs(np.linalg.eigvals(load))))
        J_M, J_L = self.motor_inertia, self.load_inertia
        A = np.array(
            [
                [0.0, 1.0, 0.0, 0.0],
                [-K / J_M, -(c + self.motor_damping) / J_M, K / J_M, c / J_M],
                [0.0, 0.0, 0.0, 1.0],
                [K / J_L, c / J_L, -K / J_L, -(c + self.load_damping) / J_L],
            ]
        )
        return float(np.max(np.abs(np.linalg.eigvals(A))))


def prescribed_motion(run: Run) -> Signal | None:
    """The recorded angle or position that the run declares as its input, or ``None``."""
    chosen = [*run.select("angle", role="input"), *run.select("position", role="input")]
    return chosen[0] if chosen else None


def gravity_moment(model: BaseModel) -> float:
    """m g r of the arm [N m]; 0 on a horizontal or translational rig, and where mass or radius are unknown."""
    rig = model.rig
    known = rig.arm_mass is not None and rig.arm_com_radius is not None and model.input_unit in ("N m", "N")
    if rig.plane != "vertical" or rig.motion != "rotational" or not known:
        return 0.0
    return float(rig.arm_mass or 0.0) * STANDARD_GRAVITY * float(rig.arm_com_radius or 0.0)


def plant_of(model: BaseModel, run: Run) -> Plant:
    """The plant of ``run``, as its brake, hold and inputs say.

    Raises:
        RefusedError: A value that this run needs is unknown.
    """
    joint = model.joint
    ratio = joint.get("reduction_ratio", 1.0)
    motion = prescribed_motion(run)
    at_motor = motion is not None and motion.channel.location == "motor"
    motor = _motor_side(model, run, at_motor)
    needed = {
        "free": ("load_inertia", "stiffness", "motor_inertia"),
        "moves": ("load_inertia", "stiffness"),
        "held": ("load_inertia", "stiffness"),
        "rigid": ("load_inertia",),
    }[motor]
    missing = [name for name in needed if name not in joint]
    if missing:
        raise RefusedError(
            f"model.json: joint.{missing[0]} is unknown and run {run.id!r} can't be predicted without it; "
            "give it under [rig] of the campaign and identify again"
        )
    shafts = joint.get("motor_inertia", 0.0) + joint.get("reducer_inertia", 0.0)
    rigid = motor == "rigid"
    return Plant(
        motor=motor,
        load_moves=motion is not None and (rigid or not at_motor),
        motor_inertia=shafts * ratio**2,
        load_inertia=joint["load_inertia"] + (shafts * ratio**2 if rigid else 0.0),
        stiffness=0.0 if rigid else joint["stiffness"],
        damping=0.0 if rigid else joint.get("damping", 0.0),
        motor_damping=joint.get("motor_damping", 0.0),
        load_damping=joint.get("load_damping", 0.0)
        + (joint.get("damping", 0.0) + joint.get("motor_damping", 0.0) if rigid else 0.0),
        gravity_moment=gravity_moment(model),
        ratio=ratio,
        gain=joint.get("efficiency", 1.0) * ratio,
    )


def _motor_side(model: BaseModel, run: Run, at_motor: bool) -> MotorSide:
    rig = model.rig
    held = run.motor_held
    if rig.topology == "single-dof":
        return "held" if rig.grounded(held=held) else "rigid"
    if held:
        return "held"
    if at_motor:
        return "moves"
    driven = run.select("speed-command") or [
        signal
        for quantity in ("torque", "current", "phase-current", "voltage")
        for signal in run.select(quantity, location="motor", role="input")
    ]
    # A drive that holds its shaft still without a word about its torque is, to the base model, a clamp.
    return "held" if run.hold.get("") == "drive" and not driven else "free"
