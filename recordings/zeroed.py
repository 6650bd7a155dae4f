"""Offsets of channels that read zero at rest, taken off: what an amplifier adds is no motion and no force.

An amplifier keeps its offset from run to run. So one that shows in the quiet runs of a channel is taken off its loud
ones too, where it is small beside the peak: the same constant in every run is no noise.

A sensor of true zero frequency that stands upright reads its weight, g cos q. What it reads beside that is an offset where
it is the same in postures of unlike weight: a tilted or mistaken sensor reads a share of the weight.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from jointscope.recordings.campaign import Campaign, Nameplate, Run, Signal, with_channels
from jointscope.recordings.quality_rest import CERTAIN, at_rest, matters, quiet_level, rest_reading, settles_later
from jointscope.recordings.units import STANDARD_GRAVITY

FOUND_IN = 1.0 / 3.0  # of a channel's runs, which makes an offset the channel's ...
AT_LEAST = 2  # ... and in as many runs
UNLIKE = 0.05  # of g, between the weights of postures that tell a constant from a share of the weight
SAME = 0.03  # of an offset, within which its readings are one
TELLS = 8.0  # twice the nats by which a constant must fit better than a share of the weight
SCATTERED = 3.0  # standard errors of a reading, within which they scatter about one offset: noise may be slow

Real = NDArray[np.float64]
Sensor = tuple[str, str, str, float, float]


def zeroed(campaign: Campaign) -> tuple[Campaign, tuple[str, ...]]:
    """The campaign with certain offsets subtracted, and one line for each, and for each reading that may be one.

    A channel whose ac coupling was still charging keeps its samples: that is no constant.
    """
    readings: dict[Sensor, dict[int, tuple[float, float]]] = {}
    weighed: dict[Sensor, dict[int, tuple[float, float, float]]] = {}
    levels: dict[int, float] = {}
    for run, signal in _signals(campaign):
        beside = _beside_weight(run, signal, campaign.rig)
        if beside is not None:
            weighed.setdefault(_sensor(signal), {})[id(signal.channel)] = beside
            continue
        reading = rest_reading(run, signal, campaign.rig)
        if reading is None or settles_later(signal, reading[0]):
            continue
        readings.setdefault(_sensor(signal), {})[id(signal.channel)] = reading
        if matters(signal, reading):
            levels[id(signal.channel)] = reading[0]
    for known in readings.values():
        found = [levels[channel] for channel in known if channel in levels]
        if len(found) >= max(AT_LEAST, FOUND_IN * len(known)):
            levels |= _of_all_runs(known, found)
    open_lines: list[str] = []
    for sensor, upright in weighed.items():
        found_here = _of_all_postures(upright)
        levels |= found_here
        left = None if found_here else _in_one_posture(upright)
        if left is not None:
            open_lines.append(
                f"{sensor[0]} at the {sensor[1]} (radius {sensor[3]:g} m): {left:.2g} m/s^2 at rest beside its weight, in one "
                "posture: an offset, a gain or a tilt; hits in another posture tell which"
            )
    lines = tuple(
        f"{signal.channel.quantity} at the {signal.channel.location} (run {run.id}): "
        f"{at_rest(signal, levels[id(signal.channel)])} subtracted"
        for run, signal in _signals(campaign)
        if id(signal.channel) in levels
    )
    runs = tuple(_without(run, levels) for run in campaign.runs)
    lines = (*lines, *open_lines)
    return (replace(campaign, runs=runs), lines) if levels else (campaign, lines)


def _signals(campaign: Campaign) -> Iterator[tuple[Run, Signal]]:
    for run in campaign.runs:
        for signal in run.signals:
            if signal.channel.samples is not None and signal.channel.quantity != "frf":
                yield run, signal


def _sensor(signal: Signal) -> Sensor:
    channel = signal.channel
    return channel.quantity, channel.location, channel.direction, channel.radius or 0.0, signal.sampling_rate


def _of_all_runs(known: Mapping[int, tuple[float, float]], found: Sequence[float]) -> dict[int, float]:
    """The offset of every run of a channel that has one: the same, where its readings differ no more than they may.

    Args:
        known: Per channel, its reading at rest and that one's standard error.
        found: The readings that matter in their runs by themselves.
    """
    common = float(np.median(found))
    reach = max(CERTAIN * float(np.median([error for _, error in known.values()])), float(np.ptp(found)))
    alike = {channel: level for channel, (level, _) in known.items() if abs(level - common) <= reach}
    errors = float(np.median([known[channel][1] for channel in alike]))
    if float(np.std(list(alike.values()))) <= SCATTERED * errors:
        return dict.fromkeys(alike, float(np.mean(list(alike.values()))))
    return alike


def _beside_weight(run: Run, signal: Signal, rig: Nameplate) -> tuple[float, float, float] | None:
    """What a sensor that weighs itself reads at rest beside its weight, the standard error, and the weight [m/s^2]."""
    channel = signal.channel
    upright = rig.plane == "vertical" and rig.motion == "rotational" and channel.coupling == "dc"
    on_arm = channel.quantity == "linear-acceleration" and channel.location != "motor"
    if not (upright and on_arm and channel.direction == "tangential" and run.initial == "rest"):
        return None
    reading = quiet_level(run, signal)
    weight = STANDARD_GRAVITY * math.cos(run.arm_angle)
    return None if reading is None else (reading[0] - weight, reading[1], weight)


def _of_all_postures(known: Mapping[int, tuple[float, float, float]]) -> dict[int, float]:
    """The offset of every run of a sensor that weighs itself, where it is certain and the same in unlike postures.

    Certain as the mean of all readings: each may be as uncertain as it is large. A share of the weight must fit them worse.
    """
    level, error, weight = (np.array(column) for column in zip(*known.values(), strict=True))
    common, uncertain, certain = _mean_of(level, error)
    unlike = float(np.ptp(weight)) > UNLIKE * STANDARD_GRAVITY
    alike = float(np.max(np.abs(level - common))) < max(CERTAIN * uncertain, SAME * abs(common))
    if not (unlike and alike and certain):
        return {}
    share = float(level @ weight) / float(weight @ weight)
    floor = level.size * (1e-3 * common) ** 2  # no two readings are nearer to each other
    constant, shared = (float(np.sum(np.square(level - x))) + floor for x in (common, share * weight))
    return dict.fromkeys(known, common) if level.size * math.log(shared / constant) > TELLS else {}


def _in_one_posture(known: Mapping[int, tuple[float, float, float]]) -> float | None:
    """What a sensor that weighs itself reads beside its weight in every run, where no posture tells why; else ``None``."""
    level, error, weight = (np.array(column) for column in zip(*known.values(), strict=True))
    common, _, certain = _mean_of(level, error)
    alone = float(np.ptp(weight)) <= UNLIKE * STANDARD_GRAVITY
    return common if alone and level.size > 1 and certain else None


def _mean_of(level: Real, error: Real) -> tuple[float, float, bool]:
    """Mean of some readings, what one is uncertain by, and whether the mean is no chance."""
    common, uncertain = float(np.mean(level)), float(np.median(error))
    return common, uncertain, abs(common) > CERTAIN * max(uncertain, float(np.std(level))) / math.sqrt(level.size)


def _without(run: Run, levels: dict[int, float]) -> Run:
    zero = {
        id(c): replace(c, samples=c.samples - levels[id(c)], taken_off=levels[id(c)])
        for stream in run.streams
        for c in stream.channels
        if id(c) in levels and c.samples is not None
    }
    return with_channels(run, zero)
