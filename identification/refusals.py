"""When the hits can't carry an answer: each check raises with the reason and the way out."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from jointscope.errors import RefusedError
from jointscope.identification.errors_in_variables import HitSpectrum
from jointscope.identification.frf import Frf
from jointscope.identification.joint_values import main_mode_of
from jointscope.identification.modal_model import ModalModel
from jointscope.identification.result import Mode

VAGUE = 0.05  # half a 95 % interval over a frequency above which it is no resonance


def check_record(spectra: Sequence[HitSpectrum], start: ModalModel, band: tuple[float, float]) -> None:
    """The resonance must lie inside the band, and the record hold four of its periods."""
    frequency = float(start.natural_frequency[main_mode_of(start)] / (2.0 * math.pi))
    if not band[0] < frequency < 0.98 * band[1]:
        raise RefusedError(
            f"the resonance at {frequency:.3g} Hz lies outside the usable band of {band[0]:.3g} to {band[1]:.3g} Hz: "
            "a harder tip drives higher frequencies, a longer record reaches lower ones"
        )
    shortest = min(hit.duration for hit in spectra)
    if shortest * frequency < 4.0:
        raise RefusedError(
            f"the record of {shortest:.3g} s holds {shortest * frequency:.1f} periods of the resonance at "
            f"{frequency:.3g} Hz: too short; record at least {8.0 / frequency:.2g} s"
        )


def check_resonance(modes: Sequence[Mode], band: tuple[float, float]) -> None:
    """At least one mode must be a peak whose place is known to 5 % and whose width is known at all."""
    for mode in modes:
        place, width = mode.frequency, mode.damping_ratio
        known = 0.5 * (place.high - place.low) <= VAGUE * place.value and width.high <= 100.0 * width.low
        if known and width.value < math.sqrt(0.5):
            return
    nearest = modes[0].frequency
    raise RefusedError(
        f"no resonance stands out in the usable band of {band[0]:.3g} to {band[1]:.3g} Hz (what comes nearest is "
        f"{nearest.value:.3g} Hz): it lies outside, or drowns in noise; a harder tip drives higher frequencies"
    )


def check_coherence(frf: Frf, modes: Sequence[Mode], band: tuple[float, float]) -> None:
    """With three hits or more, the response around the modes must be due to them."""
    if frf.averages < 3:
        return
    near = np.zeros(frf.frequency.size, dtype=bool)
    for mode in modes:
        reach = max(0.05, 2.0 * mode.damping_ratio.value) * mode.frequency.value
        near |= np.abs(frf.frequency - mode.frequency.value) <= reach
    near &= (frf.frequency >= band[0]) & (frf.frequency <= band[1])
    level = float(np.mean(frf.coherence[near])) if near.any() else 1.0
    if level < 0.5:
        raise RefusedError(
            f"the coherence around the resonance is {level:.2f}: what was measured is mostly not due to the hits; "
            "hit harder, or check that force and acceleration belong to the same hits"
        )
