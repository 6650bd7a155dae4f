"""What a hit has for itself: its own gain and time, which no model foretells, and how far they are believed.

A hit's gain multiplies its response y and its time shifts it, so that of the first order they are columns of y and dy/dt.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from jointscope.diagnosis.noise import NoiseModel
    from jointscope.diagnosis.prepare import PreparedRun

Vector = NDArray[np.float64]

SCATTERS = 3.0  # standard deviations, within which a hit's own gain, time and force noise are believed


def is_hit(run: PreparedRun) -> bool:
    """Whether the run's excitation is an impact: hit point, direction and trigger then scatter from take to take."""
    if run.run.experiment != "hammer" or run.load_force is None:
        return False
    force = np.abs(run.load_force)
    return bool(np.any(force)) and float(np.mean(force > 0.05 * force.max())) < 0.2


def scatters_whole(run: PreparedRun) -> bool:
    """Whether a hit's own gain and time multiply its whole response.

    Held by an observer it mostly follows the record, whatever the hit was (:mod:`input_scatter`).
    """
    return is_hit(run) and run.mode != "observer"


def scatter_columns(run: PreparedRun, predicted: Sequence[Vector]) -> list[NDArray[np.float64]]:
    """[y, dy/dt] of each output, y counted from its first sample, shapes (n, 2)."""
    return [departure_columns(y, output.rate) for output, y in zip(run.outputs, predicted, strict=True)]


def departure_columns(y: Vector, rate: float) -> NDArray[np.float64]:
    """[y, dy/dt], y counted from its first sample, shape (n, 2): what a hit's gain and time multiply."""
    departure = y - y[0]
    return np.stack([departure, np.gradient(departure) * rate], axis=1)


def least_scatter(columns: NDArray[np.float64], left: Vector) -> Vector:
    """Least-squares (gain [-], time [s]) of one hit from its :func:`departure_columns`, shape (2,)."""
    size = np.linalg.norm(columns, axis=0)
    size[size == 0.0] = 1.0
    return np.asarray(np.linalg.lstsq(columns / size, left, rcond=1e-8)[0] / size)


def within_scatter(own: Vector, noise: NoiseModel) -> Vector:
    """A hit's (gain, time) within three standard deviations of their scatter, shape (2,)."""
    limit = SCATTERS * np.array([noise.gain, noise.timing])
    return np.clip(own, -limit, limit)
