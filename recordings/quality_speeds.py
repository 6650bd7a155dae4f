"""Speeds that lag: the rate of the angle beside them, behind a low-pass or a cycle that nobody mentions.

A first-order low-pass of time constant T writes V for the rate A' by V + T V' = A'. Integrated, which needs no derivative of
a noisy record:

    A(t) = g int V + g T V(t) + c + d t

(d: offset of the speed; g: its scale). For a speed that is merely late T V is the first term of a series only, and it fits
better when it is moved; where all of the motion is slow, neither does.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_simpson

from jointscope.recordings.campaign import Run
from jointscope.recordings.finding import Finding

Vector = NDArray[np.float64]

EXPLAINED = 0.3  # of what the speed's integral leaves of the angle, that may be left with the lag
LEAST = 0.2  # of a sample, below which a lag is nobody's
CLEARLY = 0.5  # of the one that the other kind of lag leaves


@dataclass(frozen=True)
class Lag:
    """How a speed follows its angle's rate.

    Attributes:
        seconds: Time constant or delay [s].
        kind: Which of them, where the record tells.
    """

    seconds: float
    kind: Literal["low-pass", "delay", "either"]


def speed_findings(run: Run) -> Iterator[Finding]:
    """``lagging-speed`` for every speed whose angle the same device recorded at the same place."""
    for speed in run.select(role="output"):
        angle = run.angle_beside(speed)
        lag = None if angle is None else lag_of(angle.samples, speed.samples, speed.sampling_rate)
        if angle is None or lag is None:
            continue
        filtered = f"a first-order low-pass of {1.0 / (2.0 * math.pi * lag.seconds):.3g} Hz"
        why = {"low-pass": f": {filtered}", "delay": "", "either": f", or by {filtered}"}[lag.kind]
        detail = f"lags the rate of {angle.channel.column} by {1e3 * lag.seconds:.3g} ms{why}"
        yield Finding("lagging-speed", run.id, speed.channel.column, detail)


def lag_of(angle: Vector, speed: Vector, rate: float) -> Lag | None:
    """How ``speed`` lags the rate of ``angle``, both shape (n,); ``None`` where it does not."""
    if angle.size < 64 or not np.all(np.isfinite(angle) & np.isfinite(speed)) or not np.ptp(speed) > 0.0:
        return None
    path = np.asarray(cumulative_simpson(speed, dx=1.0 / rate, initial=0.0))
    t = np.arange(angle.size) / rate
    moved = np.stack([path, np.ones_like(t), t], axis=1)
    without, _ = _left(moved, angle)
    filtered, fitted = _left(np.column_stack([moved, speed]), angle)
    seconds = float(fitted[3] / fitted[0]) if fitted[0] != 0.0 else 0.0
    moved[:, 0] = np.interp(t + seconds, t, path)
    late, _ = _left(moved, angle)
    if not seconds > LEAST / rate or min(filtered, late) > EXPLAINED * without:
        return None
    if filtered < CLEARLY * late:
        return Lag(seconds, "low-pass")
    return Lag(seconds, "delay" if late < CLEARLY * filtered else "either")


def _left(columns: NDArray[np.float64], x: Vector) -> tuple[float, Vector]:
    """RMS that the columns leave of ``x``, and their coefficients."""
    size = np.linalg.norm(columns, axis=0)
    found = np.linalg.lstsq(columns / size, x, rcond=None)[0] / size
    return float(np.sqrt(np.mean(np.square(x - columns @ found)))), found
