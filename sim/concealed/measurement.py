"""What the devices make of a motion: anti-alias filters, rates, clocks, sensor faults, and noise that isn't white.

Two devices: the DAQ (force, accelerometer, an arm encoder) and the drive's own log (torque, motor angle, command).
Both filter with linear phase and compensate it, so that a sample is the instantaneous value of the band-limited
signal. The faults that may be concealed are fields of :class:`Acquisition`, neutral by default.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Final

import numba
import numpy as np
from numpy.typing import NDArray
from scipy import signal

Real = NDArray[np.float64]

PASS: Final = 0.40  # of the device's rate: flat up to here
REACH: Final = 20  # device samples to either side of the filter's centre
_TABLE: Final = 2048  # entries per device sample
CHANNELS: Final = ("force", "acceleration", "arm", "torque", "motor", "command")


@dataclass(frozen=True, kw_only=True)
class Acquisition:
    """Faults of the recording; every default is a faultless one.

    Attributes:
        delay: The drive's log stamps late by this [s].
        ppm: Its clock runs fast by this many parts per million.
        wander: Amplitude of a slow wander of its clock [s], one period per ``wander_period`` [s].
        frame: The delay is rounded up to whole frames of this length [s]; 0 for none.
        tilt: Angle of the accelerometer's axis off tangential [rad].
        cross: Share of the radial signal that leaks in beside the tilt.
        gain: True over stated sensitivity of the accelerometer.
        gain_slope: Relative change of that gain per m/s^2 of reading.
        force_gain: The same for the force cell.
        resonance: Frequency of the accelerometer's mount [Hz]; 0 for none.
        resonance_damping: Its damping ratio.
        bandwidth: First-order limit of the accelerometer [Hz]; 0 for none.
        level: Reading at which the accelerometer clips [m/s^2]; 0 for never.
        softness: Width of the rounding before it clips, as a share of the level.
        recovery: Time constant of the offset that a clipped reading leaves behind [s]; 0 for none.
        refresh: Rate at which the torque in the log is renewed [Hz]; 0 for every sample.
        averaged: 0 the log holds the last value, 1 it holds the mean of the last frame.
        tone: Frequency of a current ripple that the log takes in unfiltered [Hz]; 0 for none.
        tone_amplitude: As a share of the largest torque.
        log_lag: First-order filter on the logged torque [s]; 0 for none.
    """

    delay: float = 0.0
    ppm: float = 0.0
    wander: float = 0.0
    wander_period: float = 7.0
    frame: float = 0.0
    tilt: float = 0.0
    cross: float = 0.0
    gain: float = 1.0
    gain_slope: float = 0.0
    force_gain: float = 1.0
    resonance: float = 0.0
    resonance_damping: float = 0.05
    bandwidth: float = 0.0
    level: float = 0.0
    softness: float = 0.0
    recovery: float = 0.0
    refresh: float = 0.0
    averaged: float = 0.0
    tone: float = 0.0
    tone_amplitude: float = 0.0
    log_lag: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Devices:
    """The lab's two devices.

    Attributes:
        daq_rate: [Hz].
        log_rate: [Hz].
        low_cutoff: High-pass of an IEPE accelerometer [Hz]; 0 for a dc sensor.
        full_scale: Of the accelerometer [m/s^2]; 16 bits over it.
        motor_counts: Encoder counts per motor turn.
        arm_counts: Encoder counts per arm turn.
        motor_encoder: Whether the motor angle is in the log.
        arm_encoder: Whether the arm angle is in the DAQ.
    """

    daq_rate: float
    log_rate: float
    low_cutoff: float
    full_scale: float
    motor_counts: float
    arm_counts: float
    motor_encoder: bool
    arm_encoder: bool


@dataclass(frozen=True, kw_only=True)
class Noise:
    """Noise of every channel; all standard deviations in the channel's SI unit.

    Attributes:
        acceleration: White part [m/s^2].
        colour: Standard deviation of an AR(1) part over that of the white part.
        pole: Its pole, at 1000 Hz.
        level: Level-dependent coloured part: standard deviation over the running level of the signal.
        force: [N].
        torque: On the motor shaft [N m].
        arm: [rad].
        outliers: Mean number of single wild readings per run.
        hit_gain: Scatter from hit to hit of true over measured force.
        hit_timing: Scatter from hit to hit of the force channel's timing [s].
    """

    acceleration: float
    colour: float
    pole: float
    level: float
    force: float
    torque: float
    arm: float
    outliers: float
    hit_gain: float
    hit_timing: float


@functools.cache
def _kernel() -> Real:
    """Kaiser-windowed sinc with its edge midway between the pass band and half the rate, by distance in samples."""
    distance = np.arange(REACH * _TABLE + 2) / _TABLE
    edge = PASS + 0.5
    window = np.i0(9.0 * np.sqrt(np.clip(1.0 - (distance / REACH) ** 2, 0.0, 1.0))) / np.i0(9.0)
    return np.asarray(np.sinc(edge * distance) * window)


@numba.njit(cache=True, nogil=True, fastmath=True)
def _resample(x: Real, h: float, times: Real, rate: float, kernel: Real, table: int, reach: int) -> Real:
    n, channels = x.shape
    out = np.zeros((times.size, channels))
    for j in range(times.size):
        centre = times[j]
        first = int(np.ceil((centre - reach / rate) / h))
        last = int(np.floor((centre + reach / rate) / h))
        total = 0.0
        for k in range(first, last + 1):
            place = abs(centre - k * h) * rate * table
            i = int(place)
            part = place - i
            weight = kernel[i] * (1.0 - part) + kernel[i + 1] * part
            total += weight
            kk = min(max(k, 0), n - 1)
            for c in range(channels):
                out[j, c] += weight * x[kk, c]
        for c in range(channels):
            out[j, c] /= total
    return out


def resample(x: Real, timestep: float, times: Real, rate: float) -> Real:
    """Read ``x`` (n, channels), on a grid of ``timestep`` [s] from t = 0, at ``times`` [s] behind an ideal filter.

    The filter is flat to 0.40 of ``rate`` [Hz]; before the first and behind the last sample the signal is held.
    """
    return np.asarray(_resample(np.ascontiguousarray(x), timestep, times, rate, _kernel(), _TABLE, REACH))


def accelerometer(proper: Real, timestep: float, devices: Devices, fault: Acquisition) -> Real:
    """The accelerometer's analogue reading [m/s^2], shape (n,), from proper acceleration (n, 2): radial, tangential."""
    radial, tangential = proper[:, 0], proper[:, 1]
    y = np.cos(fault.tilt) * tangential + (np.sin(fault.tilt) + fault.cross) * radial
    y = y * fault.gain * (1.0 + fault.gain_slope * np.abs(y - y[0]))
    if fault.resonance > 0.0:
        w = 2.0 * np.pi * fault.resonance
        y = _filtered(y, [w**2], [1.0, 2.0 * fault.resonance_damping * w, w**2], timestep)
    if fault.bandwidth > 0.0:
        w = 2.0 * np.pi * fault.bandwidth
        y = _filtered(y, [w], [1.0, w], timestep)
    if devices.low_cutoff > 0.0:
        w = 2.0 * np.pi * devices.low_cutoff
        y = _filtered(y - y[0], [1.0, 0.0], [1.0, w], timestep)
    if fault.level > 0.0:
        y = _clipped(y, timestep, fault)
    return np.asarray(np.clip(y, -devices.full_scale, devices.full_scale))


def _filtered(y: Real, above: list[float], below: list[float], timestep: float) -> Real:
    """``y`` behind the analogue filter above(s)/below(s), settled on its first value."""
    b, a = signal.bilinear(above, below, fs=1.0 / timestep)
    state = signal.lfilter_zi(b, a) * y[0]
    return np.asarray(signal.lfilter(b, a, y, zi=state)[0])


def _clipped(y: Real, timestep: float, fault: Acquisition) -> Real:
    level = fault.level
    if fault.softness > 0.0:
        p = 1.0 / fault.softness
        clipped = y / (1.0 + np.abs(y / level) ** p) ** (1.0 / p)
    else:
        clipped = np.clip(y, -level, level)
    if fault.recovery > 0.0:
        lost = y - clipped
        b, a = signal.bilinear([1.0], [fault.recovery, 1.0], fs=1.0 / timestep)
        clipped = clipped - 0.3 * signal.lfilter(b, a, lost)
    return np.asarray(clipped)


def log_times(stamps: Real, fault: Acquisition) -> Real:
    """When the drive's log really looked [s], from the times it stamped."""
    late = np.full(stamps.shape, fault.delay)
    if fault.frame > 0.0:
        late = np.ceil((stamps + late) / fault.frame - 1e-9) * fault.frame - stamps
    return np.asarray(
        stamps / (1.0 + 1e-6 * fault.ppm)
        - late
        - fault.wander * np.sin(2.0 * np.pi * stamps / fault.wander_period)
    )


def logged_torque(torque: Real, timestep: float, times: Real, rate: float, fault: Acquisition) -> Real:
    """The torque that the drive's log holds at ``times`` [N m]."""
    if fault.tone > 0.0:
        grid = np.arange(torque.size) * timestep
        torque = torque + fault.tone_amplitude * np.max(np.abs(torque - torque[0])) * np.sin(
            2.0 * np.pi * fault.tone * grid
        )
        return np.asarray(np.interp(times, grid, torque))
    if fault.log_lag > 0.0:
        torque = _filtered(torque, [1.0], [fault.log_lag, 1.0], timestep)
    if fault.refresh <= 0.0:
        return resample(torque[:, None], timestep, times, rate)[:, 0]
    frames = np.floor(times * fault.refresh + 1e-9) / fault.refresh
    if fault.averaged < 0.5:
        return np.asarray(np.interp(frames, np.arange(torque.size) * timestep, torque))
    integral = np.concatenate([[0.0], np.cumsum(torque) * timestep])
    grid = np.arange(integral.size) * timestep
    width = 1.0 / fault.refresh
    before = np.where(
        frames - width < 0.0, (frames - width) * torque[0], np.interp(frames - width, grid, integral)
    )
    return np.asarray((np.interp(frames, grid, integral) - before) / width)


def coloured(rng: np.random.Generator, n: int, pole: float) -> Real:
    """AR(1) noise of unit variance, shape (n,)."""
    white = rng.standard_normal(n + 200)
    return np.asarray(signal.lfilter([np.sqrt(1.0 - pole**2)], [1.0, -pole], white)[200:])


def running_level(y: Real, rate: float) -> Real:
    """The signal's level over about 20 ms, same unit and shape as ``y``."""
    width = max(3, round(0.02 * rate))
    smooth = np.ones(width) / width
    return np.asarray(np.sqrt(np.convolve((y - np.median(y)) ** 2, smooth, mode="same")))


def noisy(clean: dict[str, Real], devices: Devices, noise: Noise, rng: np.random.Generator) -> dict[str, Real]:
    """Add noise to a run's clean channels and put them through their converters."""
    out: dict[str, Real] = {}
    for name, y in clean.items():
        n = y.size
        if name == "acceleration":
            pole = noise.pole ** (1000.0 / devices.daq_rate)
            y = y + noise.acceleration * (rng.standard_normal(n) + noise.colour * coloured(rng, n, pole))
            y = y + noise.level * running_level(y, devices.daq_rate) * coloured(rng, n, 0.5)
            wild = rng.random(n) < noise.outliers / n
            y = y + wild * rng.choice([-1.0, 1.0], n) * noise.acceleration * rng.uniform(8.0, 25.0, n)
            y = _converted(y, devices.full_scale / 2.0**15)
        elif name == "force":
            y = _converted(y + noise.force * rng.standard_normal(n), noise.force / 8.0)
        elif name == "torque":
            y = _converted(y + noise.torque * rng.standard_normal(n), noise.torque / 8.0)
        elif name == "motor":
            y = _converted(y, 2.0 * np.pi / devices.motor_counts)
        elif name == "arm":
            y = _converted(y + noise.arm * rng.standard_normal(n), 2.0 * np.pi / devices.arm_counts)
        out[name] = y
    return out


def _converted(y: Real, step: float) -> Real:
    return np.asarray(np.round(y / step) * step)


def noise_spectrum(name: str, level: float, n: int, rate: float, devices: Devices, noise: Noise) -> Real:
    """Variance per sample and bin of the channel's noise over the bins of an rfft, shape (n // 2 + 1,).

    Args:
        name: The channel.
        level: rms of the clean signal about its middle.
        n: Number of samples.
        rate: [Hz].
        devices: For the converters' steps.
        noise: What is added.
    """
    bins = n // 2 + 1
    turn = np.exp(-2j * np.pi * np.arange(bins) / n)
    if name == "acceleration":
        pole = noise.pole ** (1000.0 / rate)
        red = (1.0 - pole**2) / np.abs(1.0 - pole * turn) ** 2
        pink = 0.75 / np.abs(1.0 - 0.5 * turn) ** 2
        step = devices.full_scale / 2.0**15
        wild = noise.outliers / n * 300.0 * noise.acceleration**2
        return np.asarray(
            noise.acceleration**2 * (1.0 + noise.colour**2 * red)
            + (noise.level * level) ** 2 * pink
            + step**2 / 12.0
            + wild
        )
    steps = {"motor": 2.0 * np.pi / devices.motor_counts, "arm": 2.0 * np.pi / devices.arm_counts}
    added = {"force": noise.force, "torque": noise.torque, "arm": noise.arm}
    variance = added.get(name, 0.0) ** 2 + steps.get(name, 0.0) ** 2 / 12.0
    return np.full(bins, max(variance, 1e-30))
