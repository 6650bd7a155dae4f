r"""The drive's speed law, identified as a nuisance from runs that recorded command, torque and motion.

    T_e = sat(K_p e + K_i \int e dt + J_f w_c' + b_f w_c + T_0),   e = w_c - w_m   [motor shaft]

T_0 is what the integrator held before the run began, one per run. The law is a property of the drive, not of the
joint: its fit uses no joint parameter wherever the motor's motion was recorded, so friction or a wrong inertia can't
bend it. Where only the torque was recorded, w_m follows from command and law through the joint's own transfer function.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, signal
from scipy.linalg import block_diag

from jointscope.errors import InputError, RefusedError
from jointscope.models.joint import denominator
from jointscope.models.parameters import Joint
from jointscope.recordings.bandlimited import bandlimited
from jointscope.recordings.campaign import Campaign, Run, Signal
from jointscope.recordings.motor_torque import motor_torque

Real = NDArray[np.float64]

_NAMES = ("proportional", "integral", "acceleration_feedforward", "velocity_feedforward")
_FILTER = 60.0  # Hz: command and encoder agree with the logged torque below this; their noise lies above
_NEGLIGIBLE = 1e-8  # of the torque variance: what the interpolation itself leaves over
_MARGIN = 0.05  # s cut off either end, where the filters have one-sided neighbours


@dataclass(frozen=True, kw_only=True)
class Drive:
    """A PI speed law with feed-forward and a torque limit, all on the motor shaft.

    Attributes:
        proportional: K_p [N m s/rad].
        integral: K_i [N m/rad].
        acceleration_feedforward: J_f [kg m^2].
        velocity_feedforward: b_f [N m s/rad].
        torque_limit: [N m]; ``None`` where no run reached it.
        standard_errors: Of the first four, in that order; 0 for a term that the runs do not need.
        residual: RMS of logged minus explained torque below 60 Hz [N m].
        log_noise: RMS of the log's own noise in that band, from what it holds near half its rate [N m].
        explained: 1 - residual variance over torque variance [-].
        runs: Ids of the runs used.
    """

    proportional: float
    integral: float
    acceleration_feedforward: float = 0.0
    velocity_feedforward: float = 0.0
    torque_limit: float | None = None
    standard_errors: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    residual: float = 0.0
    log_noise: float = 0.0
    explained: float = 1.0
    runs: tuple[str, ...] = ()

    @property
    def unexplained(self) -> float:
        """RMS of the torque that neither the law nor the log's noise accounts for [N m]."""
        return math.sqrt(max(self.residual**2 - 1.5 * self.log_noise**2, 0.0))

    def to_json(self) -> dict[str, Any]:
        """As ``model.json`` keeps it under ``drive``."""
        units = ("N m s/rad", "N m/rad", "kg m^2", "N m s/rad")
        entries = {
            name: {
                "value": getattr(self, name),
                "unit": unit,
                "interval95": [getattr(self, name) - 1.96 * error, getattr(self, name) + 1.96 * error],
            }
            for name, unit, error in zip(_NAMES, units, self.standard_errors, strict=True)
        }
        limit = None if self.torque_limit is None else {"value": self.torque_limit, "unit": "N m"}
        return {
            "law": "pi-speed",
            **entries,
            "torque_limit": limit,
            "residual": {"value": self.residual, "unit": "N m"},
            "log_noise": {"value": self.log_noise, "unit": "N m"},
            "explained": self.explained,
            "runs": list(self.runs),
        }


def drive_from_json(content: Mapping[str, Any], file: str = "model.json") -> Drive:
    """Read what ``Drive.to_json`` wrote.

    Raises:
        InputError: A key is missing or not a number.
    """
    try:
        limit = content.get("torque_limit")
        widths = [content[name]["interval95"][1] - content[name]["value"] for name in _NAMES]
        return Drive(
            **{name: float(content[name]["value"]) for name in _NAMES},
            torque_limit=None if limit is None else float(limit["value"]),
            standard_errors=tuple(float(width) / 1.96 for width in widths),  # type: ignore[arg-type]
            residual=float(content["residual"]["value"]),
            log_noise=float(content["log_noise"]["value"]),
            explained=float(content["explained"]),
            runs=tuple(content["runs"]),
        )
    except (KeyError, TypeError, ValueError, IndexError) as problem:
        raise InputError(file, "drive", f"can't be read: {problem!r}") from None


@dataclass(frozen=True, eq=False)
class _Take:
    """One run's law data on the torque's clock; arrays of shape (n,)."""

    run: str
    times: Real
    torque: Real
    command: Real
    command_rate: Real
    speed: Real | None  # motor shaft [rad/s]
    plateau: float | None  # level that looks like a torque limit [N m]

    @property
    def saturated(self) -> NDArray[np.bool_]:
        """Where the torque stands on its plateau, shape (n,)."""
        if self.plateau is None:
            return np.zeros(self.times.size, dtype=np.bool_)
        return np.asarray(np.abs(self.torque) > 0.99 * self.plateau, dtype=np.bool_)


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
        for take in (_take(campaign, run),)
        if take is not None
    ]
    measured = [take for take in takes if take.speed is not None]
    if measured:
        drive = _regressed(_credible(measured))
    elif takes and joint is not None:
        drive = _through_the_joint(takes, joint, gravity_moment, campaign)
    else:
        return None
    return drive if drive.explained > 0.5 and drive.proportional > 0.0 and drive.integral >= 0.0 else None


def _take(campaign: Campaign, run: Run) -> _Take | None:
    commands = run.select("speed-command")
    if not commands or run.brake:
        return None
    log = motor_torque(run, campaign.rig)
    if log is None or not log.signed:
        return None
    values = log.values
    command = bandlimited(commands[0].samples, commands[0].sampling_rate, commands[0].stream.start)
    inside = (log.times >= command.start) & (log.times <= command.end)
    speed = _motor_speed(campaign, run)
    if speed is not None:
        inside &= (log.times >= speed[0]) & (log.times <= speed[1])
    if np.count_nonzero(inside) < 64:
        return None
    t = log.times[inside]
    return _Take(
        run=run.id,
        times=t,
        torque=values[inside],
        command=command(t),
        command_rate=command(t, 1),
        speed=None if speed is None else speed[2](t, speed[3]) * speed[4],
        plateau=_limit(values[inside]),
    )


def _motor_speed(campaign: Campaign, run: Run) -> tuple[float, float, Any, int, float] | None:
    """(first time, last time, band-limited record, derivative to take, factor to the motor shaft)."""
    ratio = campaign.rig.reduction_ratio or 1.0
    choices: Sequence[tuple[tuple[Signal, ...], int, float]] = (
        (run.select("angular-velocity", location="motor"), 0, 1.0),
        (run.select("velocity", location="motor"), 0, 1.0),
        (run.select("angle", location="motor"), 1, 1.0),
        (run.select("position", location="motor"), 1, 1.0),
        (run.select("angular-velocity", location="arm"), 0, ratio),
        (run.select("angle", location="arm"), 1, ratio),
    )
    for signals, derivative, factor in choices:
        if signals and campaign.rig.topology != "arm":
            record = signals[0]
            values = _smoothed(record.samples, record.sampling_rate) if derivative else record.samples
            curve = bandlimited(values, record.sampling_rate, record.stream.start)
            return curve.start, curve.end, curve, derivative, factor
    return None


def _smoothed(samples: Real, rate: float) -> Real:
    """Zero-phase low-pass, so that an encoder's steps do not become torque-sized noise when differentiated."""
    if rate <= 4.0 * _FILTER:
        return samples
    sections = signal.butter(4, 2.0 * _FILTER, fs=rate, output="sos")
    offset = samples - samples[0]
    return np.asarray(samples[0] + signal.sosfiltfilt(sections, offset), dtype=np.float64)


def _limit(torque: Real) -> float | None:
    """The torque limit: a level that the log runs into, stays on for at least 5 samples and is its largest; else ``None``.

    A smooth summit lingers near its top too, but its slope dies out before; a limit is met at full slope.
    """
    size = np.abs(torque)
    noise = 1.4826 * float(np.median(np.abs(np.diff(torque, 2)))) / math.sqrt(6.0)
    width = max(0.002 * float(size.max()), 3.0 * noise)
    if width > 0.1 * float(size.max()):
        return None  # nothing but noise at its top
    near = size > size.max() - 2.0 * width
    edges = np.flatnonzero(np.diff(np.concatenate([[False], near, [False]]).astype(int)))
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        half = 0.5 * (last - first)
        steps = [abs(size[at] - size[at - 2]) / 2.0 for at in (first, min(last + 1, size.size - 1)) if at >= 2]
        if last - first >= 5 and max(steps, default=0.0) > 4.0 * (2.0 * 2.0 * width / half):
            return float(np.median(size[first:last]))
    return None


def _regressed(takes: Sequence[_Take]) -> Drive:
    """Least squares of the filtered torque on the filtered law; feed-forward terms only where they are needed."""
    blocks, targets, holds = [], [], []
    for take in takes:
        assert take.speed is not None
        rate = (take.times.size - 1) / (take.times[-1] - take.times[0])
        e = take.command - take.speed
        integral = np.concatenate([[0.0], np.cumsum(0.5 * (e[1:] + e[:-1]))]) / rate
        columns = _low_passed(np.column_stack([e, integral, take.command_rate, take.command]), rate)
        torque = _low_passed(take.torque[:, None], rate)[:, 0]
        for piece in _unsaturated(take, rate):
            blocks.append(columns[piece])
            targets.append(torque[piece])
            holds.append(piece.size)
    if not blocks:
        raise RefusedError(
            f"run {takes[0].run!r}: the torque never leaves its limit, so the drive's law can't be seen"
        )
    held = block_diag(*[np.ones((size, 1)) for size in holds])
    A, T = np.column_stack([np.concatenate(blocks), held]), np.concatenate(targets)
    values, errors, residual = _chosen_terms(A, T)
    return Drive(
        **dict(zip(_NAMES, values, strict=True)),
        torque_limit=max((take.plateau for take in takes if take.plateau is not None), default=None),
        standard_errors=errors,
        residual=residual,
        log_noise=_log_noise(takes),
        explained=1.0 - residual**2 / max(float(np.var(T)), 1e-300),
        runs=tuple(take.run for take in takes),
    )


def _credible(takes: Sequence[_Take]) -> list[_Take]:
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
    count = max(T.size * _independence(T - A @ np.linalg.lstsq(A, T, rcond=1e-12)[0]), A.shape[1] + 2.0)
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


def _log_noise(takes: Sequence[_Take]) -> float:
    """RMS below 60 Hz of noise as white as the logs are near half their rate (median of their spectra there) [N m]."""
    powers = []
    for take in takes:
        rate = (take.times.size - 1) / (take.times[-1] - take.times[0])
        frequency, density = signal.welch(take.torque, rate, nperseg=min(256, take.times.size), detrend="linear")
        # an anti-alias filter empties the top of the band, the drive's own content fills the bottom
        quiet = (frequency > 0.3 * rate) & (frequency < 0.4 * rate)
        powers.append(
            float(np.median(density[quiet])) / 0.7 * min(_FILTER, 0.5 * rate)
        )  # median of chi^2_2 is 0.7
    return math.sqrt(float(np.mean(powers)))


def _independence(rest: Real) -> float:
    """Independent samples per sample, from the residual's correlation over one lag (first-order process)."""
    power = float(np.dot(rest, rest))
    if power == 0.0:
        return 1.0
    rho = float(np.clip(np.dot(rest[1:], rest[:-1]) / power, 0.0, 0.999))
    return (1.0 - rho) / (1.0 + rho)


def _low_passed(columns: Real, rate: float) -> Real:
    if rate <= 2.5 * _FILTER:
        return columns
    return np.asarray(signal.sosfiltfilt(signal.butter(4, _FILTER, fs=rate, output="sos"), columns, axis=0))


def _unsaturated(take: _Take, rate: float) -> list[NDArray[np.intp]]:
    """Index pieces off the limit; each has an integrator offset of its own, as anti-windup may have reset it."""
    keep = np.flatnonzero(_away_from(take.saturated, int(0.04 * rate)) & _inner(take.times))
    pieces = np.split(keep, np.flatnonzero(np.diff(keep) > 1) + 1)
    return [piece for piece in pieces if piece.size >= 0.1 * rate]


def _away_from(bad: NDArray[np.bool_], reach: int) -> NDArray[np.bool_]:
    near = np.convolve(bad.astype(float), np.ones(2 * reach + 1), mode="same")
    far: NDArray[np.bool_] = np.asarray(near < 0.5)
    return far


def _inner(times: Real) -> NDArray[np.bool_]:
    inner: NDArray[np.bool_] = (times > times[0] + _MARGIN) & (times < times[-1] - _MARGIN)
    return inner


def _through_the_joint(takes: Sequence[_Take], joint: Joint, gravity_moment: float, campaign: Campaign) -> Drive:
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
            keep = _away_from(take.saturated, 10) & _inner(take.times)
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
    covariance = np.linalg.pinv(found.jac.T @ found.jac) * variance / max(_independence(rest), 1e-3)
    K_p, K_i = np.exp(found.x)
    spread = np.sqrt(np.diag(covariance)) * np.array([K_p, K_i])
    return Drive(
        proportional=float(K_p),
        integral=float(K_i),
        torque_limit=max((take.plateau for take in takes if take.plateau is not None), default=None),
        standard_errors=(float(spread[0]), float(spread[1]), 0.0, 0.0),
        residual=math.sqrt(variance),
        log_noise=_log_noise(takes),
        explained=1.0 - variance / max(float(np.var(torque)), 1e-300),
        runs=tuple(take.run for take in takes),
    )


def _loop_torque(
    take: _Take, joint: Joint, gravity_moment: float, arm_angle: float, K_p: float, K_i: float
) -> Real:
    n, eta = joint.reduction_ratio, joint.efficiency
    J_L, K, c, b_l = joint.load_inertia, joint.stiffness, joint.damping, joint.load_damping
    D = np.polymul([1.0, 0.0], denominator(joint))  # s D(s), as L brings 1/s
    law = np.array([K_p, K_i])
    motor = eta * n**2 * np.array([J_L, b_l + c, K])  # n w_s per T_e, times D
    closed = np.polyadd(D, np.polymul(law, motor))
    dt = (take.times[-1] - take.times[0]) / (take.times.size - 1)
    t = np.arange(take.times.size) * dt
    path = arm_angle + np.concatenate([[0.0], np.cumsum(0.5 * (take.command[1:] + take.command[:-1]))]) * dt / n
    pull = -gravity_moment * (np.cos(path) - math.cos(arm_angle))
    _, from_command, _ = signal.lsim((np.polymul(law, denominator(joint)), closed), take.command, t)
    torque = np.asarray(from_command)
    if gravity_moment:
        _, from_gravity, _ = signal.lsim((-n * np.polymul(law, [c, K]), closed), pull, t)
        torque = torque + np.asarray(from_gravity)
    return torque
