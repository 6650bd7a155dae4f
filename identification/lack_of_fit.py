"""Does the linear model explain the hits, or only their average? Beside every interval, what the fit leaves over.

With several hits the residual splits in two: what all hits have in common, per unit of input (the model's fault), and
how the hits differ among themselves (noise). Their ratio is an F statistic; its size relative to the response says
whether it matters.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from jointscope.identification.direct_parametric import ParametricFit
from jointscope.identification.errors_in_variables import residual_noise

Real = NDArray[np.float64]
Complex = NDArray[np.complexfloating[Any, Any]]

MATERIAL = 0.01  # share of the response below which a real misfit is no reason to doubt a parameter


@dataclass(frozen=True, kw_only=True, eq=False)
class LackOfFit:
    """The common part of the hits' residuals.

    Attributes:
        ratio: F statistic, common over individual, per degree of freedom.
        probability: Of a larger one if the model were right.
        share: RMS of the common part over RMS of the response, noise's own share taken off [-].
        worst: Where it is largest against its noise [Hz].
        verdict: One sentence.
        frequency: [Hz], shape (n,).
        response: Common residual per unit input (first output, over its sensor), shape (n,).
    """

    ratio: float
    probability: float
    share: float
    worst: float
    verdict: str
    frequency: Real
    response: Complex


def lack_of_fit(fit: ParametricFit) -> LackOfFit | None:
    """Split the residual of ``fit``; ``None`` with fewer than three hits on the same lines."""
    first = fit.hits[0]
    alike = all(np.array_equal(hit.frequency, first.frequency) for hit in fit.hits)
    if len(fit.hits) < 3 or not alike:
        return None
    left = residual_noise(fit.model, fit.hits, fit.noise, fit.scatter)
    s = 2j * np.pi * first.frequency
    G = fit.model.response(s)[0]
    lines = np.array([row[0][0] for row in left])  # (n_hits, n)
    noise = np.array([sigma[0] for sigma in fit.noise])
    drive = np.array([hit.sensor[0] * hit.input for hit in fit.hits])
    weight = np.abs(drive) ** 2 / noise**2
    common = np.sum(np.conj(drive) * lines / noise**2, axis=0) / weight.sum(axis=0)
    shared = np.abs(common) ** 2 * weight.sum(axis=0)
    own = np.sum(np.abs(lines - common * drive) ** 2 / noise**2, axis=0)
    n, hits, p = s.size, len(fit.hits), fit.model.vector().size
    freedom = max(2 * n - p, 1), 2 * n * (hits - 1)
    ratio = float(shared.sum() / freedom[0] / (own.sum() / freedom[1]))
    probability = float(stats.f.sf(ratio, *freedom))
    excess = max(float(shared.sum()) - freedom[0] * float(own.sum()) / freedom[1], 0.0)
    share = float(np.sqrt(excess / max(np.sum(np.abs(G) ** 2 * weight.sum(axis=0)), 1e-300)))
    worst = float(first.frequency[int(np.argmax(shared / (own + 1e-300)))])
    if probability > 0.01:
        verdict = "the linear model explains the hits to within their noise"
    elif share < MATERIAL:
        verdict = (
            f"a misfit beyond noise (F = {ratio:.2f}) but immaterial: {100 * share:.2f} % of the response, "
            f"most at {worst:.1f} Hz"
        )
    else:
        verdict = (
            f"the linear model does not explain the hits: {100 * share:.1f} % of the response is left over "
            f"(F = {ratio:.1f}), most at {worst:.1f} Hz; the intervals do not cover that"
        )
    return LackOfFit(
        ratio=ratio,
        probability=probability,
        share=share,
        worst=worst,
        verdict=verdict,
        frequency=first.frequency,
        response=common,
    )
