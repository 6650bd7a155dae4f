r"""The reduced-order joint, compiled once: two inertias, every catalogue effect switchable by a number.

All at the joint output, q_s = motor angle / n, Delta = q_s + e - q (e: kinematic error):

    J_L q'' + b_l q' = T_S + T_ext - gravity(q) + load forces
    J_M q_s'' + b_m q_s' = tau - T_S + motor forces
    T_S = K Delta + c Delta' + transmission laws

Fixed-step fourth-order Runge-Kutta. Dry friction is handled exactly: inside a step its direction is fixed, a reversal
is located, the velocity set to zero there, and the contact sticks for as long as the net torque stays below breakaway
(no smoothed sign). Rate-independent hysteresis is closed-form along the step, so it adds no stiffness. Play and stops
are exact piecewise laws.

With a recorded angle a fixed-gain observer moves the rigid body only (both inertias alike, so the wind-up is left
alone): x' = f(x, u) + L (y - C x).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.kernel.compiled import Real, compiled
from jointscope.diagnosis.kernel.full_steps import simulate_full
from jointscope.diagnosis.kernel.laws import tabled as tabled
from jointscope.diagnosis.kernel.laws import windup as windup
from jointscope.diagnosis.kernel.layout import *
from jointscope.diagnosis.kernel.scalar_steps import FIXED, FREE

BENDS = (PAR_SHARE, RUB, SOFT_SMOOTH, POW_K, GAP_ROUND, GAP_SHEDS, GAP_CORNER, GAP_IMPACT)


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
    um, ul, y, w = (np.ascontiguousarray(x) for x in (um, ul, y, w))  # each other layout is compiled anew
    mode, needs = what_it_needs(P, S)
    if mode < 0:
        simulate_full(x, P, S, um, ul, y, w, t0, h, out)
        return
    steppers = FIXED if S[MOTOR] == MOTOR_HELD else FREE
    step = next(stepper for holds, stepper in steppers.items() if needs & ~holds == 0)
    step(x, P, S, bool(S[FRICTION_M] != 0), bool(S[FRICTION_L] != 0), mode, um, ul, y, t0, h, out)


@compiled
def what_it_needs(P: Real, S: NDArray[np.int64]) -> tuple[int, int]:
    """The one mode there is (0: none; -1: what scalars can't hold), and what there is beside the plain joint's laws, as bits."""
    link, near, base = S[AT_LINK] >= 0, S[AT_NEAR] >= 0, S[AT_BASE] >= 0
    modes = int(link) + int(near) + int(base)
    if S[N_X] != 4 + 2 * modes + S[N_BRANCH] or modes > 1 or S[LOAD_PRESCRIBED] or S[MOTOR] == MOTOR_PRESCRIBED:
        return -1, 0
    mode = 1 if link else (2 if near else (3 if base else 0))
    needs = 0
    if mode != 0:
        needs |= HAS_MODE
    if S[N_BRANCH] > 0:
        needs |= HAS_BRANCHES
    if S[N_TE] > 0 or S[N_RIPPLE] > 0:
        needs |= HAS_LINES
    for entry in BENDS:
        if P[entry] != 0.0:
            needs |= HAS_SPRINGS
    if S[HYST_KIND] > 0 or P[REID] != 0.0 or S[TABLE_SITE] > 0:
        needs |= HAS_LOOPS
    if P[ROUND_M_SPEED] != 0.0 or P[ROUND_L_SPEED] != 0.0 or S[PRE_SITE] > 0:
        needs |= HAS_RUBS
    return mode, needs
