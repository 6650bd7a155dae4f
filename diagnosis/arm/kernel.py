r"""All joints of an arm stepped at once: links, rotors, reducers, dry friction; compiled.

``travel`` steps motion along a path by Runge-Kutta of fourth order, ``shake`` small motion about rest by the exact
transition of its linear part. Both obey

    M(p) q'' + p' D (q' - e_k p'/2) + b_l q' + g + K_g y = T_S + J_hit' F  links
    J_M s'' + b_m s' + F_dry(s') = tau - T_S                               rotors that are not braked
    T_S = spring(s - y + e) + c' (s' - y' + e'), e = a (sin(o s + phase) - sin phase)
    tau = tau_0 + k_p (s_0 - s) - k_v s'                                   held by a drive
    tau = n eta T_e + a sin(o s + phase) + k_a (r + s_0 - s) + c_a (r' - s')   driven: logged torque, tied to the path r

The tie (an observer of about 1 Hz on the recorded motor angle) keeps a measured torque from drifting away and is soft
against everything in the band. Dry friction is exact: at the start of a step a rotor at rest stays there while what acts
on it is less than its breakaway torque; a sliding one keeps its direction through the step and stops where it would turn.
Friction with presliding is Dahl's, in closed form along the step; so is a reducer's own loop, T z beside its spring.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

(
    STIFFNESS, DAMPING, ROTOR_INERTIA, ROTOR_DAMPING, DRIVE_STIFFNESS, DRIVE_DAMPING, COULOMB, BREAKAWAY,
    STRIBECK_SPEED, GAP, GAP_DAMPING, CUBIC, SOFT_SHARE, SOFT_WIDTH, REST_TORQUE, REST_WIND_UP, LINK_DAMPING,
    SIDED, PRESLIDING, SHEDS, LOOP_TORQUE, LOOP_ANGLE, LOOP_SLIPS,
    RIPPLE, RIPPLE_ORDER, RIPPLE_PHASE, ERROR, ERROR_ORDER, ERROR_PHASE, ERROR_REACTS,
) = range(30)  # fmt: skip
COLUMNS = 30  # of a joint's row
SLIPS = 4  # springs of a loop that slip one after the other

BRAKED, HELD, DRIVEN, FREE = 0, 1, 2, 3


@njit(cache=True, nogil=True, inline="always", error_model="numpy", fastmath={"contract", "nsz"})
def _spring(wind_up: float, p: Any) -> float:  # noqa: ANN401 - a numba array
    half = 0.5 * p[GAP]
    d = wind_up
    if half > 0.0:
        if d > half:
            d -= half
        elif d < -half:
            d += half
        else:
            d = 0.0
    torque = p[STIFFNESS] * d + p[CUBIC] * d * d * d
    if p[SOFT_SHARE] != 0.0:
        torque -= p[SOFT_SHARE] * p[STIFFNESS] * p[SOFT_WIDTH] * math.tanh(d / p[SOFT_WIDTH])
    return float(torque)


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "nsz"})
def reducer_torque(wind_up: float, rate: float, p: Any) -> float:  # noqa: ANN401
    """T_S of a joint with parameter row ``p`` at a wind-up [rad] and its rate [rad/s]."""
    torque = _spring(wind_up, p)
    if p[GAP] > 0.0 and abs(wind_up) < 0.5 * p[GAP]:
        return float(torque + p[GAP_DAMPING] * p[DAMPING] * rate)
    whole = torque + p[DAMPING] * rate
    if p[SHEDS] != 0.0 and whole * torque < 0.0:  # a flank does not pull
        return 0.0
    return float(whole)


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "nsz"})
def dry_limit(v: float, p: Any) -> float:  # noqa: ANN401
    """Dry friction's size at a speed [N m]: T_c + (T_b - T_c) exp(-(v/v_s)^2)."""
    if p[BREAKAWAY] > p[COULOMB]:
        return float(p[COULOMB] + (p[BREAKAWAY] - p[COULOMB]) * math.exp(-((v / p[STRIBECK_SPEED]) ** 2)))
    return float(p[COULOMB])


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "nsz"})
def bristle(z: float, travel: float, reach: float) -> float:
    """Deflection z of Dahl's bristle over its greatest, -1 to 1, after ``travel`` [rad] in one direction.

    The single joint's kernel has the same; code compiled here is kept by this file's date and must not call another's.
    """
    end = 1.0 if travel > 0.0 else -1.0
    return float(end - (end - z) * math.exp(-abs(travel) / reach))


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "nsz"})
def bristle_torque(z: float, v: float, p: Any) -> float:  # noqa: ANN401
    """What such friction holds back [N m]."""
    return float(z * dry_limit(v, p) * (1.0 + math.copysign(p[SIDED], z)))


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "nsz"})
def loop(held: Any, wound: float, p: Any, keep: bool) -> float:  # noqa: ANN401
    """z of a reducer's loop, -1 to 1, after it was wound up by ``wound`` [rad] in one direction; ``held`` is moved on request.

    Dahl's, or equal springs that slip in even steps: z = mean of clip(wound/angle + slip, +-y_i), mean of y_i = 1.
    """
    if p[LOOP_SLIPS] == 0.0:
        z = bristle(held[0], wound, p[LOOP_ANGLE])
        if keep:
            held[0] = z
        return float(z)
    total = 0.0
    for i in range(SLIPS):
        level = 2.0 * (i + 1.0) / (SLIPS + 1.0)
        z = min(max(held[i] + wound / p[LOOP_ANGLE], -level), level)
        total += z / SLIPS
        if keep:
            held[i] = z
    return float(total)


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "nsz"})
def _rates(
    x: Any, dx: Any, m: int, P: Any, kind: Any, slip: Any, inverse: Any, gravity: Any, slope: Any,  # noqa: ANN401
    product: Any, k: int, hit: Any, force: float, torque: float, tied: float, tie: float,  # noqa: ANN401
    tie_rate: float, right: Any, bent: Any, before: Any, loops: Any, wound: Any,  # noqa: ANN401
) -> None:  # fmt: skip
    """dx/dt; ``slip`` is the direction of each rotor's sliding, 0 where it sticks; x = y, y', s, s'."""
    pace = x[m + k] if k >= 0 else 0.0
    for i in range(m):
        p = P[i]
        s, v = x[2 * m + i], x[3 * m + i]
        error, turned = 0.0, 0.0
        if kind[i] == DRIVEN and p[ERROR] != 0.0:
            at = p[ERROR_ORDER] * (s - p[REST_WIND_UP]) + p[ERROR_PHASE]
            error = p[ERROR] * (math.sin(at) - math.sin(p[ERROR_PHASE]))
            turned = p[ERROR] * p[ERROR_ORDER] * math.cos(at)
        transmitted = reducer_torque(s - x[i] + error, v - x[m + i] + turned * v, p)
        if p[LOOP_TORQUE] != 0.0:
            transmitted += p[LOOP_TORQUE] * loop(loops[i], s - x[i] - wound[i], p, False)
        total = transmitted + hit[i] * force - gravity[i] - p[LINK_DAMPING] * x[m + i]
        for j in range(m):
            if j != k:
                total -= slope[i, j] * x[j] + pace * product[i, j] * x[m + j]
            else:
                total -= 0.5 * pace * pace * product[i, j]
        right[i] = total
        dx[i] = x[m + i]
        dx[2 * m + i] = v
        if kind[i] == BRAKED or slip[i] == 0:
            dx[2 * m + i] = 0.0
            dx[3 * m + i] = 0.0
            continue
        drive = 0.0
        if kind[i] == HELD:
            drive = p[REST_TORQUE] + p[DRIVE_STIFFNESS] * (p[REST_WIND_UP] - s) - p[DRIVE_DAMPING] * v
        elif kind[i] == DRIVEN:
            drive = torque + tied + tie * (p[REST_WIND_UP] - s) - tie_rate * v
            if p[RIPPLE] != 0.0:
                drive += p[RIPPLE] * math.sin(p[RIPPLE_ORDER] * (s - p[REST_WIND_UP]) + p[RIPPLE_PHASE])
            drive -= turned * p[ERROR_REACTS] * transmitted  # an error that does no work
        dry = 0.0
        if p[PRESLIDING] > 0.0:
            dry = bristle_torque(bristle(bent[i], s - before[i], p[PRESLIDING]), v, p)
        elif p[COULOMB] > 0.0 or p[BREAKAWAY] > 0.0:
            dry = slip[i] * dry_limit(v, p) * (1.0 + slip[i] * p[SIDED])
        dx[3 * m + i] = (drive - transmitted - p[ROTOR_DAMPING] * v - dry) / p[ROTOR_INERTIA]
    for i in range(m):
        total = 0.0
        for j in range(m):
            total += inverse[i, j] * right[j]
        dx[m + i] = total


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "nsz"})
def _directions(
    x: Any, m: int, P: Any, kind: Any, slip: Any, torque: float, tied: float, tie: float, loops: Any,  # noqa: ANN401
) -> None:  # fmt: skip
    """Which way each rotor slides in the step that begins, 0 where it sticks."""
    for i in range(m):
        p = P[i]
        if kind[i] == BRAKED:
            slip[i] = 0
            continue
        s, v = x[2 * m + i], x[3 * m + i]
        if v != 0.0 or p[PRESLIDING] > 0.0:
            slip[i] = 1 if v > 0.0 else -1
            continue
        error = 0.0
        if kind[i] == DRIVEN and p[ERROR] != 0.0:
            error = math.sin(p[ERROR_ORDER] * (s - p[REST_WIND_UP]) + p[ERROR_PHASE]) - math.sin(p[ERROR_PHASE])
        net = -reducer_torque(s - x[i] + p[ERROR] * error, v - x[m + i], p)
        if p[LOOP_TORQUE] != 0.0:
            net -= p[LOOP_TORQUE] * loop(loops[i], 0.0, p, False)
        if kind[i] == HELD:
            net += p[REST_TORQUE] + p[DRIVE_STIFFNESS] * (p[REST_WIND_UP] - s)
        elif kind[i] == DRIVEN:
            net += torque + tied + tie * (p[REST_WIND_UP] - s)
            net += p[RIPPLE] * math.sin(p[RIPPLE_ORDER] * (s - p[REST_WIND_UP]) + p[RIPPLE_PHASE])
        sticks = dry_limit(0.0, p)
        if sticks > 0.0 and abs(net) <= sticks * (1.0 + math.copysign(p[SIDED], net)):
            slip[i] = 0
        else:
            slip[i] = 1 if net >= 0.0 else -1


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "nsz"})
def travel(
    inverses: Any, gravities: Any, slopes: Any, products: Any, motions: Any, tilts: Any, biases: Any,  # noqa: ANN401
    statics: Any, hit: Any, k: int, low: float, spacing: float, P: Any, kind: Any, driven: int, force: Any,  # noqa: ANN401
    torque: Any, tied: Any, tie: float, tie_rate: float, dt: float, readings: Any, rotor: Any, x: Any,  # noqa: ANN401
) -> bool:  # fmt: skip
    """Step from state ``x`` over len(readings) - 1 steps along a path; whether the motion stayed finite.

    Args:
        force, torque, tied: Hammer [N], n eta T_e and k_a r + c_a r' [N m] at half steps.
        readings: Filled: accelerometers before coupling [m/s^2], shape (steps + 1, o).
        rotor: Filled: angle of the driven rotor from its rest [rad], shape (steps + 1,).
    """
    m, steps, sensors, nodes = P.shape[0], readings.shape[0] - 1, readings.shape[1], inverses.shape[0]
    slip = np.zeros(m, np.int64)
    right = np.empty(m)
    bent, before = np.zeros(m), x[2 * m : 3 * m].copy()
    loops, wound = np.zeros((m, SLIPS)), x[2 * m : 3 * m] - x[:m]
    k1, k2, k3, k4, y = np.empty(4 * m), np.empty(4 * m), np.empty(4 * m), np.empty(4 * m), np.empty(4 * m)
    inverse, gravity, slope, product = (
        inverses[0].copy(),
        gravities[0].copy(),
        slopes[0].copy(),
        products[0].copy(),
    )
    for step in range(steps + 1):
        h = 2 * step
        node, share = 0, 0.0
        if k >= 0 and nodes > 1:
            place = (x[k] - low) / spacing
            if not abs(place) < 1e9:
                return False
            node = min(max(math.floor(place), 0), nodes - 2)
            share = min(max(place - node, 0.0), 1.0)
            for i in range(m):
                gravity[i] = (1.0 - share) * gravities[node, i] + share * gravities[node + 1, i]
                for j in range(m):
                    inverse[i, j] = (1.0 - share) * inverses[node, i, j] + share * inverses[node + 1, i, j]
                    slope[i, j] = (1.0 - share) * slopes[node, i, j] + share * slopes[node + 1, i, j]
                    product[i, j] = (1.0 - share) * products[node, i, j] + share * products[node + 1, i, j]
        _directions(x, m, P, kind, slip, torque[h], tied[h], tie, loops)
        _rates(x, k1, m, P, kind, slip, inverse, gravity, slope, product, k, hit, force[h], torque[h], tied[h],
               tie, tie_rate, right, bent, before, loops, wound)  # fmt: skip
        other = node + 1 if share > 0.0 else node
        rest = 1.0 - share
        for o in range(sensors):
            total = rest * statics[node, o] + share * statics[other, o]
            for j in range(m):
                total += (rest * motions[node, o, j] + share * motions[other, o, j]) * k1[m + j]
                if j != k:
                    total += (rest * tilts[node, o, j] + share * tilts[other, o, j]) * x[j]
                if k >= 0:
                    rate = 0.5 * x[m + k] if j == k else x[m + j]
                    total += x[m + k] * (rest * biases[node, o, j] + share * biases[other, o, j]) * rate
            readings[step, o] = total
        if driven >= 0:
            rotor[step] = x[2 * m + driven] - P[driven, REST_WIND_UP]
        if step == steps:
            break
        for i in range(4 * m):
            y[i] = x[i] + 0.5 * dt * k1[i]
        _rates(y, k2, m, P, kind, slip, inverse, gravity, slope, product, k, hit, force[h + 1], torque[h + 1],
               tied[h + 1], tie, tie_rate, right, bent, before, loops, wound)  # fmt: skip
        for i in range(4 * m):
            y[i] = x[i] + 0.5 * dt * k2[i]
        _rates(y, k3, m, P, kind, slip, inverse, gravity, slope, product, k, hit, force[h + 1], torque[h + 1],
               tied[h + 1], tie, tie_rate, right, bent, before, loops, wound)  # fmt: skip
        for i in range(4 * m):
            y[i] = x[i] + dt * k3[i]
        _rates(y, k4, m, P, kind, slip, inverse, gravity, slope, product, k, hit, force[h + 2], torque[h + 2],
               tied[h + 2], tie, tie_rate, right, bent, before, loops, wound)  # fmt: skip
        for i in range(4 * m):
            x[i] += dt / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i])
        for i in range(m):
            if P[i, LOOP_TORQUE] != 0.0:
                loop(loops[i], x[2 * m + i] - x[i] - wound[i], P[i], True)
                wound[i] = x[2 * m + i] - x[i]
            if P[i, PRESLIDING] > 0.0:
                bent[i] = bristle(bent[i], x[2 * m + i] - before[i], P[i, PRESLIDING])
                before[i] = x[2 * m + i]
            elif kind[i] != BRAKED and dry_limit(0.0, P[i]) > 0.0 and x[3 * m + i] * slip[i] < 0.0:
                x[3 * m + i] = 0.0
        if not abs(x[0]) < 1e6:
            return False
    return True


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "nsz"})
def shake(
    transition: Any, start: Any, middle: Any, end: Any, u: Any, hold: Any, ramp: Any, springs: Any, rates: Any,  # noqa: ANN401
    P: Any, joints: Any, hold_dry: Any, speeds: Any, dry_joints: Any, hold_soft: Any, ramp_soft: Any,  # noqa: ANN401
    soft_speeds: Any, soft_joints: Any, C: Any, D: Any, F: Any, readings: Any,  # noqa: ANN401
) -> bool:  # fmt: skip
    """Small motion: the linear part propagated exactly, the joints' nonlinear torques by trapezoid, dry friction implicitly.

    x_{k+1} = Phi x_k + b_0 u_k + b_1 u_{k+1/2} + b_2 u_{k+1} + (G_0 - G_1) f_k + G_1 f_{k+1} + H r
    with f = T_S - T_S(rest) - K d - c d' of each nonlinear reducer, and r the friction that brings its rotor to rest
    within the step if no more than the limit is needed (Moreau's time stepping).

    Args:
        transition: Phi, shape (n, n).
        start, middle, end: b_0, b_1, b_2, shape (n,).
        u: The run's input at half steps, shape (2 steps + 1,).
        hold, ramp: G_0, G_1, shape (nf, n).
        springs, rates: Rows that read d and d', shape (nf, n).
        P: Joints' rows with their rest, shape (m, COLUMNS).
        joints: Rows of P of the nonlinear reducers, shape (nf,).
        hold_dry: H, shape (nd, n).
        speeds: Place of each sliding rotor's speed in x, shape (nd,).
        dry_joints: Rows of P of the rotors with dry friction, shape (nd,).
        hold_soft, ramp_soft: G_0, G_1 of the rotors whose friction has presliding, shape (ns, n).
        soft_speeds, soft_joints: The same of them, shape (ns,); their angles stand n/2 before their speeds.
        C, D, F: What is read: C x + D u + F f, shapes (o, n), (o,), (o, nf).
        readings: Filled, shape (steps + 1, o).
    """
    n, steps, outputs = transition.shape[0], readings.shape[0] - 1, readings.shape[1]
    nf, nd, ns = len(joints), len(dry_joints), len(soft_joints)
    x, free, y = np.zeros(n), np.zeros(n), np.zeros(n)
    f, g = np.zeros(nf), np.zeros(nf)
    bent, rubs, rubbed = np.zeros(ns), np.zeros(ns), np.zeros(ns)
    loops, wound = np.zeros((nf, SLIPS)), np.zeros(nf)
    rounds = 3 if ns > 0 else (2 if nf > 0 else 1)
    for step in range(steps + 1):
        for o in range(outputs):
            total = D[o] * u[2 * step]
            for i in range(n):
                total += C[o, i] * x[i]
            for a in range(nf):
                total += F[o, a] * f[a]
            readings[step, o] = total
        if step == steps:
            break
        for i in range(n):
            total = start[i] * u[2 * step] + middle[i] * u[2 * step + 1] + end[i] * u[2 * step + 2]
            for j in range(n):
                total += transition[i, j] * x[j]
            free[i] = total
        for a in range(nf):
            g[a] = f[a]
        for b in range(ns):
            rubbed[b] = rubs[b]
        for _ in range(rounds):
            for i in range(n):
                total = free[i]
                for a in range(nf):
                    total += hold[a, i] * f[a] + ramp[a, i] * (g[a] - f[a])
                for b in range(ns):
                    total -= hold_soft[b, i] * rubs[b] + ramp_soft[b, i] * (rubbed[b] - rubs[b])
                y[i] = total
            for d in range(nd):
                p = P[dry_joints[d]]
                here = x[speeds[d]]
                limit = dry_limit(here, p)
                need = -y[speeds[d]] / hold_dry[d, speeds[d]]
                need = min(max(need, -limit * (1.0 + p[SIDED])), limit * (1.0 - p[SIDED]))
                for i in range(n):
                    y[i] += hold_dry[d, i] * need
            for a in range(nf):
                wind_up, rate = 0.0, 0.0
                for i in range(n):
                    wind_up += springs[a, i] * y[i]
                    rate += rates[a, i] * y[i]
                p = P[joints[a]]
                whole = reducer_torque(p[REST_WIND_UP] + wind_up, rate, p)
                if p[LOOP_TORQUE] != 0.0:
                    whole += p[LOOP_TORQUE] * loop(loops[a], wind_up - wound[a], p, False)
                g[a] = whole - p[REST_TORQUE] - p[STIFFNESS] * wind_up - p[DAMPING] * rate
            for b in range(ns):
                p, at = P[soft_joints[b]], soft_speeds[b]
                z = bristle(bent[b], y[at - n // 2] - x[at - n // 2], p[PRESLIDING])
                rubbed[b] = bristle_torque(z, y[at], p)
        for b in range(ns):
            p, at = P[soft_joints[b]], soft_speeds[b]
            bent[b] = bristle(bent[b], y[at - n // 2] - x[at - n // 2], p[PRESLIDING])
            rubs[b] = rubbed[b]
        for a in range(nf):
            f[a] = g[a]
            if P[joints[a], LOOP_TORQUE] != 0.0:
                wind_up = 0.0
                for i in range(n):
                    wind_up += springs[a, i] * y[i]
                loop(loops[a], wind_up - wound[a], P[joints[a]], True)
                wound[a] = wind_up
        for i in range(n):
            x[i] = y[i]
        if not abs(x[0]) < 1e6:
            return False
    return True
