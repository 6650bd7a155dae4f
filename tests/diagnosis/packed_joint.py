"""A joint as the compiled kernel takes it, for tests: packed numbers, switches, a run from rest."""

from __future__ import annotations

import math

import numpy as np

from jointscope.diagnosis import kernel as k

KW = dict(J_M=9.1, J_L=3.0, K=1.9e5, C=0.0)
W0 = math.sqrt(KW["K"] / KW["J_L"])


def packed(**numbers):
    P, S = np.zeros(k.N_P), np.zeros(k.N_S, dtype=np.int64)
    defaults = dict(HYST_ANGLE=1.0, FM_SPEED=1.0, FL_SPEED=1.0, FM_EXPONENT=2.0, FL_EXPONENT=2.0, STOP_EXPONENT=1.0,
                    STOP_SIDE=1.0, LOOP_LIMIT=1e300)  # fmt: skip
    S[[k.AT_LINK, k.AT_NEAR, k.AT_BASE, k.AT_BRANCH, k.AT_LOOP]] = -1
    S[k.N_X], S[k.MOTOR] = 4, k.MOTOR_HELD
    P[k.HYST_LEVEL_0 : k.HYST_LEVEL_0 + k.SLIP_ELEMENTS] = (0.4, 0.4, 0.8, 0.8, 1.2, 1.2, 1.6, 1.6)
    for name, value in {**defaults, **KW, **numbers}.items():
        if hasattr(k, name) and name in ("MOTOR", "HYST_KIND", "FRICTION_M", "FRICTION_L", "N_TE", "N_RIPPLE",
                                         "LOAD_PRESCRIBED", "N_BRANCH", "PRE_SITE"):  # fmt: skip
            S[getattr(k, name)] = value
        else:
            P[getattr(k, name)] = value
    return P, S


def modes(S, *switches):
    for switch in switches:
        S[switch] = S[k.N_X]
        S[k.N_X] += 2
    return S


def run(P, S, *, x=(0.0, 0.0, 0.0, 0.0), um=None, ul=None, duration=1.0, rate=4096.0, y=None, w=None):
    n = round(duration * rate)
    t = np.arange(2 * n + 1) / (2 * rate)
    zero = np.zeros(t.size)
    arrays = [zero if u is None else np.asarray(u(t), dtype=float) for u in (um, ul, y, w)]
    state = np.zeros(int(S[k.N_X]))
    state[: len(x)] = x
    out = np.zeros((n + 1, k.N_OUT))
    k.simulate(state, P, S, arrays[0], arrays[1], arrays[2], arrays[3], 0.0, 1.0 / rate, out)
    return t[::2], out
