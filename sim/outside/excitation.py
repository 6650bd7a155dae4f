"""What is put in: hits of a hammer, torque sweeps, speed programmes, each on the integrator's half steps."""

from __future__ import annotations

from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.signal import oaconvolve

from jointscope.sim.outside.layout import STEP
from jointscope.sim.outside.rig import Rig

Real = NDArray[np.float64]
Profile = Literal["tri", "trap", "stairs", "creep", "steady", "multi"]
PROFILES: Final[tuple[Profile, ...]] = ("tri", "trap", "stairs", "creep", "steady", "multi")

STAIRS: Final = (1.0, 0.5, 0.2, 0.07, 0.02)  # of the largest speed
CREEP: Final = (0.02, 0.05, 0.12, 0.3)
SPARE: Final = 0.04  # s beyond the recording's end that are simulated too
PULSE: Final = (0.004, 0.009)  # s, the hammer's contact
SAMPLES_OF_A_PULSE: Final = 8.5  # at least, at the DAQ's rate
FASTEST_SWEEP: Final = 95.0  # Hz
SMOOTHING: Final = 0.05  # s, of a speed programme's corners


def half_steps(duration: float) -> tuple[int, Real]:
    """Steps of a run of ``duration`` [s], and the times of its half steps [s], shape (2 steps + 2,)."""
    steps = round((duration + SPARE) / STEP)
    return steps, np.asarray(np.arange(2 * steps + 2) * STEP / 2.0, dtype=np.float64)


def hit(rng: np.random.Generator, rig: Rig, swing: float, duration: float, rate: float, sign: float) -> Real:
    """Force of one hit [N] after which the arm swings by about ``swing`` [rad]; sampled at ``rate`` [Hz]."""
    _, t = half_steps(duration)
    width = max(float(rng.uniform(*PULSE)), SAMPLES_OF_A_PULSE / rate)
    x = (t - rng.uniform(0.12, 0.25)) / width
    skewed = np.clip(x, 0.0, 1.0) ** rng.uniform(0.85, 1.2)
    shape = np.where((x > 0.0) & (x < 1.0), np.sin(np.pi * skewed) ** 2, 0.0)
    impulse = float(shape.sum()) * STEP / 2.0
    return np.asarray(sign * swing * rig.load_inertia * rig.own_rate / (rig.hammer_radius * impulse) * shape)


def _rise(t: Real, begin: float, width: float) -> Real:
    x = np.clip((t - begin) / width, 0.0, 1.0)
    return np.asarray(x**2 * (3.0 - 2.0 * x))


def taper(t: Real, begin: float, end: float, width: float) -> Real:
    """0 outside [begin, end], 1 inside, with smooth flanks of ``width`` [s]."""
    return np.asarray(_rise(t, begin, width) * (1.0 - _rise(t, end - width, width)))


def sweep(rng: np.random.Generator, rig: Rig, amplitude: float, duration: float) -> Real:
    """Torque of a linear or exponential sweep about the joint's frequency, at the output [N m]."""
    _, t = half_steps(duration)
    low, high = max(1.5, 0.15 * rig.own_frequency), min(2.3 * rig.own_frequency, FASTEST_SWEEP)
    length = duration - 0.2
    x = np.clip(t - 0.1, 0.0, length)
    if rng.random() < 0.5:
        turns = low * x + (high - low) * x**2 / (2.0 * length)
    else:
        growth = np.log(high / low) / length
        turns = low * (np.exp(growth * x) - 1.0) / growth
    phase = 2.0 * np.pi * turns + rng.uniform(0.0, 2.0 * np.pi)
    return np.asarray(amplitude * taper(t, 0.1, duration - 0.1, 0.25) * np.cos(phase))


def _segments(profile: Profile, speed: float) -> list[tuple[float, float]]:
    """Speeds [rad/s] with how long each is kept [s]."""
    if profile == "tri":
        return [(speed, 0.0), (-speed, 0.0)] * 4
    if profile == "trap":
        return [(speed, 0.5), (0.0, 0.15), (-speed, 0.5), (0.0, 0.15)] * 6
    if profile == "steady":
        return [(speed, 1.2), (-speed, 1.2)] * 4
    if profile == "stairs":
        return [(sign * share * speed, 0.3) for share in STAIRS for sign in (1.0, -1.0)]
    return [(sign * share * speed, 0.4) for share in CREEP for sign in (1.0, -1.0)] * 3


def motion(
    rng: np.random.Generator, profile: Profile, speed: float, acceleration: float, duration: float, sign: float
) -> Real:
    """Speed programme [rad/s] that reaches ``speed`` by ``acceleration`` [rad/s^2], first towards ``sign``."""
    _, t = half_steps(duration)
    if profile == "multi":
        lines = [
            (0.5, rng.uniform(0.3, 0.6), 0.0),
            (0.3, rng.uniform(0.9, 1.5), rng.uniform(0.0, 6.0)),
            (0.2, rng.uniform(2.0, 3.5), rng.uniform(0.0, 6.0)),
        ]
        waves = sum(speed * share * np.sin(2.0 * np.pi * f * t + phase) for share, f, phase in lines)
        programme = waves * taper(t, 0.1, duration - 0.15, 0.5) * sign
    else:
        programme = _ramps(t, [(sign * v, kept) for v, kept in _segments(profile, speed)], acceleration, duration)
    window = np.hanning(int(SMOOTHING / (STEP / 2.0)))
    padded = np.pad(programme, window.size, "edge")
    return np.asarray(oaconvolve(padded, window / window.sum(), "same")[window.size : -window.size])


def _ramps(t: Real, segments: list[tuple[float, float]], acceleration: float, duration: float) -> Real:
    now, v = 0.2, 0.0
    times, speeds = [0.0, now], [0.0, 0.0]
    for target, kept in segments:
        now += max(abs(target - v) / acceleration, 0.02)
        times.append(now)
        speeds.append(target)
        if kept > 0.0:
            now += kept
            times.append(now)
            speeds.append(target)
        v = target
        if now > duration - 0.6:
            break
    now += abs(v) / acceleration + 0.02
    return np.asarray(np.interp(t, [*times, now, now + 9.0], [*speeds, 0.0, 0.0]))
