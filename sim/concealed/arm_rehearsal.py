"""A case's runs: MuJoCo moves the arm, devices record it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import mujoco
import numpy as np
from numpy.typing import NDArray

from jointscope.models.arm.build import DRIVE, ElasticArm, build_arm
from jointscope.models.arm.forward import Trajectory, step_arm_repeats
from jointscope.models.arm.holding import (
    HAMMER,
    TORQUE,
    HeldArm,
    HoldKind,
    Rest,
    drive_command,
    equilibrium,
    hold_arm,
)
from jointscope.recordings.campaign import Channel, Experiment, Location, Role, Run, Stream
from jointscope.sim.arm.plan import JOINT
from jointscope.sim.concealed.arm_bench import ArmBench, Spot
from jointscope.sim.concealed.arm_laws import ArmEffect, FallingFriction, falling_friction, set_up, with_elements
from jointscope.sim.excitation import Sweep, ThereAndBack
from jointscope.sim.measurement import Converter, Device
from jointscope.sim.measurement_sensors import Encoder, iepe
from jointscope.sim.plan import HammerPlan
from jointscope.sim.pulse import total_force
from jointscope.sim.single_joint import draw_hit

Real = NDArray[np.float64]
DAQ, LOG = Device(sampling_rate=1024.0), Device(sampling_rate=500.0)
LOW_CUTOFF = 0.5  # Hz, of the accelerometers
HIT_TIME, SWEEP_TIME, MOTION_TIME, LEAD, TRAIL = 1.6, 2.8, 3.2, 0.3, 0.4  # s


@dataclass(frozen=True, kw_only=True, eq=False)
class ArmTake:
    """One run's truth.

    Attributes:
        kind, spot: Experiment, and where it was hit.
        hold, posture: At the start.
        force, torque, command: Hammer [N], T_e [N m on the motor shaft], speed command [rad/s there]; ``None`` where absent.
    """

    kind: Experiment
    spot: Spot | None
    hold: Mapping[str, HoldKind]
    posture: Mapping[str, float]
    trajectory: Trajectory
    force: Real | None
    torque: Real | None
    command: Real | None
    duration: float


def rehearse_arm(
    bench: ArmBench, effects: tuple[ArmEffect, ...], rng: np.random.Generator, *, few: bool = False
) -> list[ArmTake]:
    """Every take of the bench with ``effects`` in the arm; with ``few`` one strong take of each kind."""
    arm = with_elements(build_arm(bench.truth), effects)
    hits, sweeps, motions = (1, 1, 1) if few else bench.repeats
    takes: list[ArmTake] = []
    for spot in bench.spots:
        takes += _hits(arm, bench, spot, effects, rng, hits, bench.hit_levels[-1:] if few else bench.hit_levels)
    takes += _sweeps(
        arm,
        bench,
        effects,
        rng,
        [a for a in (bench.sweep_levels[-1:] if few else bench.sweep_levels) for _ in range(sweeps)],
    )
    for travel in bench.travels[-1:] if few else bench.travels:
        takes += _motions(arm, bench, effects, rng, travel, motions)
    return takes


def _grid(bench: ArmBench, duration: float) -> Real:
    steps = round((duration + max(DAQ.reach(bench.timestep), LOG.reach(bench.timestep))) / bench.timestep)
    return np.asarray(np.arange(steps) * bench.timestep, dtype=np.float64)


def _held(
    arm: ElasticArm,
    bench: ArmBench,
    posture: Mapping[str, float],
    effects: tuple[ArmEffect, ...],
    hammer: Spot | None,
) -> tuple[HeldArm, Rest, dict[str, HoldKind]]:
    hold: dict[str, HoldKind] = dict.fromkeys(arm.rotors, "brake" if hammer is not None else "drive")
    if bench.hidden is not None:
        hold[bench.hidden] = "brake"
    held = hold_arm(
        arm, hold, posture, timestep=bench.timestep, driven=[] if hammer is not None else [JOINT],
        probes=[s.probe for s in bench.sensors], hammer=None if hammer is None else hammer.probe,
    )  # fmt: skip
    rest = equilibrium(held, posture)
    set_up(held, rest, effects)
    return held, rest, hold


def _hits(
    arm: ElasticArm, bench: ArmBench, spot: Spot, effects: tuple[ArmEffect, ...], rng: np.random.Generator,
    count: int, levels: tuple[float, ...],
) -> list[ArmTake]:  # fmt: skip
    held, rest, hold = _held(arm, bench, bench.posture, effects, spot)
    hammer = HammerPlan(hits=count, levels=levels, duration=HIT_TIME, double_hit_probability=0.0)
    times = _grid(bench, HIT_TIME)
    forces = np.array([total_force(draw_hit(hammer, level, rng), times) for level in levels for _ in range(count)])
    gains = 1.0 + rng.normal(0.0, hammer.gain_scatter, len(forces))
    commands = np.zeros((len(forces), times.size, held.model.nu))
    commands[:, :, held.actuator(HAMMER)] = forces * gains[:, None]
    return [
        ArmTake(
            kind="hammer", spot=spot, hold=hold, posture=bench.posture, trajectory=trajectory, force=force,
            torque=None, command=None, duration=HIT_TIME,
        )
        for trajectory, force in zip(step_arm_repeats(held, rest, commands), forces, strict=True)
    ]  # fmt: skip


def _sweeps(
    arm: ElasticArm, bench: ArmBench, effects: tuple[ArmEffect, ...], rng: np.random.Generator, levels: list[float]
) -> list[ArmTake]:
    duration = LEAD + SWEEP_TIME + TRAIL
    held, rest, hold = _held(arm, bench, bench.posture, effects, None)
    times = _grid(bench, duration)
    commands = np.stack([_holding(held, rest, times.size) for _ in levels])
    n = arm.reduction_ratio(JOINT)
    for i, level in enumerate(levels):
        sweep = Sweep(start=LEAD, duration=SWEEP_TIME, first_frequency=4.0, last_frequency=70.0, amplitude=level)
        commands[i, :, held.actuator(JOINT + TORQUE)] = n * (sweep.torque(times) + _shaking(bench, times, rng))
    still = np.zeros_like(times)
    return [
        _driven("torque-sweep", bench.posture, hold, t, still, duration)
        for t in _stepped(held, rest, commands, falling_friction(held, effects))
    ]


def _motions(
    arm: ElasticArm,
    bench: ArmBench,
    effects: tuple[ArmEffect, ...],
    rng: np.random.Generator,
    travel: float,
    count: int,
) -> list[ArmTake]:
    duration = LEAD + MOTION_TIME + TRAIL
    posture = {**bench.posture, JOINT: bench.posture[JOINT] - 0.5 * travel}
    held, rest, hold = _held(arm, bench, posture, effects, None)
    times = _grid(bench, duration)
    path = ThereAndBack(start=LEAD, duration=MOTION_TIME, travel=travel)
    speed = np.array([path.speed(float(t)) for t in times])
    angle = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]))]) * bench.timestep
    k, n = arm.index(JOINT), arm.reduction_ratio(JOINT)
    commands = np.stack([_holding(held, rest, times.size) for _ in range(count)])
    for i in range(count):
        commands[i, :, held.actuator(JOINT + DRIVE)] = drive_command(
            held, JOINT, rest.rotor[k] + angle, speed, rest.torque[k]
        )
        commands[i, :, held.actuator(JOINT + TORQUE)] = n * _shaking(bench, times, rng)
    return [
        _driven("speed-motion", posture, hold, t, n * speed, duration)
        for t in _stepped(held, rest, commands, falling_friction(held, effects))
    ]


def _holding(held: HeldArm, rest: Rest, steps: int) -> Real:
    commands = np.zeros((steps, held.model.nu))
    for k, name in enumerate(held.arm.rotors):
        if held.hold[name] == "drive":
            commands[:, held.actuator(name + DRIVE)] = drive_command(
                held, name, np.full(1, rest.rotor[k]), np.zeros(1), rest.torque[k]
            )[0]
    return commands


def _shaking(bench: ArmBench, times: Real, rng: np.random.Generator) -> Real:
    """Torque noise of the drive [N m on the motor shaft]: white through a first-order pole at 150 Hz, faded in."""
    from scipy import signal

    pole = float(np.exp(-2.0 * np.pi * 150.0 * bench.timestep))
    noise = np.asarray(signal.lfilter([1.0 - pole], [1.0, -pole], rng.normal(size=times.size)))
    return np.asarray(noise * (bench.drive_noise / np.std(noise)) * np.clip(times / 0.1, 0.0, 1.0))


def _stepped(held: HeldArm, rest: Rest, commands: Real, friction: FallingFriction | None) -> list[Trajectory]:
    if friction is None:
        return step_arm_repeats(held, rest, commands)
    return [_stepped_by_hand(held, rest, c, friction) for c in commands]


def _stepped_by_hand(held: HeldArm, rest: Rest, commands: Real, friction: FallingFriction) -> Trajectory:
    model = held.model
    data = mujoco.MjData(model)
    data.qpos[:] = rest.qpos
    n, h = len(commands), model.opt.timestep
    position, early = np.empty((n, model.nq)), np.empty((n + 1, model.nv))
    sensors = np.empty((n, model.nsensordata))
    for i in range(n):
        position[i], early[i] = data.qpos, data.qvel
        data.ctrl[:] = commands[i]
        friction(data)
        mujoco.mj_step(model, data)
        sensors[i] = data.sensordata
    early[n] = data.qvel
    acceleration = np.diff(early, axis=0) / h
    return Trajectory(held, np.arange(n) * h, position, early[:-1] + 0.5 * h * acceleration, acceleration, sensors)


def _driven(
    kind: Experiment, posture: Mapping[str, float], hold: Mapping[str, HoldKind], t: Trajectory, command: Real,
    duration: float,
) -> ArmTake:  # fmt: skip
    torque = (t.force(JOINT + DRIVE) + t.force(JOINT + TORQUE)) / t.held.arm.reduction_ratio(JOINT)
    return ArmTake(
        kind=kind, spot=None, hold=hold, posture=posture, trajectory=t, force=None, torque=torque, command=command,
        duration=duration,
    )  # fmt: skip


# --- recording -------------------------------------------------------------------------------------------------------


def recorded_run(
    take: ArmTake, bench: ArmBench, effects: tuple[ArmEffect, ...], name: str, rng: np.random.Generator
) -> Run:
    """A take as the lab has it, with what the lab believes of its joints."""
    h = bench.timestep
    stamps = DAQ.stamps(take.duration)
    daq: list[Channel] = []
    if take.force is not None and take.spot is not None:
        cell = Converter(full_scale=2000.0, noise_rms=bench.noise[1])
        daq.append(_channel("force", "force", "N", "arm" if take.spot.joint == JOINT else "neighbour", "input",
                            cell.convert(DAQ.sample(take.force, h, stamps), rng), take.spot))  # fmt: skip
    converter = Converter(full_scale=490.0, noise_rms=bench.noise[0])
    for sensor in bench.sensors:
        felt = iepe(take.trajectory.accelerometer(sensor.probe.name), h, LOW_CUTOFF)
        channel = _channel(sensor.probe.name, "linear-acceleration", "m/s^2", "arm" if sensor.joint == JOINT else "neighbour",
                           "output", converter.convert(DAQ.sample(felt, h, stamps), rng), sensor)  # fmt: skip
        daq.append(replace(channel, coupling="ac", low_cutoff=LOW_CUTOFF, full_scale=490.0))
    streams = [
        Stream(file=f"{name}-a.npz", sampling_rate=DAQ.sampling_rate, length=stamps.size, channels=tuple(daq))
    ]
    if take.torque is not None:
        streams.append(_log(take, bench, effects, name, rng))
    believed = {row.name for row in bench.lab.joints}
    rigid = "locked" if take.force is None else "brake"
    hold = {n: take.hold[n] if n in believed else rigid for n in take.posture}
    return Run(
        id=name, experiment=take.kind, streams=tuple(streams), brake=take.force is not None,
        arm_angle=-take.posture[JOINT], joint=JOINT if take.spot is None else take.spot.joint,
        posture=dict(take.posture), hold=hold,  # type: ignore[arg-type]
    )  # fmt: skip


def _log(
    take: ArmTake, bench: ArmBench, effects: tuple[ArmEffect, ...], name: str, rng: np.random.Generator
) -> Stream:
    h = bench.timestep
    stamps = LOG.stamps(take.duration)
    assert take.torque is not None and take.command is not None
    torque = take.torque
    for e in effects:
        if e.effect == "torque-gain":
            torque = torque / e.values["gain"]
        elif e.effect == "drive-lag":
            torque = torque + e.values["time_constant"] * np.gradient(torque, h)
    n = take.trajectory.held.arm.reduction_ratio(JOINT)
    converter = Converter(full_scale=10.0, bits=16, noise_rms=bench.noise[2])
    spot = Spot(joint=JOINT, probe=bench.spots[0].probe)
    channels = (
        (
            "motor_angle",
            "angle",
            "rad",
            "output",
            Encoder().read(LOG.sample(n * take.trajectory.rotor(JOINT), h, stamps)),
        ),
        ("speed_command", "speed-command", "rad/s", "input", LOG.sample(take.command, h, stamps)),
        ("torque", "torque", "N m", "input", converter.convert(LOG.sample(torque, h, stamps), rng)),
    )
    made = tuple(
        replace(_channel(c, q, u, "motor", r, x, spot), body=None, point=None, axis=None)  # type: ignore[arg-type]
        for c, q, u, r, x in channels
    )
    return Stream(file=f"{name}-b.npz", sampling_rate=LOG.sampling_rate, length=stamps.size, channels=made)


def _channel(
    column: str, quantity: str, unit: str, location: Location, role: Role, samples: Real, spot: Spot
) -> Channel:
    return Channel(
        column=column, quantity=quantity, unit=unit, location=location, role=role, samples=samples, joint=spot.joint,  # type: ignore[arg-type]
        body=spot.probe.body, point=spot.probe.point, axis=spot.probe.axis,
    )  # fmt: skip
