"""Hit-to-hit scatter of gain and timing: no additive noise, and what the intervals stand or fall with.

Where the hammer's direction and point vary a little, each hit has a gain error, and its trigger a timing error. With
60 dB of signal to noise, leaving them out makes intervals some twenty times too narrow. Both variances are estimated
from the scatter of the hits' own gains and delays about the common model, minus what noise alone explains (moment
estimator of a random effect, DerSimonian and Laird 1986, with the mean taken off as in REML).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from jointscope.identification.errors_in_variables import HitSpectrum, Scatter, whiten
from jointscope.identification.modal_model import ModalModel

Real = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class HitDeviations:
    """Each hit's own gain and delay against the common model.

    Attributes:
        gain: Relative, shape (n_hits,).
        timing: Output late against input [s], shape (n_hits,).
        gain_noise: Standard deviation of ``gain`` due to noise alone, shape (n_hits,).
        timing_noise: Of ``timing`` [s], shape (n_hits,).
    """

    gain: Real
    timing: Real
    gain_noise: Real
    timing_noise: Real


def deviations(model: ModalModel, hits: Sequence[HitSpectrum], noise: Sequence[Real]) -> HitDeviations:
    """Generalised least squares of (g_h, t_h) on each hit's residual, noise in both channels as in the fit."""
    rows = []
    for hit, sigma in zip(hits, noise, strict=True):
        white = whiten(model, hit, sigma, Scatter(gain=0.0, timing=0.0))
        solve = white.solver(without_scatter=True)
        design = np.column_stack([white.gain, white.timing])
        weighted = solve(design)
        covariance = np.linalg.inv(design.T @ weighted)
        rows.append((*(covariance @ (weighted.T @ white.residual)), *np.sqrt(np.diag(covariance))))
    gain, timing, gain_noise, timing_noise = np.array(rows).T
    return HitDeviations(gain=gain, timing=timing, gain_noise=gain_noise, timing_noise=timing_noise)


def random_effect(values: Real, noise: Real) -> float:
    """Variance of a random effect under ``values`` measured with standard deviations ``noise``; 0 for one value."""
    if values.size < 2:
        return 0.0
    variance = 0.0
    for _ in range(
        20
    ):  # iterated weights (Paule and Mandel 1982): the statistic equals its expectation at the end
        weight = 1.0 / (noise**2 + variance)
        mean = np.sum(weight * values) / weight.sum()
        excess = np.sum(weight * (values - mean) ** 2) - (values.size - 1)
        slope = np.sum(weight**2 * (values - mean) ** 2)
        new = max(0.0, variance + excess / max(slope, 1e-300))
        if abs(new - variance) <= 1e-6 * max(new, float(np.min(noise)) ** 2):
            return float(new)
        variance = new
    return float(variance)


def estimate_scatter(found: HitDeviations) -> Scatter:
    """Standard deviations of the hits' gains and delays beyond noise."""
    return Scatter(
        gain=random_effect(found.gain, found.gain_noise) ** 0.5,
        timing=random_effect(found.timing, found.timing_noise) ** 0.5,
    )
