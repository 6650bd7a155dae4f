"""Rates of the joint in scalars: base, friction, play, springs, stops; if rich, one mode, one hysteresis, lines, tables."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.kernel.compiled import Real, compiled, inlined
from jointscope.diagnosis.kernel.laws import (
    STRUCTURAL_WIDTH,
    bent,
    bristles,
    by_quadrant,
    faded,
    friction,
    hysteresis,
    missing,
    powered,
    rounded,
    seated,
    slipping,
    tabled,
    through_gear,
    turned,
    with_table,
)
from jointscope.diagnosis.kernel.layout import *


def _scalar_rates_source(
    q_s: float, v_s: float, q: float, v: float, r: float, u: float, t: float, um: float, ul: float, y: float,
    held: bool, p: tuple[float, ...], turn: tuple[float, float, float], f: tuple[float, ...],
    dry_m: bool, dry_l: bool, sm: int, sl: int, rich: bool, P: Real, S: NDArray[np.int64], mem: Real, mode: int,
    on: tuple[int, ...], relaxing: float, seat: int,
) -> tuple[float, ...]:  # fmt: skip
    """Rates of q_s, q_s', q, q', r, r' (r: modal coordinate), then a_s, q'', link's r'', T_S, tau, net torques, levels.

    ``relaxing``: torque of relaxation branches [N m]. ``seat``: flank of a play whose law is taken through the step, +1 or
    -1, 0 between them; 2 where the wind-up says it.
    """
    J_m, J_l, k, c, b_m, b_l, gap, centre, inside, k_2, k_3, k_soft, soft, drift, drag, weight = p[:16]
    (
        g_cos,
        g_sin,
        stop_angle,
        stop_k,
        stop_c,
        stop_exponent,
        side,
        o_1,
        o_2,
        o_qs,
        o_vs,
        o_q,
        o_v,
        sided,
        direct,
    ) = p[16:]
    lines, springs, corner, flank, rub, par, impact, sheds, power = on[:9]
    loops, reid, kind, rubs, table, ripples, round_m, round_l, pre = on[9:]
    delta, rate = q_s - q, v_s - v
    back_m, back_l = 0.0, 0.0
    if rich:
        for i in range(lines):
            b = TE_0 + 4 * i
            arg = P[b + 1] * (q_s + P[MOTOR_ZERO]) + P[b + 2] * q + P[b + 3]
            sine, slope = turned(arg, mem, MEM_TURN + 3 * i)
            delta += P[b] * sine
            slope *= P[b]
            rate += slope * (P[b + 1] * v_s + P[b + 2] * v)
            back_m += slope * P[b + 1]
            back_l += slope * P[b + 2]
    el, contact = delta, 1.0
    if gap > 0.0:
        el = delta - centre
        if rich and corner:
            el, slope = bent(el, gap, P[GAP_CORNER])
            contact = faded(slope, P[GAP_FADE])
        elif seat == 1 or (seat == 2 and el > gap):
            el -= gap
        elif seat == -1 or (seat == 2 and el < -gap):
            el += gap
        else:
            el, contact = 0.0, inside
        if rich and flank:
            share = seated(el, P)
            el, contact = el * math.sqrt(share), contact * faded(share, P[GAP_FADE])
    factor, damping = 1.0 + drift * t, c * contact
    if rich and springs:
        if rub:
            damping += P[RUB] * abs(delta)
        if par:
            factor += P[PAR_SHARE] * math.sin(
                P[PAR_MOTOR] * (q_s + P[MOTOR_ZERO]) + P[PAR_LOAD] * q + P[PAR_PHASE]
            )
    secant = k * factor + (k_2 + k_3 * el) * el
    if rich and springs:
        beside = powered(el, P) if power else 0.0
        if impact:
            damping += P[GAP_IMPACT] * abs(secant * el + beside)
        T = secant * el + (damping * rate + beside)
        if sheds and T * (el if seat == 2 else seat) <= 0.0:
            T = 0.0
    else:
        T = secant * el + damping * rate
    if k_soft != 0.0:
        T -= k_soft * (missing(el, soft, P[SOFT_SMOOTH]) if rich else min(max(el, -soft), soft))
    T += relaxing
    if rich and loops:
        if reid:
            bend = STRUCTURAL_WIDTH * P[REID_OMEGA] * delta
            T += P[REID] * k * abs(delta) * rate / math.sqrt(rate * rate + bend * bend + 1e-30)
        if kind == MAXWELL_SLIP:
            T += P[HYST_TORQUE] * slipping(mem, delta - mem[0], P)
        elif kind != 0:
            T += P[HYST_TORQUE] * hysteresis(mem[1], delta - mem[0], P[HYST_ANGLE], kind, P[HYST_SHAPE])
        if table == AT_TRANSMISSION:
            T = with_table(T, P, S, delta, rate, q)
    innovation = 0.0
    if o_2 != 0.0:
        innovation = y - o_qs * q_s - o_vs * v_s - o_q * q - o_v * v
    lift, push = o_1 * innovation, o_2 * innovation

    tau, cogging = um, 0.0
    if rich:
        for i in range(ripples):
            b = RIPPLE_0 + 4 * i
            arg = P[b + 2] * (q_s + direct * (q - q_s) + P[MOTOR_ZERO]) + P[b + 3]
            sine, _ = turned(arg, mem, MEM_TURN + 3 * (LINES_EACH + i))
            cogging += direct * (P[b] + P[b + 1] * (ul + cogging)) * sine
            tau += (P[b] + P[b + 1] * tau) * sine
    net_m = (tau - b_m * v_s) - T  # what T comes into last: each torque before it is ready while T is worked out
    if rich and lines > 0:
        net_m -= P[TE_REACTS] * back_m * T
    if rich and rubs:
        if table == AT_MOTOR:
            net_m += tabled(P, v_s if S[TABLE_OF] == OF_SPEED else q_s)
        if round_m:
            net_m -= rounded(
                P[ROUND_M] + P[ROUND_M_LOAD] * by_quadrant(T, P[ROUND_M_QUADRANT], v_s), P[ROUND_M_SPEED],
                P[ROUND_M_EXCESS], P[ROUND_M_FALL], P[ROUND_M_SIDED], v_s,
            )  # fmt: skip
        if pre == AT_MOTOR:
            net_m -= bristles(mem[9], q_s - mem[8], v_s, T, P)
    level_m = f[5] * abs(T)
    a_s, dq_s, dv_s = 0.0, 0.0, 0.0
    if not held:
        dq_s = v_s + lift
        if dry_m:
            if sm == 0:
                dq_s = lift
            else:
                a_s = (net_m - sm * friction(f[0], f[1], f[2], f[3], f[4], v_s, sm) - sm * level_m) * (1.0 / J_m)
                dv_s = a_s + push
        else:
            a_s = net_m * (1.0 / J_m)
            dv_s = a_s + push
    net_m += J_m * push

    inertia, angle, mount, pull, du = J_l, q, 0.0, 0.0, 0.0
    if mode != 0:
        if mode == 3:
            angle += r
            mount = P[BASE_SHARE] / J_l * (P[BASE_HIT] * ul - T)
            mount -= P[BASE_OMEGA] * (P[BASE_OMEGA] * r + 2.0 * P[BASE_ZETA] * u)
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
    through = T
    if direct != 0.0:
        rest = (weight + b_l * v) - (g_sin * sine - g_cos * cosine) + (drag * v + sided) * abs(v)
        through = through_gear(ul + cogging, rest, v, P)
    net_l = T + ((ul + cogging - weight) - b_l * v + (g_sin * sine - g_cos * cosine) - (drag * v + sided) * abs(v))
    if rich and lines > 0:
        net_l -= P[TE_REACTS] * back_l * T
    if rich and rubs:
        if table == AT_LOAD:
            net_l += tabled(P, v if S[TABLE_OF] == OF_SPEED else q)
        if round_l:
            net_l -= rounded(
                P[ROUND_L] + P[ROUND_L_LOAD] * by_quadrant(through, P[ROUND_L_QUADRANT], v), P[ROUND_L_SPEED],
                P[ROUND_L_EXCESS], P[ROUND_L_FALL], P[ROUND_L_SIDED], v,
            )  # fmt: skip
        if pre == AT_LOAD:
            net_l -= bristles(mem[9], q - mem[8], v, through, P)
    if mode == 1 or mode == 2:
        net_l += (J_l - inertia) * pull
        if mode == 1:
            net_l -= P[LINK_HIT] * ul
    if stop_k != 0.0:
        depth = side * (q - stop_angle)
        if depth > 0.0:
            reaction = stop_k * depth**stop_exponent * (1.0 + stop_c * side * v)
            if reaction > 0.0:
                net_l -= side * reaction
    level_l = f[11] * abs(through)
    dq, dv, a = lift, 0.0, mount
    if dry_l:
        if sl != 0:
            a = (net_l - sl * friction(f[6], f[7], f[8], f[9], f[10], v, sl) - sl * level_l) * (1.0 / inertia)
            dq, dv = v + lift, a + (push - mount)
    else:
        a = net_l * (1.0 / inertia)
        dq, dv = v + lift, a + (push - mount)
    net_l += inertia * (push - mount)
    link = mount  # of the mode that hammer and sensor may ride on
    if mode == 1 or mode == 2:
        du = -a - pull
        if mode == 1:
            du += P[LINK_HIT] * ul / P[LINK_J]
            link = du
    return dq_s, dv_s, dq, dv, u, du, a_s, a, link, T, tau, net_m, net_l, level_m, level_l


scalar_rates_inlined = inlined(_scalar_rates_source)


@compiled
def scalar_rates(
    q_s: float, v_s: float, q: float, v: float, r: float, u: float, t: float, um: float, ul: float, y: float,
    held: bool, p: tuple[float, ...], turn: tuple[float, float, float], f: tuple[float, ...],
    dry_m: bool, dry_l: bool, sm: int, sl: int, rich: bool, P: Real, S: NDArray[np.int64], mem: Real, mode: int,
    on: tuple[int, ...], relaxing: float, seat: int,
) -> tuple[float, ...]:  # fmt: skip
    """The same, called where it is rarely needed."""
    return scalar_rates_inlined(
        q_s, v_s, q, v, r, u, t, um, ul, y, held, p, turn, f, dry_m, dry_l, sm, sl, rich, P, S, mem, mode, on,
        relaxing, seat,
    )  # fmt: skip
