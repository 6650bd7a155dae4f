r"""Stiffness of an axis from its wind-up: encoders before and behind the gearbox, and the motor's torque.

w = q_motor/n - q_link. Behind rotor and friction the spring carries T_S = n T_e - J_M q'' - T_c sign(q') - F_v q', so

    w = w_0 + T_S/K + skew q' + a sin q + b cos q

skew: what a difference in time between the two encoders makes of a moving axis, [s] (F_v/K can't be told from it and is
counted there); a, b: once-per-turn errors of the encoder rings. The *plain* spring is w = w_0 + n T_e/K alone, which is
what a wind-up plot against torque shows. Both are least squares on records low-passed alike; 95 % intervals are from a
bootstrap over half-second blocks, widened to the scatter between records where that is larger.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import signal, stats

from jointscope.errors import RefusedError
from jointscope.recordings.campaign import Campaign

Real = NDArray[np.float64]

_BLOCK = 0.5  # s
_DRAWS = 400
_SIGN_SPEED = 2e-3  # rad/s over which the sign of the speed turns: encoder noise lies below


@dataclass(frozen=True, kw_only=True, eq=False)
class WindupRecord:
    """One take of one axis.

    Attributes:
        name: Of the take.
        rate: [Hz].
        motor_angle: At the output, q_motor/n [rad], shape (n,).
        link_angle: Behind the gearbox [rad], shape (n,).
        torque: n T_e [N m at the output], shape (n,).
    """

    name: str
    rate: float
    motor_angle: Real
    link_angle: Real
    torque: Real


@dataclass(frozen=True, kw_only=True)
class Interval:
    """A value with its 95 % interval; a compliance whose interval reaches zero has no upper stiffness (``inf``)."""

    value: float
    low: float
    high: float


@dataclass(frozen=True, kw_only=True, eq=False)
class WindupFit:
    """What the wind-up of an axis says.

    Attributes:
        plain_stiffness: Of the spring alone against the motor's torque [N m/rad].
        plain_explained: Share of the wind-up's variance it explains [-].
        stiffness: K with rotor inertia, friction, skew and ring errors allowed for [N m/rad].
        skew: [s].
        coulomb: T_c [N m at the output].
        explained: Share of the variance explained by the full model [-].
        skew_share: Share of the variance explained by the skew alone [-].
        spread: Peak to peak of the wind-up [rad].
        left: RMS of what the full model leaves [rad].
        plain_left: RMS of what the plain spring leaves [rad].
    """

    plain_stiffness: Interval
    plain_explained: float
    stiffness: Interval
    skew: Interval
    coulomb: Interval
    explained: float
    skew_share: float
    spread: float
    left: float
    plain_left: float


def windup_records(campaign: Campaign) -> tuple[tuple[WindupRecord, ...], float]:
    """Every run with torque, motor angle and link angle on one device; and J_M of the rotor at the output [kg m^2].

    Raises:
        RefusedError: The nameplate lacks the ratio or the motor's inertia, or no run has all three channels.
    """
    rig = campaign.rig
    if rig.reduction_ratio is None or rig.motor_inertia is None:
        missing = "reduction_ratio" if rig.reduction_ratio is None else "motor_inertia"
        raise RefusedError(f"{campaign.path}: a wind-up needs rig.{missing}")
    n = rig.reduction_ratio
    records = []
    for run in campaign.runs:
        torque, motor, link = (
            run.select("torque", location="motor"), run.select("angle", location="motor"),
            run.select("angle", location="arm"),
        )  # fmt: skip
        if not (torque and motor and link) or len({torque[0].device, motor[0].device, link[0].device}) > 1:
            continue
        shaft = torque[0].samples / (n if torque[0].channel.side == "output" else 1.0)
        records.append(
            WindupRecord(
                name=run.id, rate=motor[0].sampling_rate, motor_angle=motor[0].samples / n,
                link_angle=link[0].samples, torque=n * shaft,
            )
        )  # fmt: skip
    if not records:
        raise RefusedError(f"{campaign.path}: no run has torque, motor angle and link angle on one device")
    return tuple(records), (rig.motor_inertia + (rig.reducer_inertia or 0.0)) * n * n


def fit_windup(
    records: Sequence[WindupRecord], rotor_inertia: float, *, low_pass: float = 6.0, rng: np.random.Generator
) -> WindupFit:
    """Fit plain and full spring to all records of one axis at once, an offset for each.

    Args:
        records: At least one, each of at least 4 s.
        rotor_inertia: J_M = J_m n^2 at the output [kg m^2].
        low_pass: Zero-phase, on both sides alike [Hz].
        rng: Of the bootstrap.

    Raises:
        RefusedError: The axis hardly moves, or the records are too short.
    """
    if not records or min(r.torque.size / r.rate for r in records) < 4.0:
        raise RefusedError("a wind-up needs records of at least 4 s")
    if max(float(np.ptp(r.link_angle)) for r in records) < 0.02:
        raise RefusedError("the axis hardly moves (under 0.02 rad): its wind-up tells gravity, not stiffness")
    prepared = [_prepare(r, rotor_inertia, low_pass) for r in records]
    full, plain = _stack(prepared, full=True), _stack(prepared, full=False)
    y = full[1]
    centred = y - _means(y, full[2])[full[2]]
    answer, answer_plain = _solve(*full[:2]), _solve(*plain[:2])
    left, left_plain = y - full[0] @ answer, y - plain[0] @ answer_plain
    speed = full[0][:, 1] - _means(full[0][:, 1], full[2])[full[2]]
    alone = centred - speed * float(speed @ centred) / float(speed @ speed)
    draws = _bootstrap(full, records[0].rate, rng)
    draws_plain = _bootstrap(plain, records[0].rate, rng)
    single = np.array([_solve(*_stack([p], full=True)[:2])[:3] for p in prepared])
    single_plain = np.array([_solve(*_stack([p], full=False)[:2])[:1] for p in prepared])
    widths, widths_plain = _half_widths(draws, single), _half_widths(draws_plain, single_plain)
    variance = float(np.mean(centred**2))
    coulomb = -answer[2] / answer[0]
    of_coulomb = abs(coulomb) * float(np.hypot(widths[2] / abs(answer[2]), widths[0] / abs(answer[0])))
    return WindupFit(
        plain_stiffness=_inverse(float(answer_plain[0]), float(widths_plain[0])),
        plain_explained=1.0 - float(np.mean(left_plain**2)) / variance,
        stiffness=_inverse(float(answer[0]), float(widths[0])),
        skew=Interval(value=float(answer[1]), low=float(answer[1] - widths[1]), high=float(answer[1] + widths[1])),
        coulomb=Interval(value=float(coulomb), low=float(coulomb - of_coulomb), high=float(coulomb + of_coulomb)),
        explained=1.0 - float(np.mean(left**2)) / variance,
        skew_share=1.0 - float(np.mean(alone**2)) / variance,
        spread=float(np.ptp(centred)),
        left=float(np.sqrt(np.mean(left**2))),
        plain_left=float(np.sqrt(np.mean(left_plain**2))),
    )


def statement(fit: WindupFit, axis: str) -> str:
    """What a linear spring leaves unexplained on this axis, in one or two sentences."""
    percent = 100.0 * (1.0 - fit.plain_explained)
    return (
        f"{axis}: a linear spring against motor torque leaves {percent:.0f} % of the wind-up's variance "
        f"({1e3 * fit.plain_left:.3f} mrad rms of {1e3 * fit.spread:.2f} mrad peak to peak). "
        f"{100.0 * fit.skew_share:.0f} % of the variance follows the speed, like two encoders read "
        f"{1e3 * fit.skew.value:.2f} ms apart, which no spring does; with that, friction and ring errors allowed for, "
        f"{1e3 * fit.left:.3f} mrad rms are left and K = {fit.stiffness.value / 1e6:.2f} "
        f"[{fit.stiffness.low / 1e6:.2f}, {fit.stiffness.high / 1e6:.2f}] MN m/rad."
    )


@dataclass(frozen=True, eq=False)
class _Prepared:
    torque: Real
    spring: Real
    speed: Real
    sign: Real
    rings: Real
    windup: Real


def _prepare(record: WindupRecord, rotor_inertia: float, low_pass: float) -> _Prepared:
    step = 1.0 / record.rate
    span = max(5, 2 * round(0.02 * record.rate) + 1)
    middle = 0.5 * (record.motor_angle + record.link_angle)  # of two clocks: the skew's square then drops out
    speed = signal.savgol_filter(middle, span, 3, 1, delta=step)
    acceleration = signal.savgol_filter(middle, span, 3, 2, delta=step)
    filt = signal.butter(3, low_pass, fs=record.rate, output="sos")
    cut = round(0.25 * record.rate)

    def smooth(values: Real) -> Real:
        return np.asarray(signal.sosfiltfilt(filt, values, axis=0))[cut:-cut]

    q = record.motor_angle
    return _Prepared(
        torque=smooth(record.torque),
        spring=smooth(record.torque - rotor_inertia * acceleration),
        speed=smooth(speed),
        sign=smooth(np.tanh(speed / _SIGN_SPEED)),
        rings=smooth(np.column_stack([np.sin(q), np.cos(q)])),
        windup=smooth(record.motor_angle - record.link_angle),
    )


def _stack(prepared: Sequence[_Prepared], *, full: bool) -> tuple[Real, Real, NDArray[np.int_]]:
    """Regressors with one offset column per record, wind-up, and the record each row belongs to."""
    rows, sides, owner = [], [], []
    for k, part in enumerate(prepared):
        offsets = np.zeros((part.windup.size, len(prepared)))
        offsets[:, k] = 1.0
        own = [part.spring, part.speed, part.sign, *part.rings.T] if full else [part.torque]
        rows.append(np.column_stack([*own, offsets]))
        sides.append(part.windup)
        owner.append(np.full(part.windup.size, k))
    return np.concatenate(rows), np.concatenate(sides), np.concatenate(owner)


def _solve(X: Real, y: Real) -> Real:
    scale = np.linalg.norm(X, axis=0)
    return np.asarray(np.linalg.lstsq(X / scale, y, rcond=None)[0] / scale)


def _means(values: Real, owner: NDArray[np.int_]) -> Real:
    return np.asarray(np.bincount(owner, weights=values) / np.bincount(owner), dtype=np.float64)


def _bootstrap(stacked: tuple[Real, Real, NDArray[np.int_]], rate: float, rng: np.random.Generator) -> Real:
    X, y, owner = stacked
    X, y = X.copy(), y.copy()
    inner = X.shape[1] - int(owner.max()) - 1
    for column in range(inner):
        X[:, column] -= _means(X[:, column], owner)[owner]
    y -= _means(y, owner)[owner]
    X = X[:, :inner]
    length = max(1, round(_BLOCK * rate))
    blocks = [slice(a, a + length) for a in range(0, y.size - length + 1, length)]
    grams = np.array([X[b].T @ X[b] for b in blocks])
    sides = np.array([X[b].T @ y[b] for b in blocks])
    scale = np.sqrt(np.diag(grams.sum(axis=0)))
    draws = []
    for _ in range(_DRAWS):
        chosen = rng.integers(0, len(blocks), len(blocks))
        gram = grams[chosen].sum(axis=0) / np.outer(scale, scale)
        draws.append(np.linalg.lstsq(gram, sides[chosen].sum(axis=0) / scale, rcond=None)[0] / scale)
    return np.array(draws)


def _half_widths(draws: Real, single: Real) -> Real:
    """Half 95 % intervals: of the bootstrap, or of the mean of single records where that is wider."""
    low, high = np.percentile(draws[:, : single.shape[1]], [2.5, 97.5], axis=0)
    half = 0.5 * (high - low)
    n = single.shape[0]
    if n < 2:
        return np.asarray(half)
    between = single.std(axis=0, ddof=1) / np.sqrt(n) * float(stats.t.ppf(0.975, n - 1))
    return np.asarray(np.maximum(half, between), dtype=np.float64)


def _inverse(compliance: float, half: float) -> Interval:
    low, high = compliance - half, compliance + half
    value = 1.0 / compliance if compliance > 0.0 else np.inf
    return Interval(value=value, low=1.0 / high if high > 0.0 else 0.0, high=1.0 / low if low > 0.0 else np.inf)
