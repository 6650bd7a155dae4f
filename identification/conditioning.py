"""From a run's channels to what the fit needs: torque about the joint in, and how each output feels q''.

Radii, dc offsets, AC coupling and the gravity an accelerometer feels are dealt with here, by model and not by filtering
the record: an output carries a *sensor* S(s), measured = S(s) q'', so that nothing is taken from or added to its noise.

    tangential acceleration on an arm   S = r - g sin(q0)/s^2   (specific force r q'' + g cos q, linearised at q0)
    angular acceleration, acceleration  S = 1
    angular velocity, velocity          S = 1/s
    angle, position                     S = 1/s^2
    AC coupling                         S times s/(s + 2 pi low_cutoff)
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jointscope.models.parameters import STANDARD_GRAVITY
from jointscope.recordings.campaign import Channel, Nameplate, Run, Signal

Real = NDArray[np.float64]
Complex = NDArray[np.complexfloating[Any, Any]]

_ORDER = {
    "linear-acceleration": 2, "angular-acceleration": 2, "acceleration": 2, "angular-velocity": 1, "velocity": 1,
    "angle": 0, "position": 0,
}  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False)
class Excitation:
    """The external input of a run.

    Attributes:
        signal: Where it was recorded.
        lever: Factor from the channel's SI value to the generalised force about the joint [m], or 1.
        unit: Of the generalised force: ``N m``, ``N``, or ``input unit`` where the channel's scale is unknown.
        low_cutoff: Of its AC coupling [Hz]; 0 where it is dc.
    """

    signal: Signal
    lever: float
    unit: str
    low_cutoff: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Response:
    """One output of a run.

    Attributes:
        signal: Where it was recorded.
        name: Column, for messages.
        order: Time derivatives of q that it measures: 2, 1 or 0.
        lever: Factor from q's derivative to the channel [m], or 1.
        gravity: g sin(q0) where an accelerometer feels the arm tilt [m/s^2], else 0.
        low_cutoff: Of its AC coupling [Hz]; 0 where it is dc.
    """

    signal: Signal
    name: str
    order: int
    lever: float
    gravity: float
    low_cutoff: float

    def sensor(self, s: Complex) -> Complex:
        """S(s) = measured/q'' at ``s`` [rad/s], same shape."""
        transfer = self.lever * s ** (self.order - 2) - self.gravity / s**2
        if self.low_cutoff:
            transfer = transfer * s / (s + 2.0 * math.pi * self.low_cutoff)
        return np.asarray(transfer, dtype=np.complex128)


def _low_cutoff(channel: Channel) -> float:
    return (channel.low_cutoff or 0.0) if channel.coupling == "ac" else 0.0


def hammer_excitation(run: Run, rig: Nameplate) -> Excitation | None:
    """The force or torque that acts on the arm (or load); ``None`` where none was recorded."""
    inputs = [
        signal
        for signal in run.select(role="input")
        if signal.channel.quantity in ("force", "torque") and signal.channel.location in ("arm", "load")
    ]
    if not inputs:
        return None
    channel = inputs[0].channel
    turning = rig.motion == "rotational"
    lever = (channel.radius or 1.0) if channel.quantity == "force" and turning else 1.0
    unit = ("N m" if turning else "N") if channel.calibrated else "input unit"
    return Excitation(signal=inputs[0], lever=lever, unit=unit, low_cutoff=_low_cutoff(channel))


def arm_responses(run: Run, rig: Nameplate) -> list[Response]:
    """The outputs that move with the arm (or load), in file order; radial accelerometers are left out."""
    found = []
    gravity = STANDARD_GRAVITY * math.sin(run.arm_angle) if rig.plane == "vertical" else 0.0
    for signal in run.select(role="output"):
        channel = signal.channel
        if (
            channel.location not in ("arm", "load")
            or channel.quantity not in _ORDER
            or channel.direction == "radial"
        ):
            continue
        linear = channel.quantity == "linear-acceleration" and rig.motion == "rotational"
        found.append(
            Response(
                signal=signal,
                name=channel.column,
                order=_ORDER[channel.quantity],
                lever=(channel.radius or 1.0) if linear else 1.0,
                gravity=gravity if linear else 0.0,
                low_cutoff=_low_cutoff(channel),
            )
        )
    return found


def gravity_stiffness(run: Run, rig: Nameplate) -> float | None:
    """K_g = -m g r sin(q0) [N m/rad], to be taken off a2/b1; 0 in the horizontal plane; ``None`` where it is unknown."""
    if rig.motion == "translational" or rig.plane == "horizontal":
        return 0.0
    if rig.arm_mass is None or rig.arm_com_radius is None:
        return 0.0 if abs(math.sin(run.arm_angle)) < 1e-9 else None
    return -rig.arm_mass * STANDARD_GRAVITY * rig.arm_com_radius * math.sin(run.arm_angle)


def without_high_pass(force: Real, rate: float, low_cutoff: float) -> Real:
    """A hammer's force, shape (n,), as it was before its AC coupling: u + w_c integral of u.

    The dc offset, which the integral would turn into a ramp, is the one that leaves the record flat away from the hit.
    """
    corner = 2.0 * np.pi * low_cutoff / rate
    restored = force + corner * (np.cumsum(force) - 0.5 * force)
    ramp = 1.0 + corner * (np.arange(force.size) + 0.5)
    away = np.abs(np.arange(force.size) - int(np.argmax(np.abs(force - np.median(force))))) > 0.03 * rate
    if away.sum() < 16:
        return restored - float(np.median(force)) * ramp
    offset = float(ramp[away] @ restored[away] / (ramp[away] @ ramp[away]))
    return restored - offset * ramp
