"""A case's runs: what is done to the rig, run by run, and the clean channels that come of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from jointscope.models.parameters import Rig
from jointscope.recordings.bandlimited import bandlimited
from jointscope.sim.concealed import measurement
from jointscope.sim.concealed.engine import TIMESTEP, Drive, Motion, march
from jointscope.sim.concealed.law import Effect, Kind, Moment, Setting
from jointscope.sim.concealed.measurement import Acquisition, Devices
from jointscope.sim.concealed.mjcf import compile_plant, settle_time

Real = NDArray[np.float64]
TIE = 1.0  # Hz
TAIL = 0.06  # s simulated beyond a run's end, for the filters


@dataclass(frozen=True, kw_only=True)
class Take:
    """One run as it is carried out.

    Attributes:
        kind: The experiment.
        angle: The arm's angle at the start [rad].
        duration: [s].
        begin: When it begins [s] since the session began.
        force: Peak of the hit as the force cell sees it [N].
        pulse: Duration of the hit [s].
        exponent: Shape of the pulse, sin to this power.
        at: When the hit comes [s].
        gain: True over measured force of this hit, less 1.
        late: The force channel's timing error in this hit [s].
        amplitude: Of the swept torque on the motor shaft [N m].
        band: First and last frequency of the sweep [Hz].
        logarithmic: Whether the sweep's frequency rises by a constant ratio.
        travel: Of the motion, out and back [rad].
        share: Part of the motion's time that is spent at rest, at its ends.
        loaded: Whether the arm carries the payload, where there is one.
    """

    kind: Kind
    angle: float
    duration: float
    begin: float
    force: float = 0.0
    pulse: float = 0.006
    exponent: float = 1.0
    at: float = 0.05
    gain: float = 0.0
    late: float = 0.0
    amplitude: float = 0.0
    band: tuple[float, float] = (4.0, 80.0)
    logarithmic: bool = False
    travel: float = 0.0
    share: float = 0.06

    @property
    def braked(self) -> bool:
        """Hits are done with the brake on."""
        return self.kind == "hammer"


@dataclass(frozen=True, kw_only=True)
class DriveGains:
    """The drive's own settings.

    Attributes:
        hold: Frequency of the weak position hold during a sweep [Hz].
        bandwidth: Of the speed loop [Hz].
        integral: Corner of its integral part over the bandwidth.
        cycle: Between two updates of the drive [s].
        resolution: Of the encoder that the drive sees, at the output [rad].
    """

    hold: float
    bandwidth: float
    integral: float
    cycle: float
    resolution: float


@dataclass(frozen=True, kw_only=True)
class Plan:
    """Everything about a case but the rig and what is concealed.

    Attributes:
        timestep: Of the engine [s]; a multiple of ``TIMESTEP`` of which the drive's cycle is a multiple.
    """

    takes: tuple[Take, ...]
    devices: Devices
    gains: DriveGains
    setting: Setting | None = field(default=None, repr=False)
    timestep: float = TIMESTEP

    def moment(self, index: int) -> Moment:
        """The run's place in the session."""
        take = self.takes[index]
        return Moment(
            index=index, runs=len(self.takes), begin=take.begin, braked=take.braked, kind=take.kind,
            duration=take.duration,
        )  # fmt: skip


def grid(take: Take, timestep: float = TIMESTEP) -> Real:
    """The stepping grid of a run [s], tail included."""
    return np.arange(round((take.duration + TAIL) / timestep), dtype=np.float64) * timestep


def hit(take: Take, times: Real) -> Real:
    """The force of the hit as measured [N], shape of ``times`` [s]."""
    inside = (times > take.at) & (times < take.at + take.pulse)
    wave = np.sin(np.pi * np.clip((times - take.at) / take.pulse, 0.0, 1.0))
    return np.asarray(np.where(inside, take.force * np.abs(wave) ** take.exponent, 0.0))


def sweep(take: Take, times: Real) -> Real:
    """The swept torque [N m], faded in and out over 50 ms."""
    low, high = take.band
    length = take.duration
    if take.logarithmic:
        rate = np.log(high / low) / length
        phase = 2.0 * np.pi * low * (np.exp(rate * np.minimum(times, length)) - 1.0) / rate
    else:
        phase = 2.0 * np.pi * (low * times + 0.5 * (high - low) / length * times**2)
    fade = np.clip(times / 0.05, 0.0, 1.0) * np.clip((length - times) / 0.05, 0.0, 1.0)
    return np.asarray(take.amplitude * np.sin(phase) * fade)


def motion(take: Take, times: Real) -> Real:
    """The commanded motor speed over n [rad/s]: out and back, speed in triangles with rounded corners."""
    rest = take.share * take.duration
    half = 0.5 * (take.duration - 2.0 * rest)
    peak = 2.0 * take.travel / half
    corners = rest + half * np.array([0.0, 0.5, 1.0, 1.5, 2.0])
    speed = np.interp(times, corners, [0.0, peak, 0.0, -peak, 0.0])
    width = round(0.04 / (times[1] - times[0]))
    window = np.hanning(width)
    return np.asarray(np.convolve(speed, window / window.sum(), mode="same"))


def drive(rig: Rig, take: Take, gains: DriveGains, times: Real) -> Drive:
    """The drive for a run."""
    if take.braked:
        return Drive(0, np.zeros(times.size))
    joint = rig.joint
    ratio = joint.efficiency * joint.reduction_ratio
    inertia = (joint.reflected_inertia + joint.load_inertia) / ratio
    cycle = round(gains.cycle / float(times[1] - times[0]))
    if take.kind == "torque-sweep":
        w = 2.0 * np.pi * gains.hold
        return Drive(1, sweep(take, times), (1.6 * w * inertia, w**2 * inertia), np.inf, cycle, gains.resolution)
    w = 2.0 * np.pi * gains.bandwidth
    weight = abs(rig.gravity_torque(0.0)) / ratio
    limit = 6.0 * take.travel / (0.25 * take.duration) ** 2 * inertia + 2.0 * weight
    return Drive(
        2,
        motion(take, times),
        (w * inertia, gains.integral * w**2 * inertia),
        limit,
        cycle,
        gains.resolution,
    )


def act(rig: Rig, plan: Plan, index: int, effects: Sequence[Effect]) -> tuple[Motion, Mapping[str, Real]]:
    """Carry out one run on the rig.

    Returns:
        The motion, and what the cells and the drive were given, on the stepping grid: ``force`` [N], ``command``
        [rad/s at the output].
    """
    take, moment = plan.takes[index], plan.moment(index)
    setting = plan.setting
    assert setting is not None
    times = grid(take, plan.timestep)
    measured = hit(take, times)
    pushed = (1.0 + take.gain) * hit(replace(take, at=take.at + take.late), times)
    plant = compile_plant(rig, effects, setting, moment, take.angle, plan.timestep)
    slots = tuple(e.law.loop(e.values, setting, moment) for e in effects if e.law.loop is not None)
    what = drive(rig, take, plan.gains, times)
    moved = march(
        plant, start=take.angle, push=pushed, drive=what, slots=slots, session=take.begin, gravity=rig.gravity,
        settle=settle_time(effects),
    )  # fmt: skip
    return moved, {"force": measured, "command": what.programme}


def faults(effects: Sequence[Effect], moment: Moment) -> Acquisition:
    """The recording's faults among the effects."""
    fault = Acquisition()
    for effect in effects:
        if effect.law.chain is not None:
            fault = replace(fault, **effect.law.chain(effect.values, moment))
    return fault


def clean_channels(rig: Rig, plan: Plan, index: int, effects: Sequence[Effect]) -> dict[str, Real]:
    """The run's channels without noise, in SI; motor angle, torque and command on the motor shaft.

    In driven runs the motor angle is there even if the lab doesn't record it (see :func:`declared`).
    """
    moved, given = act(rig, plan, index, effects)
    return _read(rig, plan, index, moved, given, faults(effects, plan.moment(index)))


def _read(
    rig: Rig, plan: Plan, index: int, moved: Motion, given: Mapping[str, Real], fault: Acquisition
) -> dict[str, Real]:
    take, devices = plan.takes[index], plan.devices
    h, n = moved.timestep, rig.joint.reduction_ratio
    daq = np.arange(int(take.duration * devices.daq_rate)) / devices.daq_rate
    stamps = np.arange(int(take.duration * devices.log_rate)) / devices.log_rate
    looked = measurement.log_times(stamps, fault)

    acceleration = measurement.accelerometer(moved.accelerometer, h, devices, fault)
    analogue = {"acceleration": acceleration}
    if take.braked:
        analogue["force"] = given["force"] * fault.force_gain
    if devices.arm_encoder:
        analogue["arm"] = moved.arm
    logged = {}
    if devices.motor_encoder or not take.braked:
        logged["motor"] = n * moved.motor
    if take.kind == "speed-motion":
        logged["command"] = n * given["command"]
    channels = _sampled(analogue, h, daq, devices.daq_rate) | _sampled(logged, h, looked, devices.log_rate)
    if not take.braked:
        channels["torque"] = measurement.logged_torque(moved.torque, h, looked, devices.log_rate, fault)
    return {name: channels[name] for name in measurement.CHANNELS if name in channels}


def _sampled(signals: Mapping[str, Real], h: float, times: Real, rate: float) -> dict[str, Real]:
    if not signals:
        return {}
    read = measurement.resample(np.column_stack(list(signals.values())), h, times, rate)
    return dict(zip(signals, read.T, strict=True))


def declared(channels: Mapping[str, Real], devices: Devices) -> dict[str, Real]:
    """The channels that the lab's devices record."""
    absent = {"arm"} - ({"arm"} if devices.arm_encoder else set())
    absent |= {"motor"} - ({"motor"} if devices.motor_encoder else set())
    return {name: y for name, y in channels.items() if name not in absent}


def replayed(
    rig: Rig, plan: Plan, index: int, record: Mapping[str, Real], effects: Sequence[Effect] = ()
) -> dict[str, Real]:
    """What ``rig``, with ``effects``, would read under the torque that a driven run logged; nothing is assumed of the drive.

    The motor is tied to the recorded motor angle by a loose spring and damper (1 Hz), so that the rig doesn't drift
    away; what the tie can't follow is left to be compared.
    """
    take, devices, joint = plan.takes[index], plan.devices, rig.joint
    setting = plan.setting
    assert setting is not None
    times = grid(take, plan.timestep)
    fault = faults(effects, plan.moment(index))
    stamped = times * (1.0 + 1e-6 * fault.ppm) + fault.delay  # where the log put what happened then
    torque = bandlimited(record["torque"], devices.log_rate)(stamped)
    motor = bandlimited(record["motor"], devices.log_rate)(stamped) / joint.reduction_ratio
    moment = plan.moment(index)
    plant = compile_plant(rig, effects, setting, moment, take.angle, plan.timestep)
    slots = tuple(e.law.loop(e.values, setting, moment) for e in effects if e.law.loop is not None)
    w = 2.0 * np.pi * TIE
    inertia = (joint.reflected_inertia + joint.load_inertia) / plant.ratio
    what = Drive(3, torque, (1.4 * w * inertia, w**2 * inertia), np.inf, 1, 0.0, motor)
    moved = march(
        plant, start=take.angle, push=np.zeros(times.size), drive=what, slots=slots, session=take.begin,
        gravity=rig.gravity, settle=settle_time(effects),
    )  # fmt: skip
    given = {"force": np.zeros(times.size), "command": what.programme}
    return _read(rig, plan, index, moved, given, faults(effects, moment))


def rehearse(rig: Rig, plan: Plan, effects: Sequence[Effect], runs: Sequence[int]) -> list[dict[str, Real]]:
    """The clean channels of some of the case's runs."""
    return [clean_channels(rig, plan, index, effects) for index in runs]
