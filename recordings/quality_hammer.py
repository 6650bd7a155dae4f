"""Hammer runs: second contacts, pulses too short for the rate, dead sensors, recordings that end too soon."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from jointscope.recordings.campaign import Run, Signal
from jointscope.recordings.finding import Finding
from jointscope.recordings.pulses import Pulse, baseline, find_pulses

Real = NDArray[np.float64]
SECOND_CONTACT = 0.03  # of the first one's height
NARROW = 2.0  # samples between the half-height points
TRUNCATED = 0.15  # of the response's first swing


def hammer_findings(run: Run) -> Iterator[Finding]:
    """``double-hit``, ``undersampled-pulse``, ``dead-channel`` and ``truncated-decay`` of a hammer run."""
    forces = run.select("force", role="input")
    for force in forces:
        pulses = find_pulses(force.samples, force.sampling_rate, share=SECOND_CONTACT)
        if not pulses:
            yield Finding("dead-channel", run.id, force.channel.column, "no hit stands out of its noise")
            continue
        yield from _second_contact(run, force, pulses)
        yield from _sampling(run, force, max(pulses, key=lambda pulse: abs(pulse.height)))
    if len(forces) == 1:
        pulses = find_pulses(forces[0].samples, forces[0].sampling_rate)
        if pulses:
            hit = float(forces[0].times[pulses[0].peak])
            for signal in run.select(role="output"):
                if signal.channel.quantity in ("linear-acceleration", "acceleration", "angular-acceleration"):
                    yield from _response(run, signal, hit)


def _second_contact(run: Run, force: Signal, pulses: tuple[Pulse, ...]) -> Iterator[Finding]:
    main = max(pulses, key=lambda pulse: abs(pulse.height))
    others = [pulse for pulse in pulses if pulse is not main]
    if not others:
        return
    other = max(others, key=lambda pulse: abs(pulse.height))
    delay = (other.peak - main.peak) / force.sampling_rate
    share = 100.0 * other.height / main.height
    kind = "the hammer bounced" if abs(delay) < 0.2 else "two hits in one run; cut it into two"
    detail = f"{len(pulses)} contacts, {abs(1e3 * delay):.3g} ms apart, the weaker {share:.2g} % of the stronger: {kind}"
    yield Finding("double-hit", run.id, force.channel.column, detail)


def _sampling(run: Run, force: Signal, pulse: Pulse) -> Iterator[Finding]:
    """A pulse has left the rate behind where it is narrow and its spectrum doesn't fall before half the rate."""
    if pulse.width >= NARROW:
        return
    level, _ = baseline(force.samples)
    reach = max(16, 8 * (pulse.last - pulse.first + 1))
    part = force.samples[max(0, pulse.peak - reach) : pulse.peak + reach] - level
    spectrum = np.abs(np.fft.rfft(np.nan_to_num(part), 512))  # 0 ... half the rate in 257 lines
    kept = float(spectrum[180:205].mean() / spectrum[1:26].mean())
    if kept < 0.5:
        return
    rate = force.sampling_rate
    detail = (
        f"{pulse.width:.2g} samples wide at half height; its spectrum still holds {100.0 * kept:.0f} % at "
        f"{0.375 * rate:.0f} Hz: its peak is not the force's, use a softer tip or sample faster than {rate:.4g} Hz"
    )
    yield Finding("undersampled-pulse", run.id, force.channel.column, detail)


def _response(run: Run, signal: Signal, hit: float) -> Iterator[Finding]:
    x = np.nan_to_num(signal.samples - np.nanmedian(signal.samples))
    at = round((hit - signal.stream.start) * signal.sampling_rate)
    if not 0 <= at < x.size - 64:
        return
    tail = max(16, (x.size - at) // 20)
    end = float(np.std(x[-tail:]))
    after = x[at : at + max(32, round(0.1 * signal.sampling_rate))]
    before = x[: max(0, at - 8)]
    noise = float(np.std(before)) if before.size >= 16 else 0.0
    swing = float(np.max(np.abs(after)))
    if before.size >= 16 and float(np.std(after)) < 1.5 * noise:
        detail = (
            f"as quiet after the hit ({np.std(after):.2g}) as before it ({noise:.2g}): is the sensor connected?"
        )
        yield Finding("dead-channel", run.id, signal.channel.column, detail)
        return
    rms = float(np.sqrt(max(end**2 - noise**2, 0.0))) * np.sqrt(2.0)
    if rms > TRUNCATED * swing:
        detail = f"still swings by {100.0 * rms / swing:.0f} % of its peak when the recording ends: record longer"
        yield Finding("truncated-decay", run.id, signal.channel.column, detail)
