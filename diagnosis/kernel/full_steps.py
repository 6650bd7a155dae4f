"""The joint stepped as a state vector: every law, loops, branches and prescribed motions too."""

from __future__ import annotations

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
    winding_of,
    windup_of,
)
from jointscope.diagnosis.kernel.full_rates import rates, rates_inlined
from jointscope.diagnosis.kernel.laws import friction
from jointscope.diagnosis.kernel.layout import *


@compiled
def _record(P: Real, S: NDArray[np.int64], sm: int, sl: int, aux: Real, out: Real, k: int) -> None:
    """One node's row."""
    row = out[k]
    row[X_QS], row[X_VS], row[X_AS] = aux[10], aux[11], aux[5]
    row[X_Q], row[X_V], row[X_A] = aux[14], aux[15], aux[6]
    row[X_LINK], row[X_MOUNT], row[X_TS] = aux[7], aux[16], aux[2]
    row[X_TAU] = aux[12] if S[AT_LOOP] >= 0 else aux[8]
    torque = aux[13]
    if S[LOAD_PRESCRIBED]:
        if S[FRICTION_L]:
            torque += sl * (
                aux[4] + friction(P[FL_PLUS], P[FL_MINUS], P[FL_EXCESS], P[FL_SPEED], P[FL_EXPONENT], aux[15], sl)
            )
    elif S[FRICTION_M]:
        torque += sm * (
            aux[3] + friction(P[FM_PLUS], P[FM_MINUS], P[FM_EXCESS], P[FM_SPEED], P[FM_EXPONENT], aux[11], sm)
        )
    row[X_TEXT] = torque


@compiled
def simulate_full(
    x: Real, P: Real, S: NDArray[np.int64], um: Real, ul: Real, y: Real, w: Real, t0: float, h: float, out: Real
) -> None:
    """Every law; see :func:`simulate`."""
    n = out.shape[0] - 1
    m = S[N_X]
    k1, k2, xt, total, xn = np.zeros(m), np.zeros(m), np.zeros(m), np.zeros(m), np.zeros(m)
    aux, ahead = np.zeros(N_AUX), np.zeros(N_AUX)
    mem = np.zeros(N_MEM)
    pre = 0 if S[PRE_SITE] == AT_MOTOR else 2
    mem[8] = x[pre]
    mem[5] = 1e9  # angle about which weight is expanded; none yet
    mem[MEM_TURN::3] = 1e9  # the lines' arguments alike
    mem[0] = windup_of(x, P, S, y[0])
    mem[MEM_SEAT] = 2.0
    half, centre = P[GAP_HALF], P[GAP_CENTRE]
    play = sets_in_at_once(P)
    hyst = S[HYST_KIND] != 0
    dry_m = S[FRICTION_M] != 0 and S[MOTOR] == MOTOR_FREE
    dry_l = S[FRICTION_L] != 0 and S[LOAD_PRESCRIBED] == 0
    sm = 1 if x[1] > 0.0 else (-1 if x[1] < 0.0 else 0)
    sl = 1 if x[3] > 0.0 else (-1 if x[3] < 0.0 else 0)
    for k in range(n):
        if S[LOAD_PRESCRIBED]:
            sl = 1 if w[2 * k] > 0.0 else (-1 if w[2 * k] < 0.0 else 0)
        if S[MOTOR] == MOTOR_PRESCRIBED:
            sm = 1 if w[2 * k] > 0.0 else (-1 if w[2 * k] < 0.0 else 0)
        s, target, pending, part = 0.0, 1.0, 0, 1.0
        if play:
            mem[MEM_SEAT] = flank_of(windup_of(x, P, S, y[2 * k]) - centre, half)
        for event in range(MAX_EVENTS):
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
                    a, b, c, e = input_at(um, k, at), input_at(ul, k, at), input_at(y, k, at), input_at(w, k, at)
                rates_inlined(xt, k2, t0 + (k + at) * h, a, b, c, e, P, S, mem, sm, sl, aux, stage == 0)
                weight = 1.0 if stage == 0 or stage == 3 else 2.0
                ahead_by = 0.5 * d if stage < 2 else d
                for i in range(m):
                    total[i] += weight * k2[i]
                    xt[i] = x[i] + ahead_by * k2[i]
            for i in range(m):
                xn[i] = x[i] + d / 6.0 * total[i]
            if event == 0:
                _record(P, S, sm, sl, aux, out, k)
            if not (dry_m or dry_l or play):
                break
            if pending == 0:
                if event >= MAX_EVENTS - 2:
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
                    rates(xn, k1, t0 + (k + 1.0) * h, um[j], ul[j], y[j], w[j], P, S, mem, sm, sl, ahead, True)
                    if dry_m and sm == 0:
                        go = direction(ahead[0], ahead[3], P, FM_PLUS)
                        if go != 0:
                            part = release(aux[0], ahead[0], aux[3], ahead[3], P, FM_PLUS, go)
                            if pending == 0 or part < share:
                                pending, share = 3 if go > 0 else 5, part
                    if dry_l and sl == 0:
                        go = direction(ahead[1], ahead[4], P, FL_PLUS)
                        if go != 0:
                            part = release(aux[1], ahead[1], aux[4], ahead[4], P, FL_PLUS, go)
                            if pending == 0 or part < share:
                                pending, share = 4 if go > 0 else 6, part
                if play:
                    before = windup_of(x, P, S, input_at(y, k, s)) - centre
                    after = windup_of(xn, P, S, y[2 * k + 2]) - centre
                    r0, r1 = winding_of(x, S, input_at(w, k, s)) * d, winding_of(xn, S, w[2 * k + 2]) * d
                    part = met(before, r0, after, r1, half, int(mem[MEM_SEAT]))
                    if part < 2.0 and (pending == 0 or part < share):
                        pending, share = 7, part
                if pending == 0:
                    break
                target = s + share * (1.0 - s)
                if target - s > 1e-9:
                    continue
                for i in range(m):
                    xn[i] = x[i]
            # the event itself, at fraction target
            if hyst:
                remember(P, S, mem, windup_of(xn, P, S, input_at(y, k, target)))
            if S[PRE_SITE] != 0:
                slide(P, mem, xn[pre], xn[pre + 1])
            for i in range(m):
                x[i] = xn[i]
            s, target = target, 1.0
            if pending == 1 or pending == 2:
                x[1 if pending == 1 else 3] = 0.0
                stuck_m, stuck_l = (0, sl) if pending == 1 else (sm, 0)
                a, b, c, e = input_at(um, k, s), input_at(ul, k, s), input_at(y, k, s), input_at(w, k, s)
                rates(x, k1, t0 + (k + s) * h, a, b, c, e, P, S, mem, stuck_m, stuck_l, ahead, True)
                if pending == 1:
                    sm = direction(ahead[0], ahead[3], P, FM_PLUS)
                else:
                    sl = direction(ahead[1], ahead[4], P, FL_PLUS)
            elif pending == 3 or pending == 5:
                sm = 1 if pending == 3 else -1
            elif pending != 7:
                sl = 1 if pending == 4 else -1
            elif mem[MEM_SEAT] != 0.0:
                mem[MEM_SEAT] = 0.0
            else:
                mem[MEM_SEAT] = 1.0 if windup_of(x, P, S, input_at(y, k, s)) > centre else -1.0
            pending = 0
            if s > 1.0 - 1e-9:
                for i in range(m):
                    xn[i] = x[i]
                break
        if hyst:
            remember(P, S, mem, windup_of(xn, P, S, y[2 * k + 2]))
        if S[PRE_SITE] != 0:
            slide(P, mem, xn[pre], xn[pre + 1])
        for i in range(m):
            x[i] = xn[i]
    j = 2 * n
    mem[MEM_SEAT] = 2.0
    rates(x, k1, t0 + n * h, um[j], ul[j], y[j], w[j], P, S, mem, sm, sl, aux, True)
    _record(P, S, sm, sl, aux, out, n)
