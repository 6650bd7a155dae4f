r"""The drive's speed law, identified as a nuisance from runs that recorded command, torque and motion.

    T_e = sat(K_p e + K_i \int e dt + J_f w_c' + b_f w_c + T_0),   e = w_c - w_m   [motor shaft]

T_0 is what the integrator held before the run began, one per run. The law is a property of the drive, not of the
joint: its fit uses no joint parameter wherever the motor's motion was recorded, so friction or a wrong inertia can't
bend it. Where only the torque was recorded, w_m follows from command and law through the joint's own transfer function.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, signal
from scipy.linalg import block_diag

from jointscope.errors import RefusedError
from jointscope.identification.drive_instruments import (
    Explaining,
    as_recorded,
    by_command,
    instruments,
    integral,
    law_columns,
)
from jointscope.identification.drive_law import LAW_TERMS, Drive
from jointscope.identification.drive_takes import (
    LAW_BAND,
    Take,
    away_from,
    independence,
    inner,
    log_noise,
    read_take,
)
from jointscope.models.joint import denominator
from jointscope.models.parameters import Joint
from jointscope.recordings.campaign import Campaign

Real = NDArray[np.float64]

_NEGLIGIBLE = 1e-8  # of the torque variance: what the interpolation itself leaves over
CLEAN_BAND = 15.0  # Hz, in which the command alone is asked: motions end below it
ACCOUNTS = 0.05  # of the torque's rms that a law may leave, below which it is the drive
BENT = 0.03  # of K_p, beyond which noise of the speed is what bends it


def identify_drive(campaign: Campaign, joint: Joint | None = None, *, gravity_moment: float = 0.0) -> Drive | None:
    """The speed law of ``campaign``'s drive, from its runs with a speed command and a logged torque.

    Args:
        campaign: Runs with ``role = "validate"`` are left out.
        joint: Base model; needed only where no run recorded the motor's motion.
        gravity_moment: m g r of the arm [N m], likewise.

    Returns:
        The law, or ``None`` where no run carries it or the law explains less than half of the torque's variance.
    """
    takes = [
        take
        for run in campaign.runs
        if run.role != "validate"
        for take in (read_take(campaign, run),)
        if take is not None
    ]
    measured = [take for take in takes if take.speed is not None]
    if measured:
        drive = _unbent(_credible(measured))
    elif takes and joint is not None:
        drive = _through_the_joint(takes, joint, gravity_moment, campaign)
    else:
        return None
    return drive if drive.explained > 0.5 and drive.proportional > 0.0 and drive.integral >= 0.0 else None


def _unbent(takes: Sequence[Take]) -> Drive:
    """The law, by what the command makes of the speed where the speed's noise bends it.

    Noise of the speed stands on the side of what explains: it takes K_p down, and the feed-forward in its place. What follows
    from the command alone knows nothing of it. What the law leaves is still said of the wide band.
    """
    plain = _regressed(takes)
    if plain.lacking < ACCOUNTS:
        return plain
    clean = _regressed(takes, CLEAN_BAND, by_command)
    bent = abs(clean.proportional - plain.proportional) > BENT * abs(clean.proportional)
    if not bent or clean.proportional <= 0.0 or clean.integral < 0.0:
        return plain
    terms = {name: getattr(clean, name) for name in LAW_TERMS}
    return replace(plain, **terms, standard_errors=clean.standard_errors)


def _regressed(takes: Sequence[Take], band: float = LAW_BAND, explaining: Explaining = as_recorded) -> Drive:
    """Least squares of the torque on the law, both below ``band`` [Hz]; feed-forward terms only where they are needed.

    Args:
        explaining: What of the law's columns the torque is regressed on.
    """
    blocks, targets, holds, means = [], [], [], []
    for take in takes:
        rate = take.rate
        columns = _low_passed(law_columns(take), rate, band)
        torque = _low_passed(take.torque[:, None], rate, band)[:, 0]
        known = _low_passed(instruments(take), rate, band)
        for piece in _unsaturated(take, rate):
            blocks.append(columns[piece])
            targets.append(torque[piece])
            means.append(known[piece])
            holds.append(piece.size)
    if not blocks:
        raise RefusedError(
            f"run {takes[0].run!r}: the torque never leaves its limit, so the drive's law can't be seen"
        )
    held = block_diag(*[np.ones((size, 1)) for size in holds])
    A, T = np.column_stack([np.concatenate(blocks), held]), np.concatenate(targets)
    values, errors, residual = _chosen_terms(explaining(A, np.column_stack([np.concatenate(means), held])), T)
    return Drive(
        **dict(zip(LAW_TERMS, values, strict=True)),
        torque_limit=max((take.plateau for take in takes if take.plateau is not None), default=None),
        standard_errors=errors,
        residual=residual,
        log_noise=log_noise(takes),
        explained=1.0 - residual**2 / max(float(np.var(T)), 1e-300),
        runs=tuple(take.run for take in takes),
    )


def _credible(takes: Sequence[Take]) -> list[Take]:
    """The takes without those plateaus that the drive went beyond elsewhere, or on which the law asks for no more.

    A limit cuts off what the law asks for; a constant acceleration makes a plateau on which both agree.
    """
    highest = max(float(np.max(np.abs(take.torque))) for take in takes)
    takes = [take if (take.plateau or 0.0) > 0.97 * highest else replace(take, plateau=None) for take in takes]
    if all(take.plateau is None for take in takes):
        return takes
    without = [replace(take, plateau=None) for take in takes]
    bounded, unbounded = _regressed(takes), _regressed(without)
    # were the plateau no limit, leaving it out would hardly change how well the law explains the torque
    return takes if bounded.residual < 0.5 * unbounded.residual else without


def _chosen_terms(A: Real, T: Real) -> tuple[tuple[float, ...], tuple[float, float, float, float], float]:
    """Values and standard errors of the four law terms, and the residual's RMS; smallest BIC wins."""
    holds = list(range(4, A.shape[1]))
    # neighbouring filtered samples say much the same: count what is independent, once for all candidates
    count = max(T.size * independence(T - A @ np.linalg.lstsq(A, T, rcond=1e-12)[0]), A.shape[1] + 2.0)
    best = None
    for extra in ((), (2,), (3,), (2, 3)):
        use = [0, 1, *extra, *holds]
        scale = np.linalg.norm(A[:, use], axis=0)
        scale[scale == 0.0] = 1.0
        solution, *_ = np.linalg.lstsq(A[:, use] / scale, T, rcond=1e-12)
        variance = float(np.mean((T - A[:, use] @ (solution / scale)) ** 2)) + _NEGLIGIBLE * float(np.var(T))
        bic = count * math.log(max(variance, 1e-300)) + len(use) * math.log(count)
        if best is None or bic < best[0] - 6.0:
            covariance = np.linalg.pinv((A[:, use] / scale).T @ (A[:, use] / scale)) * variance * T.size / count
            best = (bic, use, solution / scale, np.sqrt(np.diag(covariance)) / scale, math.sqrt(variance))
    assert best is not None
    _, use, solution, errors, residual = best
    values, spread = np.zeros(4), np.zeros(4)
    for place, column in enumerate(use):
        if column < 4:
            values[column], spread[column] = solution[place], errors[place]
    a, b, c, d = (float(error) for error in spread)
    return tuple(values.tolist()), (a, b, c, d), residual


def _low_passed(columns: Real, rate: float, band: float) -> Real:
    if rate <= 2.5 * band:
        return columns
    return np.asarray(signal.sosfiltfilt(signal.butter(4, band, fs=rate, output="sos"), columns, axis=0))


def _unsaturated(take: Take, rate: float) -> list[NDArray[np.intp]]:
    """Index pieces off the limit; each has an integrator offset of its own, as anti-windup may have reset it."""
    keep = np.flatnonzero(away_from(take.saturated, int(0.04 * rate)) & inner(take.times))
    pieces = np.split(keep, np.flatnonzero(np.diff(keep) > 1) + 1)
    return [piece for piece in pieces if piece.size >= 0.1 * rate]


def _through_the_joint(takes: Sequence[Take], joint: Joint, gravity_moment: float, campaign: Campaign) -> Drive:
    """K_p and K_i from command and torque alone: the closed loop's own response to command and gravity.

    With P(s) = n w_s/T_e of the joint, L = K_p + K_i/s, gravity's torque d at the arm along the commanded path and
    G_d(s) = n w_s/d: T_e = L (w_c - P T_e - G_d d).
    """
    angles = {run.id: run.arm_angle for run in campaign.runs}
    inertia = (joint.reflected_inertia + joint.load_inertia) / (joint.efficiency * joint.reduction_ratio**2)

    def residuals(logs: Real) -> Real:
        K_p, K_i = np.exp(logs)
        parts = []
        for take in takes:
            explained = _loop_torque(take, joint, gravity_moment, angles[take.run], K_p, K_i)
            keep = away_from(take.saturated, 10) & inner(take.times)
            parts.append((take.torque - explained - np.mean((take.torque - explained)[keep]))[keep])
        return np.concatenate(parts)

    starts = [np.log([inertia * 2 * math.pi * f, inertia * (2 * math.pi * f) ** 2 / 4]) for f in (3.0, 12.0, 40.0)]
    found = min(
        (optimize.least_squares(residuals, start, x_scale="jac", max_nfev=60) for start in starts),
        key=lambda result: float(result.cost),
    )
    rest = np.asarray(found.fun)
    torque = np.concatenate([take.torque - np.mean(take.torque) for take in takes])
    variance = float(np.mean(rest**2))
    covariance = np.linalg.pinv(found.jac.T @ found.jac) * variance / max(independence(rest), 1e-3)
    K_p, K_i = np.exp(found.x)
    spread = np.sqrt(np.diag(covariance)) * np.array([K_p, K_i])
    return Drive(
        proportional=float(K_p),
        integral=float(K_i),
        torque_limit=max((take.plateau for take in takes if take.plateau is not None), default=None),
        standard_errors=(float(spread[0]), float(spread[1]), 0.0, 0.0),
        residual=math.sqrt(variance),
        log_noise=log_noise(takes),
        explained=1.0 - variance / max(float(np.var(torque)), 1e-300),
        runs=tuple(take.run for take in takes),
    )


def _loop_torque(
    take: Take, joint: Joint, gravity_moment: float, arm_angle: float, K_p: float, K_i: float
) -> Real:
    n, eta = joint.reduction_ratio, joint.efficiency
    J_L, K, c, b_l = joint.load_inertia, joint.stiffness, joint.damping, joint.load_damping
    D = np.polymul([1.0, 0.0], denominator(joint))  # s D(s), as L brings 1/s
    law = np.array([K_p, K_i])
    motor = eta * n**2 * np.array([J_L, b_l + c, K])  # n w_s per T_e, times D
    closed = np.polyadd(D, np.polymul(law, motor))
    dt = 1.0 / take.rate
    path = arm_angle + integral(take.command, take.rate) / n
    pull = -gravity_moment * (np.cos(path) - math.cos(arm_angle))
    torque = _response(np.polymul(law, denominator(joint)), closed, take.command, dt)
    if gravity_moment:
        torque = torque + _response(-n * np.polymul(law, [c, K]), closed, pull, dt)
    return torque


def _response(numerator: Real, denominator: Real, u: Real, dt: float) -> Real:
    """What numerator(s)/denominator(s) makes of ``u`` from rest, exact for what is linear between samples; shape of ``u``.

    What ``scipy.signal.lsim`` gives, by recursive filters in place of its loop over samples: u_0 from the first sample on,
    and the rest, which begins at zero.
    """
    from_zero, from_step = (
        signal.cont2discrete((numerator, denominator), dt, method=method) for method in ("foh", "zoh")
    )
    later = signal.lfilter(from_zero[0].ravel(), from_zero[1], u - u[0])
    if u[0] == 0.0:
        return np.asarray(later)
    return np.asarray(later + signal.lfilter(from_step[0].ravel(), from_step[1], np.full(u.size, u[0])))
