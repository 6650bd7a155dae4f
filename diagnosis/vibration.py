"""A periodic disturbance from outside: steady from before the run's first sample, its phase another in every run.

It is superposed on the response through the linear base, H(jw) of each channel; the phase of each run is the one that
fits best, a nuisance (clocks of different runs have no common zero). At the joint's own resonance broadband noise looks
like such a line.
"""

from __future__ import annotations

import functools
import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len, rfft

from jointscope.diagnosis import kernel
from jointscope.diagnosis.channels import ACCELERATIONS
from jointscope.diagnosis.wind_up import WIND_UP
from jointscope.recordings.campaign import gearing

if TYPE_CHECKING:
    from jointscope.diagnosis.assembly import Assembly
    from jointscope.diagnosis.problem import Output, PreparedRun

Vector = NDArray[np.float64]
BESIDE = 20  # bins of a record on either side of a line, by which its noise is measured


@functools.lru_cache(maxsize=64)
def _hann(size: int) -> Vector:
    return np.hanning(size)


@functools.lru_cache(maxsize=64)
def _turning(step: float, size: int) -> NDArray[np.complex128]:
    return np.asarray(np.exp(1j * step * np.arange(size)))


def _carrier(output: Output, omega: float) -> NDArray[np.complex128]:
    """exp(j omega t) at the samples of ``output``, shape (n,); most trials of a record share their frequency."""
    if not output.times.size:
        return np.empty(0, dtype=np.complex128)
    first: complex = np.exp(1j * omega * output.times[0])
    return np.asarray(first * _turning(omega / output.rate, output.times.size))


def disturbance(assembly: Assembly, run: PreparedRun, predicted: list[Vector]) -> list[Vector]:
    """``predicted`` with the disturbance's response added at the run's best phase."""
    frequency, amplitude = assembly.chain.vibration
    omega = 2.0 * math.pi * frequency
    shapes = [
        amplitude * response(assembly, run, output, omega) * _carrier(output, omega) for output in run.outputs
    ]
    total = 0.0 + 0.0j
    for output, y, shape in zip(run.outputs, predicted, shapes, strict=True):
        r = (output.data - y)[output.mask]
        if r.size:
            # a robust size, so that a ring-down which the model misses does not outweigh the quiet part
            size = float(np.median(np.abs(r)))
            if not math.isfinite(size):  # a model that flew apart has no phase
                continue
            tapered = _hann(r.size) * np.clip(r, -6.0 * size, 6.0 * size)
            total += np.sum(np.conj(shape[output.mask]) * tapered) / beside(tapered, frequency / output.rate)
    phase = total / abs(total) if abs(total) > 0.0 else 1.0
    return [y + np.real(phase * shape) for y, shape in zip(predicted, shapes, strict=True)]


def beside(tapered: Vector, place: float) -> float:
    """Power of what is left beside a line, per sample: an angle's slow part is no noise to a tone.

    Of the whole where a record is too short, or too slow, to have anything beside it.

    Args:
        tapered: The residual, Hann tapered, shape (n,).
        place: Frequency of the line over the sampling rate.
    """
    size = next_fast_len(tapered.size, real=True)
    spectrum = rfft(tapered, size)
    at = round(place * size)
    near = np.concatenate([spectrum[max(at - BESIDE, 1) : max(at - 3, 1)], spectrum[at + 4 : at + 1 + BESIDE]])
    level = float(np.median(np.abs(near) ** 2)) / tapered.size if near.size else float(np.mean(np.square(tapered)))
    return max(level, 1e-300)


def response(assembly: Assembly, run: PreparedRun, output: Output, omega: float) -> complex:
    """Channel per unit of disturbance at ``omega`` [rad/s] through the linear base (observer included)."""
    P, s = assembly.P, 1j * omega
    spring = P[kernel.K] + s * P[kernel.C]
    mount = assembly.chain.vibration_mount
    load = P[kernel.J_L] * s * s + P[kernel.B_L] * s
    push = -P[kernel.J_L] if mount else 1.0
    L = np.array([P[kernel.OBS_1], P[kernel.OBS_2]])
    # unknowns: q_s, q; an observer adds the same injection to both, which stands on the right-hand side
    inject = L[0] * s + L[1] if L[0] != 0.0 else L[1] * s  # a followed speed gives no position
    row = np.array([P[kernel.OBS_QS] + P[kernel.OBS_VS], P[kernel.OBS_Q] + P[kernel.OBS_V]])
    motor = P[kernel.J_M] * s * s + P[kernel.B_M] * s
    A = np.array([[motor + spring, -spring], [-spring, load + spring]], dtype=np.complex128)
    if not run.motor_moves:
        A[0] = [1.0, 0.0]
    truth = np.linalg.solve(A, np.array([0.0, push]))
    follow = 0.0 + 0.0j
    if P[kernel.OBS_2] != 0.0:  # what the observer, which knows of no disturbance, has followed already
        follow = complex(inject / (s * s + inject) * (row @ truth))
    if output.quantity in ACCELERATIONS and output.location != "motor":
        value = s * s * truth[1] + (1.0 if mount else 0.0)
        return complex(value * ((output.radius or 1.0) if output.quantity == "linear-acceleration" else 1.0))
    if output.quantity == WIND_UP:
        return complex(truth[0] - truth[1])
    side = truth[0 if output.location == "motor" and run.spring else 1]  # a rigid axis has one motion
    scale = gearing(output.quantity, output.location, run.ratio)
    if output.quantity in ("angle", "position"):
        return complex((side - follow) * scale)
    if output.quantity in ("angular-velocity", "velocity"):
        return complex(s * (side - follow) * scale)
    if output.quantity in ACCELERATIONS:
        return complex(s * s * side * scale)
    return 0.0
