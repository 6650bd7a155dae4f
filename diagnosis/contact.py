"""The hammer's force outside its contacts is sensor noise, not force: without contact nothing pushes.

Left in, that noise drives the model through the quiet part of a record; whatever damps or blocks the model there
(dry friction above all) then seems to explain the recording.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

Vector = NDArray[np.float64]

PEAK_SHARE = 0.005  # of the peak below which a force is no contact
NOISE_REACH = 6.0  # robust standard deviations of the record within which a force is noise
MARGIN = 0.008  # s kept before and after a contact: the recorder's ringing belongs to the pulse
LONGEST = 0.25  # share of the record; a force that acts longer is no impact and is left alone


def resting_noise(force: Vector) -> float:
    """Standard deviation of the force cell's noise [as ``force``], shape (n,): what it reads while nothing touches."""
    good = force[np.isfinite(force)]
    return 1.4826 * float(np.median(np.abs(good - np.median(good)))) if good.size else 0.0


def contact_only(force: Vector, rate: float) -> Vector:
    """``force`` less its resting value, and zero outside the contacts, shape (n,); unchanged where it is no impact.

    Args:
        force: Samples, any unit, shape (n,).
        rate: Sampling rate [Hz].
    """
    good = force[np.isfinite(force)]
    if good.size < 64:
        return force
    rest = float(np.median(good))
    spread = resting_noise(good)
    departure = force - rest
    peak = float(np.nanmax(np.abs(departure)))
    contact = np.abs(departure) > max(NOISE_REACH * spread, PEAK_SHARE * peak)
    if peak == 0.0 or not np.any(contact) or np.mean(contact) > LONGEST:
        return force
    contact = binary_dilation(contact, iterations=max(2, round(MARGIN * rate)))
    return np.where(contact, departure, 0.0)
