"""What the inputs of a sweep cannot foretell: where a rigid body that nothing holds drifts below the excitation.

Half a bit of a torque log carries a perfect model away by half a radian in five seconds. A torque sweep is made about a
posture, and below the band that it excites its log holds nothing but its own zero: there no model's angle or speed is
worth comparing, and a prediction is given without it. Runs whose speed was commanded are foretold in closed loop, and a
motion goes where its torque says: both keep everything.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt, welch

from jointscope.recordings.campaign import FORCES, Nameplate, Quantity, Run

Vector = NDArray[np.float64]

ASKED = 0.01  # of the input's greatest spectral density
BELOW = 0.45  # of the band's lower edge: corner of the cut, which takes 1 % of the edge itself
# what encoders give: where the body goes
FOLLOWING: tuple[Quantity, ...] = ("angle", "position", "angular-velocity", "velocity")


def lower_edge(x: Vector, rate: float) -> float:
    """Lowest frequency [Hz] at which ``x`` holds a hundredth of its greatest spectral density; 0 for a short record."""
    if len(x) < 1024 or not np.any(x):
        return 0.0
    frequency, density = welch(x - np.mean(x), rate, nperseg=min(len(x), round(4.0 * rate)))
    asked = frequency[density > ASKED * density.max()]
    return float(asked[0]) if asked.size else 0.0


def drift_corner(run: Run, rig: Nameplate) -> float | None:
    """Corner [Hz] below which this run's angles and speeds can't be foretold; ``None`` where nothing drifts."""
    tied = run.motor_held if rig.topology == "two-inertia" else rig.grounded(held=run.motor_held)
    if run.experiment != "torque-sweep" or tied or run.select("speed-command"):
        return None
    return below_sweep(run)


def below_sweep(run: Run) -> float | None:
    """Corner [Hz] below which the inputs of a sweep hold nothing; ``None`` where they hold everything."""
    drives = [s for s in run.select(role="input") if s.channel.quantity in FORCES]
    edge = min((lower_edge(s.samples, s.sampling_rate) for s in drives), default=0.0)
    return BELOW * edge if edge > 0.0 else None


def drift_free(x: Vector, corner: float, rate: float) -> Vector:
    """``x`` with what lies below ``corner`` [Hz] taken off at zero phase, its first value kept; same shape.

    The first value stands for the posture, as it is of a run that begins at rest.
    """
    sections = butter(3, min(corner, 0.4 * rate), "highpass", fs=rate, output="sos")
    if x.size <= 3 * (2 * len(sections) + 1) or not np.all(np.isfinite(x)):
        return x
    return np.asarray(x[0] + sosfiltfilt(sections, x - x[0]))
