"""What a hit's force and response owe each other: sign, and the arm's inertia where its stiffness no longer counts."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from jointscope.identification.quality_inertia import arm_inertia
from jointscope.identification.quality_relation import Party, Relation
from jointscope.recordings.campaign import Nameplate, Run, Signal
from jointscope.recordings.pulses import Pulse, find_pulses

Real = NDArray[np.float64]


def hit_relations(run: Run, rig: Nameplate) -> Iterator[Relation]:
    """While the hammer pushes, the arm beneath it accelerates with the push."""
    for force in run.select("force", role="input"):
        pulses = find_pulses(force.samples, force.sampling_rate, share=0.5)
        if not pulses:
            continue
        says = f"{force.channel.column}: a hammer only pushes"
        yield Relation((Party(force, 1),), math.copysign(1.0, pulses[0].height), 0.0, math.inf, says, hard=False)
        for quantity in ("linear-acceleration", "acceleration", "angular-acceleration"):
            for response in run.select(quantity, role="output"):
                if response.channel.direction == "tangential" and response.device == force.device:
                    yield from _driving_point(force, response, pulses[0], rig)


def _driving_point(force: Signal, response: Signal, pulse: Pulse, rig: Nameplate) -> Iterator[Relation]:
    peak, first, last = pulse.peak, pulse.first, pulse.last
    f = np.nan_to_num(force.samples - np.nanmedian(force.samples))
    a = np.nan_to_num(response.samples - np.nanmedian(response.samples[: max(first, 8)]))
    part = slice(max(0, first - 2), min(f.size, max(peak + 2, (peak + last) // 2 + 1)))
    norm = float(np.linalg.norm(f[part]) * np.linalg.norm(a[part]))
    noise = 1.4826 * float(np.median(np.abs(a[: max(first - 4, 8)])))
    if norm == 0.0 or np.max(np.abs(a[part])) < 8.0 * noise:
        return
    correlation = float(f[part] @ a[part]) / norm
    if abs(correlation) < 0.6:
        return
    parties = (Party(response, 1), Party(force, -1))
    says = f"{response.channel.column} right after the hit of {force.channel.column}"
    arm = arm_inertia(rig)
    mass = _apparent_mass(f, a, pulse, force.sampling_rate)
    radii = force.channel.radius and response.channel.radius
    known = radii and arm.known and force.channel.calibrated and response.channel.calibrated
    if not known or mass is None:
        yield Relation(parties, math.copysign(1.0, correlation), 0.0, math.inf, says)
        return
    lever = float(force.channel.radius or 1.0)
    if response.channel.quantity == "linear-acceleration":
        lever *= float(response.channel.radius or 1.0)
    gain = math.copysign(arm.likely / (abs(mass) * lever), correlation)
    says += f", apparent inertia {abs(mass) * lever:.3g} kg m^2 where {arm}"
    yield Relation(parties, gain, 0.5 * arm.likely / arm.most, 2.0 * arm.likely / arm.least, says)


def _apparent_mass(f: Real, a: Real, pulse: Pulse, rate: float) -> float | None:
    """J in A = F/(J + c/(j w) - K/w^2) over the lines that stand out of the noise; ``None`` if vague.

    Fitted together with stiffness and damping, so that a soft tip that excites only below the resonance is no inertia;
    weighted so that the response's error is least (Sanathanan and Koerner, 1963).

    Args:
        f: Force of one hit, shape (n,), zero at rest.
        a: Response, likewise.
    """
    contact = slice(max(0, pulse.first - 4), pulse.last + 5)
    F = np.fft.rfft(np.concatenate([np.zeros(contact.start), f[contact], np.zeros(f.size - contact.stop)]))
    A = np.fft.rfft(a)
    quiet = a[: pulse.first - 4] if pulse.first >= 20 else a[-a.size // 10 :]
    noise = float(np.std(quiet)) * math.sqrt(a.size)
    omega = 2.0 * math.pi * np.fft.rfftfreq(f.size, 1.0 / rate)
    used = (np.abs(A) > 6.0 * noise) & (np.abs(F) > 0.3 * np.abs(F[1:8]).max()) & (omega > 0.0)
    if np.count_nonzero(used) < 16:
        return None
    F, A, omega = F[used], A[used], omega[used]
    columns = np.column_stack([A, A / (1j * omega), -A / omega**2])  # (lines, 3)
    weight = np.abs(A / F)
    for _ in range(4):
        M = np.concatenate([(columns * weight[:, None]).real, (columns * weight[:, None]).imag])
        y = np.concatenate([(F * weight).real, (F * weight).imag])
        scale = np.linalg.norm(M, axis=0)
        solution, _, rank, _ = np.linalg.lstsq(M / scale, y, rcond=1e-9)
        if rank < 3:
            return None
        J, c, K = solution / scale
        weight = 1.0 / np.abs(J + c / (1j * omega) - K / omega**2)
    variance = float(np.sum((y - M / scale @ solution) ** 2)) / (y.size - 3)
    error = math.sqrt(variance * np.linalg.inv((M / scale).T @ (M / scale))[0, 0]) / scale[0]
    # without lines well above the resonance the inertia is a matter of the model, not of the data
    inertial = K <= 0.0 or omega[-1] > 1.5 * math.sqrt(K / abs(J))
    return float(J) if inertial and abs(J) > 10.0 * error else None
