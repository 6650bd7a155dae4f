"""What each run says about the drive: command, torque and the motor's speed on one clock, and where the torque is limited."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from jointscope.recordings.bandlimited import bandlimited
from jointscope.recordings.campaign import Campaign, Run, Signal
from jointscope.recordings.motor_torque import motor_torque

Real = NDArray[np.float64]

LAW_BAND = 60.0  # Hz: command and encoder agree with the logged torque below this; their noise lies above
_MARGIN = 0.05  # s cut off either end, where the filters have one-sided neighbours


@dataclass(frozen=True, eq=False)
class Take:
    """One run's law data on the torque's clock; arrays of shape (n,)."""

    run: str
    times: Real
    torque: Real
    command: Real
    command_rate: Real
    speed: Real | None  # motor shaft [rad/s]
    plateau: float | None  # level that looks like a torque limit [N m]

    @property
    def rate(self) -> float:
        """Of the torque's log [Hz]."""
        return float((self.times.size - 1) / (self.times[-1] - self.times[0]))

    @property
    def saturated(self) -> NDArray[np.bool_]:
        """Where the torque stands on its plateau, shape (n,)."""
        if self.plateau is None:
            return np.zeros(self.times.size, dtype=np.bool_)
        return np.asarray(np.abs(self.torque) > 0.99 * self.plateau, dtype=np.bool_)


def read_take(campaign: Campaign, run: Run) -> Take | None:
    """The run's law data, or ``None`` where it has no speed command, no signed torque, or too little of both together."""
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
    return Take(
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
        (run.select("velocity", location="motor"), 0, ratio),
        (run.select("angle", location="motor"), 1, 1.0),
        (run.select("position", location="motor"), 1, ratio),
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
    if rate <= 4.0 * LAW_BAND:
        return samples
    sections = signal.butter(4, 2.0 * LAW_BAND, fs=rate, output="sos")
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


def away_from(bad: NDArray[np.bool_], reach: int) -> NDArray[np.bool_]:
    """Where no sample within ``reach`` is ``bad``, shape (n,)."""
    near = np.convolve(bad.astype(float), np.ones(2 * reach + 1), mode="same")
    far: NDArray[np.bool_] = np.asarray(near < 0.5)
    return far


def inner(times: Real) -> NDArray[np.bool_]:
    """Where both of a filter's sides lie within ``times`` [s], shape (n,)."""
    inner: NDArray[np.bool_] = (times > times[0] + _MARGIN) & (times < times[-1] - _MARGIN)
    return inner


def log_noise(takes: Sequence[Take]) -> float:
    """RMS below 60 Hz of noise as white as the logs are near half their rate (median of their spectra there) [N m]."""
    powers = []
    for take in takes:
        rate = take.rate
        frequency, density = signal.welch(take.torque, rate, nperseg=min(256, take.times.size), detrend="linear")
        # an anti-alias filter empties the top of the band, the drive's own content fills the bottom
        quiet = (frequency > 0.3 * rate) & (frequency < 0.4 * rate)
        powers.append(
            float(np.median(density[quiet])) / 0.7 * min(LAW_BAND, 0.5 * rate)
        )  # median of chi^2_2 is 0.7
    return math.sqrt(float(np.mean(powers)))


def independence(rest: Real) -> float:
    """Independent samples per sample, from the residual's correlation over one lag (first-order process)."""
    power = float(np.dot(rest, rest))
    if power == 0.0:
        return 1.0
    rho = float(np.clip(np.dot(rest[1:], rest[:-1]) / power, 0.0, 0.999))
    return (1.0 - rho) / (1.0 + rho)
