"""One run carried out in MuJoCo with the concealed engine's laws: any force, torque or speed programme, any sensors."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from jointscope.models.parameters import Rig
from jointscope.sim.concealed import measurement
from jointscope.sim.concealed.engine import TIMESTEP, Drive, march
from jointscope.sim.concealed.law import Effect, Kind, Moment, Setting
from jointscope.sim.concealed.measurement import Devices
from jointscope.sim.concealed.mjcf import compile_plant, settle_time
from jointscope.sim.concealed.rehearsal import TAIL, faults

Real = NDArray[np.float64]
Programme = Callable[[Real], Real]

HOLD_HZ = 0.6  # of the loose position hold under a torque programme
SPEED_LOOP_HZ = 4.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Work:
    """What is done in a run.

    Attributes:
        angle: Of the arm at the start [rad].
        duration: [s].
        braked: Whether the motor is held.
        force: On the hammer's place, as its cell reads it [N].
        torque: Beside a loose hold, n T_e before the efficiency [N m at the joint output].
        speed: Commanded, at the output [rad/s]; where given, a speed loop drives the motor.
        gain, late: True over measured force less 1, and its lateness [s], of this hit.
        radius: The accelerometer's, in terms of the rig's.
        one_device: Whether the drive's signals are logged on the DAQ's clock.
        bandwidth, integral: Of the speed loop [Hz], and its integral corner over it.
    """

    kind: Kind
    angle: float
    duration: float
    braked: bool
    force: Programme | None = field(default=None, repr=False)
    torque: Programme | None = field(default=None, repr=False)
    speed: Programme | None = field(default=None, repr=False)
    gain: float = 0.0
    late: float = 0.0
    radius: float = 1.0
    one_device: bool = False
    bandwidth: float = SPEED_LOOP_HZ
    integral: float = 0.2


def _drive(rig: Rig, work: Work, times: Real, devices: Devices) -> Drive:
    if work.braked:
        return Drive(0, np.zeros(times.size))
    joint = rig.joint
    ratio = joint.efficiency * joint.reduction_ratio
    inertia = (joint.reflected_inertia + joint.load_inertia) / ratio
    step = 2.0 * np.pi / (devices.motor_counts * joint.reduction_ratio)
    if work.speed is None:
        w = 2.0 * np.pi * HOLD_HZ
        torque = np.zeros(times.size) if work.torque is None else work.torque(times) / joint.reduction_ratio
        return Drive(1, np.asarray(torque, dtype=np.float64), (1.6 * w * inertia, w**2 * inertia), np.inf, 5, step)
    w = 2.0 * np.pi * work.bandwidth
    programme = np.asarray(work.speed(times), dtype=np.float64)
    return Drive(2, programme, (w * inertia, work.integral * w**2 * inertia), np.inf, 5, step)


def carry_out(
    rig: Rig, setting: Setting, work: Work, effects: Sequence[Effect], devices: Devices, *, index: int, runs: int,
    begin: float,
) -> dict[str, Real]:  # fmt: skip
    """Every channel of the run without noise, in SI; torque, motor angle and command on the motor shaft.

    Args:
        rig: The true rig.
        setting: Its scales, by which the laws were sized.
        index, runs, begin: The run's place in the session, and when it begins [s].
    """
    rig = replace(rig, accelerometer_radius=rig.accelerometer_radius * work.radius)
    moment = Moment(
        index=index, runs=runs, begin=begin, braked=work.braked, kind=work.kind, duration=work.duration
    )
    times = np.arange(round((work.duration + TAIL) / TIMESTEP), dtype=np.float64) * TIMESTEP
    measured = np.zeros(times.size) if work.force is None else np.asarray(work.force(times), dtype=np.float64)
    pushed = measured
    if work.force is not None and (work.gain or work.late):
        pushed = (1.0 + work.gain) * np.asarray(work.force(times - work.late), dtype=np.float64)
    plant = compile_plant(rig, effects, setting, moment, work.angle)
    slots = tuple(e.law.loop(e.values, setting, moment) for e in effects if e.law.loop is not None)
    drive = _drive(rig, work, times, devices)
    moved = march(
        plant, start=work.angle, push=pushed, drive=drive, slots=slots, session=begin, gravity=rig.gravity,
        settle=settle_time(effects),
    )  # fmt: skip
    fault = faults(effects, moment)
    h, n = moved.timestep, rig.joint.reduction_ratio
    log_rate = devices.daq_rate if work.one_device else devices.log_rate
    daq = np.arange(int(work.duration * devices.daq_rate)) / devices.daq_rate
    stamps = np.arange(int(work.duration * log_rate)) / log_rate
    looked = stamps if work.one_device else measurement.log_times(stamps, fault)
    acceleration = measurement.accelerometer(moved.accelerometer, h, devices, fault)
    analogue = np.column_stack([measured * fault.force_gain, acceleration, moved.arm])
    read = measurement.resample(analogue, h, daq, devices.daq_rate)
    channels = {"force": read[:, 0], "acceleration": read[:, 1], "arm": read[:, 2]}
    log = measurement.resample(np.column_stack([n * moved.motor, n * drive.programme]), h, looked, log_rate)
    channels["motor"] = log[:, 0]
    if not work.braked:
        channels["torque"] = measurement.logged_torque(moved.torque, h, looked, log_rate, fault)
        if work.speed is not None:
            channels["command"] = log[:, 1]
    return channels
