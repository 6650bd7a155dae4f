"""From the likelihood's optimum to 95 % intervals that cover.

Two answers for every quantity, side by side. *Model*: the Fisher matrix with noise, gain scatter and timing scatter as
estimated, its t quantile at the effective number of degrees of freedom (Satterthwaite 1946), because a scatter
variance from 20 hits is itself uncertain. *Repeats*: the spread of the hits' own answers, taken from their scores at the
common optimum (cluster-robust sandwich, Liang and Zeger 1986, n/(n - 1) and t with n - 1 degrees of freedom), which
needs no noise model but at least two hits. The wider is the headline, where it is wider by more than a spread between
that few hits scatters itself; always taking the wider would pick up chance and cover 97 instead of 95 %.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from jointscope.identification.direct_parametric import ParametricFit
from jointscope.identification.errors_in_variables import whiten

Real = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """A value with its uncertainty.

    Attributes:
        value: In ``unit``.
        unit: Spelled out.
        sd: Standard deviation behind the headline interval.
        low: Lower end of the headline's 95 % interval.
        high: Upper end.
        model: 95 % interval from the noise and scatter model.
        repeats: 95 % interval from the spread between hits, or ``None`` with fewer than two.
    """

    value: float
    unit: str
    sd: float
    low: float
    high: float
    model: tuple[float, float]
    repeats: tuple[float, float] | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Uncertainty:
    """Covariances of ``model.vector()`` at the optimum.

    Attributes:
        model: From noise and scatter, shape (p, p).
        noise: The noise's share of it.
        gain: The share of the gain scatter.
        timing: The share of the timing scatter.
        gain_freedom: Effective degrees of freedom behind ``gain``; 0 where nothing is known of it.
        timing_freedom: Of ``timing``.
        noise_freedom: Of ``noise``.
        repeats: Cluster-robust covariance, or ``None`` for one hit.
        lines: For one hit, the same over blocks of neighbouring lines: what a misfit alike from line to line does.
        hits: Number of hits.
    """

    model: Real
    noise: Real
    gain: Real
    timing: Real
    gain_freedom: float
    timing_freedom: float
    noise_freedom: float
    repeats: Real | None
    hits: int
    lines: Real | None = None

    def variance(self, gradient: Real) -> float:
        """Variance of a quantity with this ``gradient``, shape (p,), by the model (of one hit: or by its lines)."""
        found = float(gradient @ self.model @ gradient)
        if self.lines is not None:
            found = max(found, float(gradient @ self.lines @ gradient))
        return max(found, 0.0)

    def freedom(self, gradient: Real) -> float:
        """Effective degrees of freedom of the variance of a quantity with this ``gradient``, shape (p,)."""
        shares = [float(gradient @ part @ gradient) for part in (self.noise, self.gain, self.timing)]
        total = sum(shares)
        if total <= 0.0:
            return self.noise_freedom
        spread = sum(
            share**2 / max(freedom, 1e-9)
            for share, freedom in zip(
                shares, (self.noise_freedom, self.gain_freedom, self.timing_freedom), strict=True
            )
            if share > 0.0
        )
        return max(1.0, total**2 / spread) if spread > 0.0 else self.noise_freedom


def uncertainty(fit: ParametricFit) -> Uncertainty:
    """Covariances at the optimum of ``fit``."""
    bread = _inverse(fit.information)
    p = bread.shape[0]
    gain, timing, scores = np.zeros((p, p)), np.zeros((p, p)), []
    for hit, sigma in zip(fit.hits, fit.noise, strict=True):
        white = whiten(fit.model, hit, sigma, fit.scatter)
        weighted = white.solver()(white.sensitivity) @ bread
        for share, column in ((gain, white.gain), (timing, white.timing)):
            effect = weighted.T @ column
            share += np.outer(effect, effect)
        scores.append(weighted.T @ white.residual)
        lines = weighted * white.residual[:, None]
    gain *= fit.scatter.gain**2
    timing *= fit.scatter.timing**2
    n = len(fit.hits)
    moved = np.array(scores)
    moved = moved - moved.mean(axis=0)
    found = fit.found
    return Uncertainty(
        model=bread,
        noise=bread - gain - timing,
        gain=gain,
        timing=timing,
        gain_freedom=_scatter_freedom(fit.scatter.gain, found.gain_noise),
        timing_freedom=_scatter_freedom(fit.scatter.timing, found.timing_noise),
        noise_freedom=max(fit.freedom, 1.0),
        repeats=None if n < 2 else n / (n - 1.0) * moved.T @ moved,
        hits=n,
        lines=_between_blocks(lines, fit.model.outputs) if n == 1 else None,
    )


def _between_blocks(scores: Real, outputs: int, count: int = 60) -> Real:
    """Sandwich over ``count`` blocks of neighbouring lines; ``scores`` of shape (2 n_outputs n, p) are already steps."""
    per_output = scores.reshape(2, outputs, -1, scores.shape[1]).sum(axis=(0, 1))  # (n, p)
    size = max(1, per_output.shape[0] // count)
    sums = np.add.reduceat(per_output, np.arange(0, per_output.shape[0], size), axis=0)
    return np.asarray(sums.T @ sums * len(sums) / (len(sums) - 1.0))


def _scatter_freedom(scatter: float, noise: Real) -> float:
    """A variance s^2 found under noise v has the relative variance 2 (s^2 + v)^2/((n - 1) s^4)."""
    if noise.size < 2 or scatter == 0.0:
        return 0.0
    under = float(np.mean(noise**2))
    return (noise.size - 1.0) * (scatter**2 / (scatter**2 + under)) ** 2


def _inverse(information: Real) -> Real:
    scale = 1.0 / np.sqrt(np.maximum(np.diag(information), 1e-300))
    return np.asarray(
        scale[:, None] * np.linalg.pinv(information * np.outer(scale, scale), hermitian=True) * scale
    )


def logarithmic(value: float, gradient: Real, unit: str, of: Uncertainty) -> Estimate:
    """Estimate of a quantity of one sign whose logarithm has this ``gradient`` in ``model.vector()``, shape (p,)."""
    factor = math.sqrt(of.variance(gradient))
    half = float(stats.t.ppf(0.975, of.freedom(gradient))) * factor
    repeats, widest = None, half
    if of.repeats is not None:
        spread = math.sqrt(float(gradient @ of.repeats @ gradient))
        wide = float(stats.t.ppf(0.975, of.hits - 1)) * spread
        repeats = _around(value, wide)
        chance = 1.0 / math.sqrt(2.0 * (of.hits - 1.0))  # relative standard error of a spread between so many hits
        if wide > half * (1.0 + chance):
            widest, factor = wide, max(factor, spread)
    low, high = _around(value, widest)
    return Estimate(
        value=value,
        unit=unit,
        sd=abs(value) * factor,
        low=low,
        high=high,
        model=_around(value, half),
        repeats=repeats,
    )


def _around(value: float, half: float) -> tuple[float, float]:
    ends = value * math.exp(-min(half, 50.0)), value * math.exp(min(half, 50.0))
    return min(ends), max(ends)
