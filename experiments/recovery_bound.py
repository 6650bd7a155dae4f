r"""The Cramer-Rao bound of K, J_L and c from hits, noise in both channels, force zero outside a contact of known length.

Unknowns of one hit besides theta = (K, J_L, c): the force's samples inside the contact. With dG/d theta analytic,

    G = s^2/D,  D = J_L s^2 + c s + K,   dG/dK = -G/D,  dG/dJ_L = -G s^2/D,  dG/dc = -G s/D,

the samples eliminated (Schur complement = a covariance of rank equal to their number) the Fisher matrix is

    I = sum_h J_h' (s_y^2 1 + s_u^2 (G E)(G E)')^{-1} J_h,   J_h = dG/d theta U_h,

over the real and imaginary parts of the lines in the band, E the Fourier kernel of the contact's samples.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from jointscope.experiments.recovery_truth import Bench, Pulse

Real = NDArray[np.float64]


def fisher_matrix(
    bench: Bench,
    pulses: Sequence[Pulse],
    acceleration_noise: Sequence[float],
    force_noise: Sequence[float],
    band: tuple[float, float],
) -> Real:
    """Fisher matrix of (K, J_L, c), shape (3, 3).

    Args:
        bench: The rig.
        pulses: The hits.
        acceleration_noise: Standard deviation of each hit's acceleration samples [m/s^2].
        force_noise: Of each hit's force samples [N].
        band: Lines used [Hz].
    """  # fmt: skip
    count = round(bench.rate * bench.duration)
    line = np.arange(1, count // 2)
    frequency = line * bench.rate / count
    s = 2j * np.pi * frequency[(frequency >= band[0]) & (frequency <= band[1])]
    D = bench.inertia * s**2 + bench.damping * s + bench.stiffness
    G = bench.accelerometer_radius * s**2 / D
    times = np.arange(count) / bench.rate
    total = np.zeros((3, 3))
    for pulse, noise_y, noise_u in zip(pulses, acceleration_noise, force_noise, strict=True):
        drive = np.pi / pulse.contact  # Laplace transform of the half sine, by hand
        U = (
            pulse.peak
            * bench.hammer_radius
            * drive
            * (1.0 + np.exp(-s * pulse.contact))
            / (s**2 + drive**2)
            * np.exp(-s * pulse.start)
        )
        slopes = np.stack([-G / D, -G * s**2 / D, -G * s / D], axis=1) * U[:, None]
        inside = times[(times >= pulse.start) & (times <= pulse.start + pulse.contact)]
        kernel = np.exp(-np.outer(s, inside)) * bench.hammer_radius / bench.rate
        line_noise = noise_y * np.sqrt(count / 2.0) / bench.rate
        J = np.concatenate([slopes.real, slopes.imag]) / line_noise
        M = G[:, None] * kernel * noise_u
        M = np.concatenate([M.real, M.imag]) / line_noise
        total += J.T @ np.linalg.solve(np.eye(J.shape[0]) + M @ M.T, J)
    return total
