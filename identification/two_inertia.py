r"""The two-inertia joint fitted to the responses of both sides at once.

Per generalised torque at the output (paper, Equations 4-7),

    q_s''/tau = s (J_L s^2 + (c + b_l) s + K)/D(s),     q''/tau = s (c s + K)/D(s).

Both sides together give all of J_M, J_L, K, c, b_m and b_l per unit of input; the load side alone does only where J_M
is known. Errors of a real bench are multiplicative (amplitude-dependent damping), so the residual is the complex
logarithm of measured over fitted, its variance the periods' scatter plus a common share that is estimated, and its
loss is robust (Student-like), so that a few lines the linear joint can't describe don't bend the rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from jointscope.errors import RefusedError
from jointscope.identification.response_estimate import WELL_BEHAVED, Responses

Real = NDArray[np.float64]
Complex = NDArray[np.complexfloating[Any, Any]]

PARAMETERS = ("motor_inertia_output", "load_inertia", "stiffness", "damping", "motor_damping", "load_damping")
_DELAYS = 1e-3  # s, scale of the delays


@dataclass(frozen=True, kw_only=True, eq=False)
class TwoInertia:
    """One joint per unit of input: J_M, J_L [kg m^2], K [N m/rad], c, b_m, b_l [N m s/rad], all at the output."""

    values: Real

    def accelerations(self, s: Complex) -> tuple[Complex, Complex]:
        """q_s''/tau and q''/tau, shape of ``s`` [rad/s]."""
        J_M, J_L, K, c, b_m, b_l = self.values
        D = np.polyval(
            [
                J_M * J_L,
                J_M * (b_l + c) + J_L * (b_m + c),
                (J_M + J_L) * K + (b_m + b_l) * c + b_m * b_l,
                K * (b_m + b_l),
            ],
            s,
        )
        return s * (J_L * s**2 + (c + b_l) * s + K) / D, s * (c * s + K) / D


@dataclass(frozen=True, kw_only=True, eq=False)
class TwoInertiaFit:
    """The fit and its evidence.

    Attributes:
        joint: Estimated values.
        delays: By which each output follows the input beyond the model [s], shape (n_outputs,).
        signs: +1, or -1 where an output's sign had to be turned, shape (n_outputs,).
        free: Indices into ``PARAMETERS`` that were estimated.
        covariance: Of the logarithms of the free parameters, shape (n_free, n_free), by blocks of lines.
        blocks: Number of blocks behind it.
        share: The common relative error that the linear joint leaves [-].
        log_errors: RMS of ln|fitted/measured| per output over its usable lines.
        responses: What was fitted, per run.
    """

    joint: TwoInertia
    delays: Real
    signs: Real
    free: tuple[int, ...]
    covariance: Real
    blocks: int
    share: float
    log_errors: Real
    responses: tuple[Responses, ...]


def fitted(fit: TwoInertiaFit, sides: Sequence[str], frequency: Real) -> Complex:
    """Responses of the outputs in the order of ``sides``, shape (n_outputs, n)."""
    return _predicted(fit.joint.values, fit.delays, fit.signs, sides, frequency)


def _predicted(values: Real, delays: Real, signs: Real, sides: Sequence[str], frequency: Real) -> Complex:
    s = 2j * np.pi * frequency
    motor, load = TwoInertia(values=values).accelerations(s)
    return np.array(
        [
            sign * (motor if side == "motor" else load) * np.exp(-s * delay)
            for side, delay, sign in zip(sides, delays, signs, strict=True)
        ]
    )


def _signs(responses: Responses, sides: Sequence[str]) -> Real:
    """Below the first resonance both sides move with the torque: the phase of each output's low lines says its sign."""
    low = responses.frequency <= np.quantile(responses.frequency, 0.1)
    signs = []
    for values in responses.values:
        mean = np.sum(values[low] / np.abs(values[low]))
        signs.append(1.0 if mean.real >= 0.0 else -1.0)
    return np.array(signs)


def _starts(responses: Responses, sides: Sequence[str], known: dict[int, float]) -> list[Real]:
    """Starting values from the antiresonance of the motor's side, the total inertia at low and J_M at high frequency."""
    frequency = responses.frequency
    side = responses.values[sides.index("motor")] if "motor" in sides else responses.values[0]
    size = np.abs(side)
    low = float(np.median(size[: max(3, size.size // 12)]))
    total = 1.0 / low
    peak = 2.0 * np.pi * float(frequency[int(np.argmax(np.convolve(size, np.ones(3), "same")[1:-1])) + 1])
    dip = 2.0 * np.pi * float(frequency[int(np.argmin(np.convolve(size, np.ones(3), "same")[1:-1])) + 1])
    starts = []
    for ratio in (0.25, 1.0, 4.0):
        J_M = known.get(0, total / (1.0 + ratio))
        J_L = max(total - J_M, 0.1 * total) if 0 in known else total - J_M
        notches = {0.7 * peak}
        if "motor" in sides and 0.1 * peak < dip < peak:
            notches.add(dip)
        for notch in sorted(notches):
            K = J_L * notch**2
            damping = 0.02 * np.sqrt(K * J_L)
            starts.append(np.array([J_M, J_L, K, damping, 0.5 * damping, 0.5 * damping]))
    return starts


def fit_two_inertia(
    responses: Sequence[Responses], sides: Sequence[str], known: dict[int, float] | None = None
) -> TwoInertiaFit:
    """Fit the joint to the outputs' responses of one or several runs.

    Args:
        responses: Accelerations per generalised torque, one entry per run, outputs in the order of ``sides``.
        sides: ``"motor"`` or ``"load"`` per output.
        known: Parameters (index into ``PARAMETERS``) that are given.

    Raises:
        RefusedError: Only one side was recorded and J_M is unknown.
    """
    known = dict(known or {})
    if len(set(sides)) < 2 and 0 not in known:
        raise RefusedError(
            f"only the {sides[0]}'s motion was recorded: without rig.motor_inertia it fixes K/(J_M J_L) and J_M + J_L at "
            "best, not K, J_M and J_L; record both sides, or give the motor inertia"
        )
    free = tuple(index for index in range(6) if index not in known)
    signs = _signs(responses[0], sides)
    share, best = 0.1, None
    for start in _starts(responses[0], sides, known):
        found = _minimise(responses, sides, signs, known, free, start, np.zeros(len(sides)), share)
        if best is None or found.cost < best.cost:
            best = found
    assert best is not None
    for _ in range(6):
        values, delays = _unpack(best.x, known, free, len(sides))
        share = _share(responses, sides, signs, values, delays)
        best = _minimise(responses, sides, signs, known, free, values, delays, share)
    values, delays = _unpack(best.x, known, free, len(sides))
    covariance, blocks = _block_covariance(best, responses, len(sides), len(free))
    return TwoInertiaFit(
        joint=TwoInertia(values=values),
        delays=delays,
        signs=signs,
        free=free,
        covariance=covariance,
        blocks=blocks,
        share=share,
        log_errors=_log_errors(responses, sides, signs, values, delays),
        responses=tuple(responses),
    )


def _unpack(x: Real, known: dict[int, float], free: Sequence[int], outputs: int) -> tuple[Real, Real]:
    values = np.empty(6)
    values[list(free)] = np.exp(x[: len(free)])
    for index, value in known.items():
        values[index] = value
    return values, x[len(free) :] * _DELAYS if outputs else np.zeros(0)


def _residual(
    responses: Sequence[Responses], sides: Sequence[str], signs: Real, values: Real, delays: Real, share: float
) -> Real:
    parts = []
    for run in responses:
        ratio = run.values / _predicted(values, delays, signs, sides, run.frequency)
        relative = run.deviation / np.abs(run.values)
        sigma = np.sqrt(share**2 + relative**2)
        weight = np.where(relative < WELL_BEHAVED, 1.0 / sigma, 0.0)
        parts.append(np.stack([np.log(np.abs(ratio)) * weight, np.angle(ratio) * weight], axis=-1).reshape(-1, 2))
    return np.concatenate(parts).ravel()


def _minimise(
    responses: Sequence[Responses],
    sides: Sequence[str],
    signs: Real,
    known: dict[int, float],
    free: Sequence[int],
    start: Real,
    delays: Real,
    share: float,
) -> optimize.OptimizeResult:
    x = np.concatenate([np.log(np.maximum(start[list(free)], 1e-12 * start.max())), delays / _DELAYS])

    def error(x: Real) -> Real:
        values, late = _unpack(x, known, free, len(sides))
        return _residual(responses, sides, signs, values, late, share)

    lower = np.concatenate([np.full(len(free), -60.0), np.full(len(sides), -5.0)])
    return optimize.least_squares(error, x, bounds=(lower, -lower), loss="cauchy", f_scale=2.0, max_nfev=200)


def _share(responses: Sequence[Responses], sides: Sequence[str], signs: Real, values: Real, delays: Real) -> float:
    """The common relative error, from the middle of the residuals' distribution after the noise's share."""
    squares = []
    for run in responses:
        ratio = run.values / _predicted(values, delays, signs, sides, run.frequency)
        relative = run.deviation / np.abs(run.values)
        keep = relative < 0.3
        squares.append((0.5 * np.abs(np.log(ratio)) ** 2 - relative**2)[keep])
    pooled = np.concatenate(squares)
    return float(np.sqrt(max(float(np.median(pooled)) / np.log(2.0), 1e-8)))


def _log_errors(
    responses: Sequence[Responses], sides: Sequence[str], signs: Real, values: Real, delays: Real
) -> Real:
    rows: list[list[Real]] = [[] for _ in sides]
    for run in responses:
        model = _predicted(values, delays, signs, sides, run.frequency)
        keep = run.deviation / np.abs(run.values) < 0.1
        for o in range(len(sides)):
            rows[o].append(np.log(np.abs(model[o] / run.values[o]))[keep[o]])
    return np.array([float(np.sqrt(np.mean(np.concatenate(row) ** 2))) if row else np.nan for row in rows])


def _block_covariance(
    found: optimize.OptimizeResult, responses: Sequence[Responses], outputs: int, free: int
) -> tuple[Real, int]:
    """Sandwich with neighbouring lines in one block: misfit of a linear model is alike from line to line."""
    jac, residual = np.asarray(found.jac), np.asarray(found.fun)
    scale = np.linalg.norm(jac, axis=0)
    scale = np.maximum(scale, 1e-6 * scale.max())
    bread = np.linalg.pinv((jac / scale).T @ (jac / scale), rcond=1e-12)
    labels, at = [], 0
    for run in responses:
        n = run.frequency.size
        size = max(3, n // 24)
        block = at + np.arange(n) // size
        labels.append(np.repeat(np.tile(block, outputs), 2))
        at = int(block.max()) + 1
    label = np.concatenate(labels)
    scores = np.zeros((at, jac.shape[1]))
    np.add.at(scores, label, jac / scale * residual[:, None])
    meat = scores.T @ scores * at / max(at - jac.shape[1], 1)
    full = bread @ meat @ bread / np.outer(scale, scale)
    return full[:free, :free], at
