"""Common poles of many spectra by vector fitting: the Sanathanan-Koerner iteration in a basis of its own poles.

Gustavsen and Semlyen 1999 (relaxed: Gustavsen 2006). Outputs, not FRFs, are fitted, so that one hit is enough and a
record cut off in mid-decay is no error: for output o of hit h

    sigma(s) Y_oh = (r_o(s) + mu_o + kappa_o s^2) S_o U_h + tau_oh(s),   sigma, r, tau in the same partial fractions.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jointscope.identification.errors_in_variables import HitSpectrum

Real = NDArray[np.float64]
Complex = NDArray[np.complexfloating[Any, Any]]


def starting_poles(low: float, high: float, count: int) -> Complex:
    """``count`` lightly damped poles spread evenly over ``low`` to ``high`` [Hz], upper half plane [rad/s]."""
    edges = 2.0 * np.pi * (low + (high - low) * (np.arange(count) + 0.5) / count)
    return np.asarray(edges * (-0.01 + 1j))


def _fractions(s: Complex, poles: Complex) -> Complex:
    """Real-coefficient partial fractions of conjugate pairs, shape (n, 2 n_poles)."""
    left, right = 1.0 / (s[:, None] - poles), 1.0 / (s[:, None] - np.conj(poles))
    columns = np.empty((s.size, 2 * poles.size), dtype=np.complex128)
    columns[:, 0::2] = left + right
    columns[:, 1::2] = 1j * (left - right)
    return columns


def _relocate(poles: Complex, weights: Real, constant: float) -> Complex:
    """Zeros of constant + sum of fractions: eigenvalues of A - b c/constant in real block form."""
    n = poles.size
    A, b = np.zeros((2 * n, 2 * n)), np.zeros(2 * n)
    for k, pole in enumerate(poles):
        A[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = [[pole.real, pole.imag], [-pole.imag, pole.real]]
        b[2 * k] = 2.0
    found = np.linalg.eigvals(A - np.outer(b, weights) / constant)
    found = np.where(found.real > 0.0, -np.conj(found), found)  # unstable ones are mirrored
    upper = found[found.imag > 1e-9 * np.abs(found)]
    return np.asarray(upper[np.argsort(upper.imag)], dtype=np.complex128)


def vector_fit(
    hits: Sequence[HitSpectrum], poles: Complex, *, passes: int = 8, transients: bool = False
) -> Complex:
    """Poles in the upper half plane [rad/s] that serve all outputs of all hits, at most as many as ``poles``.

    Each output is weighted by one over its rms. ``transients`` gives each record a transient of its own.
    """
    for _ in range(passes):
        if poles.size == 0:
            return poles
        rows, sides = [], []
        for hit in hits:
            s = 2j * np.pi * hit.frequency
            scale = np.abs(poles).mean()
            fractions = _fractions(s, poles) * scale
            for o, output in enumerate(hit.output):
                drive = hit.sensor[o] * hit.input
                own = np.concatenate([fractions, np.ones((s.size, 1)), (s[:, None] / scale) ** 2], axis=1)
                own = own * drive[:, None]
                if transients:
                    loose = np.concatenate([fractions, np.ones((s.size, 1)), s[:, None] / scale], axis=1)
                    own = np.concatenate([own, loose * np.abs(drive).mean()], axis=1)
                weight = 1.0 / np.sqrt(np.mean(np.abs(output) ** 2))
                shared = np.concatenate([-fractions * output[:, None], -output[:, None]], axis=1)
                block = np.concatenate([own, shared], axis=1) * weight
                real = np.concatenate([block.real, block.imag])
                norm = np.linalg.norm(real[:, : own.shape[1]], axis=0)
                real[:, : own.shape[1]] /= np.where(norm > 0.0, norm, 1.0)
                upper = np.asarray(np.linalg.qr(real, mode="r"))
                rows.append(upper[own.shape[1] :, own.shape[1] :])  # what the output's own unknowns can't explain
                sides.append(np.real(np.sum(shared[:, -1] * weight)))
        stacked = np.concatenate(rows)
        relaxed = np.zeros(
            stacked.shape[1]
        )  # the mean of sigma over the lines is one: keeps zero from being the answer
        size = sum(hit.frequency.size for hit in hits)
        for hit in hits:
            s = 2j * np.pi * hit.frequency
            relaxed[:-1] += np.real(_fractions(s, poles).sum(axis=0)) * np.abs(poles).mean()
            relaxed[-1] += s.size
        emphasis = np.linalg.norm(stacked) / size
        system = np.concatenate([stacked, emphasis * relaxed[None, :]])
        right = np.zeros(system.shape[0])
        right[-1] = emphasis * size
        solution = np.linalg.lstsq(system, right, rcond=None)[0]
        constant = solution[-1] if abs(solution[-1]) > 1e-8 else 1e-8
        new = _relocate(poles, solution[:-1] * np.abs(poles).mean(), float(constant))
        settled = new.size == poles.size and np.max(np.abs(new - poles) / np.abs(poles)) < 1e-6
        poles = new
        if settled:
            break
    return poles
