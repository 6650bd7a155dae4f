"""Residuals made standard normal: prediction-error filter per output, hit gain and timing marginalised per run.

Sigma = L L' + s_g^2 y y' + s_t^2 y. y.' (science of B.2, stage 0), H H' of what the noise of the recorded input makes the
model do (``input_scatter``), and s_0^2 1 1' for each channel whose zero no record tells (``zeros``).
With U = L^-1 [s_g y, s_t y., H, s_0 1], U'U = V lambda V' and D = U V lambda^-1/2,
w = (I - D diag(1 - (1 + lambda)^-1/2) D') L^-1 r is the symmetric square root of Woodbury's identity:
w'w = r' Sigma^-1 r exactly, and w is linear in r.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.assembly import OBSERVER_ZETA, observer_corner
from jointscope.diagnosis.channels import ACCELERATIONS
from jointscope.diagnosis.excitation import asked_only, below_excitation
from jointscope.diagnosis.input_noise import Inlet, Ringing, noise_share
from jointscope.diagnosis.noise import (
    ANGULAR,
    GAIN_BOUNDS,
    TIMING_BOUNDS,
    BlockNoise,
    Key,
    NoiseModel,
    block_key,
    block_noise,
    inflation,
    quantum,
    slowly_followed,
    white,
)
from jointscope.diagnosis.own_hit import (
    SCATTERS,
    is_hit,
    least_scatter,
    scatter_columns,
    scatters_whole,
    within_scatter,
)
from jointscope.diagnosis.poles import Pole
from jointscope.diagnosis.prediction_error import prediction_errors
from jointscope.diagnosis.scattered import less_scatter
from jointscope.diagnosis.wind_up import WIND_UP
from jointscope.diagnosis.zeros import zero_scatter, zeros

if TYPE_CHECKING:
    from jointscope.diagnosis.input_scatter import Pushes
    from jointscope.diagnosis.prepare import Output, PreparedRun

Vector = NDArray[np.float64]

PRIOR_FREEDOM = 25.0  # degrees of freedom with which a run is believed to be as noisy as its kind
UNFELT = (
    0.1  # of the noise's power, below which the scatter along a direction is none: it costs time in every residual
)
SAMPLES_PER_FREEDOM = 8.0  # of a coloured residual
_NONE = np.empty(0)


@dataclass(frozen=True, eq=False)
class OutputFilter:
    """L^-1 of one output: r -> (ar * ringing * (r / d)) / sigma at the scored samples."""

    ar: Vector
    weight: Vector  # 1 / d, zero at unscored samples, shape (n,)
    sigma: float
    keep: NDArray[np.intp]
    sections: NDArray[np.float64] | None = None  # high-pass below the excitation, second-order sections
    ringing: Ringing | None = None

    def __call__(self, r: NDArray[np.float64]) -> NDArray[np.float64]:
        """Filter columns, shape (n, k) -> (n_kept, k)."""
        if self.sections is not None:
            r = asked_only(r, self.sections)
        above, below = (
            (_NONE, _NONE) if self.ringing is None else (self.ringing.numerator, self.ringing.denominator)
        )
        return np.asarray(
            prediction_errors(
                np.ascontiguousarray(r), self.weight, above, below, self.ar, self.keep, float(self.sigma)
            )
        )


@dataclass(frozen=True, eq=False)
class Likely:
    """(U'U + I)^-1 U' w: the most likely amounts of what scatters by one of each column of U, by the filtered residual w.

    Attributes:
        u: U, shape (n, k).
        gram: U'U, shape (k, k).
    """

    u: NDArray[np.float64]
    gram: NDArray[np.float64]

    def __call__(self, w: Vector) -> Vector:
        """The amounts, shape (k,)."""
        return np.asarray(np.linalg.solve(self.gram + np.eye(len(self.gram)), self.u.T @ w), dtype=np.float64)


@dataclass(frozen=True, eq=False)
class RunWhitener:
    """Sigma^-1/2 of one run, its outputs stacked.

    Attributes:
        filters: One per output.
        directions: D, the orthonormal scatter directions, shape (n_kept, r).
        shrink: 1 - (1 + lambda)^-1/2 of each.
        scatter: Of a hit, one standard deviation of everything that scatters, per output, shapes (n, k).
        likely: Of a hit, how much of each most likely happened.
    """

    filters: tuple[OutputFilter, ...]
    directions: NDArray[np.float64]
    shrink: Vector
    scatter: tuple[NDArray[np.float64], ...] = ()
    likely: Likely | None = None

    @property
    def sizes(self) -> tuple[int, ...]:
        """Number of scored samples of each output."""
        return tuple(len(f.keep) for f in self.filters)

    @property
    def log_determinant(self) -> float:
        """ln |Sigma^-1/2| of this run, up to what no hypothesis changes."""
        total = float(np.sum(np.log(1.0 - self.shrink))) if self.shrink.size else 0.0
        for f in self.filters:
            total += float(np.sum(np.log(f.weight[f.keep]))) - len(f.keep) * float(np.log(f.sigma))
        return total

    def filter(self, arrays: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
        """L^-1 of stacked outputs; each array of shape (n,) or (n, k)."""
        return np.concatenate(
            [f(a.reshape(len(a), -1)) for f, a in zip(self.filters, arrays, strict=True)], axis=0
        )

    def __call__(self, arrays: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
        """w for residuals or columns, shape (n_kept, k)."""
        w = self.filter(arrays)
        if self.shrink.size == 0:
            return w
        if w.shape[1] == 1:
            return np.asarray(less_scatter(w[:, 0], self._rows, self.shrink))[:, None]
        return w - self.directions @ (self.shrink[:, None] * (self.directions.T @ w))

    @cached_property
    def _rows(self) -> NDArray[np.float32]:
        return np.ascontiguousarray(self.directions.T, dtype=np.float32)

    def settled(self, residuals: Sequence[Vector]) -> Sequence[Vector]:
        """Residuals of the outputs less what most likely scattered from hit to hit, shapes (n,).

        Within what scatters: a hit whose gain is 80 standard deviations off was not hit harder, the model is wrong.
        """
        if self.likely is None:
            return residuals
        amounts = np.clip(self.likely(self.filter(residuals)[:, 0]), -SCATTERS, SCATTERS)
        return [r - c @ amounts for r, c in zip(residuals, self.scatter, strict=True)]


def output_filter(
    output: Output, noise: BlockNoise, scale: float = 1.0, sections: NDArray[np.float64] | None = None
) -> OutputFilter:
    """The filter of one output; samples whose filter memory reaches outside the scored part are dropped.

    ``scale``: noise of this run over that of its kind; ``sections``: high-pass of what no excitation asked for.
    """
    mask = output.mask.copy()
    for lag in range(1, len(noise.ar)):
        mask[lag:] &= output.mask[:-lag]
        mask[:lag] = False
    weight = np.where(output.mask, 1.0 / inflation(output, noise), 0.0)
    return OutputFilter(noise.ar, weight, noise.sigma * scale, np.flatnonzero(mask), sections, noise.ringing)


def run_scale(output: Output, noise: BlockNoise, residual: Vector) -> float:
    """Noise of this take over that of its kind [-], shrunk towards 1: force noise for one grows with the hit's level."""
    if slowly_followed(output):  # its raw residual is what the observer lets go, slower than anything that counts
        e = output_filter(output, noise)(residual[:, None])[:, 0]
    else:
        e = (residual / inflation(output, noise))[output.mask] / noise.marginal
    if e.size == 0 or not np.all(np.isfinite(e)):
        return 1.0
    weight = e.size / SAMPLES_PER_FREEDOM
    return float(np.sqrt((PRIOR_FREEDOM + weight * np.mean(np.square(e))) / (PRIOR_FREEDOM + weight)))


def without_scatter(
    run: PreparedRun,
    noise: NoiseModel,
    predicted: Sequence[Vector],
    bare: RunWhitener,
    pushed: Pushes | None = None,
) -> list[Vector]:
    """Residuals of a run less its angles' zeros, and a hit's own gain and time, all within three standard deviations.

    Less, too, what the noise of its input most likely did (``pushed``, see :func:`input_scatter.pushes`).
    """
    left = [o.data - y for o, y in zip(run.outputs, predicted, strict=True)]
    below = [below_excitation(run, o) for o in run.outputs]
    for k, size in zero_scatter(run, noise).items():
        zero = float(np.mean(asked_only(left[k], below[k])[run.outputs[k].mask]))
        left[k] = left[k] - np.clip(zero, -3.0 * size, 3.0 * size)
    if scatters_whole(run):
        own = within_scatter(np.array(own_scatter(run, predicted, bare)), noise)
        left = [r - c @ own for r, c in zip(left, scatter_columns(run, predicted), strict=True)]
    if pushed is not None:
        u = bare.filter(pushed)
        eta = Likely(u, u.T @ u)(bare.filter(left)[:, 0])
        left = [r - h @ eta for r, h in zip(left, pushed, strict=True)]
    return [asked_only(r, sections) for r, sections in zip(left, below, strict=True)]


def own_scatter(run: PreparedRun, predicted: Sequence[Vector], bare: RunWhitener) -> tuple[float, float]:
    """Least-squares gain [-] and time [s] of one hit."""
    w = bare.filter([o.data - y for o, y in zip(run.outputs, predicted, strict=True)])
    u = bare.filter(scatter_columns(run, predicted))
    gain, shift = least_scatter(u, w[:, 0])
    return float(gain), float(shift)


def _bare(run: PreparedRun, blocks: Sequence[BlockNoise], scales: Sequence[float]) -> RunWhitener:
    filters = tuple(
        output_filter(o, b, s, below_excitation(run, o))
        for o, b, s in zip(run.outputs, blocks, scales, strict=True)
    )
    return RunWhitener(filters, np.zeros((sum(len(f.keep) for f in filters), 0)), np.zeros(0))


def run_whitener(
    run: PreparedRun, noise: NoiseModel, predicted: Sequence[Vector] | None, pushed: Pushes | None = None
) -> RunWhitener:
    """Sigma^-1/2 of ``run``; of a hit, ``predicted`` is the response whose gain and timing scatter.

    ``pushed``: What the noise of its input does, see :func:`input_scatter.pushes`.
    """
    blocks = [noise.blocks[block_key(run, o)] for o in run.outputs]
    bare = _bare(run, blocks, [1.0] * len(blocks))
    if predicted is None or not run.outputs or not all(np.all(np.isfinite(y)) for y in predicted):
        return bare
    residuals = without_scatter(run, noise, predicted, bare, pushed)
    bare = _bare(run, blocks, [run_scale(o, b, r) for o, b, r in zip(run.outputs, blocks, residuals, strict=True)])
    return marginalised(run, noise, predicted, bare, pushed)


def marginalised(
    run: PreparedRun,
    noise: NoiseModel,
    predicted: Sequence[Vector],
    bare: RunWhitener,
    pushed: Pushes | None = None,
) -> RunWhitener:
    """``bare`` with what scatters from take to take marginalised: its angles' zeros, a hit's gain and time, its input's noise."""
    columns = zeros(run, noise)
    if scatters_whole(run):
        spread = np.array([noise.gain, noise.timing])
        scatter = [c * spread for c in scatter_columns(run, predicted)]
        columns = [np.concatenate(pair, axis=1) for pair in zip(scatter, columns, strict=True)]
    if pushed is not None:
        columns = [np.concatenate(pair, axis=1) for pair in zip(columns, pushed, strict=True)]
    if not any(c.shape[1] for c in columns):
        return bare
    u = bare.filter(columns)
    with np.errstate(over="ignore", invalid="ignore"):
        gram = u.T @ u
    if not np.all(np.isfinite(gram)):  # of a model that flies apart: nothing scatters like it
        return bare
    eigenvalues, vectors = np.linalg.eigh(gram)
    felt = eigenvalues > UNFELT
    directions = np.asfortranarray(u @ (vectors[:, felt] / np.sqrt(eigenvalues[felt])))
    shrink = 1.0 - 1.0 / np.sqrt(1.0 + eigenvalues[felt])
    if not is_hit(run):
        return RunWhitener(bare.filters, directions, shrink)
    return RunWhitener(bare.filters, directions, shrink, tuple(columns), Likely(u, gram))


def hit_scatter(
    runs: Sequence[PreparedRun], noise: NoiseModel, predictions: Sequence[Sequence[Vector]]
) -> tuple[float, float, list[tuple[float, float]]]:
    """Scatter of hit gain [-] and timing [s], robustly over the hits, and each hit's own (gain, time)."""
    found = [
        own_scatter(run, predicted, run_whitener(run, noise, None)) if scatters_whole(run) else (0.0, 0.0)
        for run, predicted in zip(runs, predictions, strict=True)
    ]
    hits = np.array([f for f, run in zip(found, runs, strict=True) if scatters_whole(run)])
    if len(hits) < 3:
        return 0.01, 3e-5, found
    spread = np.sqrt(np.mean(np.square(hits), axis=0))  # about zero: the mean belongs to the base's parameters
    robust = 1.4826 * np.median(np.abs(hits), axis=0)
    spread = np.minimum(spread, 2.0 * np.maximum(robust, 1e-12))
    return float(np.clip(spread[0], *GAIN_BOUNDS)), float(np.clip(spread[1], *TIMING_BOUNDS)), found


def estimate_noise(
    runs: Sequence[PreparedRun],
    predictions: Sequence[Sequence[Vector]],
    before: NoiseModel,
    max_order: int,
    way: Inlet | None = None,
    pushed: Sequence[Pushes | None] = (),
) -> NoiseModel:
    """The noise that ``predictions`` leave: scatter first, then each block's colour and relative error.

    ``way`` is how the noise of a logged torque reaches the outputs of the model that predicted, ``pushed`` what the noise
    of each run's input does there, empty where that is left out.
    """
    gain, timing, _ = hit_scatter(runs, before, predictions)
    poles: dict[Key, Pole] = {}
    shares: dict[Key, list[float]] = {}
    own: dict[Key, Pole] = {}
    for run in runs:
        for output in run.outputs:
            key, observed = block_key(run, output), run.mode == "observer" and output.quantity in ANGULAR
            if way is not None and output.quantity in (*ACCELERATIONS, WIND_UP) and run.motor_moves in way.poles:
                own[key] = way.poles[run.motor_moves]
            if observed:  # what reaches an accelerometer through the resonance is taken off the input itself
                poles[key] = (observer_corner(run), OBSERVER_ZETA)
                w0 = 2.0 * np.pi * observer_corner(run)
                share = noise_share(run, output, way, quantum(output), w0) if way is not None else 0.0
                shares.setdefault(key, []).append(share)
    outputs: dict[Key, list[Output]] = {}
    residuals: dict[Key, list[Vector]] = {}
    scattered = NoiseModel(before.blocks, gain, timing)
    for run, predicted, force in zip(runs, predictions, pushed or [None] * len(runs), strict=True):
        left = without_scatter(run, scattered, predicted, run_whitener(run, before, None), force)
        for output, residual in zip(run.outputs, left, strict=True):
            key = block_key(run, output)
            outputs.setdefault(key, []).append(output)
            residuals.setdefault(key, []).append(residual)
    blocks = {
        key: block_noise(
            outputs[key],
            residuals[key],
            max_order,
            max(quantum(o) for o in outputs[key]),
            poles.get(key),
            float(np.median(shares.get(key, [0.0]))),
            own.get(key),
        )
        for key in outputs
    }
    return NoiseModel(blocks, gain, timing)


def completed(
    noise: NoiseModel,
    runs: Sequence[PreparedRun],
    predictions: Sequence[Sequence[Vector]],
    max_order: int,
    way: Inlet | None = None,
    pushed: Sequence[Pushes | None] = (),
) -> NoiseModel:
    """``noise`` with a block for every kind of channel in ``runs``: what no fitted run has, by what is left of it here."""
    own = [
        (run, predicted, force)
        for run, predicted, force in zip(runs, predictions, pushed or [None] * len(runs), strict=True)
        if any(block_key(run, output) not in noise.blocks for output in run.outputs)
    ]
    if not own:
        return noise
    theirs = [run for run, _, _ in own]
    before = NoiseModel({**white(theirs).blocks, **noise.blocks}, noise.gain, noise.timing)
    forces = [force for _, _, force in own]
    found = estimate_noise(theirs, [predicted for _, predicted, _ in own], before, max_order, way, forces)
    return NoiseModel({**found.blocks, **noise.blocks}, noise.gain, noise.timing)
