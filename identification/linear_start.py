"""Where the likelihood starts: iterated linear least squares (Sanathanan and Koerner 1963) over all hits' spectra.

The direct form (20) times its denominator is linear in its coefficients,

    s^2 Y = -a1 s Y - a2 Y + b1 s^2 S U,

and each pass divides by the last pass's denominator, so that the error counted is the output's own.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jointscope.errors import RefusedError
from jointscope.identification.errors_in_variables import HitSpectrum
from jointscope.identification.modal_model import ModalModel, single_mode

Real = NDArray[np.float64]
Complex = NDArray[np.complexfloating[Any, Any]]


def single_mode_start(hits: Sequence[HitSpectrum], passes: int = 12) -> ModalModel:
    """(a1, a2, b1) of one mode and one output by iterated linear least squares.

    Each hit is normalised by its level, so that hard hits don't outvote soft ones by more than their noise would.

    Raises:
        RefusedError: No pass gives an oscillating, decaying mode: the band holds no resonance.
    """
    s = 2j * np.pi * np.concatenate([hit.frequency for hit in hits])
    output = np.concatenate([hit.output[0] / hit.sensor[0] / hit.level for hit in hits])
    drive = np.concatenate([hit.input / hit.level for hit in hits])
    sensor = np.concatenate([np.abs(hit.sensor[0]) for hit in hits])
    peak = 2.0 * np.pi * _peak_frequency(hits)
    scale = np.array([peak, peak**2, 1.0])
    columns = np.column_stack([-s * output, -output, s**2 * drive]) * scale
    target = s**2 * output
    weight = sensor / np.abs(s**2 + 0.1 * peak * s + peak**2)
    best: tuple[float, Real] | None = None
    for _ in range(passes):
        rows = np.concatenate([(columns * weight[:, None]).real, (columns * weight[:, None]).imag])
        right = np.concatenate([(target * weight).real, (target * weight).imag])
        solution = np.linalg.lstsq(rows, right, rcond=None)[0] * scale
        a1, a2, b1 = solution
        if a2 > 0.0 and np.isfinite(solution).all():
            error = output - b1 * s**2 / (s**2 + abs(a1) * s + a2) * drive
            score = float(np.sum(np.abs(error * sensor) ** 2))
            if a1 > 0.0 and (best is None or score < best[0]):
                best = (score, solution)
        weight = sensor / np.maximum(np.abs(s**2 + a1 * s + a2), 1e-9 * peak**2)
    if best is None:
        raise RefusedError(
            f"no oscillating, decaying mode between {hits[0].frequency[0]:.3g} and {hits[0].frequency[-1]:.3g} Hz: "
            "the resonance lies outside the band or the record is too noisy; widen the band or hit harder"
        )
    a1, a2, b1 = best[1]
    return single_mode(b1=float(b1), a1=float(a1), a2=float(a2))


def _peak_frequency(hits: Sequence[HitSpectrum]) -> float:
    """Where the mean output over mean input spectrum is largest, weighted as H1 [Hz]."""
    common = hits[0].frequency
    same = [hit for hit in hits if hit.frequency.size == common.size]
    cross = np.sum([hit.output[0] * np.conj(hit.input) for hit in same], axis=0)
    power = np.sum([np.abs(hit.input) ** 2 for hit in same], axis=0)
    return float(common[int(np.argmax(np.abs(cross / power / same[0].sensor[0])))])
