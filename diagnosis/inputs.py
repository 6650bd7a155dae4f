"""What drives a run: external torque on the arm, motor torque and speed command, referred to the joint output."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.answered import answered
from jointscope.diagnosis.contact import contact_only, resting_noise
from jointscope.diagnosis.input_estimate import estimated_input
from jointscope.diagnosis.input_noise import log_noise
from jointscope.errors import RefusedError
from jointscope.recordings.bandlimited import Bandlimited, bandlimited
from jointscope.recordings.campaign import Nameplate, Run, Signal
from jointscope.recordings.held_log import common_hold
from jointscope.recordings.motor_torque import motor_torque as recorded_torque

Vector = NDArray[np.float64]

ALIKE = (
    1.5  # times the noise of a device's quietest experiment: the most that any log has, if the arm answers to more
)


@dataclass(frozen=True, eq=False)
class Drive:
    """One input as a function of time.

    Attributes:
        signal: Value at the joint output [N m, N, rad/s or m/s; per input unit where uncalibrated].
        device: Stream it comes from.
        factor: What one unit of the channel (SI) is at the joint output.
        calibrated: Whether the value is in SI.
        samples: What the log most likely stands for (``input_estimate``; of a hit, its contacts), times ``factor``,
            shape (n,).
        noise: Standard deviation of the white noise that was in it [as ``samples``]; a hit's contacts still hold it.
        held: Rate of its updates [Hz] where its values are seen to repeat themselves; 0 elsewhere.
    """

    signal: Bandlimited
    device: int
    factor: float
    calibrated: bool
    samples: Vector
    noise: float = 0.0
    held: float = 0.0


def without_noise(drive: Drive, log: Log | None = None) -> Drive:
    """The same torque as its log most likely stands for; what ``log`` says is read off it where it is not given."""
    rate = drive.signal.rate
    log = log or Log(log_noise(drive.samples, rate))
    samples = estimated_input(drive.samples, rate, log.noise)
    signal = bandlimited(samples, rate, drive.signal.start)
    return replace(drive, signal=signal, samples=samples, noise=log.noise, held=log.held)


@dataclass(frozen=True)
class Log:
    """What the torque logs of a device say of themselves.

    Attributes:
        noise: Of the run's log [N m at the output].
        held: As in :class:`Drive`.
    """

    noise: float
    held: float = 0.0


def torque_logs(runs: Sequence[Run], rig: Nameplate) -> list[Log | None]:
    """Noise and hold of each run's torque log, by all runs of its device; ``None`` where there is no log.

    A device is as noisy in one experiment as in another. What is more in the quietest windows of one is torque, unless the
    arm does not answer to it.
    """
    drives = [motor_torque(run, rig) for run in runs]
    keys = [(-1, 0.0) if drive is None else (drive.device, drive.signal.rate) for drive in drives]
    logs: list[Log | None] = [None] * len(drives)
    for key in dict.fromkeys(keys):
        members = [(i, drive) for i, (drive, own) in enumerate(zip(drives, keys, strict=True)) if own == key]
        device = [(i, drive) for i, drive in members if drive is not None]
        hold = common_hold([drive.samples for _, drive in device], key[1])
        levels: dict[str, dict[int, float]] = {}
        for i, drive in device:
            level = log_noise(drive.samples, key[1]) if hold is None else hold.noise
            levels.setdefault(runs[i].experiment, {})[i] = level
        most = ALIKE * min((float(np.median([*v.values()])) for v in levels.values()), default=0.0)
        for own in levels.values():
            louder = [(runs[i], drive, own[i]) for i, drive in device if own.get(i, 0.0) > most]
            unheard = louder != [] and answered(louder) is False
            for i, level in own.items():
                logs[i] = Log(level if unheard else min(level, most), 0.0 if hold is None else hold.rate)
    return logs


def _drive(signal: Signal, factor: float, calibrated: bool, *, impact: bool = False) -> Drive:
    samples = np.asarray(signal.samples, dtype=np.float64) * factor
    noise = 0.0
    if impact:
        recorded, samples = samples, contact_only(samples, signal.sampling_rate)
        noise = 0.0 if samples is recorded else resting_noise(recorded)
    return Drive(
        bandlimited(samples, signal.sampling_rate, signal.stream.start),
        signal.device,
        factor,
        calibrated,
        samples,
        noise,
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
            parts.append(
                _drive(signal, channel.radius or 1.0, channel.calibrated, impact=run.experiment == "hammer")
            )
        elif channel.quantity == "torque" and channel.location in ("arm", "load"):
            parts.append(_drive(signal, 1.0, channel.calibrated))
        elif channel.quantity == "force" and channel.location == "load":
            parts.append(_drive(signal, 1.0, channel.calibrated, impact=run.experiment == "hammer"))
    return _sum(parts) if parts else None


def motor_torque(run: Run, rig: Nameplate) -> Drive | None:
    """n T_e before the efficiency, at the joint output [N m]; per ampere, volt or unit where its scale is unknown.

    A torque is preferred to a current, a current to a voltage (a scaled torque: the back-EMF is viscous damping, which
    the fit absorbs). Where only |T_e| is known there is no torque to drive a model with.
    """
    n = rig.reduction_ratio or 1.0
    forces = run.select("force", location="motor")
    if forces:
        return _drive(forces[0], 1.0, forces[0].channel.calibrated)
    try:
        found = recorded_torque(run, rig)
    except RefusedError:
        found = None
    if found is not None and found.signed:
        source = found.source
        samples = np.asarray(found.values, dtype=np.float64) * n
        size = float(np.max(np.abs(source.samples))) or 1.0
        factor = float(np.max(np.abs(samples))) / size or n
        signal = bandlimited(samples, source.sampling_rate, source.stream.start)
        return Drive(signal, source.device, factor, found.unit == "N m", samples)
    voltages = run.select("voltage", location="motor")
    return _drive(voltages[0], n, voltages[0].channel.scale is not None) if voltages else None


def speed_command(run: Run, rig: Nameplate) -> Drive | None:
    """Commanded speed at the joint output [rad/s]."""
    found = run.select("speed-command", role="input")
    return _drive(found[0], 1.0 / (rig.reduction_ratio or 1.0), True) if found else None
