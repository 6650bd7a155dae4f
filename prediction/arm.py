r"""The multi-joint predictor: the states of all joints, stepped in the arm's own MJCF under the recorded inputs.

The joint under test is driven by its measured torque (eta n T_e on the rotor), the others are held as the run says. A
measured torque replayed open loop lets the joint drift (half a bit is enough), so the rotor is tied to the commanded
path by a spring and damper of ``ANCHOR`` Hz, far below the band that is scored. The run starts in equilibrium, so the
torque's own offset is what it takes to make the model rest.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import interpolate
from scipy import signal as dsp

from jointscope.errors import RefusedError
from jointscope.models.arm.build import DRIVE, ElasticArm, with_drive
from jointscope.models.arm.forward import Trajectory, step_arm
from jointscope.models.arm.holding import (
    HAMMER,
    TORQUE,
    HeldArm,
    HoldKind,
    Probe,
    Rest,
    drive_command,
    equilibrium,
    hold_arm,
)
from jointscope.models.arm.linear import joint_values
from jointscope.models.arm.reference import arm_reference
from jointscope.models.arm.table import Payload
from jointscope.prediction.currents import torque_from_currents
from jointscope.prediction.sensors import ac_coupled
from jointscope.recordings.bandlimited import resampled
from jointscope.recordings.campaign import Nameplate, Run, Signal

Real = NDArray[np.float64]

ANCHOR = 0.2  # Hz
TIMESTEP = 1e-4  # s
_AT_REST = 0.02  # s at the start that are surely at rest


@dataclass(frozen=True, kw_only=True, eq=False)
class ArmChannel:
    """One predicted channel: SI values at the channel's own times, shape (n,)."""

    signal: Signal
    times: Real
    values: Real


@dataclass(frozen=True, kw_only=True, eq=False)
class ArmPrediction:
    """A run as the model has it.

    Attributes:
        run: The run.
        channels: Every accelerometer and motor angle that the run declares.
        torque: T_e that drove it on the motor shaft [N m], on ``times``; ``None`` with the brake on.
        times: Of the stepping [s].
        notes: What a reader must know.
    """

    run: Run
    channels: tuple[ArmChannel, ...]
    torque: Real | None
    times: Real
    notes: tuple[str, ...]

    def channel(self, column: str) -> ArmChannel:
        """By its column."""
        return next(c for c in self.channels if c.signal.channel.column == column)


def predict_arm(arm: ElasticArm, rig: Nameplate, run: Run, *, torque_sign: float = 1.0) -> ArmPrediction:
    """Predict every accelerometer and motor angle of ``run`` from its inputs.

    Args:
        arm: The elastic arm, with the drives that hold its joints.
        rig: Nameplate of the joint under test.
        run: Names the joint, the posture and how the joints are held.
        torque_sign: +1 where a positive recorded torque turns the model's joint positively (from the map).

    Raises:
        RefusedError: The run has no joint, or no input that moves it.
    """
    if run.joint is None:
        raise RefusedError(f"run {run.id}: says no joint; the arm's model needs to know which one moves or is hit")
    hold = held_as(arm, run)
    driven = hold[run.joint] in ("drive", "free")
    grid = _grid(run)
    probes = [probe_of(arm, s) for s in run.select("linear-acceleration", role="output", recorded=False)]
    payload = (
        None if run.payload_mass is None else Payload(mass=run.payload_mass, com=run.payload_com or (0, 0, 0))
    )
    hit = run.select("force", role="input")
    hammer = probe_of(arm, hit[0], HAMMER) if hit else None
    if driven:
        arm, hold = _anchored(arm, run.joint, run.posture), {**hold, run.joint: "drive"}
    held = hold_arm(
        arm, hold, run.posture, timestep=TIMESTEP, driven=[run.joint] if driven else [], probes=probes,
        hammer=hammer, payload=payload,
    )  # fmt: skip
    rest = equilibrium(held, run.posture)
    commands = _holding(held, rest, grid.size)
    base = [s.channel.column for s in run.select(role="output", recorded=False) if s.channel.location == "base"]
    notes = [f"{', '.join(base)}: the model's base does not move"] if base else []
    torque = None
    if hammer is not None:
        force = hit[0]
        commands[:, held.actuator(HAMMER)] = resampled(
            force.samples, force.sampling_rate, force.stream.start, grid
        )
    if driven:
        torque = _drive_with(held, rest, run, rig, grid, commands, torque_sign, notes)
    elif hammer is None:
        raise RefusedError(
            f"run {run.id}: joint {run.joint} is braked and nothing hits the arm: there is no input"
        )
    trajectory = step_arm(held, rest, commands)
    return ArmPrediction(
        run=run, channels=_read_out(trajectory, run, rig), torque=torque, times=grid, notes=tuple(notes)
    )


def held_as(arm: ElasticArm, run: Run) -> dict[str, HoldKind]:
    """How each joint of ``arm`` is held in ``run``; joints on which the run is silent are braked.

    Raises:
        RefusedError: A joint is held in a way that the linear reducer can't represent.
    """
    hold: dict[str, HoldKind] = dict.fromkeys(arm.rotors, "brake")
    for name, kind in run.hold.items():
        if not name and run.joint is None:
            continue
        if kind == "brake-with-play":
            raise RefusedError(
                f"run {run.id}: {name} is held by a brake with play, which this model does not have"
            )
        hold[arm.rotors[arm.index(name or str(run.joint))]] = kind
    if run.joint is not None and run.joint not in run.hold:
        hold[run.joint] = "brake" if run.brake else "free"
    return hold


def probe_of(arm: ElasticArm, signal: Signal, name: str | None = None) -> Probe:
    """Where a force or an accelerometer sits.

    Raises:
        RefusedError: The channel names neither a site of the model nor a body, point and axis.
    """
    channel = signal.channel
    if channel.location == "base" and channel.body is None:
        return Probe(
            name=name or channel.column, body="world", point=(0.0, 0.0, 0.0), axis=channel.axis or (0.0, 0.0, 1.0)
        )
    if channel.body is not None and channel.point is not None and channel.axis is not None:
        return Probe(name=name or channel.column, body=channel.body, point=channel.point, axis=channel.axis)
    if channel.site is not None and (site := arm.spec.site(channel.site)) is not None:
        import mujoco

        turned = np.zeros(3)
        mujoco.mju_rotVecQuat(turned, np.asarray(channel.axis or (0.0, 0.0, 1.0)), np.asarray(site.quat))
        x, y, z = (float(v) for v in site.pos)
        a, b, c = (float(v) for v in turned)
        return Probe(name=name or channel.column, body=site.parent.name, point=(x, y, z), axis=(a, b, c))
    raise RefusedError(
        f"{signal.stream.file}: {channel.column}: an arm's model needs body, point and axis, or a site it has"
    )


def _anchored(arm: ElasticArm, joint: str, posture: Mapping[str, float]) -> ElasticArm:
    k = arm.index(joint)
    inertia = float(joint_values(arm).rotor_inertia[k] + arm_reference(arm).locked_inertia(posture)[k])
    omega = 2.0 * math.pi * ANCHOR
    return with_drive(arm, joint, inertia * omega**2, 2.0 * inertia * omega)


def _holding(held: HeldArm, rest: Rest, steps: int) -> Real:
    commands = np.zeros((steps, held.model.nu))
    for k, name in enumerate(held.arm.rotors):
        if held.hold[name] == "drive":
            angle, still = np.full(1, rest.rotor[k]), np.zeros(1)
            commands[:, held.actuator(name + DRIVE)] = drive_command(held, name, angle, still, rest.torque[k])[0]
    return commands


def _drive_with(
    held: HeldArm, rest: Rest, run: Run, rig: Nameplate, grid: Real, commands: Real, sign: float, notes: list[str]
) -> Real:
    """Put torque and anchor of the driven joint into ``commands``; returns T_e [N m] on ``grid``."""
    joint = str(run.joint)
    k, n = held.arm.index(joint), held.arm.reduction_ratio(joint)
    eta = 1.0 if rig.efficiency is None else rig.efficiency
    torque = sign * _recorded_torque(run, rig, grid, sign * rest.torque[k] / n, notes)
    speed = _commanded_speed(run, grid, n)
    still = _still(run, speed)
    offset = float(rest.torque[k] - eta * n * np.mean(torque[:still]))
    commands[:, held.actuator(joint + TORQUE)] = eta * n * torque + offset - rest.torque[k]
    path = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]))]) * TIMESTEP
    commands[:, held.actuator(joint + DRIVE)] = drive_command(
        held, joint, rest.rotor[k] + path, speed, rest.torque[k]
    )
    return torque


def _still(run: Run, speed: Real) -> int:
    """Over how many steps from the start the torque's mean is what holds the arm.

    Until the drive is told to move; a drive that is never told to holds on average throughout.
    """
    shortest = round(_AT_REST / TIMESTEP)
    if run.hold.get(str(run.joint)) != "drive":
        return shortest
    moving = np.flatnonzero(np.abs(speed) > 1e-3 * max(float(np.max(np.abs(speed))), 1e-6))
    return max(shortest, int(moving[0])) if moving.size else speed.size


def _recorded_torque(run: Run, rig: Nameplate, grid: Real, holding: float, notes: list[str]) -> Real:
    """T_e on the motor shaft as recorded [N m], shape of ``grid``."""
    own = [s for s in run.select("torque", location="motor", role="input") if s.channel.joint in (None, run.joint)]
    currents = [
        s for s in run.select("current", location="motor", role="input") if s.channel.joint in (None, run.joint)
    ]
    if own:
        scale = 1.0 / (rig.reduction_ratio or 1.0) if own[0].channel.side == "output" else 1.0
        return scale * resampled(own[0].samples, own[0].sampling_rate, own[0].stream.start, grid)
    if currents and rig.torque_constant is not None:
        peak = math.sqrt(2.0) if currents[0].channel.per == "rms" else 1.0
        scale = peak * rig.torque_constant
        return scale * resampled(currents[0].samples, currents[0].sampling_rate, currents[0].stream.start, grid)
    found = torque_from_currents(run, rig, holding, run.joint)
    if not found.anchored:
        notes.append("the current at rest is too small to tell the torque's sign; taken as measured")
    notes += [f"torque's sign ambiguous between {d.start:.3f} and {d.end:.3f} s" for d in found.doubts]
    if found.times.size == grid.size and np.allclose(found.times, grid):
        return found.values
    return resampled(found.values, found.rate, float(found.times[0]), grid)


def _commanded_speed(run: Run, grid: Real, n: float) -> Real:
    commands = [s for s in run.select("speed-command", role="input") if s.channel.joint in (None, run.joint)]
    if not commands:
        return np.zeros_like(grid)
    command = commands[0]
    return resampled(command.samples, command.sampling_rate, command.stream.start, grid) / n


def _grid(run: Run) -> Real:
    lengths = [s.start + s.length / s.sampling_rate for s in run.streams if s.length]
    if not lengths:
        raise RefusedError(f"run {run.id}: holds no samples; nothing can be predicted from it")
    return np.asarray(np.arange(round(max(lengths) / TIMESTEP)) * TIMESTEP, dtype=np.float64)


def _read_out(trajectory: Trajectory, run: Run, rig: Nameplate) -> tuple[ArmChannel, ...]:
    channels = []
    for signal in run.select(role="output", recorded=False):
        channel = signal.channel
        if channel.location == "base":
            continue  # the model stands on rock; a zero is no prediction
        if channel.quantity == "linear-acceleration":
            felt = trajectory.accelerometer(channel.column)
            cutoff = channel.low_cutoff or 0.0
            values = ac_coupled(felt, 1.0 / TIMESTEP, cutoff) if channel.coupling == "ac" else felt
        elif channel.quantity == "angle" and channel.location == "motor" and channel.joint in (None, run.joint):
            if trajectory.held.rotor[trajectory.held.arm.index(str(run.joint))] < 0:
                continue
            values = trajectory.held.arm.reduction_ratio(str(run.joint)) * trajectory.rotor(str(run.joint))
        else:
            continue
        times = signal.times
        smooth = _below_half(values, signal.sampling_rate)
        curve = interpolate.make_interp_spline(trajectory.times, smooth, k=5)
        inside = np.clip(times, trajectory.times[0], trajectory.times[-1])
        channels.append(ArmChannel(signal=signal, times=times, values=np.asarray(curve(inside))))
    return tuple(channels)


def _below_half(values: Real, rate: float) -> Real:
    """Zero-phase low-pass at 0.46 of the device's rate, so that nothing folds; the record's ends are held."""
    if rate >= 0.9 / TIMESTEP:
        return values
    reach = round(24.0 / (rate * TIMESTEP))
    taps = dsp.firwin(2 * reach + 1, 0.46 * rate, fs=1.0 / TIMESTEP, window=("kaiser", 8.0))
    padded = np.concatenate([np.full(reach, values[0]), values, np.full(reach, values[-1])]) - values[0]
    return np.asarray(dsp.oaconvolve(padded, taps, mode="valid") + values[0], dtype=np.float64)
