"""Equations of the test draw's own laws, as the engine steps them: parameters p, state x, signals s, forces f.

Apart from every other draw's: a diagnosis that was tuned on those has not seen these.
"""

from __future__ import annotations

import math

from jointscope.sim.concealed.engine import (
    A_S,
    LOAD,
    MOTOR,
    Q_S,
    SESSION,
    SHAKE,
    T_S,
    TAU,
    TRANSMISSION,
    W_S,
    WINDUP,
    WINDUP_RATE,
    H,
    Q,
    Real,
    T,
    W,
)  # fmt: skip


def slipping_elements(p: Real, x: Real, s: Real, f: Real) -> None:
    """Dry friction as p[0] elements that stick to the shaft, their limits uneven along it: p = n, side, depth, k, ..."""
    q = s[Q_S] if p[1] < 0.5 else s[Q]
    uneven = 1.0 + p[2] * math.sin(p[3] * q)
    for i in range(int(p[0])):
        k, limit = p[4 + 2 * i], p[5 + 2 * i] * uneven
        torque = k * (q - x[i])
        if torque > limit:
            x[i] = q - limit / k
            torque = limit
        elif torque < -limit:
            x[i] = q + limit / k
            torque = -limit
        if p[1] < 0.5:
            f[MOTOR] -= torque
        else:
            f[LOAD] -= torque


def ageing(p: Real, x: Real, s: Real, f: Real) -> None:
    """Contacts that age at rest and renew in sliding: T, rise, v_s, length, bristle stiffness, side."""
    v = s[W_S] if p[5] < 0.5 else s[W]
    h = s[H]
    age = (x[1] + h) / (1.0 + h * abs(v) / p[3])
    x[1] = min(age, 10.0)
    rested = age * p[2] / p[3]
    limit = p[0] * (1.0 + p[1] * rested / (1.0 + rested))
    z = (x[0] + h * v) / (1.0 + h * p[4] * abs(v) / limit)
    torque = p[4] * z + 0.1 * math.sqrt(p[4]) * (z - x[0]) / h
    x[0] = z
    if p[5] < 0.5:
        f[MOTOR] -= torque
    else:
        f[LOAD] -= torque


def knee_loss(p: Real, x: Real, s: Real, f: Real) -> None:
    """Loss p[0] (sqrt(T_S^2 + p[2]^2) - p[2]) against the motor's speed, set-valued at J = p[1]."""
    a = s[A_S]
    v = s[W_S] - 0.5 * s[H] * a
    limit = p[0] * (math.sqrt(s[T_S] ** 2 + p[2] ** 2) - p[2])
    stop = -(p[1] * v / s[H] + p[1] * a - x[0])
    stop = max(-limit, min(limit, stop))
    x[0] = stop
    f[MOTOR] += stop


def late_drag(p: Real, x: Real, s: Real, f: Real) -> None:
    """Quadratic drag beyond a speed: p[0] (|v| - p[1])^2 for |v| > p[1]."""
    over = abs(s[W]) - p[1]
    if over > 0.0:
        f[LOAD] -= p[0] * over * over * math.copysign(1.0, s[W])


def round_teeth(p: Real, x: Real, s: Real, f: Real) -> None:
    """Play with rounded contact, off the middle: K, c, half gap, rounding, offset."""
    d = s[WINDUP] - p[4]
    depth = abs(d) - p[2]
    push = 0.5 * (depth + math.sqrt(depth * depth + p[3] * p[3]))
    share = push / (abs(depth) + p[3])
    f[TRANSMISSION] += p[0] * push * math.copysign(1.0, d) + p[1] * min(share, 1.0) * s[WINDUP_RATE]
    f[TRANSMISSION] -= p[0] * 0.5 * (math.sqrt(p[2] * p[2] + p[3] * p[3]) - p[2]) * math.copysign(1.0, d)


def three_slopes(p: Real, x: Real, s: Real, f: Real) -> None:
    """Added to K: p[0] missing below p[1], half of it missing up to p[2]; p[3] makes one side softer."""
    d = s[WINDUP]
    a = abs(d)
    gone = p[0] * min(a, p[1]) + 0.5 * p[0] * min(max(a - p[1], 0.0), p[2] - p[1])
    side = 1.0 + (p[3] if d > 0.0 else -p[3])
    f[TRANSMISSION] -= gone * side * math.copysign(1.0, d)


def steep_dahl(p: Real, x: Real, s: Real, f: Real) -> None:
    """dT/dDelta = T_h/D (1 - T/T_h sgn v)^p[2]: p = T_h, D."""
    v = s[WINDUP_RATE]
    z = x[0]
    left = max(0.0, 1.0 - z * (1.0 if v > 0.0 else -1.0))
    x[0] = max(-1.0, min(1.0, z + s[H] * v / p[1] * left ** p[2]))
    f[TRANSMISSION] += p[0] * x[0]


def second_order_lag(p: Real, x: Real, s: Real, f: Real) -> None:
    """The rotor's torque follows the logged one as a second-order system: w, zeta.

    Exact over a step in which the log's torque moves along a straight line.
    """
    if x[2] == 0.0:
        x[2], x[0], x[3] = 1.0, s[TAU], s[TAU]
    h, w, zeta = s[H], p[0], p[1]
    damped = w * math.sqrt(1.0 - zeta * zeta)
    rate = (s[TAU] - x[3]) / h
    behind = 2.0 * zeta * rate / w
    e, v = x[0] - x[3] + behind, x[1] - rate
    fade, c, n = math.exp(-zeta * w * h), math.cos(damped * h), math.sin(damped * h) / damped
    x[0] = s[TAU] - behind + fade * (e * (c + zeta * w * n) + v * n)
    x[1] = rate + fade * (v * (c - zeta * w * n) - e * w * w * n)
    x[3] = s[TAU]
    f[MOTOR] += x[0] - s[TAU]


def sagging_gain(p: Real, x: Real, s: Real, f: Real) -> None:
    """Gain off by p[0], falling by the share p[1] with every run's seconds over p[2]."""
    f[MOTOR] += p[0] * (1.0 - p[1] * max(s[T], 0.0) / p[2]) * s[TAU]


def counterweight(p: Real, x: Real, s: Real, f: Real) -> None:
    """A weight on a lever that folds: -p[0] cos q / sqrt(1 + p[1]^2 - 2 p[1] sin q)."""
    f[LOAD] -= p[0] * math.cos(s[Q]) / math.sqrt(1.0 + p[1] * p[1] - 2.0 * p[1] * math.sin(s[Q]))


def rubber(p: Real, x: Real, s: Real, f: Real) -> None:
    """A rubber stop beyond p[0] on side p[1]: k (d + d^2/p[3]) and damping p[4] k d d'."""
    d = (s[Q] - p[0]) * p[1]
    if d > 0.0:
        push = p[2] * (d + d * d / p[3] + p[4] * d * s[W] * p[1])
        if push > 0.0:
            f[LOAD] -= push * p[1]


def relaxing(p: Real, x: Real, s: Real, f: Real) -> None:
    """K p[1] log(1 + session/p[2]) added to the spring."""
    f[TRANSMISSION] += p[0] * p[1] * math.log(1.0 + max(s[SESSION], 0.0) / p[2]) * s[WINDUP]


def wandering_line(p: Real, x: Real, s: Real, f: Real) -> None:
    """A shaken floor whose frequency wanders: p[0] sin(2 pi p[1] t + p[3] sin(2 pi p[4] t) + p[2])."""
    t = s[T]
    f[SHAKE] += p[0] * math.sin(2.0 * math.pi * p[1] * t + p[3] * math.sin(2.0 * math.pi * p[4] * t) + p[2])
