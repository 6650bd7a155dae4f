"""Inside a step: inputs at any fraction of it, when dry friction turns or lets go, what hysteresis remembers."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.kernel.compiled import Real, compiled
from jointscope.diagnosis.kernel.laws import bristle, hysteresis
from jointscope.diagnosis.kernel.layout import *


@compiled
def input_at(u: Real, k: int, s: float) -> float:
    """Input at the fraction ``s`` of step ``k``; ``u`` holds half steps."""
    a, b, c = u[2 * k], u[2 * k + 1], u[2 * k + 2]
    return float(a + s * (4.0 * b - 3.0 * a - c) + 2.0 * s * s * (a - 2.0 * b + c))


@compiled
def remember(P: Real, S: NDArray[np.int64], mem: Real, delta: float) -> None:
    """Move the hysteresis memory to wind-up ``delta``."""
    travel = delta - mem[0]
    if S[HYST_KIND] == MAXWELL_SLIP:
        for i in range(SLIP_ELEMENTS):
            limit, j = P[HYST_LEVEL_0 + i], MEM_SLIP + i
            mem[j] = min(max(mem[j] + travel / P[HYST_ANGLE], -limit), limit)
    else:
        mem[1] = hysteresis(mem[1], travel, P[HYST_ANGLE], S[HYST_KIND], P[HYST_SHAPE])
    mem[0] = delta


@compiled
def slide(P: Real, mem: Real, q: float, v: float) -> None:
    """Move the memory of friction with presliding to angle ``q``, reached at speed ``v``."""
    mem[9] = bristle(mem[9], q - mem[8], v, P)
    mem[8] = q


@compiled
def windup_of(x: Real, P: Real, S: NDArray[np.int64], y: float) -> float:
    q_s = y if S[MOTOR] == MOTOR_PRESCRIBED else x[0]
    q = y if S[LOAD_PRESCRIBED] else x[2]
    return windup_of_scalars(q_s, q, P, S)


@compiled
def winding_of(x: Real, S: NDArray[np.int64], w: float) -> float:
    """Rate of the wind-up but for the lines' part; ``w``: the speed that is prescribed."""
    v_s = w if S[MOTOR] == MOTOR_PRESCRIBED else x[1]
    v = w if S[LOAD_PRESCRIBED] else x[3]
    return float(v_s - v)


@compiled
def sets_in_at_once(P: Real) -> bool:
    """Whether a play has flanks whose stiffness is there at once: each crossing is an event."""
    return bool(P[GAP_HALF] > 0.0 and P[GAP_CORNER] == 0.0 and P[GAP_ROUND] == 0.0)


@compiled
def windup_of_scalars(q_s: float, q: float, P: Real, S: NDArray[np.int64]) -> float:
    error = 0.0
    for i in range(S[N_TE]):
        b = TE_0 + 4 * i
        error += P[b] * math.sin(P[b + 1] * (q_s + P[MOTOR_ZERO]) + P[b + 2] * q + P[b + 3])
    return float(q_s + error - q)


@compiled
def direction(net: float, load: float, P: Real, first: int) -> int:
    """Where a contact at rest goes under ``net`` [N m]: 0 while |net| <= breakaway; ``first``: FM_PLUS or FL_PLUS."""
    excess = 1.0 + P[first + 2]
    if net > P[first] * excess + load:
        return 1
    if net < -(P[first + 1] * excess + load):
        return -1
    return 0


@compiled
def release(f0: float, f1: float, g0: float, g1: float, P: Real, first: int, go: int) -> float:
    """Fraction of the interval at which a stuck contact lets go, the net torque taken as a straight line."""
    excess = 1.0 + P[first + 2]
    level = P[first] if go > 0 else P[first + 1]
    over0 = go * f0 - level * excess - g0
    over1 = go * f1 - level * excess - g1
    if over0 >= 0.0 or over1 <= over0:
        return 0.0
    return float(-over0 / (over1 - over0))


@compiled
def flank_of(el: float, half: float) -> int:
    """Which flank of a play a wind-up ``el`` from its centre is on, +1 or -1; 0 between them."""
    if el > half:
        return 1
    return -1 if el < -half else 0


@compiled
def crossing(d0: float, r0: float, d1: float, r1: float) -> float:
    """Fraction of an interval at which what goes from ``d0`` to ``d1`` of the other sign meets nought.

    By Hermite's cubic through both ends, of which ``r0`` and ``r1`` are the rates times the interval.
    """
    if d0 == 0.0 or d0 * d1 > 0.0:
        return 0.0
    low, high, u = 0.0, 1.0, d0 / (d0 - d1)
    cubic, square = 2.0 * (d0 - d1) + r0 + r1, 3.0 * (d1 - d0) - 2.0 * r0 - r1
    for _ in range(20):
        value = d0 + u * (r0 + u * (square + u * cubic))
        if value * d0 > 0.0:
            low = u
        else:
            high = u
        slope = r0 + u * (2.0 * square + 3.0 * u * cubic)
        step = -value / slope if slope != 0.0 else 2.0
        if abs(step) < 1e-9:
            break
        u = u + step if low < u + step < high else 0.5 * (low + high)
    return float(u)


@compiled
def met(before: float, r0: float, after: float, r1: float, half: float, seat: int) -> float:
    """Fraction of an interval at which a play leaves the flank, or the room between, that it is ``seat``ed at; 2 if it does not.

    ``before`` and ``after`` are wind-ups from its centre, of which ``r0`` and ``r1`` are the rates times the interval.
    """
    if flank_of(after, half) == seat:
        return 2.0
    edge = half if seat > 0 or (seat == 0 and after > 0.0) else -half
    return crossing(before - edge, r0, after - edge, r1)
