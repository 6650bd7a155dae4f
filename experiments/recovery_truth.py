"""Hammer records with exact answers, by a route that shares nothing with the estimator: the closed-form response.

J q'' + c q' + K q = T_L with a half-sine pulse T_L(t) = A sin(pi t/T), 0 <= t <= T, from rest, has an elementary
solution; it is evaluated on a grid eight times as fine as the record, passed with the force through the same
anti-alias filter (Butterworth, order 8, causal), and only then sampled.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy import signal

Real = NDArray[np.float64]

OVERSAMPLING = 8


@dataclass(frozen=True, kw_only=True)
class Bench:
    """The braked rig and how it is recorded.

    Attributes:
        stiffness: K [N m/rad].
        inertia: J_L [kg m^2].
        damping: c [N m s/rad].
        rate: [Hz].
        duration: [s].
        hammer_radius: [m].
        accelerometer_radius: [m].
        filter_corner: Anti-alias filter over half the rate [-]; 0: none.
    """

    stiffness: float = 193_665.0
    inertia: float = 3.02
    damping: float = 59.76
    rate: float = 1024.0
    duration: float = 2.0
    hammer_radius: float = 0.8
    accelerometer_radius: float = 0.95
    filter_corner: float = 0.8


@dataclass(frozen=True, kw_only=True)
class Pulse:
    """One hit: peak force [N], contact time [s], start [s]."""

    peak: float
    contact: float
    start: float


def draw_pulses(rng: np.random.Generator, count: int) -> list[Pulse]:
    """Hits of 60-500 N lasting 5-10 ms that start 20-30 ms into the record."""
    return [
        Pulse(
            peak=float(np.exp(rng.uniform(np.log(60.0), np.log(500.0)))),
            contact=float(rng.uniform(5e-3, 10e-3)),
            start=float(rng.uniform(0.02, 0.03)),
        )
        for _ in range(count)
    ]


def acceleration(bench: Bench, pulse: Pulse, times: Real) -> Real:
    """q'' [rad/s^2] at ``times`` [s], in closed form."""
    J, c, K = bench.inertia, bench.damping, bench.stiffness
    torque, drive = pulse.peak * bench.hammer_radius, np.pi / pulse.contact
    decay = c / (2.0 * J)
    ring = np.sqrt(K / J - decay**2)
    pole = complex(-decay, ring)
    held = torque / complex(
        K - J * drive**2, c * drive
    )  # q = Im(held e^{i drive t}) + Re(free e^{pole t}) in contact

    def free_from(q: float, speed: float) -> complex:
        return complex(q, -(speed + decay * q) / ring)

    free = free_from(-held.imag, -(1j * drive * held).imag)
    end = np.exp(pole * pulse.contact) * free
    swing = held * np.exp(1j * drive * pulse.contact)
    after = free_from(
        end.real + swing.imag, (pole * np.exp(pole * pulse.contact) * free).real + (1j * drive * swing).imag
    )
    t = times - pulse.start
    inside = (-(drive**2) * held * np.exp(1j * drive * t)).imag + (
        pole**2 * free * np.exp(pole * t.clip(0.0))
    ).real
    beyond = (pole**2 * after * np.exp(pole * (t - pulse.contact).clip(0.0))).real
    return np.where(t < 0.0, 0.0, np.where(t <= pulse.contact, inside, beyond))


@cache
def _anti_alias(corner: float, fine: float) -> Real:
    return np.asarray(signal.butter(8, corner, fs=fine, output="sos"))


def record(bench: Bench, pulse: Pulse, late: float = 0.0) -> tuple[Real, Real]:
    """Noise-free force [N] and tangential acceleration [m/s^2] as sampled, each of shape (n,).

    ``late`` [s] is by how much the acceleration's channel lags the force's.
    """
    fine = bench.rate * OVERSAMPLING
    times = np.arange(round(bench.duration * fine)) / fine
    t = times - pulse.start
    force = np.where((t >= 0.0) & (t <= pulse.contact), pulse.peak * np.sin(np.pi * t / pulse.contact), 0.0)
    both = np.stack([force, bench.accelerometer_radius * acceleration(bench, pulse, times - late)])
    if bench.filter_corner:
        both = signal.sosfilt(_anti_alias(bench.filter_corner * bench.rate / 2.0, fine), both, axis=1)
    return both[0, ::OVERSAMPLING], both[1, ::OVERSAMPLING]
