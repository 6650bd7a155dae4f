"""The joint stepped in scalars: no state vector, so three times as fast; loops, several modes and prescribed motions can't."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.kernel.compiled import Real, compiled
from jointscope.diagnosis.kernel.events import (
    direction,
    flank_of,
    input_at,
    met,
    release,
    remember,
    sets_in_at_once,
    slide,
    windup_of_scalars,
)
from jointscope.diagnosis.kernel.laws import TURN
from jointscope.diagnosis.kernel.layout import *
from jointscope.diagnosis.kernel.scalar_rates import scalar_rates, scalar_rates_inlined


@compiled
def relaxed(
    zs: Real, to: int, stage: int, rate: float, weight: float, ahead: float, spring: Real, slow: Real
) -> float:
    """Rates of the branches at ``stage`` added to the step's, and they moved by them to row ``to``: their torque there [N m]."""
    torque = 0.0
    for i in range(MOST_BRANCHES):
        f = rate - slow[i] * zs[stage, i]
        zs[5, i] = f if stage == 0 else zs[5, i] + weight * f
        zs[to, i] = zs[0, i] + ahead * f
        torque += spring[i] * zs[to, i]
    return torque


def _scalar_simulator(holds: int, HELD: bool) -> Callable[..., None]:
    """One loop, compiled for what it ``holds`` (bits of the layout) with the motor free or ``HELD``.

    What it does not hold the compiler leaves out: with all laws on offer a step takes five times as long as a plain one, with
    all but lines and modes, or lines and friction alone, three times. A branch's rate is that of the wind-up less its own,
    z' = Delta' - z/tau, so its stages need no more of the joint than its speeds.
    """
    LINES, SPRINGS, LOOPS, RUBS = (bool(holds & bit) for bit in (HAS_LINES, HAS_SPRINGS, HAS_LOOPS, HAS_RUBS))
    MODES, BRANCHES = bool(holds & HAS_MODE), bool(holds & HAS_BRANCHES)
    RICH = LINES or SPRINGS or LOOPS or RUBS

    def integrate(
        x: Real, P: Real, S: NDArray[np.int64], dry_m: bool, dry_l: bool, mode: int,
        um: Real, ul: Real, y: Real, t0: float, h: float, out: Real,
    ) -> None:  # fmt: skip
        n = out.shape[0] - 1
        q_s, v_s, q, v, r, u = x[0], x[1], x[2], x[3], 0.0, 0.0
        at = 0  # no mode, and known to the compiler
        if MODES:
            at = mode
        if at != 0:
            r, u = x[4], x[5]
        p = (
            P[J_M], P[J_L], P[K], P[C], P[B_M], P[B_L], P[GAP_HALF], P[GAP_CENTRE], P[GAP_DAMPING], P[K_2], P[K_3],
            P[K_SOFT], P[SOFT_ANGLE], P[DRIFT], P[C_QUADRATIC], P[G_CONST], P[G_COS], P[G_SIN], P[STOP_ANGLE],
            P[STOP_K], P[STOP_C], P[STOP_EXPONENT], P[STOP_SIDE], P[OBS_1], P[OBS_2], P[OBS_QS], P[OBS_VS], P[OBS_Q],
            P[OBS_V], P[C_SIDED], P[DIRECT],
        )  # fmt: skip
        f = (
            P[FM_PLUS], P[FM_MINUS], P[FM_EXCESS], P[FM_SPEED], P[FM_EXPONENT], P[FM_LOAD],
            P[FL_PLUS], P[FL_MINUS], P[FL_EXCESS], P[FL_SPEED], P[FL_EXPONENT], P[FL_LOAD],
        )  # fmt: skip
        # what is switched on, read once: each look would cost every stage
        lines, ripples, corner, flank, rub, par, impact, sheds, power = 0, 0, 0, 0, 0, 0, 0, 0, 0
        reid, kind, table, round_m, round_l, pre = 0, 0, 0, 0, 0, 0
        if LINES:
            lines, ripples = S[N_TE], S[N_RIPPLE]
        if SPRINGS:
            corner, flank, rub = int(P[GAP_CORNER] != 0.0), int(P[GAP_ROUND] > 0.0), int(P[RUB] != 0.0)
            par, impact, sheds = int(P[PAR_SHARE] != 0.0), int(P[GAP_IMPACT] != 0.0), int(P[GAP_SHEDS] != 0.0)
            power = int(P[POW_K] != 0.0)
        if LOOPS:
            reid, kind, table = int(P[REID] != 0.0), S[HYST_KIND], S[TABLE_SITE]
        if RUBS:
            round_m, round_l, pre = int(P[ROUND_M_SPEED] != 0.0), int(P[ROUND_L_SPEED] != 0.0), S[PRE_SITE]
        half, centre = P[GAP_HALF], P[GAP_CENTRE]
        play = sets_in_at_once(P)
        springs, loops = rub | par | impact | sheds | power, reid | kind | int(table == AT_TRANSMISSION)
        rubs = table | round_m | round_l | pre
        on = (
            lines, springs, corner, flank, rub, par, impact, sheds, power,
            loops, reid, kind, rubs, table, ripples, round_m, round_l, pre,
        )  # fmt: skip
        turn = (q, math.cos(q), math.sin(q))
        sm = 1 if v_s > 0.0 else (-1 if v_s < 0.0 else 0)
        sl = 1 if v > 0.0 else (-1 if v < 0.0 else 0)
        dry_m = dry_m and not HELD
        mem = np.zeros(N_MEM)
        mem[MEM_TURN::3] = 1e9  # arguments about which lines are expanded; none yet
        hyst = kind != 0
        if RICH:
            mem[0] = windup_of_scalars(q_s, q, P, S)
            mem[8] = q_s if pre == AT_MOTOR else q
        # where the branches are, at the three later stages, after the step; the sum of their rates
        zs = np.zeros((6, MOST_BRANCHES))
        spring, slow = np.zeros(MOST_BRANCHES), np.zeros(MOST_BRANCHES)
        z1, z2, z3, z4 = 0.0, 0.0, 0.0, 0.0
        relaxing = BRANCHES
        if RICH and BRANCHES:
            relaxing = S[N_BRANCH] > 0
        if relaxing:
            for i in range(S[N_BRANCH]):
                zs[0, i] = x[S[AT_BRANCH] + i]
                spring[i], slow[i] = P[BRANCH_0 + 2 * i], 1.0 / P[BRANCH_0 + 2 * i + 1]
        for k in range(n):
            if abs(q - turn[0]) > TURN:
                turn = (q, math.cos(q), math.sin(q))
            s, target, pending, seat, part = 0.0, 1.0, 0, 2, 1.0
            if play:
                seat = flank_of(windup_of_scalars(q_s, q, P, S) - centre, half)
            e_qs, e_vs, e_q, e_v, e_r, e_u = q_s, v_s, q, v, r, u
            for event in range(MAX_EVENTS):
                whole = s == 0.0 and target == 1.0
                d = (target - s) * h
                t, mid = t0 + (k + s) * h, 0.5 * (s + target)
                if whole:
                    j = 2 * k
                    m1, l1, y1, m2, l2, y2 = um[j], ul[j], y[j], um[j + 1], ul[j + 1], y[j + 1]
                    m3, l3, y3 = um[j + 2], ul[j + 2], y[j + 2]
                else:
                    m1, l1, y1 = input_at(um, k, s), input_at(ul, k, s), input_at(y, k, s)
                    m2, l2, y2 = input_at(um, k, mid), input_at(ul, k, mid), input_at(y, k, mid)
                    m3, l3, y3 = input_at(um, k, target), input_at(ul, k, target), input_at(y, k, target)
                if relaxing:
                    z1 = 0.0
                    for i in range(MOST_BRANCHES):
                        z1 += spring[i] * zs[0, i]
                a1, b1, c1, d1, f1, g1, acc_s, acc, link, T, tau, net_m, net_l, level_m, level_l = (
                    scalar_rates_inlined(
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
                        HELD,
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
                        at,
                        on,
                        z1,
                        seat,
                    )
                )
                g = 0.5 * d
                if relaxing:
                    z2 = relaxed(zs, 1, 0, v_s - v, 1.0, g, spring, slow)
                a2, b2, c2, d2, f2, g2, _1, _2, _3, _4, _5, _6, _7, _8, _9 = scalar_rates_inlined(
                    q_s + g * a1, v_s + g * b1, q + g * c1, v + g * d1, r + g * f1, u + g * g1, t + g, m2, l2, y2,
                    HELD, p, turn, f, dry_m, dry_l, sm, sl, RICH, P, S, mem, at, on, z2, seat,
                )  # fmt: skip
                if relaxing:
                    z3 = relaxed(zs, 2, 1, v_s + g * b1 - v - g * d1, 2.0, g, spring, slow)
                a3, b3, c3, d3, f3, g3, _1, _2, _3, _4, _5, _6, _7, _8, _9 = scalar_rates_inlined(
                    q_s + g * a2, v_s + g * b2, q + g * c2, v + g * d2, r + g * f2, u + g * g2, t + g, m2, l2, y2,
                    HELD, p, turn, f, dry_m, dry_l, sm, sl, RICH, P, S, mem, at, on, z3, seat,
                )  # fmt: skip
                if relaxing:
                    z4 = relaxed(zs, 3, 2, v_s + g * b2 - v - g * d2, 2.0, d, spring, slow)
                a4, b4, c4, d4, f4, g4, _1, _2, _3, _4, _5, _6, _7, _8, _9 = scalar_rates_inlined(
                    q_s + d * a3, v_s + d * b3, q + d * c3, v + d * d3, r + d * f3, u + d * g3, t + d, m3, l3, y3,
                    HELD, p, turn, f, dry_m, dry_l, sm, sl, RICH, P, S, mem, at, on, z4, seat,
                )  # fmt: skip
                if relaxing:
                    relaxed(zs, 4, 3, v_s + d * b3 - v - d * d3, 1.0, 0.0, spring, slow)
                    z4 = 0.0
                    for i in range(MOST_BRANCHES):
                        zs[4, i] += d / 6.0 * zs[5, i]
                        z4 += spring[i] * zs[4, i]
                g = d / 6.0
                e_qs = q_s + g * (a1 + 2.0 * (a2 + a3) + a4)
                e_vs = v_s + g * (b1 + 2.0 * (b2 + b3) + b4)
                e_q = q + g * (c1 + 2.0 * (c2 + c3) + c4)
                e_v = v + g * (d1 + 2.0 * (d2 + d3) + d4)
                if MODES:
                    e_r = r + g * (f1 + 2.0 * (f2 + f3) + f4)
                    e_u = u + g * (g1 + 2.0 * (g2 + g3) + g4)
                if event == 0:
                    row = out[k]
                    row[X_QS], row[X_VS], row[X_AS], row[X_Q], row[X_V], row[X_A] = q_s, v_s, acc_s, q, v, acc
                    row[X_LINK], row[X_MOUNT] = (0.0, link) if mode == 3 else (link, 0.0)
                    row[X_TS], row[X_TAU], row[X_TEXT] = T, tau, 0.0
                if not (dry_m or dry_l or play):
                    break
                if pending == 0:
                    if event >= MAX_EVENTS - 2:
                        break
                    share = 1.0
                    if dry_m and sm != 0 and sm * e_vs < 0.0:
                        pending, share = 1, v_s / (v_s - e_vs) if sm * v_s > 0.0 else 0.0
                    if dry_l and sl != 0 and sl * e_v < 0.0:
                        part = v / (v - e_v) if sl * v > 0.0 else 0.0
                        if pending == 0 or part < share:
                            pending, share = 2, part
                    if (dry_m and sm == 0) or (dry_l and sl == 0):
                        _1, _2, _3, _4, _5, _6, _7, _8, _9, _a, _b, far_m, far_l, far_gm, far_gl = scalar_rates(
                            e_qs, e_vs, e_q, e_v, e_r, e_u, t0 + (k + 1.0) * h, m3, l3, y3, HELD, p, turn, f, dry_m,
                            dry_l, sm, sl, RICH, P, S, mem, at, on, z4, seat,
                        )  # fmt: skip
                        if dry_m and sm == 0:
                            go = direction(far_m, far_gm, P, FM_PLUS)
                            if go != 0:
                                part = release(net_m, far_m, level_m, far_gm, P, FM_PLUS, go)
                                if pending == 0 or part < share:
                                    pending, share = 3 if go > 0 else 5, part
                        if dry_l and sl == 0:
                            go = direction(far_l, far_gl, P, FL_PLUS)
                            if go != 0:
                                part = release(net_l, far_l, level_l, far_gl, P, FL_PLUS, go)
                                if pending == 0 or part < share:
                                    pending, share = 4 if go > 0 else 6, part
                    if play:
                        before = windup_of_scalars(q_s, q, P, S) - centre
                        after = windup_of_scalars(e_qs, e_q, P, S) - centre
                        part = met(before, (v_s - v) * d, after, (e_vs - e_v) * d, half, seat)
                        if part < 2.0 and (pending == 0 or part < share):
                            pending, share = 7, part
                    if pending == 0:
                        break
                    target = s + share * (1.0 - s)
                    if target - s > 1e-9:
                        continue
                    e_qs, e_vs, e_q, e_v, e_r, e_u = q_s, v_s, q, v, r, u
                    if relaxing:
                        zs[4], z4 = zs[0], z1
                # the event itself, at fraction target
                q_s, v_s, q, v, r, u = e_qs, e_vs, e_q, e_v, e_r, e_u
                if relaxing:
                    zs[0] = zs[4]
                if hyst:
                    remember(P, S, mem, windup_of_scalars(q_s, q, P, S))
                if pre != 0:
                    slide(P, mem, q_s if pre == AT_MOTOR else q, v_s if pre == AT_MOTOR else v)
                s, target = target, 1.0
                if pending == 1 or pending == 2:
                    if pending == 1:
                        v_s = 0.0
                    else:
                        v = 0.0
                    stuck_m, stuck_l = (0, sl) if pending == 1 else (sm, 0)
                    _1, _2, _3, _4, _5, _6, _7, _8, _9, _a, _b, far_m, far_l, far_gm, far_gl = scalar_rates(
                        q_s, v_s, q, v, r, u, t0 + (k + s) * h, input_at(um, k, s), input_at(ul, k, s), input_at(y, k, s),
                        HELD, p, turn, f, dry_m, dry_l, stuck_m, stuck_l, RICH, P, S, mem, at, on, z4, seat,
                    )  # fmt: skip
                    if pending == 1:
                        sm = direction(far_m, far_gm, P, FM_PLUS)
                    else:
                        sl = direction(far_l, far_gl, P, FL_PLUS)
                elif pending == 3 or pending == 5:
                    sm = 1 if pending == 3 else -1
                elif pending != 7:
                    sl = 1 if pending == 4 else -1
                elif seat != 0:
                    seat = 0
                else:
                    seat = 1 if windup_of_scalars(q_s, q, P, S) > centre else -1
                pending = 0
                e_qs, e_vs, e_q, e_v, e_r, e_u = q_s, v_s, q, v, r, u
                if s > 1.0 - 1e-9:
                    break
            q_s, v_s, q, v, r, u = e_qs, e_vs, e_q, e_v, e_r, e_u
            if relaxing:
                zs[0] = zs[4]
            if hyst:
                remember(P, S, mem, windup_of_scalars(q_s, q, P, S))
            if pre != 0:
                slide(P, mem, q_s if pre == AT_MOTOR else q, v_s if pre == AT_MOTOR else v)
        j = 2 * n
        _1, _2, _3, _4, _5, _6, acc_s, acc, link, T, tau, _7, _8, _9, _a = scalar_rates(
            q_s, v_s, q, v, r, u, t0 + n * h, um[j], ul[j], y[j], HELD, p, turn, f, dry_m, dry_l, sm, sl, RICH, P, S, mem,
            at, on, z4, int(np.int64(2)),  # no literal: for one it would be compiled anew
        )  # fmt: skip
        row = out[n]
        row[X_QS], row[X_VS], row[X_AS], row[X_Q], row[X_V], row[X_A] = q_s, v_s, acc_s, q, v, acc
        row[X_LINK], row[X_MOUNT] = (0.0, link) if mode == 3 else (link, 0.0)
        row[X_TS], row[X_TAU], row[X_TEXT] = T, tau, 0.0

    return compiled(integrate)


# By what they hold, in the order of the time a step takes: the first that holds all that a joint needs steps it. Friction
# and lines stand together, as they do in most searches: each costs the other 70 ns a step, and all laws on offer 150.
BENT, TURNING = HAS_SPRINGS | HAS_LOOPS | HAS_RUBS, HAS_LINES | HAS_RUBS
HOLDS = (0, HAS_MODE, TURNING, BENT, HAS_MODE | HAS_BRANCHES, HAS_ALL)
FREE = {holds: _scalar_simulator(holds, HELD=False) for holds in HOLDS}
FIXED = {holds: _scalar_simulator(holds, HELD=True) for holds in HOLDS}
