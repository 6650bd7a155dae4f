"""Rest: the angles and the holding torque at which nothing accelerates, from which every run starts."""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from jointscope.errors import JointscopeError
from jointscope.sim.stepping import ForceLaw, Machine, relax

Real = NDArray[np.float64]

_STEP = 1e-7  # rad, difference step of the Jacobian
_TIGHT = 1e-9  # N m
_FIRST_GUESSES = (0.0, 1e-4, -1e-4, 1e-3, -1e-3, 1e-2, -1e-2)  # rad of wind-up; a play has no stiffness inside


class EquilibriumError(JointscopeError):
    """No angles near the arm angle asked for keep the model at rest."""


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """A machine at rest.

    Attributes:
        q: Angles [rad], shape (nq,).
        torque: Motor torque on the shaft that holds them [N m].
    """

    q: Real
    torque: float


def equilibrium(machine: Machine, arm_angle: float, law: ForceLaw | None = None) -> Equilibrium:
    """Newton's method on the static forces, with the arm at ``arm_angle`` [rad] from the horizontal.

    Args:
        machine: A model whose motor is free (actuator and joint ``motor``, tendon ``arm``). Dry friction (with
            actuators named ``friction ...``) and springs that yield are left out: they can hold any point nearby.
        arm_angle: q [rad].
        law: Forces beyond the model.

    Raises:
        EquilibriumError: No rest was found.
    """
    model = _without_dry_friction(machine.model)
    data = mujoco.MjData(model)
    motor, arm = model.actuator("motor").id, model.tendon("arm").id
    data.qpos[model.joint("motor").qposadr[0]] = arm_angle
    upright = np.append(np.array(data.qpos), 0.0)
    reducer = int(model.joint("reducer").qposadr[0]) if _has_joint(model, "reducer") else 0

    def imbalance(x: Real) -> Real:
        data.qpos[:], data.qvel[:], data.ctrl[motor] = x[:-1], 0.0, x[-1]
        mujoco.mj_fwdPosition(model, data)
        relax(model, data)
        mujoco.mj_forward(model, data)
        force = data.qfrc_passive + data.qfrc_actuator - data.qfrc_bias
        if law is not None:
            force = force + law(0.0, np.array(data.qpos), np.zeros(model.nv))
        return np.append(force, (data.ten_length[arm] - arm_angle) * 1e6)  # 1e-15 rad weighs like 1e-9 N m

    best = np.inf
    for wind_up in _FIRST_GUESSES:
        unknowns = upright.copy()
        unknowns[reducer] += wind_up
        unknowns, left = _newton(imbalance, unknowns)
        if left < 1e3 * _TIGHT:
            return Equilibrium(unknowns[:-1].copy(), float(unknowns[-1]))
        best = min(best, left)
    raise EquilibriumError(f"arm angle {arm_angle:.4g} rad: no rest found, {best:.3g} N m stay unbalanced")


def _newton(imbalance: Callable[[Real], Real], unknowns: Real) -> tuple[Real, float]:
    """Where Newton's method ends, and what is left unbalanced there [N m]."""
    for _ in range(50):
        residual = imbalance(unknowns)
        if np.abs(residual).max() < _TIGHT:
            break
        jacobian = np.column_stack(
            [(imbalance(unknowns + step) - residual) / _STEP for step in np.eye(unknowns.size) * _STEP]
        )
        unknowns = unknowns - np.linalg.lstsq(jacobian, residual, rcond=None)[0]
    return unknowns, float(np.abs(imbalance(unknowns)).max())


def _without_dry_friction(model: mujoco.MjModel) -> mujoco.MjModel:
    """A copy whose asymmetric friction does not pull."""
    names = [model.actuator(i).name for i in range(model.nu)]
    friction = [i for i, name in enumerate(names) if name.startswith("friction ")]
    if not friction:
        return model
    model = copy.copy(model)
    model.actuator_biasprm[friction] = 0.0
    return model


def _has_joint(model: mujoco.MjModel, name: str) -> bool:
    return bool(mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name) >= 0)
