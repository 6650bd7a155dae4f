"""Copies of a campaign that say the same in other words, and one from which the effect that was found is taken out.

A copy in other units, at half the rate, begun later or with an output the other way up is the same recording: the answer
must be the same. Where dry friction was named, its force along the recorded motion is taken off the logged force: what is
left holds only the base, and the answer must be none.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, resample_poly, sosfiltfilt

from jointscope.recordings.campaign import Campaign, Channel, Run, Stream

Vector = NDArray[np.float64]

LATER = 0.731  # s by which the clocks of a time-shifted copy are ahead
CUT = 0.4  # s left out at the start of runs that do not begin at rest
UNIT = 0.37  # of SI: the unit that a rescaled copy is written in
_MOTION_HZ = 20.0  # low-pass of the recorded motion before its speed is taken
_SPEED_OF = {"position": "velocity", "angle": "angular-velocity"}


def _real(channel: Channel) -> Vector:
    return np.asarray(channel.samples, dtype=np.float64)


def rescaled(campaign: Campaign) -> Campaign:
    """Every channel in another unit of known size; uncalibrated ones at another gain."""

    def change(channel: Channel) -> Channel:
        if channel.samples is None:
            return channel
        if channel.calibrated:
            return replace(
                channel, unit="1", scale=UNIT, file_unit=None, sensitivity=None, counts_per_turn=None, rated_torque=None,
                rated_current=None,
            )  # fmt: skip
        return replace(channel, samples=_real(channel) * UNIT)

    return _channels(campaign, lambda stream: replace(stream, channels=tuple(map(change, stream.channels))))


def decimated(campaign: Campaign) -> Campaign:
    """Half the rate, low-passed with zero phase first."""

    def change(stream: Stream) -> Stream:
        channels = tuple(
            c if c.samples is None else replace(c, samples=_halved(_real(c))) for c in stream.channels
        )
        return replace(
            stream, channels=channels, sampling_rate=stream.sampling_rate / 2.0, length=(stream.length + 1) // 2
        )

    return _channels(campaign, change)


def _halved(samples: Vector) -> Vector:
    return np.asarray(resample_poly(samples, 1, 2, padtype="line"))


def shifted(campaign: Campaign) -> Campaign:
    """All clocks ahead by the same time; runs that do not begin at rest begin later."""

    def change(stream: Stream, run: Run) -> Stream:
        cut = round(CUT * stream.sampling_rate) if run.initial == "estimate" else 0
        channels = tuple(c if c.samples is None else replace(c, samples=_real(c)[cut:]) for c in stream.channels)
        start = stream.start + LATER + cut / stream.sampling_rate
        return replace(stream, channels=channels, start=start, length=stream.length - cut)

    runs = tuple(replace(run, streams=tuple(change(s, run) for s in run.streams)) for run in campaign.runs)
    return replace(campaign, runs=runs)


def flipped(campaign: Campaign) -> Campaign:
    """The outputs at arm or load the other way up, as from a sensor mounted backwards."""

    def change(channel: Channel) -> Channel:
        turned = channel.role == "output" and channel.location in ("arm", "load")
        return replace(channel, samples=-_real(channel)) if turned and channel.samples is not None else channel

    return _channels(campaign, lambda stream: replace(stream, channels=tuple(map(change, stream.channels))))


def _channels(campaign: Campaign, change: Callable[[Stream], Stream]) -> Campaign:
    runs = tuple(replace(run, streams=tuple(change(s) for s in run.streams)) for run in campaign.runs)
    return replace(campaign, runs=runs)


COPIES: dict[str, Callable[[Campaign], Campaign]] = {
    "rescaled": rescaled,
    "decimated": decimated,
    "time-shifted": shifted,
    "sign-flipped": flipped,
}


def without_friction(campaign: Campaign, diagnosis: Mapping[str, Any]) -> Campaign | None:
    """The campaign with the dry friction that was named taken off the logged force.

    Returns:
        ``None`` where the answer names no friction between the logged force and a recorded motion.
    """
    taken = [effect for effect in diagnosis["effects"] if _removable(effect, campaign)]
    if not taken:
        return None
    damping = (diagnosis["parameters"].get("load_damping") or {}).get("value") or 0.0
    for effect in taken:
        campaign = replace(campaign, runs=tuple(_freed(run, campaign, effect, damping) for run in campaign.runs))
    return campaign


def _removable(effect: Mapping[str, Any], campaign: Campaign) -> bool:
    if effect["effect"] not in ("coulomb-friction", "stribeck-friction"):
        return False
    return str(effect["location"]) == ("motor" if campaign.rig.topology == "two-inertia" else "load")


def friction_force(effect: Mapping[str, Any], speed: Vector, damping: float) -> Vector:
    """Force against the motion [N m or N at the output] of a named law at ``speed``, shape of ``speed``."""
    p = {name: float(entry["value"]) for name, entry in effect["parameters"].items()}
    level = p["torque"] * (1.0 + p.get("asymmetry", 0.0) * np.sign(speed))
    if "breakaway" in p:
        exponent = 1.0 if effect.get("law") == "exponential" else 2.0
        excess = max(p["breakaway"] - p["torque"], 0.0)
        level = level + excess * np.exp(-((np.abs(speed) / p["stribeck_velocity"]) ** exponent))
    one_sided = p.get("viscous_asymmetry", 0.0) * damping * np.abs(speed)
    return np.asarray(level * np.sign(speed) + one_sided)


def _freed(run: Run, campaign: Campaign, effect: Mapping[str, Any], damping: float) -> Run:
    place = effect["location"]
    ratio = (campaign.rig.reduction_ratio or 1.0) if place == "motor" else 1.0
    motion = next((s for q in _SPEED_OF for s in run.select(q, location=place, role="output")), None)  # type: ignore[arg-type]
    if motion is None:
        return run
    rate = motion.sampling_rate
    smooth = sosfiltfilt(butter(2, _MOTION_HZ, fs=rate, output="sos"), motion.samples / ratio)
    speed = np.gradient(smooth) * rate

    def change(channel: Channel, stream: Stream) -> Channel:
        logged = channel.role == "input" and channel.location == place and channel.quantity in ("force", "torque")
        if not logged or channel.samples is None:
            return channel
        at = np.interp(stream.times, motion.times, speed)
        return replace(channel, samples=_real(channel) - friction_force(effect, at, damping) / ratio)

    streams = tuple(replace(s, channels=tuple(change(c, s) for c in s.channels)) for s in run.streams)
    return replace(run, streams=streams)


def same_answer(original: Mapping[str, Any], copy: Mapping[str, Any], *, calibrated: bool) -> tuple[bool, float]:
    """Whether a copy got the same verdict and the same effects in the same order, and the main parameter's ratio.

    The parameter must agree within a tenth, where it has a unit to be compared in.
    """
    names = [[(e["effect"], e["location"]) for e in answer["effects"]] for answer in (original, copy)]
    alike = original["verdict"] == copy["verdict"] and names[0] == names[1]
    if not alike or not names[0]:
        return alike, math.nan
    first, second = (_main(answer) for answer in (original, copy))
    ratio = second / first if first else math.nan
    return alike and (not calibrated or abs(ratio - 1.0) <= 0.1), ratio


def _main(answer: Mapping[str, Any]) -> float:
    value = next(iter(answer["effects"][0]["parameters"].values()))["value"]
    return math.nan if value is None else float(value)
