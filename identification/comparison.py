"""The textbooks' answers on the same FRF: half-power bandwidth, circle fit, least squares on H1. For comparison only."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from jointscope.identification.frf import Frf

Real = NDArray[np.float64]
Complex = NDArray[np.complexfloating[Any, Any]]


@dataclass(frozen=True, kw_only=True)
class ModeFigure:
    """One mode as one method sees it.

    Attributes:
        method: Its name.
        frequency: Natural frequency [Hz].
        damping_ratio: [-].
        b1: Modal constant of the accelerance [1/(kg m^2)].
    """

    method: str
    frequency: float
    damping_ratio: float
    b1: float

    @property
    def inertia(self) -> float:
        """1/b1 [kg m^2]."""
        return 1.0 / self.b1

    @property
    def stiffness(self) -> float:
        """a2/b1 [N m/rad]."""
        return (2.0 * np.pi * self.frequency) ** 2 / self.b1

    @property
    def damping(self) -> float:
        """a1/b1 [N m s/rad]."""
        return 4.0 * np.pi * self.frequency * self.damping_ratio / self.b1


def half_power(frequency: Real, accelerance: Complex, near: float) -> ModeFigure | None:
    """Bandwidth at -3 dB around the peak nearest to ``near`` [Hz], straight lines between the FRF's own lines.

    ``None`` where the peak does not fall to -3 dB on both sides.
    """
    size = np.abs(accelerance)
    window = (frequency > 0.8 * near) & (frequency < 1.25 * near)
    if window.sum() < 5:
        return None
    first = int(np.flatnonzero(window)[0])
    top = first + int(np.argmax(size[window]))
    limit = size[top] / np.sqrt(2.0)
    left, right = top, top
    while left > 0 and size[left] > limit:
        left -= 1
    while right < size.size - 1 and size[right] > limit:
        right += 1
    if size[left] > limit or size[right] > limit:
        return None
    low = np.interp(limit, size[left : left + 2], frequency[left : left + 2])
    high = np.interp(limit, size[right - 1 : right + 1][::-1], frequency[right - 1 : right + 1][::-1])
    ratio = float((high - low) / (2.0 * frequency[top]))
    return ModeFigure(
        method="half power",
        frequency=float(frequency[top]),
        damping_ratio=ratio,
        b1=float(2.0 * ratio * size[top]),
    )


def circle_fit(frequency: Real, accelerance: Complex, near: float, damping_ratio: float) -> ModeFigure | None:
    """Kennedy and Pancu's circle through the mobility around ``near`` [Hz], over four half-power bandwidths.

    The natural frequency is where the circle is run through fastest; damping is the mean over all pairs of points to
    either side, (w_a^2 - w_b^2)/(2 w_n (w_a tan(theta_a/2) + w_b tan(theta_b/2))) over w_n.
    """
    reach = max(4.0 * damping_ratio * near, 3.0 * float(frequency[1] - frequency[0]))
    keep = np.abs(frequency - near) <= reach
    if keep.sum() < 6:
        return None
    omega = 2.0 * np.pi * frequency[keep]
    mobility = accelerance[keep] / (1j * omega)
    design = np.column_stack([mobility.real, mobility.imag, np.ones(omega.size)])
    solution = np.linalg.lstsq(design, np.abs(mobility) ** 2, rcond=None)[0]
    centre = complex(solution[0], solution[1]) / 2.0
    radius = float(np.sqrt(max(solution[2] + abs(centre) ** 2, 0.0)))
    angle = np.unwrap(np.angle(mobility - centre))
    sweep = np.gradient(angle, omega**2)
    peak = int(np.argmax(np.abs(np.convolve(sweep, np.ones(3) / 3.0, mode="same")[1:-1]))) + 1
    around = slice(max(0, peak - 2), peak + 3)
    curve = np.polyfit(omega[around] - omega[peak], sweep[around], 2)
    natural = omega[peak] + (np.clip(-curve[1] / (2.0 * curve[0]), -1.0, 1.0) if curve[0] else 0.0)
    zero = np.interp(natural, omega, angle)
    turned = np.abs(angle - zero)
    below, above = np.flatnonzero(omega < natural), np.flatnonzero(omega > natural)
    pairs = [
        (omega[a] ** 2 - omega[b] ** 2)
        / (2.0 * natural * (omega[a] * np.tan(turned[a] / 2.0) + omega[b] * np.tan(turned[b] / 2.0)))
        for a in above
        for b in below
        if 0.3 < turned[a] < 2.6 and 0.3 < turned[b] < 2.6
    ]
    if not pairs:
        return None
    ratio = float(np.median(pairs))
    sign = 1.0 if (mobility[int(np.argmax(np.abs(mobility)))]).real >= 0.0 else -1.0
    return ModeFigure(
        method="circle fit",
        frequency=float(natural / (2.0 * np.pi)),
        damping_ratio=ratio,
        b1=float(sign * 2.0 * ratio * natural * 2.0 * radius),
    )


def least_squares_h1(frf: Frf, band: tuple[float, float], near: float, damping_ratio: float) -> ModeFigure | None:
    """The form (20) with b2 and b3 fitted to H1 by unweighted nonlinear least squares, as the paper does."""
    keep = (frf.frequency >= band[0]) & (frf.frequency <= band[1]) & np.isfinite(frf.h1)
    if keep.sum() < 6:
        return None
    s, target = frf.s[keep], frf.h1[keep]
    scale = 2.0 * np.pi * near
    x, size = s / scale, float(np.max(np.abs(target)))

    def error(values: Real) -> Real:
        b1, b2, b3, a1, a2 = values
        left = (b1 * x**2 + b2 * x + b3) / (x**2 + a1 * x + a2) - target / size
        return np.concatenate([left.real, left.imag])

    start = np.array([2.0 * damping_ratio, 0.0, 0.0, 2.0 * damping_ratio, 1.0])
    found = optimize.least_squares(error, start, method="lm")
    b1, _, _, a1, a2 = found.x
    if not (a2 > 0.0 and b1 != 0.0):
        return None
    a1, a2 = a1 * scale, a2 * scale**2
    if frf.shift:
        a1, a2 = a1 - 2.0 * frf.shift, a2 - (a1 - 2.0 * frf.shift) * frf.shift - frf.shift**2
    return ModeFigure(
        method="least squares on H1",
        frequency=float(np.sqrt(a2) / (2.0 * np.pi)),
        damping_ratio=float(a1 / (2.0 * np.sqrt(a2))),
        b1=float(b1 * size),
    )
