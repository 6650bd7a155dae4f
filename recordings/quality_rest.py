"""What a channel reads while the rig is at rest and nothing should be there: offsets, and sensors still settling."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from jointscope.recordings.campaign import Nameplate, Run, Signal
from jointscope.recordings.finding import Finding
from jointscope.recordings.pulses import find_pulses
from jointscope.recordings.units import si_unit

Real = NDArray[np.float64]

CERTAIN = 6.0  # standard errors by which a level stands out


def rest_findings(run: Run, signal: Signal, rig: Nameplate) -> Iterator[Finding]:
    """``offset`` and ``unsettled-iepe``, for channels that read zero at rest."""
    level = rest_level(run, signal, rig)
    if level is None:
        return
    column = signal.channel.column
    peak = float(np.nanmax(np.abs(signal.samples - level)))
    detail = f"{at_rest(signal, level)}, {100.0 * abs(level) / peak:.2g} % of the peak"
    if settles_later(signal, level):
        constant = 1.0 / (2.0 * math.pi * (signal.channel.low_cutoff or math.inf))
        yield Finding(
            "unsettled-iepe",
            run.id,
            column,
            f"{detail}, gone at the end: wait {5.0 * constant:.2g} s before recording",
        )
        return
    yield Finding("offset", run.id, column, f"{detail}: subtract it, or zero the amplifier")


def rest_level(run: Run, signal: Signal, rig: Nameplate) -> float | None:
    """What a channel that should read zero reads before anything happens, where that is certain and matters [its unit]."""
    reading = rest_reading(run, signal, rig)
    return reading[0] if reading is not None and matters(signal, reading) else None


def matters(signal: Signal, reading: tuple[float, float]) -> bool:
    """Whether a level, given with its standard error, is certain and large enough beside the peak of ``signal``."""
    level, uncertainty = reading
    share = 0.002 if signal.channel.quantity == "force" else 0.005
    peak = float(np.nanmax(np.abs(signal.samples - level)))
    return abs(level) > max(CERTAIN * uncertainty, share * peak)


def rest_reading(run: Run, signal: Signal, rig: Nameplate) -> tuple[float, float] | None:
    """(level, its standard error) of a channel that should read zero before anything happens [its unit]."""
    return quiet_level(run, signal) if reads_zero_at_rest(run, signal, rig) else None


def quiet_level(run: Run, signal: Signal) -> tuple[float, float] | None:
    """(level, its standard error) of a channel before anything happens [its unit]."""
    quiet = quiet_start(run, signal)
    if quiet is None:
        return None
    # slow noise makes a level less certain than white noise would: twice the white figure
    return float(np.median(quiet)), 2.5 * _scatter(quiet) / math.sqrt(quiet.size)


def at_rest(signal: Signal, level: float) -> str:
    """A level with its unit, for people."""
    unit = si_unit(signal.channel)
    return f"{level:.3g}{'' if unit == '1' else f' {unit}'} at rest"


def settles_later(signal: Signal, level: float) -> bool:
    """Whether an ac-coupled channel that begins at ``level`` has left it by the end: its coupling was still charging."""
    if signal.channel.coupling != "ac":
        return False
    x = signal.samples
    tail = x[-max(16, x.size // 5) :]
    return abs(float(np.nanmean(tail))) < 0.4 * abs(level)


def reads_zero_at_rest(run: Run, signal: Signal, rig: Nameplate) -> bool:
    """Whether nothing but an offset can be on the channel before the excitation."""
    channel = signal.channel
    if run.initial != "rest":
        return False
    if channel.quantity == "force":
        return run.experiment == "hammer" and channel.role == "input"
    if channel.quantity == "linear-acceleration":
        across = rig.plane == "horizontal" and channel.direction == "tangential"
        return channel.coupling == "ac" or across
    return channel.quantity in ("acceleration", "angular-acceleration", "angular-velocity", "velocity")


def quiet_start(run: Run, signal: Signal) -> Real | None:
    """The samples before anything happens, or ``None`` where the excitation begins at once.

    Before a hammer's hit; else the first 50 ms, if they are quiet against the rest.
    """
    x, rate = signal.samples, signal.sampling_rate
    count = max(16, round(0.05 * rate))
    if run.experiment == "hammer":
        forces = run.select("force", role="input")
        pulses = find_pulses(forces[0].samples, forces[0].sampling_rate) if forces else ()
        if not pulses:
            return None
        hit = forces[0].times[pulses[0].first] - signal.stream.start
        # the foot of the pulse and the ringing ahead of it belong to the hit
        count = math.floor((hit - 4.0 / forces[0].sampling_rate) * rate) - 4
        if signal.channel is forces[0].channel and count < 16:
            return _between(x, pulses[0].last, rate)
    quiet = x[: max(count, 0)]
    quiet = quiet[np.isfinite(quiet)]
    if quiet.size < 16 or _scatter(quiet) > 0.25 * float(np.nanstd(x)):
        return None
    return quiet


def _scatter(x: Real) -> float:
    """Standard deviation by the median absolute deviation: an anti-alias filter rings ahead of a hit."""
    return 1.4826 * float(np.median(np.abs(x - np.median(x))))


def _between(force: Real, last: int, rate: float) -> Real | None:
    """A force record without pre-trigger: what comes well after the contact."""
    rest = force[last + max(16, round(0.02 * rate)) :]
    return rest if rest.size >= 16 else None
