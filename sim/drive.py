"""The servo drive in speed control: a PI law on encoder increments, with a torque limit, once per drive cycle."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

from jointscope.errors import JointscopeError
from jointscope.sim.measurement_sensors import Encoder
from jointscope.sim.stepping import Controller


class DriveError(JointscopeError):
    """The drive's settings can't work."""


@dataclass(frozen=True, kw_only=True)
class SpeedDrive:
    """T_e = sat(K_p e + K_i int e dt + J_f w_c' + b_f w_c + T_0), e = w_c - w_m, on the motor shaft.

    The current loop is ideal: the torque is what was asked for, held over a cycle. The integrator stops at the limit.

    Attributes:
        proportional: K_p [N m s/rad]; the default gives about 15 Hz on the paper's rig.
        integral: K_i [N m/rad].
        acceleration_feedforward: J_f [kg m^2].
        velocity_feedforward: b_f [N m s/rad].
        torque_limit: [N m].
        cycle: Of the speed loop [s].
        encoder: Seen by the loop.
    """

    proportional: float = 0.08
    integral: float = 1.6
    acceleration_feedforward: float = 0.0
    velocity_feedforward: float = 0.0
    torque_limit: float = 4.8
    cycle: float = 250e-6
    encoder: Encoder = field(default_factory=Encoder)

    def __post_init__(self) -> None:
        if self.proportional < 0.0 or self.integral < 0.0 or self.torque_limit <= 0.0 or self.cycle <= 0.0:
            raise DriveError(f"{self}: needs gains >= 0, a positive torque_limit and a positive cycle")


def speed_loop(
    drive: SpeedDrive,
    command: Callable[[float], float],
    *,
    reduction_ratio: float,
    motor_angle: float,
    holding_torque: float,
) -> Controller:
    """The running drive of one take.

    Args:
        drive: Its settings.
        command: Commanded motor speed [rad/s] as a function of time [s].
        reduction_ratio: n.
        motor_angle: q_s at rest before the take [rad], at the joint output.
        holding_torque: T_0 that holds the arm there [N m].
    """
    count = 2.0 * math.pi / drive.encoder.counts_per_turn
    limit, cycle = drive.torque_limit, drive.cycle

    def read(q_s: float) -> float:
        return round(reduction_ratio * q_s / count) * count

    last = read(motor_angle)
    last_command = command(0.0)
    integrator = holding_torque
    torque = holding_torque
    last_time, due = -cycle, 0.0

    def control(t: float, motor_angle: float) -> float:
        nonlocal last, last_command, last_time, integrator, torque, due
        if t < due - 1e-9:
            return torque
        due += cycle
        elapsed = t - last_time  # the cycle, or the steps nearest to it
        angle, wanted = read(motor_angle), command(t)
        error = wanted - (angle - last) / elapsed
        feedforward = (
            drive.acceleration_feedforward * (wanted - last_command) / elapsed
            + drive.velocity_feedforward * wanted
        )
        asked = drive.proportional * error + integrator + feedforward
        torque = min(max(asked, -limit), limit)
        if torque == asked or (asked - torque) * error < 0.0:
            integrator += drive.integral * error * elapsed
        last, last_command, last_time = angle, wanted, t
        return torque

    return control
