r"""The load, elbow angle and reducers that give an arm wanted resonances at one joint.

A hit on the link of joint j sees modes with J~_r = 1/phi_jr^2, K~_r = omega_r^2 J~_r, c~_r = phi_r^T C phi_r/phi_jr^2
(paper, Equations 22-25, in mass-normalised shapes). For two modes made by joints j and k alone, with the rest stiff,
4 kappa <= (w2/w1 - w1/w2)^2 bounds the coupling kappa = M_jk^2/(M_jj M_kk - M_jk^2): a stretched arm couples its
shoulder and elbow too strongly for two close resonances, so the elbow has to be bent. The search is a multi-start
least squares over mass scale, bend and the two stiffnesses; the two dampings follow from a linear system.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from jointscope.errors import JointscopeError
from jointscope.models.arm.build import source_file
from jointscope.models.arm.linear import JointValues, Modes, linear_arm, natural_modes
from jointscope.models.arm.reference import Reference, loaded, robot_reference
from jointscope.models.arm.table import ArmTable

Real = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Target:
    """One wanted mode at the joint that is hit: J~ [kg m^2], c~ [N m s/rad], K~ [N m/rad]."""

    inertia: float
    damping: float
    stiffness: float

    @property
    def frequency(self) -> float:
        """sqrt(K~/J~)/2 pi [Hz]."""
        return float(np.sqrt(self.stiffness / self.inertia) / (2.0 * np.pi))


PAPER_TABLE_4 = (
    Target(inertia=8.603, damping=61.29, stiffness=95_689.66),
    Target(inertia=13.55, damping=81.92, stiffness=439_324.32),
)
"""Table 4 of the paper: 16.785 and 28.658 Hz."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Solution:
    """What was found.

    Attributes:
        table: The arm with its solved figures.
        modes: Its modes with all joints braked.
        found: Equivalent parameters of the wanted modes, in the order of the targets.
        error: Largest relative deviation from the targets over frequencies, J~ and c~ [-].
        coupling: |M_jk|/sqrt(M_jj M_kk) at the posture [-].
        coupling_bound: The largest that the two wanted frequencies allow when only the two joints yield [-].
        starts: How many starts were tried, and how many of them ended within 1e-6 of the best.
    """

    table: ArmTable
    modes: Modes
    found: tuple[Target, ...]
    error: float
    coupling: float
    coupling_bound: float
    starts: tuple[int, int]


def equivalent(modes: Modes, at: Real) -> list[Target]:
    """J~, c~, K~ of every mode at a driving point whose row over the links is ``at`` (1 at the joint that is hit)."""
    weight = (at @ modes.shape) ** 2
    omega = 2.0 * np.pi * modes.frequency
    inertia = 1.0 / np.maximum(weight, 1e-30)
    return [
        Target(inertia=float(J), damping=float(2.0 * z * w * J), stiffness=float(w**2 * J))
        for J, z, w in zip(inertia, modes.damping_ratio, omega, strict=True)
    ]


def coupling_bound(low: float, high: float) -> float:
    """Largest |M_jk|/sqrt(M_jj M_kk) with which two springs on j and k can give the frequencies ``low``, ``high`` [Hz]."""
    ratio = (high / low) ** 2
    return (ratio - 1.0) / (ratio + 1.0)


def solve_arm(
    table: ArmTable,
    hit: str,
    bend: str,
    targets: tuple[Target, Target] = PAPER_TABLE_4,
    *,
    starts: int = 24,
    rng: np.random.Generator,
) -> Solution:
    """Find mass scale, the angle of ``bend``, and K and c of joints ``hit`` and ``bend``, for two wanted modes.

    Args:
        table: Everything else: robot, payload, the other joints' figures and angles. Its figures for what is sought are
            ignored.
        hit: Joint whose link is hit.
        bend: Joint whose angle is free; its mode is the other one.
        targets: Lower mode first.
        starts: Random starts of the search.
        rng: Draws them.

    Raises:
        JointscopeError: No start comes within 1 % of the targets, or only with a negative damping.
    """
    base = robot_reference(source_file(table), table.lock)
    names = [row.name for row in table.joints]
    if tuple(names) != base.joints:
        raise JointscopeError(f"the table's joints must be {', '.join(base.joints)}, in this order")
    problem = _Problem(base, table, names.index(hit), names.index(bend), targets)
    found = []
    for _ in range(starts):
        start = np.array([rng.normal(0.0, 0.4), rng.uniform(0.3, 2.8), *rng.uniform(10.5, 12.5, 2)])
        fit = optimize.least_squares(
            problem.residual,
            start,
            bounds=([-2.5, 0.1, 8.0, 8.0], [2.5, 3.05, 16.0, 16.0]),
            xtol=1e-14,
            ftol=1e-14,
        )
        found.append((fit.cost, fit.x))
    found.sort(key=lambda item: item[0])
    cost, x = found[0]
    if not np.sqrt(2.0 * cost) < 0.01:
        raise JointscopeError(
            f"no load and stiffness of {hit} and {bend} gives {targets[0].frequency:.4g} and {targets[1].frequency:.4g} Hz "
            f"at {hit} (best misses by {100 * np.sqrt(2.0 * cost):.2g} %); change the payload or the other joints"
        )
    close = int(sum(item[0] < cost + 1e-12 for item in found))
    return problem.solution(x, (starts, close))


@dataclass(frozen=True, eq=False)
class _Problem:
    base: Reference
    table: ArmTable
    hit: int
    bend: int
    targets: tuple[Target, Target]

    def posture(self, x: Real) -> Mapping[str, float]:
        return {**self.table.posture, self.base.joints[self.bend]: float(x[1])}

    def values(self, x: Real, damping: Real | None = None) -> JointValues:
        rows = self.table.joints
        stiffness = np.array([row.stiffness for row in rows])
        stiffness[[self.hit, self.bend]] = np.exp(x[2:4])
        c = np.array([row.damping for row in rows])
        if damping is not None:
            c[[self.hit, self.bend]] = damping
        none = np.zeros(len(rows))
        return JointValues(
            stiffness=stiffness, damping=c, rotor_inertia=none, rotor_damping=none, drive_stiffness=none,
            drive_damping=none,
        )  # fmt: skip

    def modes(self, x: Real, damping: Real | None = None) -> Modes:
        reference = loaded(self.base, float(np.exp(x[0])), self.table.payload)
        return natural_modes(linear_arm(reference, self.posture(x), self.values(x, damping), {}))

    def chosen(self, modes: Modes) -> NDArray[np.int_]:
        """The two modes that the hit joint moves most, lower first."""
        return np.sort(np.argsort(modes.shape[self.hit] ** 2)[-2:])

    def residual(self, x: Real) -> Real:
        modes = self.modes(x)
        pick = self.chosen(modes)
        wanted = np.array([t.frequency for t in self.targets]), np.array([t.inertia for t in self.targets])
        return np.concatenate(
            [np.log(modes.frequency[pick] / wanted[0]), -np.log(modes.shape[self.hit, pick] ** 2 * wanted[1])]
        )

    def dampings(self, x: Real) -> Real:
        """c of the two joints from phi^T C phi = c~ phi_j^2 of both modes, the others' damping given, shape (2,)."""
        modes = self.modes(x, np.zeros(2))
        pick = self.chosen(modes)
        omega = 2.0 * np.pi * modes.frequency[pick]
        others = 2.0 * modes.damping_ratio[pick] * omega
        wanted = np.array([t.damping / t.inertia for t in self.targets])
        shape = modes.shape[[self.hit, self.bend]][:, pick]
        return np.asarray(np.linalg.solve(shape.T**2, wanted - others), dtype=np.float64)

    def solution(self, x: Real, starts: tuple[int, int]) -> Solution:
        damping = self.dampings(x)
        if np.any(damping < 0.0):
            raise JointscopeError(
                "the wanted dampings need a negative damping of one joint; lower the others' damping"
            )
        values = self.values(x, damping)
        rows = tuple(
            replace(row, stiffness=float(values.stiffness[k]), damping=float(values.damping[k]))
            for k, row in enumerate(self.table.joints)
        )
        posture = dict(self.posture(x))
        scale = float(np.exp(x[0]))
        modes = self.modes(x, damping)
        pick = self.chosen(modes)
        unit = np.eye(len(rows))[self.hit]
        found = tuple(equivalent(modes, unit)[k] for k in pick)
        error = max(
            abs(getattr(f, key) / getattr(t, key) - 1.0)
            for f, t in zip(found, self.targets, strict=True)
            for key in ("frequency", "inertia", "damping")
        )
        M = loaded(self.base, scale, self.table.payload).mass_matrix(posture)
        j, k = self.hit, self.bend
        return Solution(
            table=replace(self.table, joints=rows, posture=posture, mass_scale=scale),
            modes=modes,
            found=found,
            error=float(error),
            coupling=float(abs(M[j, k]) / np.sqrt(M[j, j] * M[k, k])),
            coupling_bound=coupling_bound(self.targets[0].frequency, self.targets[1].frequency),
            starts=starts,
        )
