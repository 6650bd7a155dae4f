r"""The direct parametric fit of Li et al. (Sensors 2022, 22, 6170, Equations 17-25), by maximum likelihood over hits.

    G(s) = b1 s^2/(s^2 + a1 s + a2),   J_L = 1/b1,  c = a1/b1,  K = a2/b1 - K_g

The start is the iterated linear fit (``linear_start``), the estimate the errors-in-variables likelihood
(``errors_in_variables``) whose noise levels and hit scatter come from the data themselves, in turns. The paper's b2 and
b3 are left out: the arm starts at rest, and fitting them costs the stiffness more than twice its standard deviation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jointscope.identification.errors_in_variables import (
    HitSpectrum,
    Scatter,
    compact,
    minimise,
    residual_noise,
)
from jointscope.identification.hit_scatter import HitDeviations, deviations, estimate_scatter
from jointscope.identification.modal_model import ModalModel

Real = NDArray[np.float64]
Complex = NDArray[np.complexfloating[Any, Any]]

_ROUNDS = 8  # of noise and scatter against the fit; three usually do
_SHAPE_FREEDOM = 80  # degrees of freedom wanted behind every point of the noise's shape


@dataclass(frozen=True, kw_only=True, eq=False)
class ParametricFit:
    """The likelihood's optimum and everything its intervals need.

    Attributes:
        hits: The spectra fitted, inside the band.
        model: Estimated modes.
        information: Fisher matrix of ``model.vector()`` with noise and scatter as estimated, shape (p, p).
        noise: Standard deviation of real and imaginary part of each output line, per hit, shape (n_outputs, n).
        scatter: Estimated hit-to-hit scatter.
        found: Each hit's own gain and delay.
        cost: Sum of squared whitened residuals, and
        freedom: its degrees of freedom.
        evaluations: Cost evaluations in all.
    """

    hits: tuple[HitSpectrum, ...]
    model: ModalModel
    information: Real
    noise: tuple[Real, ...]
    scatter: Scatter
    found: HitDeviations
    cost: float
    freedom: float
    evaluations: int


def noise_levels(
    model: ModalModel,
    hits: Sequence[HitSpectrum],
    noise: Sequence[Real],
    scatter: Scatter,
    shape: Sequence[Real] | None = None,
) -> list[Real]:
    """Noise of each hit's lines from what the fit leaves over: one level per hit and output, times a common ``shape``."""
    levels = []
    for at, (lines, freedom) in enumerate(residual_noise(model, hits, noise, scatter)):
        form = np.ones(lines.shape) if shape is None else shape[at]
        share = max(freedom, 1.0) / (2.0 * lines.size)  # of the lines' real numbers that are free
        level = np.sqrt(np.mean(np.abs(lines / form) ** 2, axis=1) / 2.0 / share)
        levels.append(np.maximum(level[:, None] * form, _floor(model, hits[at])))
    return levels


def _floor(model: ModalModel, hit: HitSpectrum) -> Real:
    """The least noise worth telling from none, shape (n_outputs, 1): a thousandth of what the force's noise does."""
    transfer = hit.sensor * model.response(2j * np.pi * hit.frequency)
    through = np.abs(transfer) * np.linalg.norm(hit.input_basis, axis=1)
    return np.asarray(
        np.maximum(1e-3 * through.max(axis=1), 1e-9 * np.abs(hit.output).max(axis=1))[:, None] + 1e-300
    )


def noise_shape(
    model: ModalModel, hits: Sequence[HitSpectrum], noise: Sequence[Real], scatter: Scatter
) -> list[Real]:
    """How the outputs' noise depends on frequency, common to all hits, mean square one; shape (n_outputs, n) per hit.

    The squared residuals of all hits, each over its own level, smoothed over as many lines as give every point
    ``_SHAPE_FREEDOM`` degrees of freedom.
    """
    left = residual_noise(model, hits, noise, scatter)
    where, at = np.unique(np.concatenate([hit.frequency for hit in hits]).round(9), return_inverse=True)
    squares = np.concatenate(
        [np.abs(lines) ** 2 / np.mean(np.abs(lines) ** 2, axis=1, keepdims=True) for lines, _ in left], axis=1
    )
    count = np.bincount(at)
    total = np.array([np.cumsum(np.pad(np.bincount(at, weights=row), (1, 0))) for row in squares])
    number = np.cumsum(np.pad(count, (1, 0)))
    half = min(max(_SHAPE_FREEDOM // (4 * int(np.median(count))), 1), where.size // 2)
    centre = np.arange(where.size)
    low, high = np.maximum(centre - half, 0), np.minimum(centre + half + 1, where.size)
    smooth = (total[:, high] - total[:, low]) / (number[high] - number[low])
    return [
        np.sqrt(np.array([np.interp(hit.frequency, where, row) for row in smooth]).clip(1e-4, None))
        for hit in hits
    ]


def fit_hits(hits: Sequence[HitSpectrum], start: ModalModel, *, coloured: bool = True) -> ParametricFit:
    """Maximum likelihood from ``start``; noise levels, the noise's shape and hit scatter are estimated in turns.

    Args:
        hits: Spectra inside the band, one entry per hit.
        start: Modes to start at; its make-up (modes, residual terms) is kept.
        coloured: Let the outputs' noise depend on frequency.

    Raises:
        RefusedError: No convergence.
    """
    heard = list(hits)
    noise = [np.full(hit.output.shape, _rough_noise(start, hit)) for hit in heard]
    hits = [_audible(start, hit, sigma) for hit, sigma in zip(heard, noise, strict=True)]
    scatter, model, evaluations = Scatter(), start, 0
    shape: list[Real] | None = None
    for turn in range(_ROUNDS):
        optimum = minimise(model, hits, noise, scatter, tolerance=1e-2 if turn < 2 else 1e-3)
        model, evaluations = optimum.model, evaluations + optimum.evaluations
        if coloured and turn >= 1:
            shape = noise_shape(model, hits, noise, scatter)
        new_noise = noise_levels(model, hits, noise, scatter, shape)
        change = max(float(np.max(np.abs(np.log(a / b)))) for a, b in zip(new_noise, noise, strict=True))
        noise = new_noise
        if turn == 0:
            hits = [_audible(model, hit, sigma) for hit, sigma in zip(heard, noise, strict=True)]
        found = deviations(model, hits, noise)
        new_scatter = estimate_scatter(found)
        change = max(change, abs(new_scatter.gain - scatter.gain) / (new_scatter.gain + 1e-4))
        change = max(change, abs(new_scatter.timing - scatter.timing) / (new_scatter.timing + 1e-6))
        scatter = new_scatter
        if turn >= 2 and change < 0.02:
            break
    optimum = minimise(model, hits, noise, scatter, tolerance=1e-4)
    freedom = sum(f for _, f in residual_noise(optimum.model, hits, noise, scatter))
    return ParametricFit(
        hits=tuple(hits),
        model=optimum.model,
        information=optimum.information,
        noise=tuple(noise),
        scatter=scatter,
        found=found,
        cost=optimum.cost,
        freedom=freedom,
        evaluations=evaluations + optimum.evaluations,
    )


def _audible(model: ModalModel, hit: HitSpectrum, noise: Real) -> HitSpectrum:
    """The hit without its force noise where that is under a tenth of the output's: it then only costs time."""
    through = np.abs(hit.sensor * model.response(2j * np.pi * hit.frequency))
    share = through * np.linalg.norm(hit.input_basis, axis=1) / np.sqrt(2.0) / noise
    quiet = not share.size or float(np.sqrt(np.mean(share**2))) < 0.1
    return replace(hit, input_basis=hit.input_basis[:, :0]) if quiet else compact(hit)


def _rough_noise(model: ModalModel, hit: HitSpectrum) -> float:
    error = hit.output - hit.sensor * model.response(2j * np.pi * hit.frequency) * hit.input
    return float(np.sqrt(np.mean(np.abs(error) ** 2) / 2.0)) + float(np.max(_floor(model, hit)))
