"""Force laws of the joint, each a function of the packed numbers and of where the joint is."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.kernel.compiled import Real, compiled, inlined
from jointscope.diagnosis.kernel.layout import *

STRUCTURAL_WIDTH = 0.05  # of the velocity amplitude at REID_OMEGA over which the structural law turns round
SATURATED = 19.0  # where tanh is 1 to 1e-16, and exp(-2 x) nothing beside it
TURN = 0.02  # rad over which weight is expanded to third order (1e-8)
LINE_TURN = 0.25  # rad over which a line is expanded to sixth order (1e-8)


@inlined
def turned(arg: float, mem: Real, at: int) -> tuple[float, float]:
    """(sin, cos) of ``arg`` [rad], expanded about an angle nearby that ``mem`` holds from ``at`` on, and takes anew."""
    d = arg - mem[at]
    if abs(d) > LINE_TURN:
        mem[at], mem[at + 1], mem[at + 2], d = arg, math.sin(arg), math.cos(arg), 0.0
    e = d * d
    even = 1.0 - e * (0.5 - e * (1.0 / 24.0 - e * (1.0 / 720.0)))
    odd = d * (1.0 - e * (1.0 / 6.0 - e * (1.0 / 120.0 - e * (1.0 / 5040.0))))
    return mem[at + 1] * even + mem[at + 2] * odd, mem[at + 2] * even - mem[at + 1] * odd


@compiled
def quick_tanh(x: float) -> float:
    """tanh(x) by one exponential, to 1e-16 of 1."""
    if abs(x) > SATURATED:
        return 1.0 if x > 0.0 else -1.0
    e = math.exp(-2.0 * abs(x))
    rise = (1.0 - e) / (1.0 + e)
    return rise if x > 0.0 else -rise


@compiled
def approached(u: float, rate: float, r: float) -> float:
    """u after a travel ``r`` of u' = 1 - rate u: towards 1/rate, away from it where the rate is negative."""
    if abs(rate) < 1e-9:
        return u + r
    return float(u - (1.0 - rate * u) * math.expm1(max(min(-rate * r, 50.0), -50.0)) / rate)


@compiled
def shaped_loop(u: float, r: float, shape: float) -> float:
    """Bouc-Wen, nu = 1, gamma = 1, delta = ``shape``: u' = 1 - (1 + shape) u under load, 1 - (1 - shape) u before."""
    if u < 0.0:
        back = 1.0 - shape
        due = math.log1p(-back * u) / back if back > 1e-9 else -u
        if r <= due:
            return approached(u, back, r)
        u, r = 0.0, r - due
    return approached(u, 1.0 + shape, r)


@compiled
def hysteresis(z: float, d: float, y: float, kind: int, shape: float) -> float:
    """Normalised hysteretic torque after a monotone travel ``d`` from the state ``z``; yield angle ``y``."""
    if d == 0.0:
        return z
    if kind == 4:  # one spring that slips
        return min(max(z + d / y, -1.0), 1.0)
    s = 1.0 if d > 0.0 else -1.0
    r = abs(d) / y
    if kind == 1:
        return s + (z - s) * math.exp(-r)
    u = s * z
    if kind == 5:
        return s * shaped_loop(u, r, shape)
    if u < 0.0:  # Bouc-Wen, nu = 2, beta = gamma = 1/2: unloading is linear
        if r <= -u:
            return s * (u + r)
        r += u
        u = 0.0
    if u > 0.999999:
        return s
    t = quick_tanh(r)
    return s * (u + t) / (1.0 + u * t)  # tanh(atanh u + r)


@compiled
def slipping(mem: Real, d: float, P: Real) -> float:
    """Mean of equal springs' torques after a travel ``d``, each of which slips at its own limit (Maxwell-slip)."""
    share, total = d / P[HYST_ANGLE], 0.0
    for i in range(SLIP_ELEMENTS):
        limit = P[HYST_LEVEL_0 + i]
        total += min(max(mem[MEM_SLIP + i] + share, -limit), limit)
    return total / SLIP_ELEMENTS


@compiled
def bristle_end(s: float, v: float, P: Real) -> float:
    """g(v) of :func:`bristle` in the direction ``s``: the level on which bristles end, over PRE_TORQUE."""
    level = 1.0
    if P[PRE_EXCESS] != 0.0:
        r = v / P[PRE_SPEED]
        r = abs(r) if P[PRE_EXPONENT] == 1.0 else r * r
        if r < 2.0 * SATURATED:
            level += P[PRE_EXCESS] * math.exp(-r)
    return float(level * (1.0 + s * P[PRE_SIDED]))


@compiled
def bristle(z: float, d: float, v: float, P: Real) -> float:
    """Dry friction over PRE_TORQUE after a travel ``d`` at speed ``v`` from the state ``z``: built up over PRE_ANGLE.

    dz/dq = (1 - z s/g(v))^i / y, g = (1 + s PRE_SIDED) (1 + PRE_EXCESS exp(-(v/PRE_SPEED)^p)), i = 1 - PRE_BRITTLE:
    Dahl's law, with a breakaway LuGre's.
    """
    if d == 0.0:
        return z
    s = 1.0 if d > 0.0 else -1.0
    level = bristle_end(s, v, P)
    r = abs(d) / (P[PRE_ANGLE] * level)
    if P[PRE_BRITTLE] == 0.0:
        return float(s * level + (z - s * level) * math.exp(-r) if r < 2.0 * SATURATED else s * level)
    return s * level * (1.0 - remaining(1.0 - s * z / level, r, P[PRE_BRITTLE]))


@compiled
def remaining(u: float, r: float, brittle: float) -> float:
    """What is short of the end, u, after a travel ``r`` of u' = -u^i, i = 1 - ``brittle``; beyond the end i = 1."""
    if brittle == 0.0 or u <= 0.0:
        return u * math.exp(-r)
    power = u**brittle - brittle * r
    return float(power ** (1.0 / brittle)) if power > 0.0 else 0.0


@compiled
def bristles(z: float, d: float, v: float, load: float, P: Real) -> float:
    """What bristles resist with after a travel ``d`` at speed ``v`` from the state ``z`` [N m]: LuGre's law.

    sigma_0 y z + sigma_1 y z', with sigma_0 y = T and sigma_1 = T PRE_DAMPING, T = PRE_TORQUE + PRE_LOAD |``load``|.
    """
    bent = bristle(z, d, v, P)
    torque = P[PRE_TORQUE] + P[PRE_LOAD] * abs(load)
    if P[PRE_DAMPING] == 0.0:
        return float(torque * bent)
    s = 1.0 if v > 0.0 else -1.0
    return float(torque * (bent + P[PRE_DAMPING] * v * (1.0 - s * bent / bristle_end(s, v, P))))


@compiled
def rounded(torque: float, speed: float, excess: float, fall: float, sided: float, v: float) -> float:
    """T (1 +- sided) [1 + excess exp(-(v/fall)^2)] tanh(v/speed): dry friction that creeps where a contact sticks.

    With a ``speed`` below zero v/sqrt(v^2 + speed^2) takes the place of the hyperbolic tangent.
    """
    if excess != 0.0:
        r = v / fall
        if r * r < 2.0 * SATURATED:
            torque *= 1.0 + excess * math.exp(-r * r)
    rise = quick_tanh(v / speed) if speed > 0.0 else v / math.sqrt(v * v + speed * speed)
    return torque * (rise + sided * abs(rise))


@compiled
def by_quadrant(torque: float, share: float, v: float) -> float:
    """|T| (1 - share sgn(T v)) [N m]: a gear's friction is unlike where it drives and where it is driven back."""
    return abs(torque) - share * (torque if v > 0.0 else -torque)


@compiled
def through_gear(drive: float, rest: float, v: float, P: Real) -> float:
    """Torque T [N m] that passes the gear of a rigid axis with friction mu |T| sgn(v), ahead of T or behind it.

    U = J_M a + T (1 + k) and J a = T - R, or U = J_M a + T and J a = T (1 - k) - R, with k = mu sgn(v T), r = J_M/J:
    T (1 + r + k) = U + r R, or T (1 + r - r k) = U + r R. U is the ``drive``, R the ``rest`` of what the load takes.
    """
    r = P[GEAR_SHARE]
    total = drive + r * rest
    k = abs(P[PASSED]) if total * v > 0.0 else -abs(P[PASSED])
    return float(total / (1.0 + r + (k if P[PASSED] >= 0.0 else -r * k)))


@compiled
def seated(el: float, P: Real) -> float:
    """x/(x + x_h) at a depth x = |``el``| [rad]: its root times K is Hertz's power 3/2 at first, the whole K in the end."""
    depth = abs(el)
    return float(depth / (depth + P[GAP_ROUND]))


@compiled
def bent(x: float, half: float, corner: float) -> tuple[float, float]:
    """Stretch of a spring beyond +-``half`` [rad] whose corners are bends of half width ``corner``, and its slope [-].

    x - (r_+ - r_-)/2, r_+- = ((x +- half)^2 + corner^2)^(1/2): the dead zone where there is no bend. With a ``corner``
    below zero s_+ - s_-, s_+- = |corner| ln(1 + exp((+-x - half)/|corner|)): bends whose ends fade as an exponential.
    """
    if corner < 0.0:
        up, down = (x - half) / -corner, (-x - half) / -corner
        rising, falling = math.exp(-abs(up)), math.exp(-abs(down))
        stretch = max(up, 0.0) - max(down, 0.0) + math.log1p(rising) - math.log1p(falling)
        slope = (1.0 if up > 0.0 else rising) / (1.0 + rising) + (1.0 if down > 0.0 else falling) / (1.0 + falling)
        return float(-corner * stretch), float(slope)
    above, below, width = x + half, x - half, corner * corner
    upper, lower = math.sqrt(above * above + width), math.sqrt(below * below + width)
    slope = 1.0 - 0.5 * (above / upper - below / lower)
    return float(x - 0.5 * (upper - lower)), max(float(slope), 0.0)


@compiled
def faded(share: float, power: float) -> float:
    """share^power; of the two powers that fits end at most often without the time that a power takes."""
    if power == 0.0:
        return 1.0
    return share if power == 1.0 else float(share**power)


@compiled
def missing(el: float, angle: float, smooth: float) -> float:
    """The stretch that a soft middle of +-``angle`` [rad] does without, of a stretch ``el``."""
    if smooth != 0.0:
        return float(el * angle * angle / (el * el + angle * angle))
    return float(min(max(el, -angle), angle))


@compiled
def powered(el: float, P: Real) -> float:
    """What grows with a power of the stretch [N m]."""
    return float(P[POW_K] * el * (abs(el) / P[POW_ANGLE]) ** (P[POW_EXPONENT] - 1.0))


@compiled
def elastic(P: Real, delta: float, factor: float, seat: int) -> tuple[float, float]:
    """Elastic part of T_S at wind-up ``delta`` [rad] -> (torque [N m], share of c that acts [-]).

    ``seat``: flank of a play whose law is taken, +1 or -1, 0 between them; 2 where ``delta`` says it.
    """
    el = delta
    contact = 1.0
    if P[GAP_HALF] > 0.0:
        el = delta - P[GAP_CENTRE]
        if P[GAP_CORNER] != 0.0:
            el, slope = bent(el, P[GAP_HALF], P[GAP_CORNER])
            contact = faded(slope, P[GAP_FADE])
        elif seat == 1 or (seat == 2 and el > P[GAP_HALF]):
            el -= P[GAP_HALF]
        elif seat == -1 or (seat == 2 and el < -P[GAP_HALF]):
            el += P[GAP_HALF]
        else:
            el = 0.0
            contact = P[GAP_DAMPING]
        if P[GAP_ROUND] > 0.0:
            share = seated(el, P)
            el, contact = el * math.sqrt(share), contact * faded(share, P[GAP_FADE])
    torque = factor * P[K] * el
    if P[K_3] != 0.0 or P[K_2] != 0.0:
        torque += (P[K_2] + P[K_3] * el) * el * el
    if P[POW_K] != 0.0:
        torque += powered(el, P)
    if P[K_SOFT] != 0.0:
        torque -= P[K_SOFT] * missing(el, P[SOFT_ANGLE], P[SOFT_SMOOTH])
    return torque, contact


@compiled
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
        value, _contact = elastic(P, middle, 1.0, 2)
        if value < torque:
            low = middle
        else:
            high = middle
    return float(0.5 * (low + high))


@compiled
def friction(plus: float, minus: float, excess: float, speed: float, exponent: float, v: float, s: int) -> float:
    """Dry friction's level against direction ``s`` at speed ``v`` [N m]."""
    level = plus if s > 0 else minus
    if excess != 0.0 and level != 0.0:
        r = abs(v) / speed
        level *= 1.0 + excess * math.exp(-(r * r if exponent == 2.0 else r**exponent))
    return level


@compiled
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


@inlined
def with_table(T: float, P: Real, S: NDArray[np.int64], delta: float, rate: float, q: float) -> float:
    """T_S [N m] with the table's part over wind-up [rad] or its rate [rad/s]; of turn: a stiffness over the angle q."""
    if S[TABLE_OF] == OF_TURN:
        return T + delta * tabled(P, q)
    return T + tabled(P, delta if S[TABLE_OF] == OF_WIND_UP else rate)
