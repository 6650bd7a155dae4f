r"""The accelerance as a sum of single-mode terms, with its derivatives (paper, Equations 20, 22-24).

G_o(s) = sum_m b_om s^2/(s^2 + a1_m s + a2_m) + mu_o + kappa_o s^2

for output o. ``mu`` (mass line) stands for modes below the band, ``kappa`` (stiffness line) for modes above it. The
paper's b2 and b3 stand for initial-condition constants and are identified and not used; here a record that starts or
ends in motion gets its own transient instead (``errors_in_variables``), so that they cost the parameters nothing.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

Real = NDArray[np.float64]
Complex = NDArray[np.complexfloating[Any, Any]]


@dataclass(frozen=True, kw_only=True, eq=False)
class ModalModel:
    """A sum of modes with common poles for all outputs.

    Attributes:
        a1: a1 of each mode [1/s], shape (n_modes,).
        a2: a2 of each mode [1/s^2], shape (n_modes,).
        b1: b1 per output and mode [output SI unit/s^0 per input unit], shape (n_outputs, n_modes).
        mass_line: mu per output, shape (n_outputs,), or shape (0,) where there is none.
        stiffness_line: kappa per output [s^2], shape (n_outputs,), or shape (0,).
        b2: b2 per output and mode, shape (n_outputs, n_modes), or shape (0, 0). Where joints are damped unlike, modes
            are complex: neighbouring joints pass a mode with a lag, which b2 s carries; zero for one joint.
    """

    a1: Real
    a2: Real
    b1: Real
    mass_line: Real
    stiffness_line: Real
    b2: Real = field(default_factory=lambda: np.zeros((0, 0)))

    @property
    def outputs(self) -> int:
        """Number of outputs."""
        return int(self.b1.shape[0])

    @property
    def modes(self) -> int:
        """Number of modes."""
        return self.a1.size

    @property
    def natural_frequency(self) -> Real:
        """sqrt(a2) [rad/s], shape (n_modes,)."""
        return np.sqrt(self.a2)

    @property
    def damping_ratio(self) -> Real:
        """a1/(2 sqrt(a2)) [-], shape (n_modes,)."""
        return self.a1 / (2.0 * np.sqrt(self.a2))

    def vector(self) -> Real:
        """The parameters in one vector: a1, a2, b1 (output by output), mass line, stiffness line, b2."""
        return np.concatenate(
            [self.a1, self.a2, self.b1.ravel(), self.mass_line, self.stiffness_line, self.b2.ravel()]
        )

    def with_vector(self, values: Real) -> ModalModel:
        """The model of the same make-up with other parameters."""
        n, m = self.modes, self.outputs
        ends = np.cumsum([n, n, n * m, self.mass_line.size, self.stiffness_line.size])
        a1, a2, b1, mass, stiff, b2 = np.split(values, ends)
        return replace(
            self, a1=a1, a2=a2, b1=b1.reshape(m, n), mass_line=mass, stiffness_line=stiff,
            b2=b2.reshape(self.b2.shape),
        )  # fmt: skip

    def admissible(self) -> bool:
        """Whether every mode oscillates and decays."""
        return bool(np.all(self.a2 > 0.0) and np.all(self.a1 > 0.0) and np.all(np.isfinite(self.vector())))

    def denominators(self, s: Complex) -> Complex:
        """s^2 + a1 s + a2 of every mode, shape (n_modes, n) for s [rad/s] of shape (n,)."""
        return s**2 + self.a1[:, None] * s + self.a2[:, None]

    def response(self, s: Complex) -> Complex:
        """G(s), shape (n_outputs, n)."""
        result = self.b1 @ (s**2 / self.denominators(s))
        if self.b2.size:
            result = result + self.b2 @ (s / self.denominators(s))
        if self.mass_line.size:
            result = result + self.mass_line[:, None]
        if self.stiffness_line.size:
            result = result + self.stiffness_line[:, None] * s**2
        return np.asarray(result, dtype=np.complex128)

    def jacobian(self, s: Complex) -> Complex:
        """dG/d(vector), shape (n_outputs, n, n_parameters)."""
        n, m = self.modes, self.outputs
        inverse = 1.0 / self.denominators(s)  # (n_modes, n)
        basis = s**2 * inverse
        bend = -self.b1[:, :, None] * basis * inverse  # dG/da2, (n_outputs, n_modes, n)
        if self.b2.size:
            bend = bend - self.b2[:, :, None] * s * inverse**2
        result = np.zeros((m, s.size, self.vector().size), dtype=np.complex128)
        result[:, :, :n] = np.swapaxes(bend * s, 1, 2)
        result[:, :, n : 2 * n] = np.swapaxes(bend, 1, 2)
        for o in range(m):
            result[o, :, 2 * n + o * n : 2 * n + (o + 1) * n] = basis.T
        at = 2 * n + m * n
        for line, term in ((self.mass_line, np.ones_like(s)), (self.stiffness_line, s**2)):
            for o in range(line.size):
                result[o, :, at + o] = term
            at += line.size
        for o in range(m if self.b2.size else 0):
            result[o, :, at + o * n : at + (o + 1) * n] = (s * inverse).T
        return result


def single_mode(b1: float, a1: float, a2: float) -> ModalModel:
    """One mode, one output, no residual terms: (b1 s^2)/(s^2 + a1 s + a2) (20)."""
    none = np.zeros(0)
    return ModalModel(
        a1=np.array([a1]), a2=np.array([a2]), b1=np.array([[b1]]), mass_line=none, stiffness_line=none
    )
