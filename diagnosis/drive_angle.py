r"""The motor's angle of a motion that recorded none: the drive's speed law, read backwards from its logged torque.

    T - T_0 = K_p (e + K_v E) + K_i \int (e + K_v E) dt + J_f w_c',   e = w_c - w,   E = \int e dt
    =>  E(s) = s (T - T_0 - J_f s w_c) / (s + K_v)(K_p s + K_i),   q_m = \int w_c dt - E

all at the joint output; J_f (feed-forward) and K_v (a position loop around it) are 0 unless they are needed. The filter
is stable, knows of no friction and does not drift. The gains are those with which the acceleration of q_m, passed on by
the joint, is what the arm's accelerometers read (output error). A drive whose torque says otherwise (a limit, another
law) is refused, and its command followed as before.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, signal

from jointscope.diagnosis.assembly import BASE_INDEX
from jointscope.diagnosis.channels import ACCELERATIONS, high_pass
from jointscope.diagnosis.inputs import Drive
from jointscope.diagnosis.problem import Observed, Output, PreparedRun, Problem
from jointscope.diagnosis.resolution import TAIL
from jointscope.recordings.bandlimited import bandlimited

Vector = NDArray[np.float64]
_Heard = tuple[
    Vector, "Callable[[DriveLaw], Vector]", float
]  # an accelerometer's band, its model of a law, rate [Hz]

LOWEST, HIGHEST = 0.4, 12.0  # Hz: above an accelerometer's drift, below most joints' resonances
SLOW = 3.0  # Hz; what drives move below it stands out of an accelerometer's noise
EXPLAINED = 0.8  # of the accelerometers' variance from 0.4 to 3 Hz: the least with which a law is believed
FLOOR = (
    1e-4  # of the variance in the band: less is the joint's model's own error, and no term of a law is told by it
)
PAYS = 4.0  # times: how far J_f or K_v must bring the misfit down; a wrong joint is not told from them by less
KNOWN = 0.3  # rad at the motor, or of the lag: the largest standard error of an angle that is believed
LONG = 1.0  # s; shorter records say nothing of a slow loop
UNTOLD = 20.0  # an integral gain may be anything where nothing is slow enough to need it
STARTS_HZ = (1.5, 4.0, 12.0)  # bandwidths of speed loops
_REST = 8  # samples before the command moves: the fewest that T_0 is read from
_STILL = 1e-3  # of the largest command: below it nothing moves
_STEP = 1e-3  # of a parameter's scale
_EDGE = 0.2  # s left out at either end, where the band-pass has one side only
_PER_PERIOD = 6  # samples kept per period of the highest frequency
_LAGS = 50  # of those samples over which a misfit may be correlated
_SYSTEMATIC = np.array([0.015, 0.05, 0.0, 0.0])  # what left-out physics does to the gains: the median of 21 cases
_SCALES = np.array([0.3, 0.3, 0.1, 1.0])  # of ln K_p, ln K_i, J_f over the inertia, K_v [1/s]
_LEAST = np.array(
    [-9.0, -9.0, -10.0, 0.0]
)  # bounds of the same: 2e-5 to 3e6 of the inertia; with K_v < 0 E runs off
_MOST = np.array([15.0, 15.0, 10.0, 1e3])


@dataclass(frozen=True, eq=False)
class DriveLaw:
    """A speed loop at the joint output, as the accelerometers bear it out.

    Attributes:
        gain: K_p [N m s/rad].
        integral: K_i [N m/rad].
        ahead: J_f, torque per commanded acceleration [kg m^2].
        outer: K_v, gain of a position loop around it [1/s].
        lag: RMS of what the motor lags behind its command [rad at the motor].
        angle_error: Standard error of the motor's angle that follows, RMS over the motions [rad at the motor].
        explained: Share of the accelerometers' variance between 0.4 and 3 Hz [-].
        covariance: Of ln K_p, ln K_i, J_f and K_v, shape (4, 4).
        motions: How many it was found on.
    """

    gain: float
    integral: float
    ahead: float = 0.0
    outer: float = 0.0
    lag: float = 0.0
    angle_error: float = 0.0
    explained: float = 1.0
    covariance: NDArray[np.float64] = field(default_factory=lambda: np.zeros((4, 4)))
    motions: int = 0

    def finding(self) -> str:
        """What a user reads of it."""
        explained = f"{100.0 * self.explained:.3g} % of the accelerometers from {LOWEST} to {SLOW} Hz"
        if not self.credible:
            return (
                f"motor angle not recorded in {self.motions} motions, and no law of the drive gives it ({explained}, to "
                f"{self.angle_error:.2g} rad at the motor): the speed command is followed; record the motor's angle"
            )
        gain, integral = np.sqrt(np.diag(self.covariance))[:2]
        more = (f", feed-forward {self.ahead:.3g} kg m^2" if self.ahead else "") + (
            f", position loop {self.outer:.3g} 1/s" if self.outer else ""
        )
        return (
            f"motor angle not recorded in {self.motions} motions: taken from the drive's law, read backwards from its "
            f"torque (at the output K_p {self.gain:.4g} N m s/rad +- {100.0 * gain:.1f} %, K_i {self.integral:.4g} "
            f"N m/rad +- {100.0 * integral:.1f} %{more}; {explained}), to {self.angle_error:.2g} rad at the motor"
        )

    @property
    def credible(self) -> bool:
        return self.explained > EXPLAINED and self.angle_error < KNOWN * max(1.0, self.lag)

    def drawn(self, rng: np.random.Generator) -> DriveLaw:
        """A law as likely as this one; of a gain that the motions do not tell, within a factor of ``UNTOLD``."""
        sizes, axes = np.linalg.eigh(self.covariance)
        z = axes @ (np.sqrt(np.maximum(sizes, 0.0)) * rng.standard_normal(4))
        gain, integral = np.exp(np.clip(z[:2], -math.log(UNTOLD), math.log(UNTOLD)))
        return replace(
            self,
            gain=self.gain * float(gain),
            integral=self.integral * float(integral),
            ahead=self.ahead + float(z[2]),
            outer=max(self.outer + float(z[3]), 0.0),
        )


@dataclass(frozen=True, eq=False)
class Log:
    """One motion's torque above rest [N m] and command [rad/s] on the torque's clock, shape (n,)."""

    rate: float
    times: Vector
    torque: Vector
    command: Vector
    command_rate: Vector
    initial_angle: float

    def lag(self, law: DriveLaw) -> Vector:
        """E [rad], by the trapezoidal rule."""
        s = 2.0 * self.rate
        whole = s * law.gain + law.integral
        u = (self.torque - law.ahead * self.command_rate) / whole
        lag = signal.lfilter([1.0, 1.0], [1.0, (law.integral - s * law.gain) / whole], u)
        if law.outer > 0.0:
            lag = signal.lfilter([s, -s], [s + law.outer, law.outer - s], lag)
        return np.asarray(lag, dtype=np.float64)

    def angle(self, law: DriveLaw) -> Vector:
        """q_m at the joint output, from the arm's initial angle [rad]."""
        steps = 0.5 * (self.command[1:] + self.command[:-1]) / self.rate
        path = np.concatenate([[0.0], np.cumsum(steps)])
        return np.asarray(self.initial_angle + path - self.lag(law), dtype=np.float64)


def motion_log(motor: Drive, command: Drive, initial_angle: float) -> Log | None:
    """The log of a motion from rest; ``None`` where it holds no rest, or torque and command are of two devices."""
    if motor.device != command.device:
        return None
    times = motor.signal.start + np.arange(motor.samples.size) / motor.signal.rate
    asked = command.signal(times)
    moving = np.flatnonzero(np.abs(asked) > _STILL * float(np.max(np.abs(asked))))
    still = int(moving[0]) if moving.size else 0
    if still < _REST:
        return None
    torque = motor.samples - float(np.median(motor.samples[:still]))
    return Log(motor.signal.rate, times, torque, asked, command.signal(times, 1), initial_angle)


def followed_angle(motor: Drive, command: Drive, initial_angle: float, law: DriveLaw) -> Observed | None:
    """The angle at the output that ``law`` says of a motion, to be followed for want of a recorded one."""
    log = motion_log(motor, command, initial_angle)
    if log is None:
        return None
    path = bandlimited(log.angle(law), log.rate, float(log.times[0]))
    return Observed("motor", False, path, motor.device, commanded=True, law=law)


def drive_law(problem: Problem) -> DriveLaw | None:
    """The law by output error on the accelerometers, credible or not; ``None`` where none of them hears blind motions.

    J_f and K_v are taken in one by one while they pay.
    """
    b = {name: float(problem.base.start[i]) for name, i in BASE_INDEX.items()}
    if b["stiffness"] <= 0.0:
        return None
    top = min(HIGHEST, math.sqrt(b["stiffness"] / b["load_inertia"]) / (4.0 * math.pi))
    if top < 2.0 * LOWEST:
        return None
    logs, heard = [], []
    for run in problem.runs:
        log = _blind(run)
        if log is not None:
            logs.append(log)
            heard += [_heard(log, output, b, top) for output in run.outputs if _hears(output, top)]
    if not heard:
        return None
    total = (b["load_inertia"] + b["motor_inertia"]) / max(b["efficiency"] * b["torque_scale"], 1e-3)
    best = min((_fit(heard, _at_bandwidth(hertz), (0, 1), total) for hertz in STARTS_HZ), key=lambda fit: fit.cost)
    while len(best.free) < _SCALES.size:
        more = [term for term in (2, 3) if term not in best.free]
        trials = [_fit(heard, best.x + 0.1 * _SCALES * np.eye(4)[k], (*best.free, k), total) for k in more]
        better = min(trials, key=lambda fit: fit.cost)
        if best.cost + FLOOR < PAYS * (better.cost + FLOOR):
            break
        best = better
    ratio = problem.rig.reduction_ratio or 1.0
    lags = np.concatenate([log.lag(_law(best.x, total)) for log in logs])
    return replace(
        _law(best.x, total),
        lag=ratio * float(np.sqrt(np.mean(np.square(lags)))),
        angle_error=ratio * _angle_error(logs, best, total),
        explained=_explained(heard, _law(best.x, total)),
        covariance=_covariance(best, total),
        motions=len(logs),
    )


@dataclass(frozen=True, eq=False)
class _Fit:
    x: Vector
    free: tuple[int, ...]
    cost: float  # share of the variance, outliers counted less
    covariance: NDArray[np.float64]


def _explained(heard: Sequence[_Heard], law: DriveLaw) -> float:
    """Share of the variance of what is heard below 3 Hz."""
    left, whole = 0.0, 0.0
    for recorded, model, rate in heard:
        both = np.stack([recorded - model(law), recorded])
        if SLOW < 0.4 * rate:
            both = signal.sosfiltfilt(signal.butter(2, SLOW, fs=rate, output="sos"), both)
        rest, all_of_it = np.mean(np.square(both), axis=1)
        left, whole = left + float(rest), whole + float(all_of_it)
    return 1.0 - left / (whole + 1e-300)


def _at_bandwidth(hertz: float) -> Vector:
    """ln K_p and ln K_i per inertia, J_f over it and K_v of a plain loop as fast as this."""
    w = 2.0 * math.pi * hertz
    return np.array([math.log(w), math.log(0.5 * w * w), 0.0, 0.0])


def _law(x: Vector, total: float) -> DriveLaw:
    return DriveLaw(total * math.exp(x[0]), total * math.exp(x[1]), total * float(x[2]), float(x[3]))


def _covariance(fit: _Fit, total: float) -> NDArray[np.float64]:
    full = np.zeros((4, 4))
    full[np.ix_(fit.free, fit.free)] = fit.covariance
    units = np.array([1.0, 1.0, total, 1.0])
    return full * np.outer(units, units)


def _fit(heard: Sequence[_Heard], start: Vector, free: tuple[int, ...], total: float) -> _Fit:
    """Least squares in the parameters that are ``free``."""
    chosen = np.array(free)
    size = 0.3 * float(np.sqrt(np.mean(np.concatenate([recorded**2 for recorded, *_ in heard])))) + 1e-300

    def rest(values: Vector) -> Vector:
        x = start.copy()
        x[chosen] = values
        law = _law(x, total)
        return np.concatenate([recorded - model(law) for recorded, model, _ in heard]) / size

    bounds = (_LEAST[chosen], _MOST[chosen])
    found = optimize.least_squares(
        rest, start[chosen], x_scale=_SCALES[chosen], bounds=bounds, loss="soft_l1", max_nfev=60
    )
    x = start.copy()
    x[chosen] = found.x
    left = rest(found.x)
    return _Fit(
        x=x,
        free=free,
        cost=2.0 * 0.3**2 / left.size * float(found.cost),
        covariance=_scatter(found.jac, left) + np.diag(_SYSTEMATIC[chosen] ** 2),
    )


def _scatter(slopes: NDArray[np.float64], left: Vector) -> NDArray[np.float64]:
    """Covariance of a fit whose misfit ``left`` is no white noise (Newey and West, Econometrica 55, 703, 1987)."""
    scores = slopes * left[:, None]
    whole = scores.T @ scores
    for lag in range(1, _LAGS):
        cross = scores[lag:].T @ scores[:-lag]
        whole += (1.0 - lag / _LAGS) * (cross + cross.T)
    inverse = np.linalg.pinv(slopes.T @ slopes)
    return np.asarray(inverse @ whole @ inverse, dtype=np.float64)


def _angle_error(logs: Sequence[Log], fit: _Fit, total: float) -> float:
    """RMS over all motions of the angle's standard error [rad], by differences in the law's parameters."""
    squares, count = 0.0, 0
    for log in logs:
        lag = log.lag(_law(fit.x, total))
        steps = _STEP * _SCALES * np.eye(4)[list(fit.free)]
        slopes = np.stack([(log.lag(_law(fit.x + step, total)) - lag) / step.sum() for step in steps])
        squares += float(np.sum(slopes * (fit.covariance @ slopes)))
        count += lag.size
    return math.sqrt(squares / count)


def _blind(run: PreparedRun) -> Log | None:
    """The log of a motion that follows its command for want of an encoder; of a held-out one, ``None``."""
    observed = run.observed
    if observed is None or not observed.commanded or run.role == "validate" or run.run.initial != "rest":
        return None
    if run.motor is None or run.command is None:
        return None
    return motion_log(run.motor, run.command, run.initial_angle)


def _hears(output: Output, top: float) -> bool:
    """Whether an output is a whole record of the arm's tangential acceleration, in SI, long and fast enough."""
    if output.times.size < output.rate * LONG:
        return False
    arm = output.quantity in ACCELERATIONS and output.location != "motor" and output.direction == "tangential"
    return arm and output.calibrated and output.rate > 4.0 * top and bool(np.all(output.mask[:-TAIL]))


def _heard(log: Log, output: Output, b: dict[str, float], top: float) -> _Heard:
    """What an accelerometer says between 0.4 Hz and ``top``, a few samples per period, and its model of the law."""
    band = signal.butter(2, [LOWEST, top], "bandpass", fs=output.rate, output="sos")
    step = max(1, int(output.rate / (_PER_PERIOD * top)))
    inside = (output.times > output.times[0] + _EDGE) & (output.times < output.times[-1] - _EDGE)
    keep = np.flatnonzero(inside)[::step]
    through = signal.bilinear(
        [b["damping"], b["stiffness"]], [b["load_inertia"], b["damping"], b["stiffness"]], fs=log.rate
    )
    arm = output.radius or 1.0 if output.quantity == "linear-acceleration" else 1.0

    def band_passed(y: Vector) -> Vector:
        return np.asarray(signal.sosfiltfilt(band, y - y[0])[keep], dtype=np.float64)

    def model(law: DriveLaw) -> Vector:
        angle = log.angle(law)
        motor = np.gradient(np.gradient(angle)) * log.rate**2
        y = arm * signal.lfilter(*through, motor)
        if output.gravity:
            y = y + output.gravity * np.cos(angle)
        y = np.interp(output.times, log.times, y)
        for corner in (output.low_cutoff, output.high_pass):
            if corner is not None:
                y = high_pass(y, corner, output.rate)
        return band_passed(y)

    return band_passed(output.data), model, output.rate / step
