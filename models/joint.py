r"""The two-inertia joint in closed form (Li et al., Sensors 2022, 22(16), 6170, Equations 1-24).

J_M q_s'' + b_m q_s' = eta n T_e - T_S
J_L q'' + b_l q'     = T_S + T_L
T_S = K (q_s - q) + c (q_s' - q')
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from jointscope.models.parameters import Joint

Complex = NDArray[np.complex128]


def series_stiffness(*parts: float) -> float:
    """K = 1/(1/K_1 + 1/K_2 + ...) [N m/rad] (1)."""
    return 1.0 / sum(1.0 / part for part in parts)


def denominator(joint: Joint) -> NDArray[np.float64]:
    """Coefficients of D(s), highest power first, shape (4,) (5)."""
    J_M, J_L, K, c = joint.reflected_inertia, joint.load_inertia, joint.stiffness, joint.damping
    b_m, b_l = joint.motor_damping, joint.load_damping
    return np.array(
        [
            J_M * J_L,
            J_M * b_l + J_L * b_m + J_M * c + J_L * c,
            J_M * K + J_L * K + b_m * c + b_l * c + b_m * b_l,
            K * (b_m + b_l),
        ]
    )


def load_speed_per_torque(joint: Joint, s: Complex) -> Complex:
    """G_s(s) = q'/(n T_e) [rad/s per N m] (5), shape of ``s`` [rad/s]."""
    return np.asarray(
        (joint.damping * s + joint.stiffness) / np.polyval(denominator(joint), s), dtype=np.complex128
    )


def load_acceleration_per_torque(joint: Joint, s: Complex) -> Complex:
    """G_a(s) = s G_s(s) = q''/(n T_e) [rad/s^2 per N m] (7), shape of ``s`` [rad/s]."""
    return s * load_speed_per_torque(joint, s)


def motor_acceleration_per_torque(joint: Joint, s: Complex) -> Complex:
    """q_s''/(n T_e) [rad/s^2 per N m], the driving-point accelerance at the motor, shape of ``s`` [rad/s]."""
    J_L, K, c, b_l = joint.load_inertia, joint.stiffness, joint.damping, joint.load_damping
    return np.asarray(
        s * (J_L * s**2 + (b_l + c) * s + K) / np.polyval(denominator(joint), s), dtype=np.complex128
    )


def hammer_receptance(joint: Joint, s: Complex, gravity_stiffness: float = 0.0) -> Complex:
    """q/T_L = 1/(J_L s^2 + (c + b_l) s + K + K_g) [rad per N m], motor braked (17).

    ``gravity_stiffness`` K_g = -G L sin(alpha) in the paper's symbols [N m/rad].
    """
    return 1.0 / (
        joint.load_inertia * s**2 + (joint.damping + joint.load_damping) * s + joint.stiffness + gravity_stiffness
    )


def hammer_accelerance(joint: Joint, s: Complex, gravity_stiffness: float = 0.0) -> Complex:
    """q''/T_L = s^2 q/T_L [rad/s^2 per N m], motor braked ((19) with its initial-condition constants at zero)."""
    return s**2 * hammer_receptance(joint, s, gravity_stiffness)


def antiresonance(joint: Joint) -> float:
    """w_ARF = sqrt(K/J_L) [rad/s] (8)."""
    return math.sqrt(joint.stiffness / joint.load_inertia)


def torsion_frequency(joint: Joint) -> float:
    """w_NTF = sqrt(K (1/J_M + 1/J_L)) [rad/s] (9)."""
    return math.sqrt(joint.stiffness * (1.0 / joint.reflected_inertia + 1.0 / joint.load_inertia))


@dataclass(frozen=True, kw_only=True)
class DirectForm:
    """One term (b1 s^2 + b2 s + b3)/(s^2 + a1 s + a2) of the direct parametric form (20, 24).

    b1 [1/(kg m^2)], b2 [1/(kg m^2 s)], b3 [1/(kg m^2 s^2)], a1 [1/s], a2 [1/s^2].
    """

    b1: float
    b2: float
    b3: float
    a1: float
    a2: float

    def response(self, s: Complex) -> Complex:
        """G_i(s) [rad/s^2 per N m], shape of ``s`` [rad/s] (20)."""
        return np.asarray(
            (self.b1 * s**2 + self.b2 * s + self.b3) / (s**2 + self.a1 * s + self.a2), dtype=np.complex128
        )

    @property
    def inertia(self) -> float:
        """J = 1/b1 [kg m^2] (21)."""
        return 1.0 / self.b1

    @property
    def damping(self) -> float:
        """c = a1/b1 [N m s/rad] (21)."""
        return self.a1 / self.b1

    @property
    def stiffness(self) -> float:
        """K = a2/b1 [N m/rad] (21), gravity's share included; (25) as printed divides by a11, its numbers by b11."""
        return self.a2 / self.b1


def sum_of_modes(terms: Sequence[DirectForm], s: Complex) -> Complex:
    """G_TA(s), the sum of single-mode terms [rad/s^2 per N m] (24)."""
    return np.asarray(np.sum([term.response(s) for term in terms], axis=0), dtype=np.complex128)
