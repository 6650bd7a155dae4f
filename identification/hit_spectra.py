"""One run with a hammer hit -> its spectra for the fit, or the reason why it is left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jointscope.identification.conditioning import (
    Excitation,
    Response,
    arm_responses,
    hammer_excitation,
    without_high_pass,
)
from jointscope.identification.errors_in_variables import HitSpectrum
from jointscope.identification.hits import Contact, find_contact, is_clipped, is_double_hit
from jointscope.recordings.campaign import Nameplate, Run

Real = NDArray[np.float64]
Complex = NDArray[np.complexfloating[Any, Any]]

HIGHEST_SHARE = 0.46  # of the sampling rate: beyond it aliases and the filters' flanks are all there is


@dataclass(frozen=True, kw_only=True)
class Rejected:
    """A run that is left out of the fit."""

    run: str
    finding: str
    detail: str


@dataclass(frozen=True, kw_only=True, eq=False)
class Hit:
    """A usable hit.

    Attributes:
        spectrum: All lines from the first up to 0.46 of the lowest rate.
        contact: Where the hammer touched.
        outputs: Names of the output columns, as in ``spectrum.output``.
        input_unit: Unit of the generalised force.
        calibrated: Whether every output's scale is known.
        repeat_of: The run's group of repeats, if any.
    """

    spectrum: HitSpectrum
    contact: Contact
    outputs: tuple[str, ...]
    input_unit: str
    calibrated: bool
    repeat_of: str | None


def read_hit(run: Run, rig: Nameplate) -> Hit | Rejected:
    """Spectra of one hammer run, or why it can't be used."""
    excitation, responses = hammer_excitation(run, rig), arm_responses(run, rig)
    if excitation is None:
        return Rejected(run=run.id, finding="no-input", detail="no force or torque on the arm was recorded")
    if not responses:
        return Rejected(
            run=run.id, finding="no-output", detail="no acceleration, speed or angle of the arm was recorded"
        )
    force = excitation.signal.samples
    if not np.isfinite(force).all() or any(not np.isfinite(r.signal.samples).all() for r in responses):
        return Rejected(run=run.id, finding="gaps", detail="samples are missing inside the record")
    if excitation.low_cutoff:
        force = without_high_pass(force, excitation.signal.sampling_rate, excitation.low_cutoff)
    contact = find_contact(force, excitation.signal.sampling_rate)
    if contact is None:
        return Rejected(
            run=run.id, finding="dead-channel", detail="the force channel shows no hit above its noise"
        )
    bad = _bad_hit(excitation, responses, contact)
    if bad is not None:
        return Rejected(run=run.id, finding=bad[0], detail=bad[1])
    return Hit(
        spectrum=hit_spectrum(run, excitation, responses, force, contact),
        contact=contact,
        outputs=tuple(response.name for response in responses),
        input_unit=excitation.unit,
        calibrated=all(response.signal.channel.calibrated for response in responses),
        repeat_of=run.repeat_of,
    )


def _bad_hit(excitation: Excitation, responses: Sequence[Response], contact: Contact) -> tuple[str, str] | None:
    if is_double_hit(contact):
        return "double-hit", (
            f"a second contact of {100 * contact.secondary:.0f} % of the first, "
            f"{1e3 * contact.secondary_delay:.0f} ms later"
        )
    for signal in (excitation.signal, *(response.signal for response in responses)):
        if is_clipped(signal.samples, signal.channel.full_scale):
            peak = float(np.max(np.abs(signal.samples)))
            return "clipping", f"{signal.channel.column} is cut off at {peak:.4g} {signal.channel.unit}"
    return None


def hit_spectrum(
    run: Run, excitation: Excitation, responses: Sequence[Response], force: Real, contact: Contact
) -> HitSpectrum:
    """Spectra of one hit with its force taken inside ``contact`` only; ``force`` is the cell's record, shape (n,)."""
    first = responses[0].signal
    rate, count = first.sampling_rate, first.samples.size
    top = HIGHEST_SHARE * min(rate, excitation.signal.sampling_rate, *(r.signal.sampling_rate for r in responses))
    line = np.arange(1, int(top * count / rate) + 1)
    frequency = line * rate / count
    s = 2j * np.pi * frequency
    zero = float(first.times[0])
    output = np.empty((len(responses), line.size), dtype=np.complex128)
    for o, response in enumerate(responses):
        own = response.signal
        if own.device == first.device:
            output[o] = np.fft.rfft(own.samples)[line] / rate
        else:  # another clock: the same lines from its own samples, the offset taken off as its lines are not the DFT's
            values = own.samples - own.samples.mean()
            output[o] = np.exp(-np.outer(s, own.times - zero)) @ values / own.sampling_rate
    times = excitation.signal.times[contact.window] - zero
    step = 1.0 / excitation.signal.sampling_rate
    kernel = np.exp(-np.outer(s, times)) * (step * excitation.lever)
    force = force[contact.window] - contact.offset
    clocks = {excitation.signal.device: excitation.signal.stream.start_uncertainty}
    late = 0.0
    if excitation.signal.device != first.device:
        uncertain = np.hypot(clocks[excitation.signal.device], first.stream.start_uncertainty)
        late = min(
            float(uncertain), 0.25 / float(frequency[-1]) if not np.isfinite(uncertain) else float(uncertain)
        )
    return HitSpectrum(
        run=run.id,
        frequency=frequency,
        output=output,
        input=kernel @ force,
        input_basis=kernel * contact.noise,
        sensor=np.array([response.sensor(s) for response in responses]),
        duration=count / rate,
        level=abs(contact.peak) * abs(excitation.lever),
        impulse=float(np.sum(force)) * step * excitation.lever,
        input_noise=contact.noise * abs(excitation.lever),
        clock=late,
        rate=rate,
    )
