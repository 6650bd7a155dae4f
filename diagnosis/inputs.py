"""What drives a run: external torque on the arm, motor torque and speed command, referred to the joint output."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from jointscope.recordings.bandlimited import Bandlimited, bandlimited
from jointscope.recordings.campaign import Nameplate, Run, Signal

Vector = NDArray[np.float64]

MOTOR_TORQUE = ("torque", "current", "voltage", "force", "phase-current")


@dataclass(frozen=True, eq=False)
class Drive:
    """One input as a function of time.

    Attributes:
        signal: Value at the joint output [N m, N, rad/s or m/s; per input unit where uncalibrated].
        device: Stream it comes from.
        factor: What one unit of the channel (SI) is at the joint output.
        calibrated: Whether the value is in SI.
        samples: As recorded, times ``factor``, shape (n,).
    """

    signal: Bandlimited
    device: int
    factor: float
    calibrated: bool
    samples: Vector


def _drive(signal: Signal, factor: float, calibrated: bool) -> Drive:
    samples = np.asarray(signal.samples, dtype=np.float64) * factor
    return Drive(
        bandlimited(samples, signal.sampling_rate, signal.stream.start),
        signal.device,
        factor,
        calibrated,
        samples,
    )


def _sum(parts: list[Drive]) -> Drive:
    if len(parts) == 1:
        return parts[0]
    first = parts[0]
    same = all(
        p.samples.size == first.samples.size
        and (p.signal.start, p.signal.rate) == (first.signal.start, first.signal.rate)
        for p in parts
    )
    times = first.signal.start + np.arange(first.samples.size) / first.signal.rate
    rows = [p.samples if same else p.signal(times) for p in parts]
    total = np.asarray(np.sum(rows, axis=0))
    return Drive(
        bandlimited(total, first.signal.rate, first.signal.start),
        first.device,
        first.factor,
        all(p.calibrated for p in parts),
        total,
    )


def _recorded(run: Run) -> list[Signal]:
    return [s for s in run.signals if s.channel.samples is not None]


def load_torque(run: Run) -> Drive | None:
    """External torque about the joint (or force on the carriage): hammer, shaker, torque on the arm."""
    parts: list[Drive] = []
    for signal in _recorded(run):
        channel = signal.channel
        if channel.role != "input":
            continue
        if channel.quantity == "force" and channel.location == "arm":
            parts.append(_drive(signal, channel.radius or 1.0, channel.calibrated))
        elif channel.quantity == "torque" and channel.location in ("arm", "load"):
            parts.append(_drive(signal, 1.0, channel.calibrated))
        elif channel.quantity == "force" and channel.location == "load":
            parts.append(_drive(signal, 1.0, channel.calibrated))
    return _sum(parts) if parts else None


def motor_torque(run: Run, rig: Nameplate) -> Drive | None:
    """n T_e before the efficiency, at the joint output [N m]; from torque, q-axis or phase currents, or voltage."""
    n = rig.reduction_ratio or 1.0
    phases = [s for s in _recorded(run) if s.channel.quantity == "phase-current"]
    for signal in _recorded(run):
        channel = signal.channel
        if channel.location != "motor" or channel.quantity not in MOTOR_TORQUE:
            continue
        if channel.quantity in ("torque", "force"):
            return _drive(signal, n if channel.side == "motor" else 1.0, channel.calibrated)
        if channel.quantity == "current":
            known = rig.torque_constant is not None and channel.calibrated
            return _drive(signal, n * (rig.torque_constant or 1.0), known)
        if channel.quantity == "voltage":
            return _drive(signal, n, False)
    if phases:
        return _from_phases(run, rig, phases)
    return None


def _from_phases(run: Run, rig: Nameplate, phases: list[Signal]) -> Drive | None:
    """Three phase currents and the motor angle give i_q with its sign; one phase alone only |i_q|, which is refused."""
    angles = run.select("angle", location="motor")
    if len(phases) < 3 or not angles or rig.pole_pairs is None:
        return None
    first = phases[0]
    times = first.times
    angle = bandlimited(angles[0].samples, angles[0].sampling_rate, angles[0].stream.start)(times)
    i_q = np.zeros(times.size)
    for k, signal in enumerate(phases[:3]):
        current = bandlimited(signal.samples, signal.sampling_rate, signal.stream.start)(times)
        i_q -= 2.0 / 3.0 * current * np.sin(rig.pole_pairs * angle - 2.0 * math.pi * k / 3.0)
    factor = (rig.reduction_ratio or 1.0) * (rig.torque_constant or 1.0)
    return Drive(
        bandlimited(i_q * factor, first.sampling_rate, first.stream.start),
        first.device,
        factor,
        rig.torque_constant is not None,
        i_q * factor,
    )


def speed_command(run: Run, rig: Nameplate) -> Drive | None:
    """Commanded speed at the joint output [rad/s]."""
    found = run.select("speed-command", role="input")
    return _drive(found[0], 1.0 / (rig.reduction_ratio or 1.0), True) if found else None
