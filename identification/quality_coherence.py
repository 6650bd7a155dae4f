"""Repeats of one excitation: whether the response repeats with them."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from jointscope.recordings.campaign import Campaign, Run, Signal
from jointscope.recordings.finding import Finding

Real = NDArray[np.float64]
LOW = 0.8
FEWEST = 3  # of two repeats the coherence says nothing


def coherence_findings(campaign: Campaign) -> Iterator[Finding]:
    """``low-coherence`` of hammer repeats: median over the band that the hammer excites."""
    groups: dict[str, list[Run]] = defaultdict(list)
    for run in campaign.runs:
        if run.repeat_of is not None and run.experiment == "hammer":
            groups[run.repeat_of].append(run)
    for name, runs in groups.items():
        if len(runs) >= FEWEST:
            yield from _of_group(name, runs)


def _of_group(name: str, runs: Sequence[Run]) -> Iterator[Finding]:
    forces = [run.select("force", role="input") for run in runs]
    outputs = [
        [s for s in run.select(role="output") if s.channel.quantity in ("linear-acceleration", "acceleration")]
        for run in runs
    ]
    if any(len(f) != 1 for f in forces) or len({len(o) for o in outputs}) != 1:
        return
    for place, signal in enumerate(outputs[0]):
        pairs = [(f[0], o[place]) for f, o in zip(forces, outputs, strict=True)]
        alike = {(f.sampling_rate, o.sampling_rate, o.channel.radius, f.channel.radius) for f, o in pairs}
        if len(alike) != 1 or pairs[0][0].sampling_rate != pairs[0][1].sampling_rate:
            continue
        value = median_coherence(pairs)
        if value < LOW:
            detail = f"median coherence {value:.2f} over {len(runs)} repeats of {name!r}, where the hammer excites"
            yield Finding("low-coherence", runs[0].id, signal.channel.column, detail)


def median_coherence(pairs: Sequence[tuple[Signal, Signal]]) -> float:
    """|sum F* A|^2 / (sum |F|^2 sum |A|^2) over hits, median over the lines where the force is above a tenth."""
    length = min(min(f.samples.size, a.samples.size) for f, a in pairs)
    F = np.array([_spectrum(f.samples[:length]) for f, _ in pairs])  # (hits, lines)
    A = np.array([_spectrum(a.samples[:length]) for _, a in pairs])
    cross = np.abs(np.sum(np.conj(F) * A, axis=0)) ** 2
    power = np.sum(np.abs(F) ** 2, axis=0)
    coherence = cross / np.maximum(power * np.sum(np.abs(A) ** 2, axis=0), 1e-300)
    strong = power > 0.01 * power[1:].max()
    strong[:2] = False
    return float(np.median(coherence[strong])) if strong.any() else 0.0


def _spectrum(x: Real) -> NDArray[np.complex128]:
    return np.asarray(np.fft.rfft(np.nan_to_num(x - np.nanmedian(x))), dtype=np.complex128)
