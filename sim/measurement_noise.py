"""Noise and hit scatter of known size put on a clean campaign, for statistical proofs that can't simulate every seed."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from jointscope.recordings.campaign import Campaign, Channel, Run, Stream

Real = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class HitNoise:
    """What is added to each hammer run.

    Attributes:
        acceleration: White noise, rms as a share of the channel's own peak [-].
        force: Likewise.
        gain_scatter: Relative standard deviation of the response per force, one draw per hit.
        timing_scatter: Standard deviation of the skew between force and response, one draw per hit [s].
    """

    acceleration: float = 0.01
    force: float = 0.005
    gain_scatter: float = 0.0
    timing_scatter: float = 0.0


def with_noise(campaign: Campaign, noise: HitNoise, rng: np.random.Generator) -> Campaign:
    """A copy of ``campaign`` whose hammer runs carry ``noise``; other runs are as they were."""
    return replace(
        campaign,
        runs=tuple(_noisy(run, noise, rng) if run.experiment == "hammer" else run for run in campaign.runs),
    )


def _noisy(run: Run, noise: HitNoise, rng: np.random.Generator) -> Run:
    gain = 1.0 + rng.normal(0.0, noise.gain_scatter)
    skew = rng.normal(0.0, noise.timing_scatter)
    streams = []
    for stream in run.streams:
        channels = tuple(_channel(channel, stream, noise, gain, skew, rng) for channel in stream.channels)
        streams.append(replace(stream, channels=channels))
    return replace(run, streams=tuple(streams))


def _channel(
    channel: Channel, stream: Stream, noise: HitNoise, gain: float, skew: float, rng: np.random.Generator
) -> Channel:
    if channel.samples is None or channel.quantity not in ("force", "linear-acceleration"):
        return channel
    samples = np.real(np.asarray(channel.samples)).astype(np.float64)
    share = noise.force if channel.quantity == "force" else noise.acceleration
    if channel.quantity == "linear-acceleration":
        samples = delayed(gain * samples, skew, stream.sampling_rate)
    noisy = samples + rng.normal(0.0, 1.0, samples.shape) * share * np.abs(samples).max()
    noisy.setflags(write=False)
    return replace(channel, samples=noisy)


def delayed(samples: Real, delay: float, rate: float) -> Real:
    """``samples``, shape (n,), of a signal that rests at both ends, ``delay`` [s] later, band-limited."""
    if delay == 0.0:
        return samples
    length = 2 * len(samples)
    spectrum = np.fft.rfft(samples - samples[0], length) * np.exp(
        -2j * np.pi * np.fft.rfftfreq(length, 1.0 / rate) * delay
    )
    return np.asarray(np.fft.irfft(spectrum, length)[: len(samples)] + samples[0], dtype=np.float64)
