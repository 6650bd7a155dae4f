"""What a drive's command alone says of its motor's speed: instruments for a law whose speed is noisy.

The law is linear in e = w_c - w_m and its integral. Where w_m has noise, least squares takes K_p down by the noise's share of e.
Two-stage least squares (Wooldridge 2010, 5.1) regresses e on functions of the command first, which is recorded as it was
sent, and the torque on what that gives: whatever else moves the machine, friction or a weight, only makes it less precise.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid

from jointscope.identification.drive_takes import Take

Real = NDArray[np.float64]
Explaining = Callable[[Real, Real], Real]

LATER = (0.05, 0.15)  # s by which the command is taken late: within these a drive has followed, or begun to


def law_columns(take: Take) -> Real:
    """e, its integral, the command's rate and the command, shape (n, 4) [rad/s, rad, rad/s^2, rad/s of the motor]."""
    assert take.speed is not None
    e = take.command - take.speed
    return np.column_stack([e, integral(e, take.rate), take.command_rate, take.command])


def instruments(take: Take) -> Real:
    """The command, itself later, what it has travelled since, its rate, and its path with a square, shape (n, k)."""
    late = [_delayed(take.command, lag * take.rate) for lag in LATER]
    path = integral(take.command, take.rate)
    travelled = [integral(take.command - c, take.rate) for c in late]
    return np.column_stack([take.command, take.command_rate, *late, *travelled, path, np.square(path)])


def as_recorded(columns: Real, known: Real) -> Real:
    """The law's columns as they are."""
    return columns


def by_command(columns: Real, known: Real) -> Real:
    """What the instruments make of the law's columns; columns that are among them stay as they are."""
    scale = np.linalg.norm(known, axis=0)
    used = known[:, scale > 0.0] / scale[scale > 0.0]
    return np.asarray(used @ np.linalg.lstsq(used, columns, rcond=1e-12)[0])


def integral(x: Real, rate: float) -> Real:
    """From the first sample on, by the trapezium rule, shape of ``x``."""
    return np.asarray(cumulative_trapezoid(x, dx=1.0 / rate, initial=0.0))


def _delayed(x: Real, samples: float) -> Real:
    at = np.arange(x.size, dtype=np.float64)
    return np.interp(at - samples, at, x)
