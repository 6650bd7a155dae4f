"""MuJoCo's figures beside Pinocchio's, and all modes by three routes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from jointscope.models.arm.build import ElasticArm
from jointscope.models.arm.holding import equilibrium, hold_arm
from jointscope.models.arm.linear import joint_values, linear_arm, natural_modes, stepped_frequencies
from jointscope.models.arm.reference import Reference

Real = NDArray[np.float64]

_STEP = 1e-4  # rad, of the central difference that gives MuJoCo's gravity stiffness
_TIMESTEP = 1e-5  # s, of the linearised step


@dataclass(frozen=True, kw_only=True, eq=False)
class Agreement:
    """Two engines, one arm, one posture.

    Attributes:
        mass, gravity, gravity_stiffness: Largest difference over the largest entry [-].
        pinocchio: Modes of (K, M) with Pinocchio's matrices [Hz], braked, shape (n,).
        mujoco: Modes of (K, M) with MuJoCo's matrices [Hz], shape (n,).
        stepped: Modes of the map that MuJoCo steps [Hz], shape (n,).
    """

    mass: float
    gravity: float
    gravity_stiffness: float
    pinocchio: Real
    mujoco: Real
    stepped: Real

    @property
    def modes(self) -> float:
        """Largest relative difference between the three routes [-]."""
        routes = np.array([self.pinocchio, self.mujoco, self.stepped])
        return float(np.max(np.ptp(routes, axis=0) / self.pinocchio))


def mujoco_mass_matrix(arm: ElasticArm, posture: Mapping[str, float]) -> Real:
    """M(q) of the links [kg m^2] by MuJoCo, rotors left out, shape (n, n)."""
    model, data, dofs = _at(arm, posture)
    full = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, full)
    return full[np.ix_(dofs, dofs)]


def mujoco_gravity(arm: ElasticArm, posture: Mapping[str, float]) -> Real:
    """Torque that holds each link against gravity [N m] by MuJoCo, shape (n,)."""
    _, data, dofs = _at(arm, posture)
    return np.array(data.qfrc_bias[dofs], dtype=np.float64)


def mujoco_gravity_stiffness(arm: ElasticArm, posture: Mapping[str, float]) -> Real:
    """d(gravity)/dq [N m/rad] from central differences of MuJoCo's gravity torque, shape (n, n)."""
    columns = []
    for name in arm.rotors:
        ahead = {**posture, name: posture.get(name, 0.0) + _STEP}
        behind = {**posture, name: posture.get(name, 0.0) - _STEP}
        columns.append((mujoco_gravity(arm, ahead) - mujoco_gravity(arm, behind)) / (2.0 * _STEP))
    return np.stack(columns, axis=1)


def compare_engines(arm: ElasticArm, reference: Reference, posture: Mapping[str, float]) -> Agreement:
    """Mass matrix, gravity and modes of ``arm`` at ``posture`` [rad], all rotors braked, by both engines."""
    M, g, Kg = (
        mujoco_mass_matrix(arm, posture), mujoco_gravity(arm, posture), mujoco_gravity_stiffness(arm, posture)
    )  # fmt: skip
    values = joint_values(arm)
    modes = natural_modes(linear_arm(reference, posture, values, {}))
    square = linalg.eigh(np.diag(values.stiffness) + 0.5 * (Kg + Kg.T), M, eigvals_only=True)
    held = hold_arm(arm, {}, posture, timestep=_TIMESTEP)
    return Agreement(
        mass=_difference(M, reference.mass_matrix(posture)),
        gravity=_difference(g, reference.gravity(posture)),
        gravity_stiffness=_difference(Kg, reference.gravity_stiffness(posture)),
        pinocchio=modes.frequency,
        mujoco=np.sqrt(square) / (2.0 * np.pi),
        stepped=stepped_frequencies(held, equilibrium(held, posture)),
    )


def _at(arm: ElasticArm, posture: Mapping[str, float]) -> tuple[mujoco.MjModel, mujoco.MjData, NDArray[np.int_]]:
    model = arm.spec.compile()
    data = mujoco.MjData(model)
    for joint in range(model.njnt):
        name = model.joint(joint).name
        if name not in arm.rotors:
            data.qpos[model.jnt_qposadr[joint]] = posture.get(name.removesuffix("_elastic"), 0.0)
    mujoco.mj_forward(model, data)
    return model, data, np.array([int(model.joint(name).dofadr[0]) for name in arm.reducers])


def _difference(a: Real, b: Real) -> float:
    return float(np.max(np.abs(a - b)) / max(float(np.max(np.abs(b))), 1e-12))
