r"""How far a prediction is from a recording, in the field's measures.

Spectral: error per bin in dB, 20 log10(|P|/|R|); the frequency response assurance criterion
FRAC = |R^H P|^2 / (R^H R  P^H P) (1: same shape and phase); NRMSE = ||R - P|| / ||R||; peak frequency and peak height.
In time: the error of the project's contract, RMS(R - P) / RMS(R), for angles and positions over RMS(R - R_0).
R is the recorded, P the predicted side; both come from the same estimator (``spectra``).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from jointscope.prediction.spectra import Spectrum
from jointscope.recordings.campaign import Experiment, Quantity

Real = NDArray[np.float64]

PAPER_BANDS: dict[Experiment, tuple[tuple[float, float], ...]] = {
    "hammer": ((2.0, 50.0),),  # fitted over 0-50 Hz (section 3.2)
    "torque-sweep": ((10.0, 75.0), (4.0, 15.0)),  # agreement; prediction said to be low below 15 Hz (3.3.1)
    "speed-motion": ((1.0, 60.0), (60.0, 80.0)),  # agreement 0-60 Hz; said to be low above (3.3.2)
    "free": ((1.0, 60.0),),
}
"""Frequency bands [Hz] in which the paper states how well prediction and measurement agree."""

_FROM_START: frozenset[Quantity] = frozenset({"angle", "position"})


@dataclass(frozen=True, kw_only=True)
class BandScore:
    """Agreement of two spectra in one band.

    Attributes:
        low, high: Band [Hz].
        bins: How many bins were compared.
        share: Of the band's bins, the share compared (the rest were masked) [-].
        median_error: Median over bins of \\|20 log10(\\|P\\|/\\|R\\|)\\| [dB].
        error_95: Its 95 % quantile [dB]: what 19 of 20 bins keep.
        bias: Median of 20 log10(\\|P\\|/\\|R\\|) [dB]: below 0 the prediction is low.
        frac: Frequency response assurance criterion [-], 0 to 1.
        nrmse: RMS of the complex difference over RMS of the recorded spectrum [-].
        peak_frequency: Of the recorded spectrum's highest bin in the band [Hz].
        peak_frequency_error: Predicted minus recorded [Hz].
        peak_amplitude_error: 20 log10 of predicted over recorded peak height [dB].
    """

    low: float
    high: float
    bins: int
    share: float
    median_error: float
    error_95: float
    bias: float
    frac: float
    nrmse: float
    peak_frequency: float
    peak_frequency_error: float
    peak_amplitude_error: float


def band_score(
    recorded: Spectrum, predicted: Spectrum, low: float, high: float, mask: NDArray[np.bool_] | None = None
) -> BandScore:
    """Compare two spectra on the same frequency axis in [low, high] Hz.

    Args:
        recorded: R.
        predicted: P.
        low: Lower edge [Hz].
        high: Upper edge [Hz].
        mask: Which bins may count, shape (n,) (where the truth stands clear of the noise, for instance).

    Raises:
        ValueError: The axes differ, or no bin is left.
    """
    if recorded.frequency.shape != predicted.frequency.shape or not np.allclose(
        recorded.frequency, predicted.frequency
    ):
        raise ValueError("recorded and predicted spectra must share one frequency axis")
    in_band = recorded.band(low, high)
    chosen = in_band if mask is None else in_band & mask
    if not chosen.any():
        raise ValueError(f"no bin to compare in {low:g}-{high:g} Hz")
    R, P, f = recorded.amplitude[chosen], predicted.amplitude[chosen], recorded.frequency[chosen]
    tiny = np.finfo(float).tiny
    decibel = 20.0 * np.log10(np.maximum(np.abs(P), tiny) / np.maximum(np.abs(R), tiny))
    peak_R, height_R = _peak(f, np.abs(R))
    peak_P, height_P = _peak(f, np.abs(P))
    return BandScore(
        low=low,
        high=high,
        bins=int(chosen.sum()),
        share=float(chosen.sum() / in_band.sum()),
        median_error=float(np.median(np.abs(decibel))),
        error_95=float(np.quantile(np.abs(decibel), 0.95)),
        bias=float(np.median(decibel)),
        frac=frac(R, P),
        nrmse=float(np.linalg.norm(R - P) / max(float(np.linalg.norm(R)), tiny)),
        peak_frequency=peak_R,
        peak_frequency_error=peak_P - peak_R,
        peak_amplitude_error=20.0 * math.log10(max(height_P, tiny) / max(height_R, tiny)),
    )


def frac(recorded: NDArray[np.complex128], predicted: NDArray[np.complex128]) -> float:
    """Frequency response assurance criterion of two complex spectra, shape (n,) each; 0 where one of them vanishes."""
    energy = float(np.vdot(recorded, recorded).real * np.vdot(predicted, predicted).real)
    return float(np.abs(np.vdot(recorded, predicted)) ** 2 / energy) if energy > 0.0 else 0.0


def contract_error(recorded: Real, predicted: Real, quantity: Quantity) -> float:
    """RMS(recorded - predicted) / RMS(recorded); angles and positions over RMS(recorded - its initial value).

    Args:
        recorded: Shape (n,); samples that are NaN on either side do not count.
        predicted: Shape (n,).
        quantity: Of the channel.

    Returns:
        The error [-]; ``inf`` where the recording does not move at all but the prediction does.
    """
    known = np.isfinite(recorded) & np.isfinite(predicted)
    R, P = recorded[known], predicted[known]
    reference = R - R[0] if quantity in _FROM_START else R
    scale = float(np.sqrt(np.mean(reference**2)))
    error = float(np.sqrt(np.mean((R - P) ** 2)))
    if scale == 0.0:
        return 0.0 if error == 0.0 else math.inf
    return error / scale


def _peak(frequency: Real, height: Real) -> tuple[float, float]:
    """Place [Hz] and height of the highest bin, refined by the parabola through its neighbours (log height)."""
    top = int(np.argmax(height))
    if top in (0, height.size - 1) or np.min(height[top - 1 : top + 2]) <= 0.0:
        return float(frequency[top]), float(height[top])
    spacing = np.diff(frequency[top - 1 : top + 2])
    left, middle, right = np.log(height[top - 1 : top + 2])
    curvature = left - 2.0 * middle + right
    if curvature >= 0.0 or not np.isclose(spacing[0], spacing[1]):
        return float(frequency[top]), float(height[top])
    shift = 0.5 * (left - right) / curvature
    return float(frequency[top] + shift * spacing[0]), float(np.exp(middle - 0.25 * (left - right) * shift))
