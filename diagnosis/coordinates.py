"""A hypothesis as a vector: the free base parameters and the effects' parameters, scaled for the optimiser.

A base parameter x = theta / scale; an effect's parameter is its logarithm where the catalogue says so, else divided by
its own typical size. Phases are unbounded: they are angles.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.effects import ActiveEffect

if TYPE_CHECKING:
    from jointscope.diagnosis.effects import EffectSpec, ParameterSpec
    from jointscope.diagnosis.prepare import Problem

Vector = NDArray[np.float64]

# Hits on a held joint tell K, c and J apart by their gain alone: a column that is off by the curvature of 100 periods
# (1.5 % at 1e-4) takes that direction for known.
BASE_STEP = 1e-6  # finite-difference step, relative to a base parameter's scale
EFFECT_STEP = 1e-3  # the same for effects, whose laws have corners
LIMITED = 0.1  # of its scale, within which a nuisance is small or none
SMALL = 0.3  # of its typical size, below which an effect's step goes with its amplitude ...
SMALLEST = 1e-5  # ... down to this share


@dataclass(frozen=True, eq=False)
class Coordinates:
    """The map between the optimiser's vector and physics.

    Attributes:
        start: Full base parameter vector theta of the problem, shape (n_theta,).
        free: Positions of the free ones in it, shape (n_free,).
        effects: The effects of the hypothesis.
        scale: Size of one unit of each coordinate, shape (n,); unused for logarithms.
        logarithm: Which coordinates are logarithms, shape (n,).
        lower: Bounds in coordinates, shape (n,).
        upper: Likewise.
        step: Finite-difference steps in coordinates, shape (n,).
        held: Positions of nuisances for which one of the effects stands: they stay at their start.
        limited: Positions of nuisances that are small or none.
        amplitudes: Which coordinates are sizes of effects that vanish at zero, shape (n,).
    """

    start: Vector
    free: NDArray[np.intp]
    effects: tuple[EffectSpec, ...]
    scale: Vector
    logarithm: NDArray[np.bool_]
    lower: Vector
    upper: Vector
    step: Vector
    amplitudes: NDArray[np.bool_]
    held: tuple[int, ...] = ()
    limited: tuple[int, ...] = ()

    @property
    def n_base(self) -> int:
        """Number of free base parameters; they come first."""
        return len(self.free)

    @property
    def n(self) -> int:
        """Length of the vector."""
        return len(self.scale)

    def effect_slices(self) -> tuple[slice, ...]:
        """Where each effect's parameters stand in the vector."""
        slices, position = [], self.n_base
        for spec in self.effects:
            slices.append(slice(position, position + len(spec.parameters)))
            position += len(spec.parameters)
        return tuple(slices)

    def unpack(self, x: Vector) -> tuple[Vector, tuple[ActiveEffect, ...]]:
        """Base parameters (full vector) and active effects at ``x``."""
        values = np.where(self.logarithm, np.exp(np.where(self.logarithm, x, 0.0)), x * self.scale)
        theta = self.start.copy()
        theta[self.free] = values[: self.n_base]
        active = tuple(
            ActiveEffect(spec, tuple(float(v) for v in values[where]))
            for spec, where in zip(self.effects, self.effect_slices(), strict=True)
        )
        return theta, active

    def pack(self, theta: Vector, effects: tuple[ActiveEffect, ...]) -> Vector:
        """The inverse of :meth:`unpack`, clipped to the bounds."""
        values = np.concatenate([theta[self.free], *[np.asarray(e.values, float) for e in effects]])
        logs = np.log(np.where(self.logarithm, np.maximum(values, 1e-300), 1.0))
        x = np.where(self.logarithm, logs, values / self.scale)
        return np.clip(x, self.lower, self.upper)

    def difference(self, x: Vector, j: int) -> float:
        """Finite-difference step of coordinate ``j`` at ``x``, inward at the upper bound.

        A play of a ten-thousandth of the wind-up is another law at a thousandth of it.
        """
        step = float(self.step[j])
        if self.amplitudes[j]:
            step *= min(max(abs(float(x[j])) / SMALL, SMALLEST), 1.0)
        return step if x[j] + step <= self.upper[j] else -step

    def per_unit(self, x: Vector) -> Vector:
        """d(physical value)/d(coordinate) at ``x``, shape (n,)."""
        return np.where(self.logarithm, np.exp(np.where(self.logarithm, x, 0.0)), self.scale)


def typical_size(spec: EffectSpec, position: int, problem: Problem) -> float:
    """The medium amplitude for the main parameter, else a tenth of the admitted range."""
    parameter = spec.parameters[position]
    if position == spec.amplitude:
        size = abs(spec.scale(problem)[1] - _null(parameter))
        return max(size, 1e-12) if math.isfinite(size) else 1.0  # a logarithm needs no size
    if parameter.name == "phase":
        return 1.0
    width = parameter.upper - parameter.lower
    return width / 10.0 if math.isfinite(width) and width > 0 else max(abs(parameter.lower), 1.0)


def _null(parameter: ParameterSpec) -> float:
    return 0.0 if parameter.null is None else float(parameter.null)


def coordinates(problem: Problem, effects: tuple[EffectSpec, ...] = ()) -> Coordinates:
    """The coordinates of the base with ``effects``."""
    base = problem.base
    free = np.flatnonzero(np.asarray(base.free))
    scale = list(np.asarray(base.scale, float)[free])
    lower = list(np.asarray(base.lower, float)[free] / scale)
    upper = list(np.asarray(base.upper, float)[free] / scale)
    step = [BASE_STEP] * len(free)
    logarithm = [False] * len(free)
    amplitudes = [False] * len(free)
    holds = {name for spec in effects for name in spec.holds}
    held = tuple(k for k, i in enumerate(free) if base.names[i] in holds)
    for k in held:
        lower[k] = upper[k] = base.start[free[k]] / scale[k]
    for spec in effects:
        for position, parameter in enumerate(spec.parameters):
            size = typical_size(spec, position, problem)
            logarithm.append(parameter.log)
            scale.append(size)
            if parameter.name == "phase":
                lower.append(-math.inf)
                upper.append(math.inf)
            elif parameter.log:
                lower.append(math.log(parameter.lower))
                upper.append(math.log(parameter.upper))
            else:
                lower.append(parameter.lower / size)
                upper.append(parameter.upper / size)
            step.append(EFFECT_STEP * parameter.fineness)
            amplitudes.append(position == spec.amplitude and parameter.null == 0.0 and not parameter.log)
    return Coordinates(
        start=np.asarray(base.start, float),
        free=free,
        effects=effects,
        scale=np.asarray(scale, float),
        logarithm=np.asarray(logarithm, bool),
        lower=np.asarray(lower, float),
        upper=np.asarray(upper, float),
        step=np.asarray(step, float),
        amplitudes=np.asarray(amplitudes, bool),
        held=held,
        limited=tuple(
            k
            for k, i in enumerate(free)
            if base.nuisance[i] and base.upper[i] - base.lower[i] < LIMITED * base.scale[i]
        ),
    )
