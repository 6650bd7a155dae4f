"""The noise of each kind of channel, estimated from what a model leaves: coloured, level-dependent, never white alone.

The residual of output j in a run is r = d e. e is an autoregressive process of order <= 12 (BIC); d grows with the
signal's envelope, d^2 = 1 + (kappa env / sigma)^2, so that what a law of the right name but the wrong form leaves
behind counts as relative error and not as a thousand sigma of sensor noise. Of an angle that an observer follows, kappa is
that of the innovation: the residual itself is what the observer lets go, slow and as large as the motion. On top of
it hits scatter in gain and in timing: that part is per run, of rank two, and lives in ``whiten``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft
from scipy.linalg import solve_toeplitz
from scipy.ndimage import uniform_filter1d
from scipy.signal import lfilter

from jointscope.diagnosis.assembly import OBSERVER_HZ
from jointscope.diagnosis.input_noise import Ringing, ringing, shaken
from jointscope.diagnosis.poles import Pole
from jointscope.diagnosis.recorder_step import recorder_step

if TYPE_CHECKING:
    from jointscope.diagnosis.prepare import Output, PreparedRun

Vector = NDArray[np.float64]
Key = tuple[object, ...]

MAX_ORDER = 12
ABOUT = (0.3, 1.0, 3.0)  # times the power of input noise that the torque log itself shows
NO_MATTER = 1e-3  # of the sensor's own power
PEAKS = (3.0, 10.0, 30.0, 100.0, 300.0)  # power at the joint's own pole that is tried, over the sensor's
RINGS = 1e-3  # nats per sample by which a resonance in the noise must pay
RELATIVE_FLOOR = 2e-3  # of a signal's rms: no instrument chain is modelled more closely than this
ANGULAR_FLOOR = 0.001  # the same of what an angle does within the quarter second that an observer does not follow, coloured alike
EXACT = 1e-6  # of an angle's dynamic level: what a single-precision log still tells apart
RIGID_FLOOR = (
    0.03  # and of a free inertia's, followed to 20 Hz: its innovation is the force's error, not the angle's
)
ENVELOPE_WINDOW = 0.05  # s
FOLLOWED = 0.75  # periods of the observer's corner beyond which it follows an angle: a quarter second at 3 Hz
GAIN_BOUNDS = (0.002, 0.05)  # standard deviation of a hit's gain [-]
TIMING_BOUNDS = (3e-6, 2e-4)  # of a hit's time [s]
REMEMBERED = 400  # lags over which the memory of noise is counted
BY_CHANCE = 10.8  # chi-squared of one degree of freedom, exceeded once in a thousand
ANGULAR = ("angle", "position")


@dataclass(frozen=True, eq=False)
class BlockNoise:
    """Noise of one kind of channel in one kind of experiment.

    Attributes:
        ar: Prediction-error filter, ar[0] = 1, shape (order + 1,).
        sigma: Standard deviation of the innovation [the channel's unit].
        marginal: Standard deviation of the process itself [the channel's unit].
        kappa: Model error relative to the signal's envelope [-].
        ringing: What the noise of a logged torque makes of an angle that an observer holds, taken off before ``ar``.
        told: Twice the nats by which noise that grows with the signal is likelier than noise that does not, over as many
            samples as are independent: chi-squared of one degree where it does not grow.
    """

    ar: Vector
    sigma: float
    marginal: float
    kappa: float
    ringing: Ringing | None = None
    told: float = 0.0

    @property
    def grown(self) -> float:
        """``kappa`` where it is beyond chance, else 0 [-]: few bursts of coloured noise fall on some of the envelope."""
        return self.kappa if self.told > BY_CHANCE else 0.0


@dataclass(frozen=True, eq=False)
class NoiseModel:
    """Everything that turns residuals into standard normals.

    Attributes:
        blocks: Per kind of channel, see :func:`block_key`.
        gain: Scatter of a hit's gain s_g [-].
        timing: Scatter of a hit's time s_t [s].
    """

    blocks: dict[Key, BlockNoise]
    gain: float
    timing: float


def block_key(run: PreparedRun, output: Output) -> Key:
    """Outputs that share this key are recorded alike and pooled."""
    return (
        run.run.experiment,
        run.run.brake,
        output.quantity,
        output.location,
        output.direction,
        -1.0 if output.radius is None else float(output.radius),
        float(output.rate),
    )


def fast_part(output: Output, x: Vector) -> Vector:
    """An angle, or what is left of it, less the slow part that an observer follows, shape of ``x``."""
    window = max(3, round(output.rate * FOLLOWED / output.followed_to))
    return np.asarray(x - uniform_filter1d(x, window, mode="nearest"))


def dynamic_part(output: Output) -> Vector:
    """What the output does beyond its slow part over the scored samples [the output's unit], shape (n_scored,)."""
    data = output.data[output.mask]
    if output.quantity in ANGULAR:
        return fast_part(output, data)
    return np.asarray(data - np.median(data)) if data.size else data


def dynamic_level(output: Output) -> float:
    """RMS of what the output does beyond its slow part [the output's unit]: the yardstick of relative error."""
    data = dynamic_part(output)
    return float(np.sqrt(np.mean(np.square(data)))) if data.size else 0.0


def model_floor(output: Output) -> float:
    """How closely the output is modelled at best [-], of its dynamic level."""
    if output.quantity not in ANGULAR:
        return RELATIVE_FLOOR
    return ANGULAR_FLOOR if slowly_followed(output) else RIGID_FLOOR


def slowly_followed(output: Output) -> bool:
    """Whether it is an angle whose slow part alone an observer follows: an elastic joint's, not a free inertia's."""
    return output.quantity in ANGULAR and output.followed_to <= 2.0 * OBSERVER_HZ


def envelope(output: Output) -> Vector:
    """Local rms of the output [its unit], shape (n,); constant for angles, whose error does not follow their size."""
    level = dynamic_level(output)
    if output.quantity in ANGULAR:
        return np.full(len(output.data), level)
    window = max(3, round(output.rate * ENVELOPE_WINDOW))
    centred = output.data - np.median(output.data[output.mask]) if output.mask.any() else output.data
    return np.asarray(np.sqrt(np.maximum(uniform_filter1d(np.square(centred), window, mode="nearest"), 0.0)))


def inflation(output: Output, noise: BlockNoise) -> Vector:
    """d, by which the noise is larger where the signal is, shape (n,)."""
    return np.sqrt(1.0 + np.square(noise.kappa * envelope(output) / noise.marginal))


def autocovariance(segments: Sequence[Vector], lags: int) -> Vector:
    """Pooled biased autocovariance of zero-mean segments, shape (lags + 1,)."""
    total = sum(len(s) for s in segments)
    sums = np.zeros(lags + 1)
    for s in segments:
        for lag in range(min(lags, len(s) - 1) + 1):
            sums[lag] += float(s[: len(s) - lag] @ s[lag:])
    return sums / max(total, 1)


def fit_ar(covariance: Vector, samples: int, floor: float, max_order: int) -> tuple[Vector, float, float]:
    """Yule-Walker prediction-error filter, innovation and marginal standard deviation; order by BIC.

    ``floor`` is the standard deviation of a white part added to the process: it bounds how far the filter may amplify
    bands that the anti-alias filter has emptied.
    """
    r = covariance.copy()
    r[0] = r[0] * (1.0 + 1e-6) + floor**2
    best = (np.array([1.0]), r[0])
    score = samples * np.log(r[0])
    for order in range(1, min(max_order, len(r) - 1) + 1):
        a = solve_toeplitz(r[:order], r[1 : order + 1])
        innovation = float(r[0] - a @ r[1 : order + 1])
        if innovation <= 0.0:
            break
        candidate = samples * np.log(innovation) + order * np.log(max(samples, 2))
        if candidate < score:
            score, best = candidate, (np.concatenate([[1.0], -a]), innovation)
    return best[0], float(np.sqrt(best[1])), float(np.sqrt(r[0]))


def _segments(residual: Vector, mask: NDArray[np.bool_]) -> list[Vector]:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(int)))
    return [residual[a:b] for a, b in zip(edges[::2], edges[1::2], strict=True) if b - a > 4]


def _memory(segments: Sequence[Vector]) -> float:
    """1 + 2 sum_k c(k)^2: how many samples of the residual's power count as one [-] (Bendat and Piersol 2010, 8.2)."""
    lags = max(min(REMEMBERED, max(len(s) for s in segments)), 2)
    c = np.zeros(lags)
    for s in segments:
        power = np.square(np.abs(rfft(s, next_fast_len(2 * len(s), real=True))))
        found = irfft(power, next_fast_len(2 * len(s), real=True))[: min(lags, len(s))]
        c[: len(found)] += found
    return float(2.0 * np.sum(np.square(c / c[0])) - 1.0) if c[0] > 0.0 else 1.0


def _relative_error(segments: list[Vector], envelopes: list[Vector], floor: float) -> tuple[float, float, float]:
    """Maximum-likelihood (marginal, kappa) of r_t ~ N(0, marginal^2 + (kappa env_t)^2) over a grid of their ratio.

    With twice the nats by which that beats kappa = 0, all samples counted as independent.
    """
    r, env = np.concatenate(segments), np.concatenate(envelopes)
    variance = np.square(r)
    scale = max(float(np.max(env)), 1e-300)
    best, answer = np.inf, (max(float(np.sqrt(np.mean(variance))), floor), 0.0)
    flat = np.inf
    for ratio in np.concatenate([[0.0], np.geomspace(0.5, 300.0, 24)]):
        d2 = 1.0 + np.square(ratio * env / scale)
        s2 = max(float(np.mean(variance / d2)), floor**2)
        cost = float(np.sum(np.log(s2 * d2) + variance / (s2 * d2)))
        flat = min(flat, cost) if ratio == 0.0 else flat
        if cost < best - 1e-9:
            best, answer = cost, (float(np.sqrt(s2)), float(ratio * np.sqrt(s2) / scale))
    return (*answer, flat - best)


def block_noise(
    outputs: Sequence[Output],
    residuals: Sequence[Vector],
    max_order: int,
    quantum: float = 0.0,
    pole: Pole | None = None,
    share_of_input: float = 0.0,
    own_pole: Pole | None = None,
) -> BlockNoise:
    """Noise of one block from its residuals, with per-run scatter taken off already.

    Args:
        outputs: The outputs that share a key.
        residuals: Recorded minus predicted, one per output, shape (n,) each.
        max_order: Greatest autoregressive order.
        quantum: Step of the recorder [the output's unit].
        pole: The observer's, through which the noise of an input comes, where one does.
        share_of_input: Its power over the sensor's own far below that resonance, by the log's own white part [-].
        own_pole: The joint's, at which an acceleration shows what shakes it.
    """
    level = float(np.sqrt(np.mean([dynamic_level(o) ** 2 for o in outputs])))
    coloured = slowly_followed(outputs[0])
    least, own = model_floor(outputs[0]), max(quantum / np.sqrt(12.0), 1e-300)
    floor = max((EXACT if coloured else least) * level, own)
    segments, envelopes = [], []
    for output, residual in zip(outputs, residuals, strict=True):
        env = envelope(output)
        segments.extend(_segments(residual, output.mask))
        envelopes.extend(_segments(env, output.mask))
    if not segments:
        floor = max(floor, least * level)
        return BlockNoise(np.array([1.0]), floor, floor, 0.0)
    filters: list[Ringing | None] = [None]
    if pole is not None and share_of_input > NO_MATTER:
        filters.extend(ringing(pole, times * share_of_input, outputs[0].rate) for times in ABOUT)
    if own_pole is not None:
        filters.extend(shaken(own_pole, peak, outputs[0].rate) for peak in PEAKS)
    if not coloured:
        marginal, kappa, told = _relative_error(segments, envelopes, floor)
        ratio = kappa / marginal
        scaled = _scaled(segments, envelopes, ratio)
        return replace(_shaped(scaled, [], filters, floor, max_order, ratio), told=told / _memory(scaled))
    signal = [least * dynamic_part(o) for o in outputs]  # what no model is closer to, in the colour of the motion
    shape = _shaped(segments, signal, filters, floor, max_order, 0.0)
    skipped = len(shape.ar)
    if all(len(s) <= skipped for s in segments):
        return shape
    innovations = [lfilter(shape.ar, [1.0], s)[skipped:] for s in _through(shape.ringing, segments)]
    marginal, kappa, told = _relative_error(innovations, [e[skipped:] for e in envelopes], 1e-3 * shape.sigma)
    ratio = kappa / marginal
    d = [math.sqrt(1.0 + (ratio * dynamic_level(o)) ** 2) for o in outputs]
    signal = [x / d_run for x, d_run in zip(signal, d, strict=True)]
    least_white = floor * math.sqrt(float(np.mean([1.0 / d_run**2 for d_run in d])))
    shape = _shaped(_scaled(segments, envelopes, ratio), signal, filters, least_white, max_order, ratio)
    return replace(shape, told=told)


def _scaled(segments: list[Vector], envelopes: list[Vector], ratio: float) -> list[Vector]:
    return [s / np.sqrt(1.0 + np.square(ratio * e)) for s, e in zip(segments, envelopes, strict=True)]


def _shaped(
    scaled: list[Vector],
    signal: list[Vector],
    filters: Sequence[Ringing | None],
    floor: float,
    max_order: int,
    ratio: float,
) -> BlockNoise:
    """Colour of what is left once d is divided out; ``ratio`` is kappa over the process's standard deviation."""
    samples = sum(len(s) for s in scaled)
    best: tuple[float, BlockNoise] | None = None
    for candidate in filters:
        covariance = autocovariance(_through(candidate, scaled), max_order)
        if signal:
            covariance = covariance + autocovariance(_through(candidate, signal), max_order)
        ar, sigma, whole = fit_ar(covariance, samples, floor, max_order)
        cost = samples * np.log(sigma**2) + len(ar) * np.log(samples)
        if best is None or cost < best[0] - RINGS * samples:
            best = (cost, BlockNoise(ar, sigma, whole, ratio * whole, candidate))
    assert best is not None
    return best[1]


def _through(candidate: Ringing | None, segments: list[Vector]) -> list[Vector]:
    return segments if candidate is None else [candidate(s) for s in segments]


def quantum(output: Output) -> float:
    """The recorder's step [the output's unit]: as stated, or as its record shows."""
    return output.step if output.step is not None else recorder_step(output.data[output.mask])


def white(runs: Sequence[PreparedRun]) -> NoiseModel:
    """The first guess before anything is fitted: every output white at its own dynamic level, no scatter."""
    levels: dict[Key, list[float]] = {}
    for run in runs:
        for output in run.outputs:
            levels.setdefault(block_key(run, output), []).append(dynamic_level(output))
    blocks = {}
    for key, values in levels.items():
        size = max(0.05 * float(np.sqrt(np.mean(np.square(values)))), 1e-12)
        blocks[key] = BlockNoise(np.array([1.0]), size, size, 0.0)
    return NoiseModel(blocks, gain=0.01, timing=3e-5)
