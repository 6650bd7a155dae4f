r"""Small motion of an elastic arm about rest: M x'' + C x' + K x = f, its modes and responses.

Coordinates x are the link angles q and, where they move, the rotor angles q_s at the output. With T_S = K (q_s - q)
+ c (q_s' - q') (paper, Equation 4) and Pinocchio's M(q) and gravity stiffness K_g,

    M = diag(M_link, J_M),  K = [[K_J + K_g, -K_J], [-K_J, K_J + k_p]],  C likewise with c, b_m and k_v.

A braked rotor drops out of x, a locked joint drops out with its link.
"""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from jointscope.models.arm.build import DRIVE, ElasticArm
from jointscope.models.arm.holding import HeldArm, HoldKind, Rest, damping_of_dofs
from jointscope.models.arm.reference import Reference

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]


@dataclass(frozen=True, kw_only=True, eq=False)
class JointValues:
    """Per joint, at the output, shape (n,) each; a drive that doesn't exist has zero gains.

    Attributes:
        stiffness: K [N m/rad].
        damping: c [N m s/rad].
        rotor_inertia: J_M [kg m^2].
        rotor_damping: b_m [N m s/rad].
        drive_stiffness: k_p [N m/rad].
        drive_damping: k_v [N m s/rad].
    """

    stiffness: Real
    damping: Real
    rotor_inertia: Real
    rotor_damping: Real
    drive_stiffness: Real
    drive_damping: Real


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearArm:
    """M x'' + C x' + K x = f.

    Attributes:
        M, C, K: Shape (m, m); [kg m^2], [N m s/rad], [N m/rad].
        link: Place of each joint's link angle in x, -1 where it is locked, shape (n,).
        rotor: Place of each joint's rotor angle in x, -1 where it stands still, shape (n,).
        spring: K_J of each joint [N m/rad], shape (n,).
    """

    M: Real
    C: Real
    K: Real
    link: NDArray[np.int_]
    rotor: NDArray[np.int_]
    spring: Real

    def on_links(self, row: Real) -> Real:
        """A row over link angles, shape (n,), as one over x, shape (m,)."""
        out = np.zeros(self.M.shape[0])
        out[self.link[self.link >= 0]] = row[self.link >= 0]
        return out

    def on_rotor(self, joint: int) -> Real:
        """Unit torque on (or angle of) one rotor, shape (m,)."""
        out = np.zeros(self.M.shape[0])
        out[self.rotor[joint]] = 1.0
        return out

    def receptance(self, s: Complex, force: Real) -> Complex:
        """x per unit of a force of distribution ``force``, shape (n_s, m) for s [rad/s] of shape (n_s,)."""
        dynamic = s[:, None, None] ** 2 * self.M + s[:, None, None] * self.C + self.K
        return np.asarray(
            np.linalg.solve(dynamic, np.broadcast_to(force, (s.size, force.size))[..., None])[..., 0]
        )

    def accelerance(self, s: Complex, force: Real, motion: Real, tilt: Real | None = None) -> Complex:
        """What an accelerometer reads per unit of force, shape (n_s,): (s^2 motion + tilt) x."""
        x = self.receptance(s, force)
        reading = s**2 * (x @ motion)
        return np.asarray(reading if tilt is None else reading + x @ tilt)


@dataclass(frozen=True, kw_only=True, eq=False)
class Modes:
    """Undamped modes, lowest first.

    Attributes:
        frequency: [Hz], shape (n_modes,).
        shape: Mass-normalised, columns, shape (m, n_modes): x = shape @ eta, shape.T M shape = 1.
        damping_ratio: phi^T C phi/(2 omega) [-], shape (n_modes,).
        strain: Share of each joint's reducer in the elastic energy, shape (n_joints, n_modes), columns sum to 1.
    """

    frequency: Real
    shape: Real
    damping_ratio: Real
    strain: Real


def joint_values(arm: ElasticArm) -> JointValues:
    """The figures that the arm's MJCF holds."""
    model = arm.spec.compile()
    rotor = np.array([int(model.joint(name).id) for name in arm.rotors])
    reducer = np.array([int(model.joint(name).id) for name in arm.reducers])
    damping = model.dof_damping if model.dof_damping.ndim == 1 else model.dof_damping[:, 0]
    stiffness = model.jnt_stiffness if model.jnt_stiffness.ndim == 1 else model.jnt_stiffness[:, 0]
    gains = np.zeros((2, len(arm.rotors)))
    for k, name in enumerate(arm.rotors):
        index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_ACTUATOR, name + DRIVE)
        if index >= 0:
            gains[:, k] = model.actuator_gainprm[index, 0], -model.actuator_biasprm[index, 2]
    return JointValues(
        stiffness=np.array(stiffness[reducer]),
        damping=np.array(damping[model.jnt_dofadr[reducer]]),
        rotor_inertia=np.array(model.dof_armature[model.jnt_dofadr[rotor]]),
        rotor_damping=np.array(damping[model.jnt_dofadr[rotor]]),
        drive_stiffness=gains[0],
        drive_damping=gains[1],
    )


def linear_arm(
    reference: Reference, posture: Mapping[str, float], values: JointValues, hold: Mapping[str, HoldKind]
) -> LinearArm:
    """Small motion about rest at ``posture`` [rad] with each joint held as ``hold`` says (``brake`` where silent)."""
    n = len(reference.joints)
    kinds = [hold.get(name, "brake") for name in reference.joints]
    moving = [k for k in range(n) if kinds[k] != "locked"]
    turning = [k for k in range(n) if kinds[k] in ("drive", "free")]
    link, rotor = np.full(n, -1), np.full(n, -1)
    link[moving] = np.arange(len(moving))
    rotor[turning] = len(moving) + np.arange(len(turning))
    size = len(moving) + len(turning)
    M, C, K = np.zeros((size, size)), np.zeros((size, size)), np.zeros((size, size))
    inner = np.ix_(link[moving], link[moving])
    M[inner] = reference.mass_matrix(posture)[np.ix_(moving, moving)]
    K[inner] = reference.gravity_stiffness(posture)[np.ix_(moving, moving)]
    for k in moving:
        places = [link[k]] + ([rotor[k]] if rotor[k] >= 0 else [])
        sign = np.array([[1.0, -1.0], [-1.0, 1.0]])[: len(places), : len(places)]
        K[np.ix_(places, places)] += values.stiffness[k] * sign
        C[np.ix_(places, places)] += values.damping[k] * sign
    for k in turning:
        driven = 1.0 if kinds[k] == "drive" else 0.0
        M[rotor[k], rotor[k]] += values.rotor_inertia[k]
        C[rotor[k], rotor[k]] += values.rotor_damping[k] + driven * values.drive_damping[k]
        K[rotor[k], rotor[k]] += driven * values.drive_stiffness[k]
    return LinearArm(M=M, C=C, K=K, link=link, rotor=rotor, spring=values.stiffness.copy())


def natural_modes(linear: LinearArm) -> Modes:
    """Solve K phi = omega^2 M phi."""
    square, shape = linalg.eigh(linear.K, linear.M)
    omega = np.sqrt(np.maximum(square, 0.0))
    modal_damping = np.einsum("im,ij,jm->m", shape, linear.C, shape)
    ratio = np.divide(modal_damping, 2.0 * omega, out=np.zeros_like(omega), where=omega > 1e-9)
    windup = np.zeros((linear.link.size, omega.size))
    for k in np.flatnonzero(linear.link >= 0):
        windup[k] = shape[linear.link[k]] - (shape[linear.rotor[k]] if linear.rotor[k] >= 0 else 0.0)
    energy = linear.spring[:, None] * windup**2
    total = energy.sum(axis=0)
    strain = np.divide(energy, total, out=np.zeros_like(energy), where=total > 0.0)
    return Modes(frequency=omega / (2.0 * np.pi), shape=shape, damping_ratio=ratio, strain=strain)


def damped_poles(linear: LinearArm) -> tuple[Real, Real]:
    """Frequencies |s|/2 pi [Hz] and damping ratios [-] of the oscillating poles, lowest first, shape (n_modes,) each."""
    m = linear.M.shape[0]
    inverse = np.linalg.inv(linear.M)
    state = np.block([[np.zeros((m, m)), np.eye(m)], [-inverse @ linear.K, -inverse @ linear.C]])
    poles = np.linalg.eigvals(state)
    poles = poles[poles.imag > 1e-9]
    poles = poles[np.argsort(np.abs(poles))]
    return np.abs(poles) / (2.0 * np.pi), -poles.real / np.abs(poles)


def stepped_frequencies(held: HeldArm, rest: Rest) -> Real:
    """Undamped natural frequencies [Hz] of the held model as MuJoCo steps it, shape (n_modes,).

    From the transition matrix of one step about ``rest``, its damping taken out: an eigenvalue e^(i theta) of the
    semi-implicit Euler map stands for omega = 2 sin(theta/2)/h exactly.
    """
    model = copy(held.model)
    h = model.opt.timestep
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = rest.qpos, 0.0
    total = damping_of_dofs(model)
    for joint, kind in held.hold.items():
        if kind == "drive":
            k = held.arm.index(joint)
            index = held.actuator(joint + DRIVE)
            data.ctrl[index] = rest.rotor[k] + rest.torque[k] / model.actuator_gainprm[index, 0]
            model.actuator_biasprm[index, 2] = 0.0
    model.dof_armature -= 0.5 * h * total
    model.dof_damping[:] = 0.0
    mujoco.mj_forward(model, data)
    size = 2 * model.nv + model.na
    transition = np.zeros((size, size))
    mujoco.mjd_transitionFD(model, data, 1e-6, True, transition, None, None, None)
    theta = np.angle(np.linalg.eigvals(transition))
    return np.sort(2.0 * np.sin(theta[theta > 0.0] / 2.0) / h)[: model.nv] / (2.0 * np.pi)
