"""The frozen, validated parameters of the two-inertia joint and of the single-joint rig that carries it.

Symbols follow Li et al., Sensors 2022, 22(16), 6170, section 2.1. All values are SI.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from jointscope.errors import JointscopeError

STANDARD_GRAVITY = 9.80665  # m/s^2


class ParameterError(JointscopeError):
    """A parameter is outside its physical range."""

    def __init__(self, owner: str, name: str, value: float, must: str) -> None:
        self.name = name
        self.value = value
        super().__init__(f"{owner}.{name} = {value!r}: must be {must}")


def _check(owner: object, positive: tuple[str, ...], not_negative: tuple[str, ...]) -> None:
    kind = type(owner).__name__
    for field in fields(owner):  # type: ignore[arg-type]
        value = getattr(owner, field.name)
        if isinstance(value, (int, float)) and not math.isfinite(value):
            raise ParameterError(kind, field.name, value, "finite")
    for name in positive:
        if getattr(owner, name) <= 0.0:
            raise ParameterError(kind, name, getattr(owner, name), "positive")
    for name in not_negative:
        if getattr(owner, name) < 0.0:
            raise ParameterError(kind, name, getattr(owner, name), "zero or positive")


@dataclass(frozen=True, kw_only=True)
class Joint:
    """A two-inertia elastic joint, everything but J_m and J_s referred to the joint output (paper, Equations 1-4).

    Attributes:
        stiffness: K, reducer stiffness [N m/rad].
        damping: c, reducer damping [N m s/rad].
        load_inertia: J_L, arm about the joint axis [kg m^2].
        motor_inertia: J_m, on the motor shaft [kg m^2].
        reducer_inertia: J_s, on the motor shaft [kg m^2].
        reduction_ratio: n, motor turns per output turn [-].
        motor_damping: b_m [N m s/rad].
        load_damping: b_l [N m s/rad].
        efficiency: eta, motor to arm [-].
    """

    stiffness: float
    damping: float
    load_inertia: float
    motor_inertia: float
    reducer_inertia: float
    reduction_ratio: float
    motor_damping: float = 0.0
    load_damping: float = 0.0
    efficiency: float = 1.0

    def __post_init__(self) -> None:
        _check(
            self,
            positive=("stiffness", "load_inertia", "reduction_ratio", "efficiency"),
            not_negative=("damping", "motor_inertia", "reducer_inertia", "motor_damping", "load_damping"),
        )

    @property
    def reflected_inertia(self) -> float:
        """J_M = (J_m + J_s) n^2 [kg m^2] (paper, Equation 2)."""
        return (self.motor_inertia + self.reducer_inertia) * self.reduction_ratio**2


@dataclass(frozen=True, kw_only=True)
class Rig:
    """The single-joint rig: a joint, its arm's mass distribution, and where it is hit and measured.

    Attributes:
        joint: The elastic joint.
        arm_mass: m [kg].
        arm_com_radius: r, joint axis to the arm's centre of mass [m].
        hammer_radius: Joint axis to the point that is hit [m].
        accelerometer_radius: Joint axis to the accelerometer [m].
        gravity: g [m/s^2]; 0 for a horizontal plane.
    """

    joint: Joint
    arm_mass: float
    arm_com_radius: float
    hammer_radius: float
    accelerometer_radius: float
    gravity: float = STANDARD_GRAVITY

    def __post_init__(self) -> None:
        _check(
            self,
            positive=("arm_mass", "hammer_radius", "accelerometer_radius"),
            not_negative=("arm_com_radius", "gravity"),
        )
        if self.joint.load_inertia <= self.arm_mass * self.arm_com_radius**2:
            raise ParameterError(
                "Rig",
                "joint.load_inertia",
                self.joint.load_inertia,
                f"above m r^2 = {self.arm_mass * self.arm_com_radius**2:.4g} kg m^2, or the arm has no inertia of its own",
            )

    def gravity_torque(self, arm_angle: float) -> float:
        """Gravity's torque on the arm, -m g r cos(q) [N m], at angle q from the horizontal [rad]."""
        return -self.arm_mass * self.gravity * self.arm_com_radius * math.cos(arm_angle)

    def gravity_stiffness(self, arm_angle: float) -> float:
        """-d(gravity torque)/dq = -m g r sin(q) [N m/rad], added to K in small motion about q (paper, Equation 14)."""
        return -self.arm_mass * self.gravity * self.arm_com_radius * math.sin(arm_angle)
