"""What the devices would record of a run without noise."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from jointscope.sim.outside.devices import Devices
from jointscope.sim.outside.effect import Chain
from jointscope.sim.outside.layout import (
    ARM_ACCELERATION,
    ARM_ANGLE,
    ARM_RATE,
    CARRIED,
    DRIVE,
    MOTOR_ANGLE,
    MOTOR_RATE,
    RATE,
)
from jointscope.sim.outside.physics import STANDARD_GRAVITY
from jointscope.sim.outside.rig import Rig
from jointscope.sim.outside.sampling import sampled
from jointscope.sim.outside.takes import Take

Real = NDArray[np.float64]
Record = dict[str, Real]
BASELINE_TIME: Final = 0.35  # s, in which a rectified baseline follows
HALF_STEPS: Final = 4  # of the programme per stored sample


def accelerometer(run: Real, rig: Rig, devices: Devices, chain: Chain) -> Real:
    """The accelerometer's output at ``RATE`` [m/s^2 or rad/s^2], before it is sampled.

    a = r q'' + g cos q (+ what carries it), turned by the tilt towards -r q'^2 + g sin q; mount; baseline; high-pass.
    """
    lever, weight = rig.sensor_radius, STANDARD_GRAVITY if rig.vertical and not devices.angular else 0.0
    if devices.angular:
        signal = run[:, ARM_ACCELERATION].copy()
    else:
        signal = lever * run[:, ARM_ACCELERATION] + run[:, CARRIED] + weight * np.cos(run[:, ARM_ANGLE])
        if chain.tilt:
            radial = -lever * run[:, ARM_RATE] ** 2 + weight * np.sin(run[:, ARM_ANGLE])
            signal = np.cos(chain.tilt) * signal + np.sin(chain.tilt) * radial
    if chain.resonance:
        signal = _mounted(signal, chain.resonance, chain.resonance_damping)
    if chain.rectified:
        keep = np.exp(-1.0 / (RATE * BASELINE_TIME))
        signal = signal - chain.rectified * lfilter([1.0 - keep], [1.0, -keep], np.abs(signal - signal[0]))
    if chain.pickup:
        signal = signal + chain.pickup * np.gradient(run[:, DRIVE]) * RATE
    return _high_passed(signal, devices.low_cutoff) if devices.low_cutoff else signal


def _mounted(signal: Real, frequency: float, damping: float) -> Real:
    """w^2/(s^2 + 2 D w s + w^2), bilinear with its corner in place."""
    w, k = 2.0 * RATE * np.tan(np.pi * frequency / RATE), 2.0 * RATE
    over = np.array([w * w, 2.0 * w * w, w * w])
    under = np.array(
        [k * k + 2.0 * damping * w * k + w * w, 2.0 * (w * w - k * k), k * k - 2.0 * damping * w * k + w * w]
    )
    return np.asarray(lfilter(over / under[0], under / under[0], signal - signal[0]) + signal[0])


def _high_passed(signal: Real, cutoff: float) -> Real:
    """s/(s + w), bilinear with its corner in place, settled at the first sample."""
    w = np.tan(np.pi * cutoff / RATE)
    return np.asarray(
        lfilter(np.array([1.0, -1.0]) / (1.0 + w), [1.0, -(1.0 - w) / (1.0 + w)], signal - signal[0])
    )


def logged_torque(torque: Real, times: Real, rate: float, chain: Chain) -> Real:
    """The drive's torque as its log holds it at ``times`` [s]; renewed at ``chain.log_rate`` where that isn't 0."""
    if not chain.log_rate:
        return sampled(torque, rate, times)
    renewed = np.arange(0.0, torque.size / RATE, 1.0 / chain.log_rate)
    grid = np.arange(torque.size + 1) / RATE
    if chain.log_averaged:
        area = np.concatenate([[0.0], np.cumsum(torque)]) / RATE
        before = np.interp(renewed - 1.0 / chain.log_rate, grid, area)
        values = (np.interp(renewed, grid, area) - before) * chain.log_rate
        values[0] = torque[0]
    else:
        values = np.interp(renewed, grid[:-1], torque)
    places = np.floor(times * chain.log_rate + 1e-9).astype(int)
    return np.asarray(values[np.clip(places, 0, values.size - 1)])


def sensed(run: Real, take: Take, rig: Rig, devices: Devices, chain: Chain) -> Record:
    """Clean channels of one run: what is recorded, and the wind-up between two encoders beside it."""
    begin = np.arange(int(take.duration * devices.daq_rate)) / devices.daq_rate
    stamped = np.arange(int(take.duration * devices.log_rate)) / devices.log_rate
    late = (stamped - chain.delay) / (1.0 + 1e-6 * chain.ppm) + take.offset if devices.two else stamped

    def daq(signal: Real) -> Real:
        return sampled(signal, devices.daq_rate, begin)

    def log(signal: Real) -> Real:
        return sampled(signal, devices.log_rate, late)

    read = daq(accelerometer(run, rig, devices, chain)) * chain.accelerometer_gain
    found: Record = {"acceleration": np.clip(read, -chain.level, chain.level)}
    programme = take.programme[::HALF_STEPS][: len(run)]
    arm = (log if devices.arm_on_log else daq)(run[:, ARM_ANGLE])
    if take.hit:
        found["force"] = daq(programme) * chain.force_gain
        return found | {"arm": arm} if devices.arm_on_hits else found
    found["torque"] = logged_torque(run[:, DRIVE] / (rig.efficiency * rig.ratio), late, devices.log_rate, chain)
    if rig.slide is not None:
        return found | {"position": log(run[:, ARM_ANGLE])}
    motor = rig.ratio * run[:, MOTOR_ANGLE]
    motor = motor + chain.eccentricity * np.sin(motor + chain.eccentric_phase)
    found |= {"motor": log(motor), "speed": log(rig.ratio * run[:, MOTOR_RATE])}
    if devices.arm:
        on_log = devices.arm_on_log or not devices.two
        seen = log(run[:, ARM_ANGLE]) if on_log else sampled(run[:, ARM_ANGLE], devices.log_rate, stamped)
        found |= {"arm": arm, "windup": found["motor"] / rig.ratio - seen}
    return found | {"command": log(rig.ratio * programme)} if take.travels else found
