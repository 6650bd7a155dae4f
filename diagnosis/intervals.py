"""Intervals of the estimates: the wider of the curvature's and of the scatter between runs.

The curvature's covariance (J'J)^-1 holds where the model is right. Where a law is only nearly right its misfit repeats
from run to run, so the sandwich A^-1 (sum_i g_i g_i') A^-1 with one gradient g_i per run (White 1982; Liang and Zeger
1986) stands beside it. Neither knows that a law of the right name may have another form in nature, which moves its size
by the same amount in every run: of an effect the standard error is stretched, and a share of the size added to it
(``STRETCH``, ``FORM``), as concealed effects asked for.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from jointscope.diagnosis.coordinates import Coordinates
from jointscope.diagnosis.effects import EffectSpec, ParameterSpec
from jointscope.diagnosis.objective import Objective
from jointscope.diagnosis.refit import Fit, covariance, with_fresh_jacobian

Vector = NDArray[np.float64]

STRETCH = (
    1.5  # of an effect's standard error: on 40 concealed textbook laws 25 of the 90 % intervals covered without
)
FORM = 0.02  # of the size of a law that nature knows in several forms
FORM_OF_EXACT = 0.005  # and of a delay, a weight, a gain
RATTLED = (
    0.01  # of the base's parameters beside play or a stop: valleys lie so near one another, each far too narrow
)
RATTLING = ("backlash", "end-stop")
_PLACES = ("Hz", "rad/s")  # of a mode or a line: where it is does not depend on the form


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


def form_of(spec: EffectSpec, parameter: ParameterSpec) -> float:
    """Share of a parameter's size by which a law's form may move it."""
    is_size = parameter.null in (0.0, 1.0) or parameter.log
    if not is_size or parameter.unit in _PLACES or parameter.name == "order":
        return 0.0
    return FORM_OF_EXACT if spec.exact else FORM


def with_form(where: Coordinates, x: Vector, errors: Vector) -> Vector:
    """Standard errors of the coordinates ``x``, shape (n,), with what the effects' forms leave open.

    A joint that rattles never repeats: what it does after many contacts depends on its numbers so sharply that a
    curvature says how narrow a valley is and not which of many is the right one.
    """
    found = errors.copy()
    if any(spec.name in RATTLING for spec in where.effects):
        base = range(where.n_base)
        found[base] = np.hypot(errors[base], RATTLED * np.abs(x[base]))
    for spec, rows in zip(where.effects, where.effect_slices(), strict=True):
        for i, parameter in zip(range(rows.start, rows.stop), spec.parameters, strict=True):
            null = 0.0 if parameter.null is None else parameter.null / where.scale[i]
            size = 1.0 if where.logarithm[i] else abs(x[i] - null)
            found[i] = np.hypot(STRETCH * errors[i], form_of(spec, parameter) * size)
    return found


def like_nothing(objective: Objective, fit: Fit, wider: float = 1.0) -> tuple[EffectSpec, ...]:
    """Laws of the fit whose size's 95 % interval, ``wider`` times as wide, holds the one at which they are absent.

    A mismatch of no effect's form is taken for a small one in some runs and for its opposite in others, whatever the
    likelihood says. Of a bend the inertia times what hammer and sensor see of it is known, and neither by itself: the size
    is asked for at the shape that was found.
    """
    fit = _at_its_shape(with_fresh_jacobian(objective, fit))
    where, found = fit.coordinates, estimates(objective, fit)
    alike = []
    for spec, rows in zip(where.effects, where.effect_slices(), strict=True):
        null, size = spec.parameters[spec.amplitude].null, found[rows.start + spec.amplitude]
        if null is None:
            continue
        below, above = size.value - size.low, size.high - size.value
        if size.value - wider * below <= null <= size.value + wider * above:
            alike.append(spec)
    return tuple(alike)


def _at_its_shape(fit: Fit) -> Fit:
    """The fit as if what scales the sizes of its effects were known."""
    where = fit.coordinates
    known = [
        i
        for spec, rows in zip(where.effects, where.effect_slices(), strict=True)
        for i, parameter in zip(range(rows.start, rows.stop), spec.parameters, strict=True)
        if parameter.scales_size
    ]
    if not known:
        return fit
    jacobian = fit.jacobian.copy()
    jacobian[:, known] = 0.0
    return replace(fit, jacobian=jacobian)


def estimates(objective: Objective, fit: Fit) -> tuple[Estimate, ...]:
    """Every coordinate of the fit as a physical value with its 95 % interval; bounds limit the interval."""
    where = fit.coordinates
    errors, freedom = standard_errors(objective, fit)
    errors = with_form(where, fit.x, errors)
    reach = float(student.ppf(0.975, freedom)) * errors
    low, high = np.maximum(fit.x - reach, where.lower), np.minimum(fit.x + reach, where.upper)

    def physical(x: Vector) -> Vector:
        return np.asarray(np.where(where.logarithm, np.exp(np.where(where.logarithm, x, 0.0)), x * where.scale))

    return tuple(
        Estimate(float(v), float(a), float(b))
        for v, a, b in zip(physical(fit.x), physical(low), physical(high), strict=True)
    )
