r"""What an ideal channel reads of the motion, in SI, on its stream's clock.

An accelerometer measures specific force: tangential r q'' + g cos q, radial (outwards) -r q'^2 + g sin q, the gravity
terms on a vertical plane only. An ``ac`` one passes it through s/(s + w_c), settled before the first sample.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import interpolate
from scipy import signal as dsp

from jointscope.errors import RefusedError
from jointscope.models.parameters import STANDARD_GRAVITY
from jointscope.prediction.integrate import Motion
from jointscope.prediction.plant import Plant
from jointscope.recordings.campaign import Nameplate, Signal, gearing

Real = NDArray[np.float64]


def read_channel(
    signal: Signal, times: Real, motion: Motion, plant: Plant, rig: Nameplate, fastest_input: float
) -> Real:
    """SI values of ``signal`` at ``times`` [s], same shape.

    Args:
        signal: The declared channel.
        times: On the run's clock [s].
        motion: Of the plant.
        plant: Its equations of motion (forces are read from them).
        rig: Nameplate: plane, pole pairs, torque constant.
        fastest_input: Highest rate among the inputs [Hz]; a slower channel is band-limited to its own half rate.

    Raises:
        RefusedError: The base model has no such quantity.
    """
    values = _at_steps(signal, motion, plant, rig)
    if signal.sampling_rate < 0.9 * fastest_input:
        values = _band_limited_to(values, motion.rate, signal.sampling_rate)
    return np.asarray(interpolate.make_interp_spline(motion.times, values, k=5)(times), dtype=np.float64)


def _at_steps(signal: Signal, motion: Motion, plant: Plant, rig: Nameplate) -> Real:
    channel = signal.channel
    quantity, at_motor = channel.quantity, channel.location == "motor"
    n, geared = plant.ratio, gearing(quantity, channel.location, plant.ratio)
    if quantity == "linear-acceleration":
        vertical: Literal[0, 1] = 1 if rig.plane == "vertical" and rig.motion == "rotational" else 0
        radius = channel.radius if channel.radius is not None else 1.0
        values = accelerometer(motion, radius, channel.direction, vertical * STANDARD_GRAVITY)
        return ac_coupled(values, motion.rate, channel.low_cutoff or 0.0) if channel.coupling == "ac" else values
    if quantity in ("angle", "position"):
        return np.asarray(geared * motion.motor_angle if at_motor else motion.angle)
    if quantity in ("angular-velocity", "velocity"):
        return np.asarray(geared * motion.motor_speed if at_motor else motion.speed)
    if quantity in ("angular-acceleration", "acceleration"):
        values = geared * motion.motor_acceleration if at_motor else motion.acceleration
        return ac_coupled(values, motion.rate, channel.low_cutoff or 0.0) if channel.coupling == "ac" else values
    if quantity in ("torque", "force") and not at_motor:
        lever = channel.radius if quantity == "force" and channel.radius is not None else 1.0
        return external_torque(motion, plant) / lever
    if quantity == "torque":
        torque = shaft_torque(motion, plant)
        return torque * n if channel.side == "output" else torque
    if quantity in ("current", "phase-current"):
        current = shaft_torque(motion, plant) / (rig.torque_constant or 1.0)
        return current if quantity == "current" else _phase(signal, current, motion, n, rig)
    raise RefusedError(
        f"{signal.stream.file}: {channel.column!r} is a {quantity}, which the base model does not predict"
    )


def accelerometer(
    motion: Motion, radius: float, direction: Literal["tangential", "radial"], gravity: float
) -> Real:
    """Specific force [m/s^2] at ``radius`` [m] along ``direction``, shape (n,)."""
    if direction == "tangential":
        return np.asarray(radius * motion.acceleration + gravity * np.cos(motion.angle))
    return np.asarray(-radius * motion.speed**2 + gravity * np.sin(motion.angle))


def ac_coupled(values: Real, rate: float, low_cutoff: float) -> Real:
    """``values`` through s/(s + w_c), w_c = 2 pi ``low_cutoff`` [Hz], settled at the first value; same shape."""
    if low_cutoff <= 0.0:
        return np.asarray(values - values[0], dtype=np.float64)
    b, a = dsp.bilinear([1.0, 0.0], [1.0, 2.0 * math.pi * low_cutoff], rate)
    return np.asarray(dsp.lfilter(b, a, values - values[0]))


def external_torque(motion: Motion, plant: Plant) -> Real:
    """T_ext on the load that its motion needs [N m], shape (n,) (inverse dynamics)."""
    inertial = plant.load_inertia * motion.acceleration + plant.load_damping * motion.speed
    drive = plant.gain * motion.torque if plant.motor == "rigid" else _spring_torque(motion, plant)
    return np.asarray(inertial - drive - plant.gravity_torque(motion.angle))


def shaft_torque(motion: Motion, plant: Plant) -> Real:
    """T_e [N m, motor shaft], shape (n,): as it acted, or what a prescribed motion needs."""
    if plant.motor == "moves":
        inertial = plant.motor_inertia * motion.motor_acceleration + plant.motor_damping * motion.motor_speed
        return np.asarray((inertial + _spring_torque(motion, plant)) / plant.gain)
    if plant.motor == "rigid" and plant.load_moves:
        inertial = plant.load_inertia * motion.acceleration + plant.load_damping * motion.speed
        return np.asarray((inertial - plant.gravity_torque(motion.angle)) / plant.gain)
    return motion.torque


def _spring_torque(motion: Motion, plant: Plant) -> Real:
    twist = motion.motor_angle - motion.angle
    return plant.stiffness * twist + plant.damping * (motion.motor_speed - motion.speed)


def _phase(signal: Signal, current: Real, motion: Motion, n: float, rig: Nameplate) -> Real:
    phases = [channel for channel in signal.stream.channels if channel.quantity == "phase-current"]
    k = next(place for place, channel in enumerate(phases) if channel is signal.channel)
    electrical = (rig.pole_pairs or 1) * n * motion.motor_angle
    return np.asarray(-current * np.sin(electrical - 2.0 * math.pi * k / 3.0))


def _band_limited_to(values: Real, rate: float, slower: float) -> Real:
    """Zero-phase low-pass at 0.45 times the slower rate, so that what the slow device can't hold does not fold into it."""
    reach = int(min(16.0 * rate / slower, (values.size - 1) // 2))
    kernel = np.asarray(dsp.firwin(2 * reach + 1, 0.45 * slower, fs=rate, window=("kaiser", 6.0)))
    padded = np.concatenate(
        [2.0 * values[0] - values[reach:0:-1], values, 2.0 * values[-1] - values[-2 : -reach - 2 : -1]]
    )
    return np.asarray(dsp.oaconvolve(padded, kernel, mode="valid"))
