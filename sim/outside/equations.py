"""The joint's equations of motion and a fixed-step Runge-Kutta integrator of order 4, compiled as one file.

With q_s the motor's angle over n, q the arm's, d = q_s - q + e and e the kinematic error:

    J_M q_s'' = T_act - T_S - b_m q_s' + ripple - friction
    J_L q''   = T_S - b_l q' - m g r cos q - friction - drag - stop - cable - grease + shaking + hammer

    T_S = elastic(d) + c d' + Dahl and Maxwell elements
"""

from __future__ import annotations

import math
from typing import Final

import numba
import numpy as np
from numpy.typing import NDArray

from jointscope.sim.outside.layout import (
    ACTING,
    ARM_ACCELERATION,
    ARM_ANGLE,
    ARM_RATE,
    BRISTLE,
    CABLE,
    CARRIED,
    DRIVE,
    FURTHER,
    FURTHER_RATE,
    INTEGRAL,
    JOINT_TORQUE,
    LOSS,
    MOTOR_ANGLE,
    MOTOR_RATE,
    Q_S,
    SLIP,
    STATES,
    STORED,
    STRUCTURE,
    W_S,
    Q,
    W,
)
from jointscope.sim.outside.physics import (
    HELD,
    LOAD_SPEED,
    MOTOR_SPEED,
    OUTER_BODY,
    RIGID,
    TORQUE,
    Control,
    Physics,
)

Real = NDArray[np.float64]

SECOND_PHASE: Final = 0.7  # of the kinematic error's harmonics [rad]
THIRD_PHASE: Final = 2.1
RIPPLE_PHASE: Final = 1.1  # of the ripple's second harmonic [rad]
CONTACT: Final = 0.1  # share of the gap over which damping grows to c in contact
CABLE_SIDE: Final = 0.15  # rad from the reference, where the cable's loop begins to bend
CABLE_SHARPNESS: Final = 4.0  # 1/rad


@numba.njit(cache=True)
def kinematic_error(p: Physics, q_s: float, w_s: float, q: float, w: float) -> tuple[float, float]:
    """e = A [sin a + h_2 sin(2 a + 0.7) + h_3 sin(3 a + 2.1)] [rad] and its rate [rad/s]; a = order n q_s + phase."""
    turned, rate = (q, w) if p.error_of_output > 0.5 else (p.ratio * q_s, p.ratio * w_s)
    a = p.error_order * turned + p.error_phase
    second, third = 2.0 * a + SECOND_PHASE, 3.0 * a + THIRD_PHASE
    value = math.sin(a) + p.error_second * math.sin(second) + p.error_third * math.sin(third)
    slope = math.cos(a) + 2.0 * p.error_second * math.cos(second) + 3.0 * p.error_third * math.cos(third)
    return p.error * value, p.error * slope * p.error_order * rate


@numba.njit(cache=True)
def elastic(p: Physics, d: float, stiffness: float) -> tuple[float, float]:
    """K x + K_3 x^3 - T_1 tanh(x/d_1) [N m] and x [rad], the wind-up d less the play."""
    side = 0.5 * p.gap
    x = d
    if side > 0.0:
        x = d - side if d > side else (d + side if d < -side else 0.0)
    torque = stiffness * x + p.cubic * x * x * x
    if p.soft_width > 0.0:
        torque -= p.soft_torque * math.tanh(x / p.soft_width)
    return torque, x


@numba.njit(cache=True)
def stiffness_at(p: Physics, q_s: float, t: float) -> float:
    """K (1 + rate t) (1 + a sin(order n q_s + phase)) [N m/rad]."""
    turning = 1.0 + p.turning_stiffness * math.sin(p.turning_order * p.ratio * q_s + p.turning_phase)
    return p.stiffness * (1.0 + p.stiffness_rate * t) * turning


@numba.njit(cache=True)
def ripple(p: Physics, q_s: float) -> float:
    """A [sin a + h_2 sin(2 a + 1.1)] [N m], a = order n q_s + phase."""
    a = p.ripple_order * p.ratio * q_s + p.ripple_phase
    return p.ripple * (math.sin(a) + p.ripple_second * math.sin(2.0 * a + RIPPLE_PHASE))


@numba.njit(cache=True)
def friction_level(w: float, level: float, breakaway: float, falls: float, asymmetry: float) -> float:
    """T (1 +- a) + (T_s - T) exp(-(w/w_s)^2) [N m], positive."""
    found = level * (1.0 + (asymmetry if w > 0.0 else -asymmetry))
    if falls > 0.0:
        found += (breakaway - level) * math.exp(-((w / falls) ** 2))
    return found


@numba.njit(cache=True)
def drive_torque(c: Control, y: Real, u: float, mode: float, dy: Real) -> float:
    """The drive's torque as it is logged [N m]."""
    if mode == TORQUE:
        return float(c.preload + u + c.hold * (c.reference - y[Q_S]) - c.hold_rate * y[W_S])
    if mode == MOTOR_SPEED or mode == LOAD_SPEED:
        error = u - (y[W_S] if mode == MOTOR_SPEED else y[W])
        dy[INTEGRAL] = error
        return float(c.preload + c.proportional * error + c.integral * y[INTEGRAL])
    return 0.0


@numba.njit(cache=True)
def acting_torque(p: Physics, y: Real, logged: float, t: float, dy: Real) -> float:
    """What the motor makes of the logged torque [N m]: gain, first-order lag, a torque constant that warms."""
    gain = p.gain
    if p.warming != 0.0:
        gain *= 1.0 - p.warming * (1.0 - math.exp(-t / p.warming_time))
    if p.lag > 0.0:
        dy[ACTING] = (logged - y[ACTING]) / p.lag
        return float(y[ACTING] * gain)
    return logged * gain


@numba.njit(cache=True)
def transmitted(p: Physics, y: Real, t: float, dy: Real) -> float:
    """T_S [N m]; Dahl: z' = d' - |d'| z/width, Maxwell: s' = d' - s/tau."""
    error, error_rate = 0.0, 0.0
    if p.error != 0.0:
        error, error_rate = kinematic_error(p, y[Q_S], y[W_S], y[Q], y[W])
    rate = y[W_S] - y[W] + error_rate
    torque, x = elastic(p, y[Q_S] - y[Q] + error, stiffness_at(p, y[Q_S], t))
    touching = min(1.0, abs(x) / (CONTACT * p.gap)) if p.gap > 0.0 else 1.0
    torque += p.damping * touching * rate
    for i in range(int(p.slip_count)):
        z = y[SLIP + i]
        torque += p.slip_stiffness[i] * z
        dy[SLIP + i] = rate - abs(rate) * z / p.slip_width[i]
    for i in range(int(p.loss_count)):
        s = y[LOSS + i]
        torque += p.loss_stiffness[i] * s
        dy[LOSS + i] = rate - s / p.loss_time[i]
    return float(torque)


@numba.njit(cache=True)
def resistance(p: Physics, c: Control, y: Real, dy: Real) -> float:
    """What holds the arm back [N m]: damping, gravity, friction, drag, stop, cable, grease."""
    q, w = y[Q], y[W]
    torque = p.load_damping * w + p.gravity * math.cos(q) + p.drag * w * abs(w)
    if p.load_friction != 0.0:
        level = friction_level(w, p.load_friction, p.load_breakaway, p.load_stribeck_speed, p.load_asymmetry)
        torque += level * math.tanh(w / p.load_smoothing)
    if p.stop_stiffness > 0.0:
        depth = p.stop_side * (q - p.stop_angle)
        if depth > 0.0:  # it pushes, never pulls
            torque += p.stop_side * max(0.0, p.stop_stiffness * depth + p.stop_damping * p.stop_side * w)
    if p.cable_torque != 0.0:
        dy[CABLE] = w - abs(w) * y[CABLE] / p.cable_width
        side = 1.0 + p.cable_bend * math.tanh(CABLE_SHARPNESS * (q - c.reference - CABLE_SIDE))
        torque += p.cable_torque / p.cable_width * y[CABLE] * side
    if p.grease != 0.0:
        dy[STRUCTURE] = (1.0 - y[STRUCTURE]) / p.grease_recovery - abs(w) * y[STRUCTURE] / p.grease_shear
        torque += p.grease * y[STRUCTURE] * w
    return float(torque)


@numba.njit(cache=True)
def bodies(p: Physics, y: Real, torque: float, force: float, dy: Real) -> tuple[float, float]:
    """The arm's acceleration [rad/s^2] under ``torque``, and what a moving carrier adds at the sensor [m/s^2].

    Carrier x, with mu = coupling cos(q - q_0), psi = q - q_0, F the hammer's force:
    J_L q'' + mu x'' = torque; mu q'' + M x'' = -k x - c x' + lever cos(psi) F + coupling sin(psi) q'^2.
    """
    if p.further == RIGID:
        return torque / p.load_inertia, 0.0
    x, rate = y[FURTHER], y[FURTHER_RATE]
    dy[FURTHER] = rate
    if p.further == OUTER_BODY:
        bent = p.further_stiffness * (x - y[Q]) + p.further_damping * (rate - y[W])
        dy[FURTHER_RATE] = -bent / p.further_inertia
        return (torque + bent) / p.load_inertia, 0.0
    psi = y[Q] - p.coupling_angle
    mu = p.coupling * math.cos(psi)
    lever = p.lever * math.cos(psi)
    other = -p.further_stiffness * x - p.further_damping * rate + force * lever
    other += p.coupling * math.sin(psi) * y[W] * y[W]
    whole = p.load_inertia * p.further_inertia - mu * mu
    dy[FURTHER_RATE] = (p.load_inertia * other - mu * torque) / whole
    return (torque * p.further_inertia - mu * other) / whole, lever * dy[FURTHER_RATE]


@numba.njit(cache=True)
def turn_motor(p: Physics, y: Real, acting: float, joint: float, dy: Real) -> None:
    """The motor's motion; LuGre: z' = w - sigma_0 |w| z/T(w), friction sigma_0 z + sigma_1 z'."""
    w = y[W_S]
    torque = acting - joint - p.motor_damping * w + ripple(p, y[Q_S])
    if p.loaded_friction != 0.0:
        torque -= p.loaded_friction * abs(joint) * math.tanh(w / p.loaded_smoothing)
    if p.motor_friction != 0.0:
        level = friction_level(w, p.motor_friction, p.motor_breakaway, p.motor_stribeck_speed, p.motor_asymmetry)
        if p.motor_bristles > 0.5:
            dy[BRISTLE] = w - p.bristle_stiffness * abs(w) / level * y[BRISTLE]
            torque -= p.bristle_stiffness * y[BRISTLE] + p.bristle_damping * dy[BRISTLE]
        else:
            torque -= level * math.tanh(w / p.motor_smoothing)
    dy[Q_S] = w
    dy[W_S] = torque / p.motor_inertia


@numba.njit(cache=True)
def rates(p: Physics, c: Control, y: Real, t: float, u: float, mode: float, dy: Real, out: Real) -> None:
    """Put y' into ``dy`` and what is stored into ``out``."""
    dy[:] = 0.0
    logged = drive_torque(c, y, u, mode, dy)
    acting = acting_torque(p, y, logged, t, dy)
    joint = transmitted(p, y, t, dy)
    torque = joint - resistance(p, c, y, dy)
    force, carried = 0.0, 0.0
    if mode == HELD:
        force = u
        torque += c.push * u
    elif mode == LOAD_SPEED:
        torque += acting
    if p.shaking != 0.0:
        shaking = p.shaking * math.sin(2.0 * math.pi * p.shaking_frequency * t + p.shaking_phase)
        if p.shaken_moment > 0.0:
            torque -= p.shaken_moment * shaking
            carried = shaking
        else:
            torque += shaking
    acceleration, moved = bodies(p, y, torque, force, dy)
    dy[Q], dy[W] = y[W], acceleration
    if mode == TORQUE or mode == MOTOR_SPEED:
        turn_motor(p, y, acting, joint, dy)
    elif p.brake_torque > 0.0 and abs(joint) > p.brake_torque:
        dy[Q_S] = -(abs(joint) - p.brake_torque) * np.sign(joint) / p.brake_damping
    out[MOTOR_ANGLE], out[MOTOR_RATE], out[ARM_ANGLE], out[ARM_RATE] = y[Q_S], y[W_S], y[Q], y[W]
    out[ARM_ACCELERATION], out[CARRIED], out[DRIVE], out[JOINT_TORQUE] = (
        acceleration,
        carried + moved,
        logged,
        joint,
    )


@numba.njit(cache=True)
def ahead(y: Real, slope: Real, step: float, moved: Real) -> None:
    """Put y + step slope into ``moved``."""
    for i in range(STATES):
        moved[i] = y[i] + step * slope[i]


@numba.njit(cache=True)
def integrate(
    p: Physics, c: Control, y: Real, programme: Real, steps: int, settling: int, step: float, store: int
) -> Real:
    """March ``y`` (changed in place) through a run; every ``store``-th step, shape (steps // store, STORED).

    Args:
        p: The joint, packed.
        c: The drive, packed.
        y: State at the start.
        programme: Its input on half steps, shape (2 steps + 1 or more,).
        steps: From t = 0 on.
        settling: Steps before t = 0, with the motor held and no input.
        step: [s].
        store: Steps between stored samples.
    """
    found = np.zeros((steps // store, STORED))
    k1, k2, k3, k4 = np.zeros(STATES), np.zeros(STATES), np.zeros(STATES), np.zeros(STATES)
    moved, out, unused = np.zeros(STATES), np.zeros(STORED), np.zeros(STORED)
    for k in range(-settling, steps):
        t, mode = k * step, HELD if k < 0 else c.mode
        u1, u2, u3 = (programme[2 * k], programme[2 * k + 1], programme[2 * k + 2]) if k >= 0 else (0.0, 0.0, 0.0)
        rates(p, c, y, t, u1, mode, k1, out)
        if k >= 0 and k % store == 0 and k // store < found.shape[0]:
            found[k // store] = out
        ahead(y, k1, 0.5 * step, moved)
        rates(p, c, moved, t + 0.5 * step, u2, mode, k2, unused)
        ahead(y, k2, 0.5 * step, moved)
        rates(p, c, moved, t + 0.5 * step, u2, mode, k3, unused)
        ahead(y, k3, step, moved)
        rates(p, c, moved, t + step, u3, mode, k4, unused)
        for i in range(STATES):
            y[i] += step / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i])
    return found
