"""Fourth-order Runge-Kutta for the base model, compiled: smooth inputs given at every step and half step.

The classical scheme needs its inputs at the ends and the middle of a step; given those (``bandlimited`` reads them off
the record), the error of a step is O(h^5) in the plant and in the input alike, and gravity's cosine costs nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from jointscope.prediction.plant import Plant

Real = NDArray[np.float64]

_MOTOR = {"free": 0, "held": 1, "moves": 2, "rigid": 3}


@dataclass(frozen=True, kw_only=True, eq=False)
class Loop:
    """A speed loop around the plant: T_e = log + share (law - log), the log being the torque that is given.

    law = sat(K_p e + K_i z + J_f w_c' + b_f w_c + T_0), e = w_c - n q_s' on the motor shaft, z' = e, held while the law
    is at its limit and e pushes further.

    Attributes:
        command: w_c at steps and half steps [rad/s, motor shaft], shape (2 n - 1,).
        command_rate: w_c' likewise [rad/s^2].
        law: (K_p [N m s/rad], K_i [N m/rad], J_f [kg m^2], b_f [N m s/rad], T_0 [N m], limit [N m]), shape (6,).
        share: Of the law, 0 (the log alone) to 1 (the law alone) [-].
    """

    command: Real
    command_rate: Real
    law: Real
    share: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """What the plant did, at each step; every array has shape (n,). Angles at the joint output.

    Attributes:
        start: Time of the first step [s].
        rate: Steps per second [Hz].
        motor_angle, motor_speed, motor_acceleration: q_s and its derivatives [rad, rad/s, rad/s^2].
        angle, speed, acceleration: q and its derivatives [rad, rad/s, rad/s^2].
        torque: T_e that acted [N m, motor shaft].
    """

    start: float
    rate: float
    motor_angle: Real
    motor_speed: Real
    motor_acceleration: Real
    angle: Real
    speed: Real
    acceleration: Real
    torque: Real

    @property
    def times(self) -> Real:
        """[s], shape (n,)."""
        return self.start + np.arange(self.angle.size) / self.rate


def integrate(
    plant: Plant,
    *,
    start: float,
    rate: float,
    arm_angle: float,
    motor_torque: Real,
    load_torque: Real,
    prescribed: Real | None = None,
    loop: Loop | None = None,
) -> Motion:
    """Step the plant from rest at ``arm_angle``.

    Args:
        plant: Equations of motion.
        start: Time of the first step [s].
        rate: Steps per second [Hz].
        arm_angle: q at the first step [rad]; the spring carries gravity.
        motor_torque: T_e at steps and half steps [N m, motor shaft], shape (2 n - 1,).
        load_torque: External torque on the load likewise [N m].
        prescribed: Angle, speed and acceleration of the side that is moved, at the joint output, shape (3, 2 n - 1).
        loop: The drive's speed loop, or ``None`` where the torque acts as given.

    Returns:
        The motion at n steps.
    """
    moved = np.zeros((3, motor_torque.size)) if prescribed is None else np.ascontiguousarray(prescribed)
    nothing = np.zeros(motor_torque.size)
    law = np.zeros(7) if loop is None else np.array([*loop.law, loop.share])
    command = nothing if loop is None else np.ascontiguousarray(loop.command)
    command_rate = nothing if loop is None else np.ascontiguousarray(loop.command_rate)
    q, q_s = arm_angle, plant.resting_motor_angle(arm_angle)
    w, w_s = 0.0, 0.0
    if plant.load_moves:
        q, w = moved[0, 0], moved[1, 0]
        if plant.motor == "free":
            q_s, w_s = plant.resting_motor_angle(q), w
    elif plant.motor == "moves":
        q_s, w_s = moved[0, 0], moved[1, 0]
        q = q_s - (plant.resting_motor_angle(arm_angle) - arm_angle)
        w = w_s
    constants = np.array(
        [
            plant.motor_inertia, plant.load_inertia, plant.stiffness, plant.damping, plant.motor_damping,
            plant.load_damping, plant.gravity_moment, plant.gain, plant.ratio,
        ]
    )  # fmt: skip
    columns = _march(
        _MOTOR[plant.motor], int(plant.load_moves), constants, np.array([q_s, w_s, q, w, 0.0]), 1.0 / rate,
        np.ascontiguousarray(motor_torque), np.ascontiguousarray(load_torque), moved,
        command, command_rate, law,
    )  # fmt: skip
    names = ("motor_angle", "motor_speed", "motor_acceleration", "angle", "speed", "acceleration", "torque")
    return Motion(start=start, rate=rate, **dict(zip(names, columns, strict=True)))


@numba.njit(cache=True)
def _torque(x, log, command, command_rate, law, n):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """(T_e, z')."""
    if law[6] == 0.0:
        return log, 0.0
    e = command - n * x[1]
    wanted = law[0] * e + law[1] * x[4] + law[2] * command_rate + law[3] * command + law[4]
    allowed = min(max(wanted, -law[5]), law[5])
    winds_up = (wanted > law[5] and e > 0.0) or (wanted < -law[5] and e < 0.0)
    return log + law[6] * (allowed - log), 0.0 if winds_up else e


@numba.njit(cache=True)
def _slope(motor, moves, p, x, log, outside, moved, command, command_rate, law, dx):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Write x' into ``dx`` for x = (q_s, q_s', q, q', z); return T_e."""
    J_M, J_L, K, c, b_m, b_l, G, gain, n = p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7], p[8]
    q_s, w_s, q, w = x[0], x[1], x[2], x[3]
    if motor == 2:
        q_s, w_s = moved[0], moved[1]
    if moves == 1:
        q, w = moved[0], moved[1]
    T_e, dx[4] = _torque(x, log, command, command_rate, law, n)
    T_S = gain * T_e if motor == 3 else K * (q_s - q) + c * (w_s - w)
    dx[2], dx[3] = w, (T_S + outside - b_l * w - G * np.cos(q)) / J_L
    if moves == 1:
        dx[3] = moved[2]
    dx[0], dx[1] = w_s, 0.0
    if motor == 0:
        dx[1] = (gain * T_e - T_S - b_m * w_s) / J_M
    elif motor == 2:
        dx[1] = moved[2]
    elif motor == 3:
        dx[0], dx[1] = dx[2], dx[3]
    return T_e


@numba.njit(cache=True)
def _march(motor, moves, p, x, h, log, outside, moved, command, command_rate, law):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    steps = log.size // 2 + 1
    out = np.empty((7, steps))
    k1, k2, k3, k4 = np.empty(5), np.empty(5), np.empty(5), np.empty(5)
    for i in range(steps):
        a = 2 * i
        if motor == 2:
            x[0], x[1] = moved[0, a], moved[1, a]
        if moves == 1:
            x[2], x[3] = moved[0, a], moved[1, a]
        T_e = _slope(motor, moves, p, x, log[a], outside[a], moved[:, a], command[a], command_rate[a], law, k1)
        out[0, i], out[1, i], out[2, i] = x[0], x[1], k1[1]
        out[3, i], out[4, i], out[5, i], out[6, i] = x[2], x[3], k1[3], T_e
        if i == steps - 1:
            break
        b, d = a + 1, a + 2
        _slope(
            motor, moves, p, x + 0.5 * h * k1, log[b], outside[b], moved[:, b], command[b], command_rate[b],
            law, k2,
        )  # fmt: skip
        _slope(
            motor, moves, p, x + 0.5 * h * k2, log[b], outside[b], moved[:, b], command[b], command_rate[b],
            law, k3,
        )  # fmt: skip
        _slope(motor, moves, p, x + h * k3, log[d], outside[d], moved[:, d], command[d], command_rate[d], law, k4)
        x = x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return out
