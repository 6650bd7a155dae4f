r"""The reduced-order joint, compiled once: two inertias, every catalogue effect switchable by a number.

All at the joint output, q_s = motor angle / n, Delta = q_s + e - q (e: kinematic error):

    J_L q'' + b_l q' = T_S + T_ext - gravity(q) + load forces
    J_M q_s'' + b_m q_s' = tau - T_S + motor forces
    T_S = K Delta + c Delta' + transmission laws

Fixed-step fourth-order Runge-Kutta. Dry friction is handled exactly: inside a step its direction is fixed, a reversal
is located, the velocity set to zero there, and the contact sticks for as long as the net torque stays below breakaway
(no smoothed sign). Rate-independent hysteresis is closed-form along the step, so it adds no stiffness. Play and stops
are exact piecewise laws.

One file, because compiled code is cached per file: a law changed in another one would not be compiled anew.

With a recorded angle a fixed-gain observer moves the rigid body only (both inertias alike, so the wind-up is left
alone): x' = f(x, u) + L (y - C x).
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numba import njit
from numpy.typing import NDArray

Real = NDArray[np.float64]
_compiled = njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "nsz"})
_inlined = njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "nsz"}, inline="always")

# --- numbers of the packed vector P -------------------------------------------------------------------------------
J_M, J_L, K, C, B_M, B_L = 0, 1, 2, 3, 4, 5
G_COS, G_SIN, G_CONST = 6, 7, 8  # gravity: -(G_COS cos q - G_SIN sin q) - G_CONST [N m]
GAP_HALF, GAP_CENTRE, GAP_DAMPING = 9, 10, 11  # half play [rad], its centre [rad], share of c inside it [-]
K_2, K_3, K_SOFT, SOFT_ANGLE = 12, 13, 14, 15  # K_SOFT: stiffness missing within +-SOFT_ANGLE
HYST_TORQUE, HYST_ANGLE = 16, 17
REID, REID_OMEGA = 18, 19  # loss factor of the rate-independent structural law, and its scaling frequency [rad/s]
DRIFT = 20  # relative stiffness change per second [1/s]
FM_PLUS, FM_MINUS, FM_EXCESS, FM_SPEED, FM_EXPONENT, FM_LOAD = 21, 22, 23, 24, 25, 26
FL_PLUS, FL_MINUS, FL_EXCESS, FL_SPEED, FL_EXPONENT, FL_LOAD = 27, 28, 29, 30, 31, 32
C_QUADRATIC = 33
STOP_ANGLE, STOP_K, STOP_C, STOP_EXPONENT, STOP_SIDE = 34, 35, 36, 37, 38
LINK_J, LINK_OMEGA, LINK_ZETA, LINK_HIT, LINK_SENSE = 39, 40, 41, 42, 43
NEAR_J, NEAR_OMEGA, NEAR_ZETA = 44, 45, 46
BASE_SHARE, BASE_OMEGA, BASE_ZETA = 47, 48, 49
LOOP_MIX, LOOP_P, LOOP_I, LOOP_LIMIT = 50, 51, 52, 53
OBS_1, OBS_2, OBS_QS, OBS_VS, OBS_Q, OBS_V = 54, 55, 56, 57, 58, 59
MOTOR_ZERO = 60  # recorded motor angle / n minus the model's q_s [rad]: phase reference of motor orders
TE_0 = 61  # three lines of (amplitude, per q_s, per q, phase)
RIPPLE_0 = 73  # three lines of (amplitude, share of tau, per q_s, phase)
BRANCH_0 = 85  # five branches of (stiffness, relaxation time)
TABLE_LOW, TABLE_STEP, TABLE_0 = 95, 96, 97  # a law as torque [N m] at nodes of a variable
N_NODES = 9
C_SIDED = 106  # viscous damping more in positive motion and less in negative [N m s/rad]
PRE_TORQUE, PRE_ANGLE = 107, 108  # dry friction with presliding: torque [N m], angle over which it builds up [rad]
N_P = 109

# --- integers of the switch vector S ------------------------------------------------------------------------------
N_X, AT_LINK, AT_NEAR, AT_BASE, AT_BRANCH, N_BRANCH, AT_LOOP = 0, 1, 2, 3, 4, 5, 6
MOTOR, HYST_KIND, N_TE, N_RIPPLE, FRICTION_M, FRICTION_L, LOAD_PRESCRIBED = 7, 8, 9, 10, 11, 12, 13
TABLE_SITE, TABLE_OF = 14, 15
PRE_SITE = 16
N_S = 17
MOTOR_FREE, MOTOR_HELD, MOTOR_PRESCRIBED = 0, 1, 2
DAHL, BOUC_WEN, MAXWELL_SLIP = 1, 2, 3
AT_MOTOR, AT_LOAD, AT_TRANSMISSION = 1, 2, 3  # TABLE_SITE
OF_SPEED, OF_ANGLE, OF_WIND_UP, OF_WIND_UP_RATE, OF_TURN = 0, 1, 2, 3, 4  # TABLE_OF; of turn: a stiffness

# --- columns of the result ----------------------------------------------------------------------------------------
X_QS, X_VS, X_AS, X_Q, X_V, X_A, X_LINK, X_TS, X_TAU, X_TEXT = 0, 1, 2, 3, 4, 5, 6, 7, 8, 9
N_OUT = 10

_N_AUX = 16
_STRUCTURAL_WIDTH = 0.05  # of the velocity amplitude at REID_OMEGA over which the structural law turns round
_MAX_EVENTS = 12
_TURN = 0.02  # rad over which weight is expanded to third order (1e-8)


@_compiled
def _loop(z: float, d: float, y: float, kind: int) -> float:
    """Normalised hysteretic torque after a monotone travel ``d`` from the state ``z``; yield angle ``y``."""
    if d == 0.0:
        return z
    s = 1.0 if d > 0.0 else -1.0
    r = abs(d) / y
    if kind == 1:
        return s + (z - s) * math.exp(-r)
    u = s * z
    if u < 0.0:  # Bouc-Wen, nu = 2, beta = gamma = 1/2: unloading is linear
        if r <= -u:
            return s * (u + r)
        r += u
        u = 0.0
    if u > 0.999999:
        return s
    return s * math.tanh(math.atanh(u) + r)


@_compiled
def _elastic(P: Real, delta: float, factor: float) -> tuple[float, float]:
    """Elastic part of T_S at wind-up ``delta`` [rad] -> (torque [N m], share of c that acts [-])."""
    el = delta
    contact = 1.0
    if P[GAP_HALF] > 0.0:
        el = delta - P[GAP_CENTRE]
        if el > P[GAP_HALF]:
            el -= P[GAP_HALF]
        elif el < -P[GAP_HALF]:
            el += P[GAP_HALF]
        else:
            el = 0.0
            contact = P[GAP_DAMPING]
    torque = factor * P[K] * el
    if P[K_3] != 0.0 or P[K_2] != 0.0:
        torque += (P[K_2] + P[K_3] * el) * el * el
    if P[K_SOFT] != 0.0:
        torque -= P[K_SOFT] * min(max(el, -P[SOFT_ANGLE]), P[SOFT_ANGLE])
    return torque, contact


@_compiled
def windup(P: Real, torque: float) -> float:
    """Static wind-up [rad] at which the elastic part of T_S equals ``torque`` [N m]; the nearer edge of the play."""
    if P[K] <= 0.0:
        return 0.0
    if torque == 0.0:
        return 0.0 if abs(P[GAP_CENTRE]) <= P[GAP_HALF] or P[GAP_HALF] == 0.0 else P[GAP_CENTRE]
    guess = torque / P[K]
    reach = 4.0 * abs(guess) + 2.0 * P[GAP_HALF] + abs(P[GAP_CENTRE])
    low, high = -reach, reach
    for _ in range(80):
        middle = 0.5 * (low + high)
        value, _contact = _elastic(P, middle, 1.0)
        if value < torque:
            low = middle
        else:
            high = middle
    return float(0.5 * (low + high))


@_compiled
def _friction(plus: float, minus: float, excess: float, speed: float, exponent: float, v: float, s: int) -> float:
    """Dry friction's level against direction ``s`` at speed ``v`` [N m]."""
    level = plus if s > 0 else minus
    if excess != 0.0 and level != 0.0:
        r = abs(v) / speed
        level *= 1.0 + excess * math.exp(-(r * r if exponent == 2.0 else r**exponent))
    return level


@_compiled
def tabled(P: Real, variable: float) -> float:
    """The table's torque [N m] at ``variable``: straight between nodes, constant outside them."""
    at = (variable - P[TABLE_LOW]) / P[TABLE_STEP]
    if at <= 0.0:
        return float(P[TABLE_0])
    if at >= N_NODES - 1.0:
        return float(P[TABLE_0 + N_NODES - 1])
    node = int(at)
    part = at - node
    return float((1.0 - part) * P[TABLE_0 + node] + part * P[TABLE_0 + node + 1])


def _rates_source(
    x: Real,
    dx: Real,
    t: float,
    um: float,
    ul: float,
    y: float,
    w: float,
    P: Real,
    S: NDArray[np.int64],
    mem: Real,
    sm: int,
    sl: int,
    aux: Real,
    note: bool,
) -> None:
    """Right-hand side, friction directions ``sm``, ``sl`` (0: stuck) fixed; with ``note`` diagnostics go to ``aux``."""
    q_s, v_s, q, v = x[0], x[1], x[2], x[3]
    motor = S[MOTOR]
    if motor == MOTOR_PRESCRIBED:
        q_s, v_s = y, w
    if S[LOAD_PRESCRIBED]:
        q, v = y, w

    error, error_rate = 0.0, 0.0
    for i in range(S[N_TE]):
        b = TE_0 + 4 * i
        arg = P[b + 1] * (q_s + P[MOTOR_ZERO]) + P[b + 2] * q + P[b + 3]
        error += P[b] * math.sin(arg)
        error_rate += P[b] * math.cos(arg) * (P[b + 1] * v_s + P[b + 2] * v)
    delta = q_s + error - q
    rate = v_s + error_rate - v

    T, contact = _elastic(P, delta, 1.0 + P[DRIFT] * t)
    T += P[C] * contact * rate
    if P[REID] != 0.0:
        bend = _STRUCTURAL_WIDTH * P[REID_OMEGA] * delta
        T += P[REID] * P[K] * abs(delta) * rate / math.sqrt(rate * rate + bend * bend + 1e-30)
    kind = S[HYST_KIND]
    if kind != 0:
        travel = delta - mem[0]
        if kind == MAXWELL_SLIP:
            total = 0.0
            for i in range(4):
                limit = 0.4 * (i + 1)
                total += min(max(mem[1 + i] + travel / P[HYST_ANGLE], -limit), limit)
            T += P[HYST_TORQUE] * 0.25 * total
        else:
            T += P[HYST_TORQUE] * _loop(mem[1], travel, P[HYST_ANGLE], kind)
    for i in range(S[N_BRANCH]):
        b = BRANCH_0 + 2 * i
        j = S[AT_BRANCH] + i
        T += P[b] * x[j]
        dx[j] = rate - x[j] / P[b + 1]

    if S[TABLE_SITE] == AT_TRANSMISSION:
        if S[TABLE_OF] == OF_TURN:
            T += delta * tabled(P, q)
        else:
            T += tabled(P, delta if S[TABLE_OF] == OF_WIND_UP else rate)

    innovation = 0.0
    if P[OBS_2] != 0.0:
        innovation = y - P[OBS_QS] * q_s - P[OBS_VS] * v_s - P[OBS_Q] * q - P[OBS_V] * v
    lift, push = P[OBS_1] * innovation, P[OBS_2] * innovation

    # motor side
    tau = um
    if S[AT_LOOP] >= 0:
        j = S[AT_LOOP]
        wanted = P[LOOP_P] * (w - v_s) + P[LOOP_I] * x[j] + y
        if note:
            aux[12] = wanted
        held = min(max(wanted, -P[LOOP_LIMIT]), P[LOOP_LIMIT])
        dx[j] = w - v_s if held == wanted else 0.0
        tau = um + P[LOOP_MIX] * (held - um)
    for i in range(S[N_RIPPLE]):
        b = RIPPLE_0 + 4 * i
        tau += (P[b] + P[b + 1] * tau) * math.sin(P[b + 2] * (q_s + P[MOTOR_ZERO]) + P[b + 3])
    force_m = tau - T - P[B_M] * v_s
    if S[TABLE_SITE] == AT_MOTOR:
        force_m += tabled(P, v_s if S[TABLE_OF] == OF_SPEED else q_s)
    if S[PRE_SITE] == AT_MOTOR:
        force_m -= P[PRE_TORQUE] * _loop(mem[9], q_s - mem[8], P[PRE_ANGLE], DAHL)
    level_m = P[FM_LOAD] * abs(T)
    a_s = 0.0
    if motor == MOTOR_HELD:
        dx[0], dx[1] = 0.0, 0.0
    elif motor == MOTOR_PRESCRIBED:
        a_s = um
        dx[0], dx[1] = 0.0, 0.0
    else:
        dx[0] = v_s + lift
        if sm == 0 and S[FRICTION_M]:
            dx[0], dx[1] = lift, 0.0
        else:
            f = force_m
            if S[FRICTION_M]:
                f -= sm * (
                    level_m
                    + _friction(P[FM_PLUS], P[FM_MINUS], P[FM_EXCESS], P[FM_SPEED], P[FM_EXPONENT], v_s, sm)
                )
            a_s = f / P[J_M]
            dx[1] = a_s + push
    force_m += P[J_M] * push

    # base mode: the mount turns by beta under the reaction of T_S
    beta, beta_2 = 0.0, 0.0
    if S[AT_BASE] >= 0:
        j = S[AT_BASE]
        beta = x[j]
        beta_2 = (
            -P[BASE_SHARE] / P[J_L] * T
            - P[BASE_OMEGA] * P[BASE_OMEGA] * beta
            - 2.0 * P[BASE_ZETA] * P[BASE_OMEGA] * x[j + 1]
        )
        dx[j], dx[j + 1] = x[j + 1], beta_2

    # load side
    force_l = T + ul - P[B_L] * v - P[G_CONST]
    if S[TABLE_SITE] == AT_LOAD:
        force_l += tabled(P, v if S[TABLE_OF] == OF_SPEED else q)
    if S[PRE_SITE] == AT_LOAD:
        force_l -= P[PRE_TORQUE] * _loop(mem[9], q - mem[8], P[PRE_ANGLE], DAHL)
    if P[G_COS] != 0.0 or P[G_SIN] != 0.0:
        d = q + beta - mem[5]
        if abs(d) > _TURN:
            mem[5], mem[6], mem[7] = q + beta, math.cos(q + beta), math.sin(q + beta)
            d = 0.0
        even, odd = 1.0 - 0.5 * d * d, d - d * d * d / 6.0
        force_l -= P[G_COS] * (mem[6] * even - mem[7] * odd) - P[G_SIN] * (mem[7] * even + mem[6] * odd)
    if P[C_QUADRATIC] != 0.0 or P[C_SIDED] != 0.0:
        force_l -= (P[C_QUADRATIC] * v + P[C_SIDED]) * abs(v)
    if P[STOP_K] != 0.0:
        depth = P[STOP_SIDE] * (q - P[STOP_ANGLE])
        if depth > 0.0:
            reaction = P[STOP_K] * depth ** P[STOP_EXPONENT] * (1.0 + P[STOP_C] * P[STOP_SIDE] * v)
            if reaction > 0.0:
                force_l -= P[STOP_SIDE] * reaction
    inertia = P[J_L]
    link_pull, near_pull = 0.0, 0.0
    if S[AT_LINK] >= 0:
        j = S[AT_LINK]
        link_pull = P[LINK_OMEGA] * P[LINK_OMEGA] * x[j] + 2.0 * P[LINK_ZETA] * P[LINK_OMEGA] * x[j + 1]
        inertia -= P[LINK_J]
        force_l += P[LINK_J] * link_pull - P[LINK_HIT] * ul
    if S[AT_NEAR] >= 0:
        j = S[AT_NEAR]
        near_pull = P[NEAR_OMEGA] * P[NEAR_OMEGA] * x[j] + 2.0 * P[NEAR_ZETA] * P[NEAR_OMEGA] * x[j + 1]
        inertia -= P[NEAR_J]
        force_l += P[NEAR_J] * near_pull
    level_l = P[FL_LOAD] * abs(T)
    acceleration = 0.0
    if S[LOAD_PRESCRIBED]:
        acceleration = um
        dx[2], dx[3] = 0.0, 0.0
    elif sl == 0 and S[FRICTION_L]:
        acceleration = beta_2
        dx[2], dx[3] = lift, 0.0
    else:
        f = force_l
        if S[FRICTION_L]:
            f -= sl * (
                level_l + _friction(P[FL_PLUS], P[FL_MINUS], P[FL_EXCESS], P[FL_SPEED], P[FL_EXPONENT], v, sl)
            )
        acceleration = f / inertia
        dx[2] = v + lift
        dx[3] = acceleration - beta_2 + push
    link_2 = 0.0
    if S[AT_LINK] >= 0:
        j = S[AT_LINK]
        link_2 = -acceleration - link_pull + P[LINK_HIT] * ul / P[LINK_J]
        dx[j], dx[j + 1] = x[j + 1], link_2
    if S[AT_NEAR] >= 0:
        j = S[AT_NEAR]
        dx[j], dx[j + 1] = x[j + 1], -acceleration - near_pull

    if note:
        aux[0] = force_m
        aux[1] = force_l + inertia * (push - beta_2)
        aux[2] = T
        aux[3], aux[4] = level_m, level_l
        aux[5], aux[6], aux[7] = a_s, acceleration, link_2
        aux[8] = tau
        aux[9] = delta
        aux[10], aux[11] = q_s, v_s
        aux[14], aux[15] = q, v
        if S[LOAD_PRESCRIBED]:
            aux[13] = inertia * acceleration - (force_l - ul)
        else:
            aux[13] = P[J_M] * a_s - (force_m - tau - P[J_M] * push)


# inlined into the one hot loop; called as a function at the rare events
_rates = _compiled(_rates_source)
_rates_inlined = _inlined(_rates_source)


@_compiled
def _at(u: Real, k: int, s: float) -> float:
    """Input at the fraction ``s`` of step ``k``; ``u`` holds half steps."""
    a, b, c = u[2 * k], u[2 * k + 1], u[2 * k + 2]
    return float(a + s * (4.0 * b - 3.0 * a - c) + 2.0 * s * s * (a - 2.0 * b + c))


@_compiled
def _remember(P: Real, S: NDArray[np.int64], mem: Real, delta: float) -> None:
    """Move the hysteresis memory to wind-up ``delta``."""
    travel = delta - mem[0]
    if S[HYST_KIND] == MAXWELL_SLIP:
        for i in range(4):
            limit = 0.4 * (i + 1)
            mem[1 + i] = min(max(mem[1 + i] + travel / P[HYST_ANGLE], -limit), limit)
    else:
        mem[1] = _loop(mem[1], travel, P[HYST_ANGLE], S[HYST_KIND])
    mem[0] = delta


@_compiled
def _windup_of(x: Real, P: Real, S: NDArray[np.int64], y: float) -> float:
    q_s = y if S[MOTOR] == MOTOR_PRESCRIBED else x[0]
    q = y if S[LOAD_PRESCRIBED] else x[2]
    return _windup_of_scalars(q_s, q, P, S)


@_compiled
def _windup_of_scalars(q_s: float, q: float, P: Real, S: NDArray[np.int64]) -> float:
    error = 0.0
    for i in range(S[N_TE]):
        b = TE_0 + 4 * i
        error += P[b] * math.sin(P[b + 1] * (q_s + P[MOTOR_ZERO]) + P[b + 2] * q + P[b + 3])
    return float(q_s + error - q)


@_compiled
def _direction(net: float, load: float, P: Real, first: int) -> int:
    """Where a contact at rest goes under ``net`` [N m]: 0 while |net| <= breakaway; ``first``: FM_PLUS or FL_PLUS."""
    excess = 1.0 + P[first + 2]
    if net > P[first] * excess + load:
        return 1
    if net < -(P[first + 1] * excess + load):
        return -1
    return 0


@_compiled
def _release(f0: float, f1: float, g0: float, g1: float, P: Real, first: int, go: int) -> float:
    """Fraction of the interval at which a stuck contact lets go, the net torque taken as a straight line."""
    excess = 1.0 + P[first + 2]
    level = P[first] if go > 0 else P[first + 1]
    over0 = go * f0 - level * excess - g0
    over1 = go * f1 - level * excess - g1
    if over0 >= 0.0 or over1 <= over0:
        return 0.0
    return float(-over0 / (over1 - over0))


@_compiled
def _record(P: Real, S: NDArray[np.int64], sm: int, sl: int, aux: Real, out: Real, k: int) -> None:
    """One node's row."""
    row = out[k]
    row[X_QS], row[X_VS], row[X_AS] = aux[10], aux[11], aux[5]
    row[X_Q], row[X_V], row[X_A] = aux[14], aux[15], aux[6]
    row[X_LINK], row[X_TS] = aux[7], aux[2]
    row[X_TAU] = aux[12] if S[AT_LOOP] >= 0 else aux[8]
    torque = aux[13]
    if S[LOAD_PRESCRIBED]:
        if S[FRICTION_L]:
            torque += sl * (
                aux[4] + _friction(P[FL_PLUS], P[FL_MINUS], P[FL_EXCESS], P[FL_SPEED], P[FL_EXPONENT], aux[15], sl)
            )
    elif S[FRICTION_M]:
        torque += sm * (
            aux[3] + _friction(P[FM_PLUS], P[FM_MINUS], P[FM_EXCESS], P[FM_SPEED], P[FM_EXPONENT], aux[11], sm)
        )
    row[X_TEXT] = torque


@_compiled
def _simulate_full(
    x: Real, P: Real, S: NDArray[np.int64], um: Real, ul: Real, y: Real, w: Real, t0: float, h: float, out: Real
) -> None:
    """Every law; see :func:`simulate`."""
    n = out.shape[0] - 1
    m = S[N_X]
    k1, k2, xt, total, xn = np.zeros(m), np.zeros(m), np.zeros(m), np.zeros(m), np.zeros(m)
    aux, ahead = np.zeros(_N_AUX), np.zeros(_N_AUX)
    mem = np.zeros(10)
    pre = 0 if S[PRE_SITE] == AT_MOTOR else 2
    mem[8] = x[pre]
    mem[5] = 1e9  # angle about which weight is expanded; none yet
    mem[0] = _windup_of(x, P, S, y[0])
    hyst = S[HYST_KIND] != 0
    dry_m = S[FRICTION_M] != 0 and S[MOTOR] == MOTOR_FREE
    dry_l = S[FRICTION_L] != 0 and S[LOAD_PRESCRIBED] == 0
    sm = 1 if x[1] > 0.0 else (-1 if x[1] < 0.0 else 0)
    sl = 1 if x[3] > 0.0 else (-1 if x[3] < 0.0 else 0)
    for k in range(n):
        if S[LOAD_PRESCRIBED]:
            sl = 1 if w[2 * k] > 0.0 else -1
        if S[MOTOR] == MOTOR_PRESCRIBED:
            sm = 1 if w[2 * k] > 0.0 else -1
        s, target, pending = 0.0, 1.0, 0
        for event in range(_MAX_EVENTS):
            # Runge-Kutta from fraction s to target
            d = (target - s) * h
            for i in range(m):
                xt[i] = x[i]
                total[i] = 0.0
            for stage in range(4):
                shift = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)
                at = s + shift * (target - s)
                if at == 0.0:
                    a, b, c, e = um[2 * k], ul[2 * k], y[2 * k], w[2 * k]
                elif at == 0.5:
                    a, b, c, e = um[2 * k + 1], ul[2 * k + 1], y[2 * k + 1], w[2 * k + 1]
                elif at == 1.0:
                    a, b, c, e = um[2 * k + 2], ul[2 * k + 2], y[2 * k + 2], w[2 * k + 2]
                else:
                    a, b, c, e = _at(um, k, at), _at(ul, k, at), _at(y, k, at), _at(w, k, at)
                _rates_inlined(xt, k2, t0 + (k + at) * h, a, b, c, e, P, S, mem, sm, sl, aux, stage == 0)
                weight = 1.0 if stage == 0 or stage == 3 else 2.0
                ahead_by = 0.5 * d if stage < 2 else d
                for i in range(m):
                    total[i] += weight * k2[i]
                    xt[i] = x[i] + ahead_by * k2[i]
            for i in range(m):
                xn[i] = x[i] + d / 6.0 * total[i]
            if event == 0:
                _record(P, S, sm, sl, aux, out, k)
            if not (dry_m or dry_l):
                break
            if pending == 0:
                if event >= _MAX_EVENTS - 2:
                    break
                # the first reversal or release in the rest of the step
                share = 1.0
                if dry_m and sm != 0 and sm * xn[1] < 0.0:
                    pending, share = 1, x[1] / (x[1] - xn[1]) if sm * x[1] > 0.0 else 0.0
                if dry_l and sl != 0 and sl * xn[3] < 0.0:
                    part = x[3] / (x[3] - xn[3]) if sl * x[3] > 0.0 else 0.0
                    if pending == 0 or part < share:
                        pending, share = 2, part
                if (dry_m and sm == 0) or (dry_l and sl == 0):
                    j = 2 * k + 2
                    _rates(xn, k1, t0 + (k + 1.0) * h, um[j], ul[j], y[j], w[j], P, S, mem, sm, sl, ahead, True)
                    if dry_m and sm == 0:
                        go = _direction(ahead[0], ahead[3], P, FM_PLUS)
                        if go != 0:
                            part = _release(aux[0], ahead[0], aux[3], ahead[3], P, FM_PLUS, go)
                            if pending == 0 or part < share:
                                pending, share = 3 if go > 0 else 5, part
                    if dry_l and sl == 0:
                        go = _direction(ahead[1], ahead[4], P, FL_PLUS)
                        if go != 0:
                            part = _release(aux[1], ahead[1], aux[4], ahead[4], P, FL_PLUS, go)
                            if pending == 0 or part < share:
                                pending, share = 4 if go > 0 else 6, part
                if pending == 0:
                    break
                target = s + share * (1.0 - s)
                if target - s > 1e-9:
                    continue
                for i in range(m):
                    xn[i] = x[i]
            # the event itself, at fraction target
            if hyst:
                _remember(P, S, mem, _windup_of(xn, P, S, _at(y, k, target)))
            if S[PRE_SITE] != 0:
                mem[9] = _loop(mem[9], xn[pre] - mem[8], P[PRE_ANGLE], DAHL)
                mem[8] = xn[pre]
            for i in range(m):
                x[i] = xn[i]
            s, target = target, 1.0
            if pending == 1 or pending == 2:
                x[1 if pending == 1 else 3] = 0.0
                stuck_m, stuck_l = (0, sl) if pending == 1 else (sm, 0)
                a, b, c, e = _at(um, k, s), _at(ul, k, s), _at(y, k, s), _at(w, k, s)
                _rates(x, k1, t0 + (k + s) * h, a, b, c, e, P, S, mem, stuck_m, stuck_l, ahead, True)
                if pending == 1:
                    sm = _direction(ahead[0], ahead[3], P, FM_PLUS)
                else:
                    sl = _direction(ahead[1], ahead[4], P, FL_PLUS)
            elif pending == 3 or pending == 5:
                sm = 1 if pending == 3 else -1
            else:
                sl = 1 if pending == 4 else -1
            pending = 0
            if s > 1.0 - 1e-9:
                for i in range(m):
                    xn[i] = x[i]
                break
        if hyst:
            _remember(P, S, mem, _windup_of(xn, P, S, y[2 * k + 2]))
        if S[PRE_SITE] != 0:
            mem[9] = _loop(mem[9], xn[pre] - mem[8], P[PRE_ANGLE], DAHL)
            mem[8] = xn[pre]
        for i in range(m):
            x[i] = xn[i]
    j = 2 * n
    _rates(x, k1, t0 + n * h, um[j], ul[j], y[j], w[j], P, S, mem, sm, sl, aux, True)
    _record(P, S, sm, sl, aux, out, n)


# --- the same joint in scalars: base, friction, play, springs, stops (and, if RICH, one further mode, one hysteretic law,
# periodic lines): no state vector, so three times as fast; loops, branches and prescribed motions stay above ----------


def _scalar_rates_source(
    q_s: float, v_s: float, q: float, v: float, r: float, u: float, t: float, um: float, ul: float, y: float,
    held: bool, p: tuple[float, ...], turn: tuple[float, float, float], f: tuple[float, ...],
    dry_m: bool, dry_l: bool, sm: int, sl: int, rich: bool, P: Real, S: NDArray[np.int64], mem: Real, mode: int,
) -> tuple[float, ...]:  # fmt: skip
    """Rates of q_s, q_s', q, q', r, r' (r: modal coordinate), then a_s, q'', link's r'', T_S, tau, net torques, levels."""
    J_m, J_l, k, c, b_m, b_l, gap, centre, inside, k_2, k_3, k_soft, soft, drift, drag, weight = p[:16]
    g_cos, g_sin, stop_angle, stop_k, stop_c, stop_exponent, side, o_1, o_2, o_qs, o_vs, o_q, o_v, sided = p[16:]
    delta, rate = q_s - q, v_s - v
    if rich:
        for i in range(S[N_TE]):
            b = TE_0 + 4 * i
            arg = P[b + 1] * (q_s + P[MOTOR_ZERO]) + P[b + 2] * q + P[b + 3]
            delta += P[b] * math.sin(arg)
            rate += P[b] * math.cos(arg) * (P[b + 1] * v_s + P[b + 2] * v)
    el, contact = delta, 1.0
    if gap > 0.0:
        el = delta - centre
        if el > gap:
            el -= gap
        elif el < -gap:
            el += gap
        else:
            el, contact = 0.0, inside
    T = k * (1.0 + drift * t) * el + (k_2 + k_3 * el) * el * el + c * contact * rate
    if k_soft != 0.0:
        T -= k_soft * min(max(el, -soft), soft)
    if rich:
        if P[REID] != 0.0:
            bend = _STRUCTURAL_WIDTH * P[REID_OMEGA] * delta
            T += P[REID] * k * abs(delta) * rate / math.sqrt(rate * rate + bend * bend + 1e-30)
        kind = S[HYST_KIND]
        if kind == MAXWELL_SLIP:
            share = (delta - mem[0]) / P[HYST_ANGLE]
            total = min(max(mem[1] + share, -0.4), 0.4) + min(max(mem[2] + share, -0.8), 0.8)
            total += min(max(mem[3] + share, -1.2), 1.2) + min(max(mem[4] + share, -1.6), 1.6)
            T += P[HYST_TORQUE] * 0.25 * total
        elif kind != 0:
            T += P[HYST_TORQUE] * _loop(mem[1], delta - mem[0], P[HYST_ANGLE], kind)
        if S[TABLE_SITE] == AT_TRANSMISSION:
            if S[TABLE_OF] == OF_TURN:
                T += delta * tabled(P, q)
            else:
                T += tabled(P, delta if S[TABLE_OF] == OF_WIND_UP else rate)
    innovation = 0.0
    if o_2 != 0.0:
        innovation = y - o_qs * q_s - o_vs * v_s - o_q * q - o_v * v
    lift, push = o_1 * innovation, o_2 * innovation

    tau = um
    if rich:
        for i in range(S[N_RIPPLE]):
            b = RIPPLE_0 + 4 * i
            tau += (P[b] + P[b + 1] * tau) * math.sin(P[b + 2] * (q_s + P[MOTOR_ZERO]) + P[b + 3])
    net_m = tau - T - b_m * v_s
    if rich and S[TABLE_SITE] == AT_MOTOR:
        net_m += tabled(P, v_s if S[TABLE_OF] == OF_SPEED else q_s)
    level_m = f[5] * abs(T)
    a_s, dq_s, dv_s = 0.0, 0.0, 0.0
    if not held:
        dq_s = v_s + lift
        if dry_m:
            if sm == 0:
                dq_s = lift
            else:
                a_s = (net_m - sm * (level_m + _friction(f[0], f[1], f[2], f[3], f[4], v_s, sm))) / J_m
                dv_s = a_s + push
        else:
            a_s = net_m / J_m
            dv_s = a_s + push
    net_m += J_m * push

    inertia, angle, mount, pull, du = J_l, q, 0.0, 0.0, 0.0
    if rich and mode != 0:
        if mode == 3:
            angle += r
            mount = -P[BASE_SHARE] / J_l * T - P[BASE_OMEGA] * (P[BASE_OMEGA] * r + 2.0 * P[BASE_ZETA] * u)
            du = mount
        elif mode == 1:
            pull = P[LINK_OMEGA] * (P[LINK_OMEGA] * r + 2.0 * P[LINK_ZETA] * u)
            inertia -= P[LINK_J]
        else:
            pull = P[NEAR_OMEGA] * (P[NEAR_OMEGA] * r + 2.0 * P[NEAR_ZETA] * u)
            inertia -= P[NEAR_J]
    d = angle - turn[0]
    even, odd = 1.0 - 0.5 * d * d, d - d * d * d / 6.0
    cosine, sine = turn[1] * even - turn[2] * odd, turn[2] * even + turn[1] * odd
    net_l = T + ul - b_l * v - weight - g_cos * cosine + g_sin * sine - (drag * v + sided) * abs(v)
    if rich and S[TABLE_SITE] == AT_LOAD:
        net_l += tabled(P, v if S[TABLE_OF] == OF_SPEED else q)
    if rich and (mode == 1 or mode == 2):
        net_l += (J_l - inertia) * pull
        if mode == 1:
            net_l -= P[LINK_HIT] * ul
    if stop_k != 0.0:
        depth = side * (q - stop_angle)
        if depth > 0.0:
            reaction = stop_k * depth**stop_exponent * (1.0 + stop_c * side * v)
            if reaction > 0.0:
                net_l -= side * reaction
    level_l = f[11] * abs(T)
    dq, dv, a = lift, 0.0, mount
    if dry_l:
        if sl != 0:
            a = (net_l - sl * (level_l + _friction(f[6], f[7], f[8], f[9], f[10], v, sl))) / inertia
            dq, dv = v + lift, a - mount + push
    else:
        a = net_l / inertia
        dq, dv = v + lift, a - mount + push
    net_l += inertia * (push - mount)
    link = 0.0
    if rich and (mode == 1 or mode == 2):
        du = -a - pull
        if mode == 1:
            du += P[LINK_HIT] * ul / P[LINK_J]
            link = du
    return dq_s, dv_s, dq, dv, u, du, a_s, a, link, T, tau, net_m, net_l, level_m, level_l


_scalar_rates = _compiled(_scalar_rates_source)
_scalar_rates_inlined = _inlined(_scalar_rates_source)


def _scalar_simulator(RICH: bool) -> Callable[..., None]:
    """One loop, compiled twice: without what only ``RICH`` laws need, and with it."""

    def integrate(
        x: Real, P: Real, S: NDArray[np.int64], held: bool, dry_m: bool, dry_l: bool, mode: int,
        um: Real, ul: Real, y: Real, t0: float, h: float, out: Real,
    ) -> None:  # fmt: skip
        n = out.shape[0] - 1
        q_s, v_s, q, v, r, u = x[0], x[1], x[2], x[3], 0.0, 0.0
        if RICH and mode != 0:
            r, u = x[4], x[5]
        p = (
            P[J_M], P[J_L], P[K], P[C], P[B_M], P[B_L], P[GAP_HALF], P[GAP_CENTRE], P[GAP_DAMPING], P[K_2], P[K_3],
            P[K_SOFT], P[SOFT_ANGLE], P[DRIFT], P[C_QUADRATIC], P[G_CONST], P[G_COS], P[G_SIN], P[STOP_ANGLE],
            P[STOP_K], P[STOP_C], P[STOP_EXPONENT], P[STOP_SIDE], P[OBS_1], P[OBS_2], P[OBS_QS], P[OBS_VS], P[OBS_Q],
            P[OBS_V], P[C_SIDED],
        )  # fmt: skip
        f = (
            P[FM_PLUS], P[FM_MINUS], P[FM_EXCESS], P[FM_SPEED], P[FM_EXPONENT], P[FM_LOAD],
            P[FL_PLUS], P[FL_MINUS], P[FL_EXCESS], P[FL_SPEED], P[FL_EXPONENT], P[FL_LOAD],
        )  # fmt: skip
        turn = (q, math.cos(q), math.sin(q))
        sm = 1 if v_s > 0.0 else (-1 if v_s < 0.0 else 0)
        sl = 1 if v > 0.0 else (-1 if v < 0.0 else 0)
        dry_m = dry_m and not held
        mem = np.zeros(5)
        hyst = False
        if RICH:
            hyst = S[HYST_KIND] != 0
            mem[0] = _windup_of_scalars(q_s, q, P, S)
        for k in range(n):
            if abs(q - turn[0]) > _TURN:
                turn = (q, math.cos(q), math.sin(q))
            s, target, pending = 0.0, 1.0, 0
            e_qs, e_vs, e_q, e_v, e_r, e_u = q_s, v_s, q, v, r, u
            for event in range(_MAX_EVENTS):
                whole = s == 0.0 and target == 1.0
                d = (target - s) * h
                t, mid = t0 + (k + s) * h, 0.5 * (s + target)
                if whole:
                    j = 2 * k
                    m1, l1, y1, m2, l2, y2 = um[j], ul[j], y[j], um[j + 1], ul[j + 1], y[j + 1]
                    m3, l3, y3 = um[j + 2], ul[j + 2], y[j + 2]
                else:
                    m1, l1, y1 = _at(um, k, s), _at(ul, k, s), _at(y, k, s)
                    m2, l2, y2 = _at(um, k, mid), _at(ul, k, mid), _at(y, k, mid)
                    m3, l3, y3 = _at(um, k, target), _at(ul, k, target), _at(y, k, target)
                a1, b1, c1, d1, f1, g1, acc_s, acc, link, T, tau, net_m, net_l, level_m, level_l = (
                    _scalar_rates_inlined(
                        q_s,
                        v_s,
                        q,
                        v,
                        r,
                        u,
                        t,
                        m1,
                        l1,
                        y1,
                        held,
                        p,
                        turn,
                        f,
                        dry_m,
                        dry_l,
                        sm,
                        sl,
                        RICH,
                        P,
                        S,
                        mem,
                        mode,
                    )
                )
                g = 0.5 * d
                a2, b2, c2, d2, f2, g2, _1, _2, _3, _4, _5, _6, _7, _8, _9 = _scalar_rates_inlined(
                    q_s + g * a1, v_s + g * b1, q + g * c1, v + g * d1, r + g * f1, u + g * g1, t + g, m2, l2, y2,
                    held, p, turn, f, dry_m, dry_l, sm, sl, RICH, P, S, mem, mode,
                )  # fmt: skip
                a3, b3, c3, d3, f3, g3, _1, _2, _3, _4, _5, _6, _7, _8, _9 = _scalar_rates_inlined(
                    q_s + g * a2, v_s + g * b2, q + g * c2, v + g * d2, r + g * f2, u + g * g2, t + g, m2, l2, y2,
                    held, p, turn, f, dry_m, dry_l, sm, sl, RICH, P, S, mem, mode,
                )  # fmt: skip
                a4, b4, c4, d4, f4, g4, _1, _2, _3, _4, _5, _6, _7, _8, _9 = _scalar_rates_inlined(
                    q_s + d * a3, v_s + d * b3, q + d * c3, v + d * d3, r + d * f3, u + d * g3, t + d, m3, l3, y3,
                    held, p, turn, f, dry_m, dry_l, sm, sl, RICH, P, S, mem, mode,
                )  # fmt: skip
                g = d / 6.0
                e_qs = q_s + g * (a1 + 2.0 * (a2 + a3) + a4)
                e_vs = v_s + g * (b1 + 2.0 * (b2 + b3) + b4)
                e_q = q + g * (c1 + 2.0 * (c2 + c3) + c4)
                e_v = v + g * (d1 + 2.0 * (d2 + d3) + d4)
                if RICH:
                    e_r = r + g * (f1 + 2.0 * (f2 + f3) + f4)
                    e_u = u + g * (g1 + 2.0 * (g2 + g3) + g4)
                if event == 0:
                    row = out[k]
                    row[X_QS], row[X_VS], row[X_AS], row[X_Q], row[X_V], row[X_A] = q_s, v_s, acc_s, q, v, acc
                    row[X_LINK], row[X_TS], row[X_TAU], row[X_TEXT] = link, T, tau, 0.0
                if not (dry_m or dry_l):
                    break
                if pending == 0:
                    if event >= _MAX_EVENTS - 2:
                        break
                    share = 1.0
                    if dry_m and sm != 0 and sm * e_vs < 0.0:
                        pending, share = 1, v_s / (v_s - e_vs) if sm * v_s > 0.0 else 0.0
                    if dry_l and sl != 0 and sl * e_v < 0.0:
                        part = v / (v - e_v) if sl * v > 0.0 else 0.0
                        if pending == 0 or part < share:
                            pending, share = 2, part
                    if (dry_m and sm == 0) or (dry_l and sl == 0):
                        _1, _2, _3, _4, _5, _6, _7, _8, _9, _a, _b, far_m, far_l, far_gm, far_gl = _scalar_rates(
                            e_qs, e_vs, e_q, e_v, e_r, e_u, t0 + (k + 1.0) * h, m3, l3, y3, held, p, turn, f, dry_m,
                            dry_l, sm, sl, RICH, P, S, mem, mode,
                        )  # fmt: skip
                        if dry_m and sm == 0:
                            go = _direction(far_m, far_gm, P, FM_PLUS)
                            if go != 0:
                                part = _release(net_m, far_m, level_m, far_gm, P, FM_PLUS, go)
                                if pending == 0 or part < share:
                                    pending, share = 3 if go > 0 else 5, part
                        if dry_l and sl == 0:
                            go = _direction(far_l, far_gl, P, FL_PLUS)
                            if go != 0:
                                part = _release(net_l, far_l, level_l, far_gl, P, FL_PLUS, go)
                                if pending == 0 or part < share:
                                    pending, share = 4 if go > 0 else 6, part
                    if pending == 0:
                        break
                    target = s + share * (1.0 - s)
                    if target - s > 1e-9:
                        continue
                    e_qs, e_vs, e_q, e_v, e_r, e_u = q_s, v_s, q, v, r, u
                # the event itself, at fraction target
                q_s, v_s, q, v, r, u = e_qs, e_vs, e_q, e_v, e_r, e_u
                if hyst:
                    _remember(P, S, mem, _windup_of_scalars(q_s, q, P, S))
                s, target = target, 1.0
                if pending == 1 or pending == 2:
                    if pending == 1:
                        v_s = 0.0
                    else:
                        v = 0.0
                    stuck_m, stuck_l = (0, sl) if pending == 1 else (sm, 0)
                    _1, _2, _3, _4, _5, _6, _7, _8, _9, _a, _b, far_m, far_l, far_gm, far_gl = _scalar_rates(
                        q_s, v_s, q, v, r, u, t0 + (k + s) * h, _at(um, k, s), _at(ul, k, s), _at(y, k, s), held, p, turn,
                        f, dry_m, dry_l, stuck_m, stuck_l, RICH, P, S, mem, mode,
                    )  # fmt: skip
                    if pending == 1:
                        sm = _direction(far_m, far_gm, P, FM_PLUS)
                    else:
                        sl = _direction(far_l, far_gl, P, FL_PLUS)
                elif pending == 3 or pending == 5:
                    sm = 1 if pending == 3 else -1
                else:
                    sl = 1 if pending == 4 else -1
                pending = 0
                e_qs, e_vs, e_q, e_v, e_r, e_u = q_s, v_s, q, v, r, u
                if s > 1.0 - 1e-9:
                    break
            q_s, v_s, q, v, r, u = e_qs, e_vs, e_q, e_v, e_r, e_u
            if hyst:
                _remember(P, S, mem, _windup_of_scalars(q_s, q, P, S))
        j = 2 * n
        _1, _2, _3, _4, _5, _6, acc_s, acc, link, T, tau, _7, _8, _9, _a = _scalar_rates(
            q_s, v_s, q, v, r, u, t0 + n * h, um[j], ul[j], y[j], held, p, turn, f, dry_m, dry_l, sm, sl, RICH, P, S, mem,
            mode,
        )  # fmt: skip
        row = out[n]
        row[X_QS], row[X_VS], row[X_AS], row[X_Q], row[X_V], row[X_A] = q_s, v_s, acc_s, q, v, acc
        row[X_LINK], row[X_TS], row[X_TAU], row[X_TEXT] = link, T, tau, 0.0

    return _compiled(integrate)


_simulate_plain = _scalar_simulator(False)
_simulate_rich = _scalar_simulator(True)


def simulate(
    x: Real, P: Real, S: NDArray[np.int64], um: Real, ul: Real, y: Real, w: Real, t0: float, h: float, out: Real
) -> None:
    """Integrate from state ``x`` (overwritten), write one row per node into ``out``, shape (n + 1, N_OUT).

    Args:
        x: Initial state, shape (S[N_X],): q_s, q_s', q, q', then link, neighbour and base modes (two each), relaxation
            branches, loop integrator.
        P: Packed numbers, shape (N_P,).
        S: Switches, shape (N_S,).
        um: Motor torque eta n T_e at half steps [N m], shape (2 n + 1,); the acceleration of a prescribed motion.
        ul: External torque on the arm at half steps [N m].
        y: Observed (or prescribed) angle or speed at half steps [rad, rad/s]; in a closed loop the feed-forward [N m].
        w: Speed command (or prescribed speed) at half steps, at the output [rad/s].
        t0: Time of the first node on the run's clock [s].
        h: Step [s].
        out: Result; columns X_QS ... X_TEXT.
    """
    modes = int(S[AT_LINK] >= 0) + int(S[AT_NEAR] >= 0) + int(S[AT_BASE] >= 0)
    scalar = S[N_X] == 4 + 2 * modes and modes <= 1 and S[LOAD_PRESCRIBED] == 0 and S[MOTOR] != MOTOR_PRESCRIBED
    if not scalar or S[PRE_SITE] != 0:
        _simulate_full(x, P, S, um, ul, y, w, t0, h, out)
        return
    held, dry_m, dry_l = bool(S[MOTOR] == MOTOR_HELD), bool(S[FRICTION_M] != 0), bool(S[FRICTION_L] != 0)
    rich = modes == 1 or S[N_TE] > 0 or S[N_RIPPLE] > 0 or S[HYST_KIND] > 0 or P[REID] != 0.0 or S[TABLE_SITE] > 0
    mode = 1 if S[AT_LINK] >= 0 else (2 if S[AT_NEAR] >= 0 else (3 if S[AT_BASE] >= 0 else 0))
    run = _simulate_rich if rich else _simulate_plain
    run(x, P, S, held, dry_m, dry_l, mode, um, ul, y, t0, h, out)
