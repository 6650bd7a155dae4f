r"""The transmission's torque where it has a memory or another argument than MJCF gives it.

All at the joint output, Delta = q_s + kinematic error - q. Every law is evaluated once per step, in order of time; the
first evaluation, at t = 0, is where memories are unloaded.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

Law = Mapping[str, Any]
Part = Callable[[float, float, float], float]  # t [s], Delta [rad], Delta' [rad/s] -> torque [N m]

_QUIET = 1e-30  # rad^2/s^2
SHAPED_STEP = 0.02  # of a loop's angle, by which a shaped loop is followed


@dataclass(frozen=True, kw_only=True)
class Spring:
    """T_S = K el + k_2 el^2 + k_3 el^3 - soft clip(el, +-soft_angle) + c Delta', el: Delta outside the play.

    A smooth soft middle misses el d^2/(el^2 + d^2), d = soft_angle, in place of the clipped stretch.
    With bends for corners el = Delta - (r_+ - r_-)/2, r_+- = |Delta +- gap/2 + i gap_corner|, and c (d el/dDelta)^fade;
    where gap_corner is negative they are those of w log(1 + e^(x/w)), w = -gap_corner.
    On rounded flanks K s^(1/2) and c s^fade, s = |el| / (|el| + round), in place of K and c.

    Attributes:
        stiffness, quadratic, cubic: K [N m/rad], k_2 [N m/rad^2], k_3 [N m/rad^3].
        damping: c [N m s/rad].
        gap, centre: Total play and its middle [rad].
        gap_damping: Share of c inside the play [-].
        gap_sheds: 1 where a flank does not pull.
        gap_round, gap_fade: Depth over which a flank gives way [rad]; power to which its damping does [-].
        gap_impact: With such bends, damping per elastic torque [s/rad] beside it: Hunt and Crossley's.
        gap_corner: Half width of the bends in place of the play's corners, which no element of the MJCF gives; below
            zero that of bends whose ends fade as an exponential [rad].
        soft_stiffness, soft_angle: [N m/rad], [rad].
        soft_smooth: 1 where a soft middle has no corner, which no element of the MJCF gives.
        power_stiffness, power_angle, power_exponent: What grows with a power of the stretch, S el |el/d|^(p - 1); not in
            the MJCF [N m/rad], [rad], [-].
    """

    stiffness: float
    damping: float
    quadratic: float = 0.0
    cubic: float = 0.0
    gap: float = 0.0
    centre: float = 0.0
    gap_damping: float = 1.0
    gap_sheds: float = 0.0
    gap_round: float = 0.0
    gap_fade: float = 0.0
    gap_corner: float = 0.0
    gap_impact: float = 0.0
    soft_stiffness: float = 0.0
    soft_angle: float = 0.0
    soft_smooth: float = 0.0
    power_stiffness: float = 0.0
    power_angle: float = 1.0
    power_exponent: float = 2.0

    def stretch(self, delta: float) -> tuple[float, bool]:
        """Elastic part of the wind-up [rad], and whether the teeth touch."""
        half = 0.5 * self.gap
        inside = delta - self.centre if half > 0.0 else delta
        if half == 0.0:
            return inside, True
        if inside > half:
            return inside - half, True
        if inside < -half:
            return inside + half, True
        return 0.0, False

    def elastic(self, el: float, factor: float = 1.0) -> float:
        """Torque of the stretch ``el`` [N m]; ``factor`` scales K alone."""
        torque = (factor * self.stiffness + (self.quadratic + self.cubic * el) * el) * el
        if self.power_stiffness != 0.0:
            torque += self.power_stiffness * math.pow(abs(el) / self.power_angle, self.power_exponent - 1.0) * el
        if self.soft_smooth and self.soft_stiffness != 0.0:
            d = self.soft_angle
            torque -= self.soft_stiffness * el * d * d / (el * el + d * d)
        elif self.soft_stiffness != 0.0:
            torque -= self.soft_stiffness * min(max(el, -self.soft_angle), self.soft_angle)
        return torque

    def native(self, delta: float, rate: float) -> float:
        """What the MJCF's elements give: its damper acts inside the play too [N m]."""
        cornered = self
        if self.soft_smooth or self.power_stiffness != 0.0:
            soft = 0.0 if self.soft_smooth else self.soft_stiffness
            cornered = replace(self, soft_stiffness=soft, power_stiffness=0.0)
        return cornered.elastic(self.stretch(delta)[0]) + self.damping * rate

    def bent(self, x: float) -> tuple[float, float]:
        """Stretch [rad] and its slope [-] at a wind-up ``x`` from the middle of a play with bends for corners."""
        half = 0.5 * self.gap
        if self.gap_corner < 0.0:
            ends = [(side * x - half) / -self.gap_corner for side in (1.0, -1.0)]
            over, under = (max(e, 0.0) + math.log1p(math.exp(-abs(e))) for e in ends)
            return -self.gap_corner * (over - under), sum(0.5 + 0.5 * math.tanh(0.5 * e) for e in ends)
        above, below = (complex(x + side * half, self.gap_corner) for side in (1.0, -1.0))
        slope = 1.0 - 0.5 * (above.real / abs(above) - below.real / abs(below))
        return x - 0.5 * (abs(above) - abs(below)), slope

    def torque(self, delta: float, rate: float, factor: float = 1.0) -> float:
        """T_S [N m]."""
        if self.gap_corner != 0.0:
            el, slope = self.bent(delta - self.centre)
            bent = self.elastic(el, factor)
            share = math.pow(max(slope, 0.0), self.gap_fade)
            return bent + (share * self.damping + self.gap_impact * abs(bent)) * rate
        el, touching = self.stretch(delta)
        share = 1.0 if touching else self.gap_damping
        seated = abs(el) / (abs(el) + self.gap_round) if self.gap_round > 0.0 else 1.0
        total = self.elastic(el, factor * math.sqrt(seated)) + share * seated**self.gap_fade * self.damping * rate
        return 0.0 if self.gap_sheds and total * el <= 0.0 else total


def hysteresis(law: Law) -> Part:
    """T z with the travel over ``angle``: z' = 1 - s z (Dahl) or, Bouc-Wen with nu = 2, 1 - z^2 while loading.

    With a ``shape``, Bouc-Wen with nu = 1: z' = 1 - s z - shape |z|.
    """
    if law["form"] == "bouc-wen-shaped":
        shape = float(law["shape"])
        return _by_travel(law, lambda z, travel, rate: _bouc_wen_shaped(z, travel, shape))
    follow = _dahl if law["form"] == "dahl" else _bouc_wen
    return _by_travel(law, lambda z, travel, rate: follow(z, travel))


def bristles(law: Law) -> Part:
    """T z with the travel over ``angle``: z' = (1 - s z/g)^exponent, g = (1 + s sided) (1 + excess exp(-|v/speed|^fall)).

    And ``damping`` v (1 - s z/g): LuGre's law.
    """
    excess, speed, sided = float(law["excess"]), float(law["speed"]), float(law.get("sided", 0.0))
    torque, damping = float(law["torque"]), float(law.get("damping", 0.0))
    exponent, fall = float(law.get("exponent", 1.0)), float(law.get("fall", 2.0))

    def end(sign: float, rate: float) -> float:
        return (1.0 + math.copysign(sided, sign)) * (1.0 + excess * math.exp(-(abs(rate / speed) ** fall)))

    def follow(z: float, travel: float, rate: float) -> float:
        g = end(travel, rate)
        return g * _dahl(z / g, travel / g, exponent)

    elastic = _by_travel(law, follow)

    def part(t: float, position: float, rate: float) -> float:
        bent = elastic(t, position, rate)
        return bent + damping * rate * (1.0 - math.copysign(bent, bent * rate) / (torque * end(rate, rate)))

    return part if damping > 0.0 and torque > 0.0 else elastic


def _by_travel(law: Law, follow: Callable[[float, float, float], float]) -> Part:
    """``torque`` times a state that ``follow``s (state, travel over ``angle``, rate) and is 0 where the run begins."""
    torque, angle = float(law["torque"]), float(law["angle"])
    z, last = 0.0, 0.0

    def part(t: float, position: float, rate: float) -> float:
        nonlocal z, last
        if t <= 0.0:
            z, last = 0.0, position
            return 0.0
        travel = (position - last) / angle
        last = position
        z = follow(z, travel, rate)
        return torque * z

    return part


def _dahl(z: float, travel: float, exponent: float = 1.0) -> float:
    """The exact solution of dz/dx = s (1 - s z)^exponent; past the end, where a falling level leaves it, it decays back."""
    sign = math.copysign(1.0, travel)
    short = 1.0 - sign * z
    if exponent == 1.0 or short <= 0.0:
        return sign + (z - sign) * math.exp(-abs(travel))
    n = 1.0 - exponent  # (short^n)' = -n
    left = short**n - n * abs(travel)
    return sign * (1.0 - (left ** (1.0 / n) if left > 0.0 else 0.0))


def _bouc_wen(z: float, travel: float) -> float:
    if travel == 0.0:
        return z
    sign = math.copysign(1.0, travel)
    left, along = abs(travel), sign * z
    if along < 0.0:  # unloading is linear
        unloading = min(left, -along)
        along, left = along + unloading, left - unloading
        if along < 0.0:
            return sign * along
    return sign * math.tanh(math.atanh(min(along, 1.0 - 1e-12)) + left)


def _bouc_wen_shaped(z: float, travel: float, shape: float) -> float:
    """By midpoint steps."""
    sign = math.copysign(1.0, travel)
    steps = max(1, math.ceil(abs(travel) / SHAPED_STEP))
    h = travel / steps
    for _ in range(steps):
        middle = z + 0.5 * h * (1.0 - sign * z - shape * abs(z))
        z += h * (1.0 - sign * middle - shape * abs(middle))
    return z


def relaxation(law: Law) -> Part:
    """sum_i k (Delta - what has relaxed), each spring in line with a damper of time t_i; exact for a steady rate."""
    stiffness, times = float(law["stiffness"]), [float(t) for t in law["times"]]
    stretch = [0.0] * len(times)
    last_t, last = 0.0, 0.0

    def part(t: float, delta: float, rate: float) -> float:
        nonlocal last_t, last
        if t <= 0.0:
            stretch[:] = [0.0] * len(times)
            last_t, last = t, delta
            return 0.0
        step, travel = t - last_t, delta - last
        last_t, last = t, delta
        for i, time in enumerate(times):
            kept = math.exp(-step / time)
            stretch[i] = kept * stretch[i] + travel * (1.0 - kept) * time / step
        return stiffness * sum(stretch)

    return part


def rate_independent(law: Law) -> Part:
    """k |Delta| sgn(Delta'), its corner rounded over ``turning`` |Delta|."""
    coefficient, turning = float(law["coefficient"]), float(law["turning"])

    def part(t: float, delta: float, rate: float) -> float:
        return coefficient * abs(delta) * rate / math.sqrt(rate**2 + (turning * delta) ** 2 + _QUIET)

    return part


MEMORIES: dict[str, Callable[[Law], Part]] = {
    "hysteresis": hysteresis,
    "relaxation": relaxation,
    "rate-independent-damping": rate_independent,
}
