"""Intervals of the estimates: the wider of the curvature's and of the scatter between runs.

The curvature's covariance (J'J)^-1 holds where the model is right. Where a law is only nearly right its misfit repeats
from run to run, so the sandwich A^-1 (sum_i g_i g_i') A^-1 with one gradient g_i per run (White 1982; Liang and Zeger
1986) stands beside it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from jointscope.diagnosis.objective import Objective
from jointscope.diagnosis.refit import Fit, covariance

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class Estimate:
    """A value with its 95 % interval, in its own unit."""

    value: float
    low: float
    high: float

    @property
    def sigma(self) -> float:
        """Half the interval over 1.96."""
        return (self.high - self.low) / 3.92


def standard_errors(objective: Objective, fit: Fit) -> tuple[Vector, float]:
    """Standard error of each coordinate, shape (n,), and the degrees of freedom behind it."""
    overdispersion = max(1.0, fit.chi2 / max(len(fit.w) - fit.coordinates.n, 1))
    curvature = np.sqrt(np.diag(covariance(fit, overdispersion)))
    runs = len(objective.runs)
    if runs < 4:
        return curvature, float(max(len(fit.w) - fit.coordinates.n, 1))
    inverse = covariance(fit)
    inverse[~np.isfinite(inverse)] = 0.0
    gradients = np.stack([fit.jacobian[rows].T @ fit.w[rows] for rows in objective.slices])
    gradients -= gradients.mean(axis=0)
    meat = gradients.T @ gradients * runs / (runs - 1)
    sandwich = np.sqrt(np.maximum(np.diag(inverse @ meat @ inverse), 0.0))
    return np.maximum(curvature, sandwich), float(max(runs - 2, 2))


def estimates(objective: Objective, fit: Fit) -> tuple[Estimate, ...]:
    """Every coordinate of the fit as a physical value with its 95 % interval; bounds limit the interval."""
    where = fit.coordinates
    errors, freedom = standard_errors(objective, fit)
    reach = float(student.ppf(0.975, freedom)) * errors
    low, high = np.maximum(fit.x - reach, where.lower), np.minimum(fit.x + reach, where.upper)

    def physical(x: Vector) -> Vector:
        return np.asarray(np.where(where.logarithm, np.exp(np.where(where.logarithm, x, 0.0)), x * where.scale))

    return tuple(
        Estimate(float(v), float(a), float(b))
        for v, a, b in zip(physical(fit.x), physical(low), physical(high), strict=True)
    )
