"""Rates of the joint's state vector with every law in it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.kernel.compiled import Real, compiled, inlined
from jointscope.diagnosis.kernel.laws import (
    STRUCTURAL_WIDTH,
    TURN,
    bristles,
    by_quadrant,
    elastic,
    friction,
    hysteresis,
    rounded,
    slipping,
    tabled,
    through_gear,
    turned,
    with_table,
)
from jointscope.diagnosis.kernel.layout import *


@compiled
def rubbing(through: float, q: float, v: float, P: Real, S: NDArray[np.int64], mem: Real) -> float:
    """Friction at the load that creeps or builds up [N m], under what passes ``through`` the joint [N m]."""
    torque = 0.0
    if P[ROUND_L_SPEED] != 0.0:
        torque += rounded(
            P[ROUND_L] + P[ROUND_L_LOAD] * by_quadrant(through, P[ROUND_L_QUADRANT], v), P[ROUND_L_SPEED],
            P[ROUND_L_EXCESS], P[ROUND_L_FALL], P[ROUND_L_SIDED], v,
        )  # fmt: skip
    if S[PRE_SITE] == AT_LOAD:
        torque += bristles(mem[9], q - mem[8], v, through, P)
    return torque


@compiled
def through_prescribed(needed: float, a: float, v: float, P: Real) -> float:
    """What passes the gear of a rigid axis that moves as prescribed [N m]; ``needed`` is J_L a + R, its friction left out."""
    r = P[GEAR_SHARE]
    inside = needed - P[J_L] * r / (1.0 + r) * a
    k = abs(P[PASSED]) if inside * v > 0.0 else -abs(P[PASSED])
    return float(inside if P[PASSED] >= 0.0 else inside / (1.0 - k))


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

    error, error_rate, back_m, back_l = 0.0, 0.0, 0.0, 0.0
    for i in range(S[N_TE]):
        b = TE_0 + 4 * i
        arg = P[b + 1] * (q_s + P[MOTOR_ZERO]) + P[b + 2] * q + P[b + 3]
        sine, slope = turned(arg, mem, MEM_TURN + 3 * i)
        error += P[b] * sine
        slope *= P[b]
        error_rate += slope * (P[b + 1] * v_s + P[b + 2] * v)
        back_m += slope * P[b + 1]
        back_l += slope * P[b + 2]
    delta = q_s + error - q
    rate = v_s + error_rate - v

    factor = 1.0 + P[DRIFT] * t
    if P[PAR_SHARE] != 0.0:
        factor += P[PAR_SHARE] * math.sin(P[PAR_MOTOR] * (q_s + P[MOTOR_ZERO]) + P[PAR_LOAD] * q + P[PAR_PHASE])
    seat = int(mem[MEM_SEAT])
    T, contact = elastic(P, delta, factor, seat)
    bent = T if seat == 2 else float(seat)
    T += (P[C] * contact + P[RUB] * abs(delta) + P[GAP_IMPACT] * abs(T)) * rate
    if P[GAP_SHEDS] != 0.0 and T * bent <= 0.0:
        T = 0.0
    if P[REID] != 0.0:
        bend = STRUCTURAL_WIDTH * P[REID_OMEGA] * delta
        T += P[REID] * P[K] * abs(delta) * rate / math.sqrt(rate * rate + bend * bend + 1e-30)
    kind = S[HYST_KIND]
    if kind != 0:
        travel = delta - mem[0]
        if kind == MAXWELL_SLIP:
            T += P[HYST_TORQUE] * slipping(mem, travel, P)
        else:
            T += P[HYST_TORQUE] * hysteresis(mem[1], travel, P[HYST_ANGLE], kind, P[HYST_SHAPE])
    for i in range(S[N_BRANCH]):
        b = BRANCH_0 + 2 * i
        j = S[AT_BRANCH] + i
        T += P[b] * x[j]
        dx[j] = rate - x[j] / P[b + 1]

    if S[TABLE_SITE] == AT_TRANSMISSION:
        T = with_table(T, P, S, delta, rate, q)

    innovation = 0.0
    if P[OBS_2] != 0.0:
        innovation = y - P[OBS_QS] * q_s - P[OBS_VS] * v_s - P[OBS_Q] * q - P[OBS_V] * v
    lift, push = P[OBS_1] * innovation, P[OBS_2] * innovation

    # motor side
    tau, direct = um, P[DIRECT]
    if S[AT_LOOP] >= 0:
        j = S[AT_LOOP]
        speed = v_s + direct * (v - v_s)
        wanted = P[LOOP_P] * (w - speed) + P[LOOP_I] * x[j] + y
        if note:
            aux[12] = wanted
        held = min(max(wanted, -P[LOOP_LIMIT]), P[LOOP_LIMIT])
        dx[j] = w - speed if held == wanted else 0.0
        tau = um + P[LOOP_MIX] * (held - um)
        ul += direct * tau
    cogging, share = 0.0, 0.0
    for i in range(S[N_RIPPLE]):
        b = RIPPLE_0 + 4 * i
        arg = P[b + 2] * (q_s + direct * (q - q_s) + P[MOTOR_ZERO]) + P[b + 3]
        sine, _ = turned(arg, mem, MEM_TURN + 3 * (LINES_EACH + i))
        tau += (P[b] + P[b + 1] * tau) * sine
        cogging += direct * P[b] * sine
        share += direct * P[b + 1] * sine
    force_m = tau - (1.0 + P[TE_REACTS] * back_m) * T - P[B_M] * v_s
    if S[TABLE_SITE] == AT_MOTOR:
        force_m += tabled(P, v_s if S[TABLE_OF] == OF_SPEED else q_s)
    if S[PRE_SITE] == AT_MOTOR:
        force_m -= bristles(mem[9], q_s - mem[8], v_s, T, P)
    if P[ROUND_M_SPEED] != 0.0:
        force_m -= rounded(
            P[ROUND_M] + P[ROUND_M_LOAD] * by_quadrant(T, P[ROUND_M_QUADRANT], v_s), P[ROUND_M_SPEED],
            P[ROUND_M_EXCESS], P[ROUND_M_FALL], P[ROUND_M_SIDED], v_s,
        )  # fmt: skip
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
                    level_m + friction(P[FM_PLUS], P[FM_MINUS], P[FM_EXCESS], P[FM_SPEED], P[FM_EXPONENT], v_s, sm)
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
            P[BASE_SHARE] / P[J_L] * (P[BASE_HIT] * ul - T)
            - P[BASE_OMEGA] * P[BASE_OMEGA] * beta
            - 2.0 * P[BASE_ZETA] * P[BASE_OMEGA] * x[j + 1]
        )
        dx[j], dx[j + 1] = x[j + 1], beta_2

    # load side
    force_l = (1.0 - P[TE_REACTS] * back_l) * T + ul + cogging + share * ul - P[B_L] * v - P[G_CONST]
    if S[TABLE_SITE] == AT_LOAD:
        force_l += tabled(P, v if S[TABLE_OF] == OF_SPEED else q)
    if P[G_COS] != 0.0 or P[G_SIN] != 0.0:
        d = q + beta - mem[5]
        if abs(d) > TURN:
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
    through = T
    if direct != 0.0 and S[LOAD_PRESCRIBED]:
        needed = P[J_L] * um - force_l
        through = through_prescribed(needed + cogging, um, v, P)
        dry = sl * friction(P[FL_PLUS], P[FL_MINUS], P[FL_EXCESS], P[FL_SPEED], P[FL_EXPONENT], v, sl)
        dry += sl * P[FL_LOAD] * abs(through) + rubbing(through, q, v, P, S, mem)
        force_l += share * (needed + dry) / (1.0 + share)
    elif direct != 0.0:
        through = through_gear((1.0 + share) * ul + cogging, (1.0 + share) * ul + cogging - force_l, v, P)
    force_l -= rubbing(through, q, v, P, S, mem)
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
    level_l = P[FL_LOAD] * abs(through)
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
                level_l + friction(P[FL_PLUS], P[FL_MINUS], P[FL_EXCESS], P[FL_SPEED], P[FL_EXPONENT], v, sl)
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
        aux[8], aux[16] = tau, beta_2
        aux[9] = delta
        aux[10], aux[11] = q_s, v_s
        aux[14], aux[15] = q, v
        if S[LOAD_PRESCRIBED]:
            aux[13] = inertia * acceleration - (force_l - ul)
        else:
            aux[13] = P[J_M] * a_s - (force_m - tau - P[J_M] * push)


rates_inlined = inlined(_rates_source)  # into the one hot loop


@compiled
def rates(
    x: Real, dx: Real, t: float, um: float, ul: float, y: float, w: float, P: Real, S: NDArray[np.int64], mem: Real,
    sm: int, sl: int, aux: Real, note: bool,
) -> None:  # fmt: skip
    """The same, called at the rare events."""
    rates_inlined(x, dx, t, um, ul, y, w, P, S, mem, sm, sl, aux, bool(np.bool_(note)))
