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
