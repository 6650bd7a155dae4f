"""What the arm does in each experiment, before anyone measures it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from jointscope.models.arm.build import DRIVE, ElasticArm
from jointscope.models.arm.forward import Trajectory, step_arm, step_arm_repeats
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
from jointscope.sim.arm.plan import ArmMotion, ArmPlan, ArmSweep, HammerSpot
from jointscope.sim.excitation import Sweep, ThereAndBack
from jointscope.sim.pulse import total_force
from jointscope.sim.single_joint import draw_hit

Real = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Take:
    """One run's truth on the stepping grid.

    Attributes:
        trajectory: States and sensors.
        hold: Per joint.
        posture: Link angles at the start [rad].
        force: Of the hammer as its cell feels it [N], shape (n,), or ``None``.
        torque: T_e of the joint's motor on its shaft [N m], shape (n,), or ``None`` with the brake on.
        speed_command: On the motor shaft [rad/s], shape (n,), or ``None``.
        duration: Of the record [s]; the grid goes on a little, so that filters have their other half.
    """

    trajectory: Trajectory
    hold: Mapping[str, HoldKind]
    posture: Mapping[str, float]
    duration: float
    force: Real | None = None
    torque: Real | None = None
    speed_command: Real | None = None


def hammer_takes(arm: ElasticArm, plan: ArmPlan, spot: HammerSpot, rng: np.random.Generator) -> list[Take]:
    """Every hit of a spot; no two are alike."""
    posture = dict(plan.truth.posture if spot.posture is None else spot.posture)
    hold: dict[str, HoldKind] = dict.fromkeys(arm.rotors, "brake")
    held = hold_arm(
        arm, hold, posture, timestep=plan.timestep, probes=[s.probe for s in plan.sensors], hammer=spot.hit
    )
    rest = equilibrium(held, posture)
    hammer = spot.hammer
    times = _grid(plan, hammer.duration)
    levels = [level for level in hammer.levels for _ in range(hammer.hits)]
    forces = np.array([total_force(draw_hit(hammer, level, rng), times) for level in levels])
    gains = 1.0 + rng.normal(0.0, hammer.gain_scatter, len(levels))
    commands = np.zeros((len(levels), times.size, held.model.nu))
    commands[:, :, held.actuator(HAMMER)] = forces * gains[:, None]
    return [
        Take(trajectory=run, hold=hold, posture=posture, duration=hammer.duration, force=force)
        for run, force in zip(step_arm_repeats(held, rest, commands), forces, strict=True)
    ]


def sweep_take(arm: ElasticArm, plan: ArmPlan, sweep: ArmSweep, level: float, rng: np.random.Generator) -> Take:
    """A torque sweep of amplitude ``level`` [N m on the motor shaft] while every joint is held by its drive."""
    posture = dict(plan.truth.posture)
    duration = sweep.lead + sweep.sweep_time + sweep.trail
    times = _grid(plan, duration)
    excitation = Sweep(
        start=sweep.lead, duration=sweep.sweep_time, first_frequency=sweep.first_frequency,
        last_frequency=sweep.last_frequency, amplitude=level,
    )  # fmt: skip
    held, rest, commands = _driven(arm, plan, posture, times)
    n = arm.reduction_ratio(plan.joint)
    commands[:, held.actuator(plan.joint + TORQUE)] = n * (
        excitation.torque(times) + _drive_noise(plan, times, rng)
    )
    return _driven_take(plan, step_arm(held, rest, commands), posture, duration, np.zeros_like(times))


def motion_take(
    arm: ElasticArm, plan: ArmPlan, motion: ArmMotion, travel: float, rng: np.random.Generator
) -> Take:
    """There and back by ``travel`` [rad] at triangular speed, under the joint's drive."""
    posture = {**plan.truth.posture, plan.joint: motion.start_angle}
    duration = motion.lead + motion.motion_time + motion.trail
    times = _grid(plan, duration)
    path = ThereAndBack(start=motion.lead, duration=motion.motion_time, travel=travel)
    speed = np.array([path.speed(float(t)) for t in times])
    angle = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]))]) * plan.timestep
    held, rest, commands = _driven(arm, plan, posture, times)
    k, n = arm.index(plan.joint), arm.reduction_ratio(plan.joint)
    commands[:, held.actuator(plan.joint + DRIVE)] = drive_command(
        held, plan.joint, rest.rotor[k] + angle, speed, rest.torque[k]
    )
    commands[:, held.actuator(plan.joint + TORQUE)] = n * _drive_noise(plan, times, rng)
    return _driven_take(plan, step_arm(held, rest, commands), posture, duration, n * speed)


def _driven(
    arm: ElasticArm, plan: ArmPlan, posture: Mapping[str, float], times: Real
) -> tuple[HeldArm, Rest, Real]:
    """The arm with every joint on its drive, and the commands that hold it."""
    hold: dict[str, HoldKind] = dict.fromkeys(arm.rotors, "drive")
    held = hold_arm(
        arm, hold, posture, timestep=plan.timestep, driven=[plan.joint], probes=[s.probe for s in plan.sensors]
    )
    rest = equilibrium(held, posture)
    commands = np.zeros((times.size, held.model.nu))
    for k, name in enumerate(arm.rotors):
        commands[:, held.actuator(name + DRIVE)] = drive_command(
            held, name, np.full(times.size, rest.rotor[k]), np.zeros(times.size), rest.torque[k]
        )
    return held, rest, commands


def _driven_take(
    plan: ArmPlan, trajectory: Trajectory, posture: Mapping[str, float], duration: float, speed_command: Real
) -> Take:
    arm = trajectory.held.arm
    output = trajectory.force(plan.joint + DRIVE) + trajectory.force(plan.joint + TORQUE)
    return Take(
        trajectory=trajectory, hold=dict.fromkeys(arm.rotors, "drive"), posture=posture, duration=duration,
        torque=output / arm.reduction_ratio(plan.joint), speed_command=speed_command,
    )  # fmt: skip


def _drive_noise(plan: ArmPlan, times: Real, rng: np.random.Generator) -> Real:
    """Band-limited torque noise of the drive [N m on the motor shaft], faded in over 0.1 s, shape (n,)."""
    if plan.drive_noise == 0.0:
        return np.zeros_like(times)
    share = min(0.99, 2.0 * plan.drive_noise_band * plan.timestep)
    low_pass = signal.butter(4, share, output="sos")
    noise = np.asarray(signal.sosfilt(low_pass, rng.normal(size=times.size)))
    return np.asarray(
        noise * (plan.drive_noise / np.std(noise)) * np.clip(times / 0.1, 0.0, 1.0), dtype=np.float64
    )


def _grid(plan: ArmPlan, duration: float) -> Real:
    steps = round((duration + plan.chain.reach(plan.timestep)) / plan.timestep)
    return np.asarray(np.arange(steps) * plan.timestep, dtype=np.float64)
