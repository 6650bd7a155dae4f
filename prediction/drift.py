r"""Open loop: how far a logged torque can be trusted, and what to do below that frequency.

A vertical arm integrates its torque twice, and above the horizontal gravity makes the error grow. Two things are done
where only the torque was logged. The offset of the log is taken from the rest before the motion, where the torque is
known to hold the arm. Then the run is predicted again with the offset moved by what is left uncertain of it: where the
two predictions part by more than ``TOLERABLE`` the accelerations are given above the frequency at which they agree, with
what lies below taken out, and the band is stated.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import signal as dsp

from jointscope.prediction.integrate import Motion
from jointscope.prediction.spectra import spectrum

Real = NDArray[np.float64]

TOLERABLE = 0.05  # rad of drift that leaves gravity's torque right to 5 %
AGREEMENT = 0.03  # of the spectrum: where drift moves it by less, 0.3 dB, the band is legitimate
_CREDIBLE_OFFSET = 0.05  # of the holding torque: a larger difference is not an offset but a finding
_SHORTEST_REST = 16  # samples


def resting_offset(torque: Real, hold: float) -> tuple[float, float]:
    """Mean difference of the log from ``hold`` in the rest before the motion, and its standard error [N m].

    Args:
        torque: The log's own samples [N m], shape (n,).
        hold: Torque that holds the arm at rest [N m].

    Returns:
        (0, the log's resolution or noise) where no rest is found or the difference is no mere offset.
    """
    steps = np.abs(np.diff(torque))
    resolution = float(np.min(steps[steps > 0.0])) if np.any(steps > 0.0) else 0.0
    noise = 1.4826 * float(np.median(np.abs(np.diff(torque[: max(64, torque.size // 20)], 2)))) / np.sqrt(6.0)
    scatter = max(noise, 0.5 * resolution)
    level = float(np.mean(torque[:_SHORTEST_REST]))
    moved = np.flatnonzero(np.abs(torque - level) > 5.0 * scatter + 1e-12)
    rest = int(moved[0]) if moved.size else torque.size
    if rest < _SHORTEST_REST:
        return 0.0, scatter
    rest = max(_SHORTEST_REST, int(0.8 * rest))  # a smooth start is on its way before it is seen
    offset = float(np.mean(torque[:rest])) - hold
    error = scatter / np.sqrt(rest)
    if abs(offset) > _CREDIBLE_OFFSET * abs(hold) + 5.0 * error:
        return 0.0, scatter
    if abs(offset) < 3.0 * error:
        return 0.0, float(error)  # none to be seen: taking it off would put the noise's mean in its place
    return offset, float(error)


def legitimate_from(motion: Motion, moved: Motion) -> float:
    """Lowest frequency above which two predictions' accelerations agree [Hz]; 0 where they never part.

    Args:
        motion: The prediction.
        moved: The same with the torque's offset moved.
    """
    if float(np.max(np.abs(moved.angle - motion.angle))) < TOLERABLE:
        return 0.0
    central = spectrum(motion.acceleration, motion.rate, "hann")
    apart = spectrum(moved.acceleration - motion.acceleration, motion.rate, "hann")
    # compared in bands of 1 Hz: single lines may stand in a notch
    width = max(1, round(1.0 / float(central.frequency[1])))
    count = min(central.frequency.size // width, 100)
    power = [
        (np.sum(np.abs(s.amplitude[: count * width].reshape(count, width)) ** 2, axis=1)) for s in (central, apart)
    ]
    disagree = np.flatnonzero(np.sqrt(power[1]) > AGREEMENT * np.sqrt(power[0]))
    return float(disagree[-1] + 1) * width * float(central.frequency[1]) if disagree.size else 0.0


def drift_removed(values: Real, rate: float, lowest: float) -> Real:
    """``values``, shape (n,), without what lies below ``lowest`` [Hz]; zero-phase."""
    sections = dsp.butter(4, lowest, "highpass", fs=rate, output="sos")
    return np.asarray(dsp.sosfiltfilt(sections, values - values[0]), dtype=np.float64)
