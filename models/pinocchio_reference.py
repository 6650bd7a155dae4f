"""Pinocchio's reading of the same MJCF: inertia about the joint and gravity torque, a second opinion on MuJoCo.

Pinocchio takes a file path only, reads one tree, and keeps neither springs nor tendons; armature it keeps.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pinocchio
from numpy.typing import NDArray

from jointscope.errors import InputError

Real = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class RigidBodies:
    """A model as Pinocchio reads it.

    Attributes:
        joints: Its joints in order of their coordinates.
    """

    path: Path
    joints: tuple[str, ...]
    _model: Any = field(repr=False)

    def mass_matrix(self, q: Real) -> Real:
        """M(q), armature included [kg m^2], shape (nv, nv), at ``q`` [rad], shape (nv,)."""
        matrix = pinocchio.crba(self._model, self._model.createData(), np.asarray(q, dtype=float))
        return np.array(matrix)

    def gravity_torque(self, q: Real) -> Real:
        """Torque of gravity on each joint [N m], shape (nv,), at ``q`` [rad]; in the sense of +q (so -m g r cos q)."""
        return -np.array(
            pinocchio.computeGeneralizedGravity(self._model, self._model.createData(), np.asarray(q, dtype=float))
        )


def load_mjcf(path: Path) -> RigidBodies:
    """Read an MJCF file into Pinocchio.

    Raises:
        InputError: The file can't be read, or Pinocchio kept fewer joints than it holds (it silently
            drops every tree but the first).
    """
    try:
        model = pinocchio.buildModelFromMJCF(str(path))
    except (ValueError, RuntimeError) as problem:
        raise InputError(path, None, f"Pinocchio can't read it as MJCF: {problem}") from problem
    own = mujoco.MjModel.from_xml_path(str(path))
    model.gravity.linear = np.array(own.opt.gravity)  # Pinocchio keeps its default of 9.81 whatever the file says
    expected = own.nv
    if model.nv != expected:
        raise InputError(
            path, "worldbody", f"Pinocchio read {model.nv} of {expected} degrees of freedom",
            fix="nest all bodies in one tree",
        )  # fmt: skip
    return RigidBodies(path, tuple(model.names[1:]), model)


def arm_inertia(bodies: RigidBodies, arm_joint: str = "reducer") -> float:
    """J_L: inertia of everything beyond ``arm_joint`` about its axis [kg m^2], the joints beyond it held."""
    index = _index(bodies, arm_joint)
    return float(bodies.mass_matrix(np.zeros(len(bodies.joints)))[index, index])


def arm_gravity_torque(bodies: RigidBodies, arm_angle: float, arm_joint: str = "reducer") -> float:
    """Gravity's torque about ``arm_joint`` [N m] with the arm at ``arm_angle`` [rad] and no wind-up.

    The angle is put on the first joint, the motor's (or on ``arm_joint`` itself where the motor has no joint).
    """
    index = _index(bodies, arm_joint)
    q = np.zeros(len(bodies.joints))
    q[0] = arm_angle
    return float(bodies.gravity_torque(q)[index])


def _index(bodies: RigidBodies, joint: str) -> int:
    if joint not in bodies.joints:
        raise InputError(
            bodies.path, "joint", "no such joint", value=joint, fix=f"it has {', '.join(bodies.joints)}"
        )
    return bodies.joints.index(joint)
