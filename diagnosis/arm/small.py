r"""Small motion about rest as a linear system with nonlinear joints: its matrices, made discrete exactly.

    x = (y, s, y', s'),  x' = A x + B u + E f + R r,   u: hammer force or the motor's torque with its tie

y links, s the rotors that turn, both from rest; f the nonlinear reducers' torques beyond K d + c d', r dry friction.
Inputs are read as parabolas over a step (their values at half steps), the torques f as straight lines, r as constant.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from jointscope.diagnosis.arm import kernel
from jointscope.diagnosis.arm.plant import Reduced

Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SmallMotion:
    """Continuous matrices.

    Attributes:
        A: Shape (n, n).
        B: Shape (n,).
        E: Columns of the reducers' torques, shape (n, m).
        R: Columns of the rotors' friction, shape (n, t).
        wind_up, wind_up_rate: Rows that read d and d' of every reducer, shape (m, n).
        links: Accelerations of the links as rows over x, u and f, shapes (m, n), (m,), (m, m).
        speeds: Place of each turning rotor's speed in x, shape (t,).
        turning: Their places among the joints of the table, shape (t,).
    """

    A: Vector
    B: Vector
    E: Vector
    R: Vector
    wind_up: Vector
    wind_up_rate: Vector
    links: tuple[Vector, Vector, Vector]
    speeds: NDArray[np.int64]
    turning: NDArray[np.int64]


def small_motion(
    table: Reduced, P: Vector, kinds: NDArray[np.int64], driven: int, tie: float, tie_rate: float
) -> SmallMotion:
    """The matrices of the joints of ``table`` (its first node) with parameter rows ``P``."""
    m = len(table.joints)
    turning = np.flatnonzero(kinds != kernel.BRAKED)
    t = len(turning)
    size = m + t
    inverse = np.zeros((size, size))
    inverse[:m, :m] = table.inverse[0]
    C, K = np.zeros((size, size)), np.zeros((size, size))
    K[:m, :m] = table.slope[0]
    reads = np.zeros((m, size))
    for i in range(m):
        reads[i, i] = -1.0
        C[i, i] = P[i, kernel.LINK_DAMPING]
    for r, k in enumerate(turning):
        reads[k, m + r] = 1.0
        inverse[m + r, m + r] = 1.0 / P[k, kernel.ROTOR_INERTIA]
        C[m + r, m + r] = P[k, kernel.ROTOR_DAMPING]
        if kinds[k] == kernel.HELD:
            C[m + r, m + r] += P[k, kernel.DRIVE_DAMPING]
            K[m + r, m + r] += P[k, kernel.DRIVE_STIFFNESS]
        elif kinds[k] == kernel.DRIVEN:
            C[m + r, m + r] += tie_rate
            K[m + r, m + r] += tie
    K += reads.T @ (P[:, kernel.STIFFNESS, None] * reads)
    C += reads.T @ (P[:, kernel.DAMPING, None] * reads)
    force = np.zeros(size)
    if driven >= 0:
        force[m + int(np.flatnonzero(turning == driven)[0])] = 1.0
    else:
        force[:m] = table.hit
    push = -inverse @ reads.T  # unit torque of a reducer accelerates its link forwards, its rotor back
    still = np.zeros((size, size))
    A = np.block([[still, np.eye(size)], [-inverse @ K, -inverse @ C]])
    B = np.concatenate([np.zeros(size), inverse @ force])
    E = np.concatenate([np.zeros((size, m)), push])
    R = np.concatenate([np.zeros((size, t)), inverse[:, m:]])
    none = np.zeros((m, size))
    return SmallMotion(
        A, B, E, R, np.concatenate([reads, none], axis=1), np.concatenate([none, reads], axis=1),
        (A[size : size + m], B[size : size + m], E[size : size + m]), size + m + np.arange(t), turning,
    )  # fmt: skip


def discrete(A: Vector, columns: Vector, h: float) -> tuple[Vector, Vector, Vector, Vector]:
    """Phi = exp(A h) and the integrals of exp(A (h - t)) (t/h)^k columns dt, k = 0, 1, 2, shapes as ``columns``."""
    n, q = columns.shape
    whole = np.zeros((n + 3 * q, n + 3 * q))
    whole[:n, :n] = A * h
    whole[:n, n : n + q] = columns * h
    whole[n : n + q, n + q : n + 2 * q] = np.eye(q)
    whole[n + q : n + 2 * q, n + 2 * q :] = np.eye(q)
    found = expm(whole)
    # the chain integrates 1, t/h, (t/h)^2/2
    return found[:n, :n], found[:n, n : n + q], found[:n, n + q : n + 2 * q], 2.0 * found[:n, n + 2 * q :]


def run_small(
    table: Reduced,
    P: Vector,
    kinds: NDArray[np.int64],
    driven: int,
    tie: float,
    tie_rate: float,
    u: Vector,
    rate: float,
    steps: int,
) -> Vector:
    """Accelerometers' departures from rest [m/s^2] and, last, the driven rotor's angle [rad], shape (steps + 1, o + 1).

    Args:
        u: Input's departure from rest at half steps, shape (2 steps + 1,).
        rate: Steps per second.
    """
    system = small_motion(table, P, kinds, driven, tie, tie_rate)
    bent = np.flatnonzero(
        (P[:, kernel.GAP] > 0.0)
        | (P[:, kernel.CUBIC] != 0.0)
        | (P[:, kernel.SOFT_SHARE] != 0.0)
        | (P[:, kernel.LOOP_TORQUE] != 0.0)
    )
    rubbing = [
        r for r, i in enumerate(system.turning) if P[i, kernel.COULOMB] > 0.0 or P[i, kernel.BREAKAWAY] > 0.0
    ]
    soft = [r for r in rubbing if P[system.turning[r], kernel.PRESLIDING] > 0.0]
    dry = [r for r in rubbing if r not in soft]
    columns = np.concatenate([system.B[:, None], system.E[:, bent], system.R[:, dry], system.R[:, soft]], axis=1)
    with np.errstate(over="ignore", invalid="ignore"):  # of a trial whose springs are beyond a step
        phi, zero, one, two = discrete(system.A, columns, 1.0 / rate)
    if not all(np.all(np.isfinite(x)) for x in (phi, zero, one, two)):
        return np.full((steps + 1, len(table.motion[0]) + 1), np.nan)
    a, b = zero[:, 0], one[:, 0]
    c = two[:, 0]
    # parabola through u_0, u_1/2, u_1: u_0 + (4 u_1/2 - 3 u_0 - u_1) t + (2 u_0 - 4 u_1/2 + 2 u_1) t^2
    start, middle, end = a - 3.0 * b + 2.0 * c, 4.0 * b - 4.0 * c, -b + 2.0 * c
    nf, first = len(bent), 1 + len(bent) + len(dry)
    J, S = table.motion[0], table.tilt[0]
    m, n = len(table.joints), len(system.A)
    over_x, over_u, over_f = system.links
    C = np.zeros((len(J) + 1, n))
    C[:-1] = J @ over_x
    C[:-1, :m] += S
    if driven >= 0:
        C[-1, m + int(np.flatnonzero(system.turning == driven)[0])] = 1.0
    D = np.append(J @ over_u, 0.0)
    F = np.concatenate([J @ over_f[:, bent], np.zeros((1, nf))])
    readings = np.empty((steps + 1, len(J) + 1))

    def tight(x: Vector) -> Vector:
        return np.ascontiguousarray(x, dtype=np.float64)

    good = kernel.shake(
        tight(phi), tight(start), tight(middle), tight(end), tight(u), tight(zero[:, 1 : 1 + nf].T),
        tight(one[:, 1 : 1 + nf].T), tight(system.wind_up[bent]), tight(system.wind_up_rate[bent]), tight(P),
        bent.astype(np.int64), tight(zero[:, 1 + nf : first].T), system.speeds[dry].astype(np.int64),
        system.turning[dry].astype(np.int64), tight(zero[:, first:].T), tight(one[:, first:].T),
        system.speeds[soft].astype(np.int64), system.turning[soft].astype(np.int64), tight(C), tight(D), tight(F),
        readings,
    )  # fmt: skip
    if not good:
        readings[:] = np.nan
    return readings
