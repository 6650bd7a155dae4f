"""Recorded signals made comparable: on one clock, in one band, as the motion of one shaft at the joint's output."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from jointscope.recordings.bandlimited import resampled
from jointscope.recordings.campaign import SLIDING, Nameplate, Run, Signal

Real = NDArray[np.float64]
ORDER: Final = {
    "angle": 0, "position": 0, "angular-velocity": 1, "velocity": 1, "speed-command": 1,
    "angular-acceleration": 2, "acceleration": 2, "linear-acceleration": 2,
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Grid:
    """Sample times that several devices cover [s], uniform at ``rate`` [Hz]."""

    times: Real
    rate: float


def common_grid(signals: Sequence[Signal]) -> Grid | None:
    """The slowest device's rate over the time that all signals cover; ``None`` under 64 samples."""
    rate = min(signal.sampling_rate for signal in signals)
    begin = max(float(signal.times[0]) for signal in signals)
    end = min(float(signal.times[-1]) for signal in signals)
    count = math.floor((end - begin) * rate + 1e-6) + 1
    return Grid(begin + np.arange(count) / rate, rate) if count >= 64 else None


def on_grid(signal: Signal, grid: Grid) -> Real:
    """The signal at the grid's times, shape (n,); gaps bridged by straight lines."""
    x = signal.samples
    shift = (grid.times[0] - signal.stream.start) * signal.sampling_rate
    first = round(shift)
    if signal.sampling_rate == grid.rate and abs(shift - first) < 1e-6 and np.isfinite(x).all():
        return x[first : first + grid.times.size]
    return resampled(x, signal.sampling_rate, signal.stream.start, grid.times)


def low_passed(x: Real, rate: float, corner: float) -> Real:
    """Without phase, fourth order both ways [corner in Hz]."""
    from scipy.signal import butter, sosfiltfilt

    sections = butter(4, min(corner / (0.5 * rate), 0.95), output="sos")
    return np.asarray(sosfiltfilt(sections, x, padlen=min(x.size - 2, round(3 * rate / corner))), dtype=np.float64)


def high_passed(x: Real, rate: float, corner: float) -> Real:
    """The first-order high-pass of an ac coupling, settled at the first sample (bilinear)."""
    from scipy.signal import lfilter

    k = math.tan(math.pi * corner / rate)
    b, a = np.array([1.0, -1.0]) / (1.0 + k), np.array([1.0, (k - 1.0) / (1.0 + k)])
    return np.asarray(lfilter(b, a, x - x[0]), dtype=np.float64)


def differentiated(x: Real, rate: float, times: int) -> Real:
    """Central differences, for signals low-passed well below the rate."""
    for _ in range(times):
        x = np.gradient(x, 1.0 / rate)
    return x


def energy_frequency(x: Real, rate: float, share: float) -> float:
    """Frequency [Hz] below which ``share`` of the signal's energy lies, straight trend removed."""
    from scipy.signal import detrend
    from scipy.signal.windows import tukey

    # hardly tapered: a sweep holds its lowest frequencies at one end of the record
    power = np.abs(np.fft.rfft(detrend(x) * tukey(x.size, 0.05))) ** 2
    rising = np.cumsum(power)
    line = int(np.searchsorted(rising, share * rising[-1]))
    return max(line, 1) * rate / x.size


def rigid_band(run: Run) -> float | None:
    """Frequency [Hz] below which motor and arm may be taken to move as one, or ``None`` where no drive was recorded.

    It lies just above where the excitation begins, and never under 3 Hz: an elastic joint's modes are above.
    """
    for quantity in ("torque", "current", "force", "angle", "angular-velocity"):
        for signal in run.select(quantity):
            if signal.channel.location in ("motor", "load") and np.isfinite(signal.samples).all():
                if np.ptp(signal.samples) == 0.0:
                    continue
                first = energy_frequency(signal.samples, signal.sampling_rate, 0.02)
                return max(1.8 * first, 3.0)
    return None


def ratio_to_output(signal: Signal, rig: Nameplate) -> float | None:
    """1/n for the motor's shaft, 1 for the arm or load, 1/radius for a linear acceleration; ``None`` if not known."""
    channel = signal.channel
    if channel.quantity == "linear-acceleration":
        tangential = channel.direction == "tangential" and channel.radius is not None
        return 1.0 / channel.radius if tangential and channel.radius else None
    if channel.location == "motor" and channel.quantity not in SLIDING:
        return None if rig.reduction_ratio is None else 1.0 / rig.reduction_ratio
    return 1.0


def motions(run: Run, rig: Nameplate, location: str) -> list[Signal]:
    """Recorded motion outputs at ``location`` that are comparable, angles before speeds before accelerations."""
    found = [
        signal
        for signal in run.signals
        if signal.channel.samples is not None
        and signal.channel.quantity in ORDER
        and signal.channel.quantity != "speed-command"
        and signal.channel.location == location
        and ratio_to_output(signal, rig) is not None
        and (signal.channel.calibrated or signal.channel.quantity == "angle")
        and np.nanstd(signal.samples) > 0.0
    ]
    return sorted(found, key=lambda signal: ORDER[signal.channel.quantity])
