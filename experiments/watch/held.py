"""Which recordings of the menu (``diagnosis.next_experiment.MENU``) the takes hold already, and how far they are."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.next_experiment import MENU
from jointscope.experiments.watch.judging import Take
from jointscope.recordings.campaign import Nameplate, Run, Signal

Real = NDArray[np.float64]
SPAN: Final = 10.0  # of hit levels
SWEEP_SPAN: Final = 6.0  # of sweep amplitudes: a third of one to twice it
TRENDLESS: Final = 0.05  # probability of so sorted an order by chance


@dataclass(frozen=True)
class Held:
    """Whether a recording of the menu is there.

    Attributes:
        so_far: What there is of it, in a few words; empty where nothing is.
    """

    enough: bool
    so_far: str = ""


def held(takes: Sequence[Take], rig: Nameplate) -> Mapping[str, Held]:
    """Every entry of the menu, by its key; one that can't be told from recordings counts as absent."""
    return {key: _CHECKS[key](takes, rig) if key in _CHECKS else Held(False) for key in MENU}


def _of(takes: Sequence[Take], *experiments: str) -> list[Take]:
    return [take for take in takes if take.run.experiment in experiments]


def _hits(takes: Sequence[Take]) -> list[Take]:
    return [take for take in _of(takes, "hammer") if math.isfinite(take.level) and take.level > 0.0]


def level_span(takes: Sequence[Take]) -> tuple[float, int]:
    """Largest over smallest peak of the hits, and how many octaves of level hold at least three."""
    levels = np.array([take.level for take in _hits(takes)])
    if levels.size == 0:
        return 1.0, 0
    octaves = np.unique(np.floor(np.log2(levels / levels.min() * (1 + 1e-9))), return_counts=True)[1]
    return float(levels.max() / levels.min()), int(np.sum(octaves >= 3))


def random_order(takes: Sequence[Take]) -> float:
    """Probability of hits so sorted by level, if their order were random (Spearman); 1 for fewer than five."""
    levels = [take.level for take in _hits(takes)]
    if len(levels) < 5 or len(set(levels)) < 2:
        return 1.0
    from scipy.stats import spearmanr

    return float(spearmanr(np.arange(len(levels)), levels).pvalue)


def _levels(takes: Sequence[Take], rig: Nameplate) -> Held:
    hits = _hits(takes)
    span, octaves = level_span(takes)
    sorted_by_level = random_order(takes) < TRENDLESS
    enough = span >= SPAN and octaves >= 3 and not sorted_by_level
    said = (
        f"{len(hits)} hit{'s' if len(hits) != 1 else ''} over {span:.2g}:1 in {octaves} levels of three or more"
        if hits
        else ""
    )
    return Held(enough, said + (", sorted by level" if sorted_by_level else ""))


def _preload(takes: Sequence[Take], rig: Nameplate) -> Held:
    """Static torques on the joint, from gravity, in units of m g r: three values, of either sign."""
    if rig.plane != "vertical":
        return Held(False)
    torques = _distinct([math.cos(take.run.arm_angle) for take in _hits(takes)], 0.1)
    said = f"{len(torques)} preload{'s' if len(torques) != 1 else ''}" if torques else ""
    return Held(len(torques) >= 3 and min(torques) < -0.05 and max(torques) > 0.05, said)


def _mass(takes: Sequence[Take], rig: Nameplate) -> Held:
    masses = {take.run.payload_mass or 0.0 for take in takes}
    return Held(len(masses) >= 2, f"{len(masses)} payload" + ("s" if len(masses) != 1 else ""))


def _posture(takes: Sequence[Take], rig: Nameplate) -> Held:
    driven = _of(takes, "torque-sweep", "speed-motion", "free")
    angles = _distinct([take.run.arm_angle for take in driven], 0.1)
    return Held(len(angles) >= 3, f"{len(angles)} arm angle{'s' if len(angles) != 1 else ''}" if angles else "")


def _brake(takes: Sequence[Take], rig: Nameplate) -> Held:
    states = {take.run.brake for take in _hits(takes)}
    said = "" if not states else "brake " + " and ".join("closed" if s else "open" for s in sorted(states))
    return Held(len(states) == 2, said)


def _sensor_moved(takes: Sequence[Take], rig: Nameplate) -> Held:
    seats = {
        (signal.channel.radius, signal.channel.direction)
        for take in takes
        for signal in take.run.select("linear-acceleration", location="arm")
    }
    base = any(take.run.select("linear-acceleration", location="base") for take in takes)
    said = f"{len(seats)} place{'s' if len(seats) != 1 else ''} of the accelerometer" if seats else ""
    return Held(len(seats) >= 2 or (bool(seats) and base), said + (", one on the base" if base else ""))


def _slow_ramp(takes: Sequence[Take], rig: Nameplate) -> Held:
    speeds = _speeds(takes, with_torque=True)
    sizes = _distinct([abs(speed) for speed in speeds], 0.15, relative=True)
    both = any(s > 0 for s in speeds) and any(s < 0 for s in speeds)
    return Held(len(sizes) >= 5 and both, _said_speeds(sizes, both))


def _constant_speeds(takes: Sequence[Take], rig: Nameplate) -> Held:
    speeds = _speeds(takes, with_torque=False)
    sizes = _distinct([abs(speed) for speed in speeds], 0.15, relative=True)
    return Held(len(sizes) >= 3, _said_speeds(sizes, both=False))


def _said_speeds(sizes: Sequence[float], both: bool) -> str:
    if not sizes:
        return ""
    return f"{len(sizes)} speed{'s' if len(sizes) != 1 else ''}" + (" both ways" if both else "")


def _torque_reversal(takes: Sequence[Take], rig: Nameplate) -> Held:
    """Torque slowly through zero while the arm hardly moves, both angles recorded."""
    for take in _of(takes, "torque-sweep", "free"):
        torque = _drive(take.run)
        both = take.run.select("angle", location="motor") and take.run.select("angle", location="arm")
        if torque is None or not both:
            continue
        x = torque.samples
        travel = np.ptp(take.run.select("angle", location="arm")[0].samples)
        if np.nanmin(x) < 0.0 < np.nanmax(x) and travel < 0.02 and _slow_share(torque) > 0.9:
            return Held(True, "torque through zero, both angles")
    return Held(False)


def _multisine(takes: Sequence[Take], rig: Nameplate) -> Held:
    found = []
    for take in _of(takes, "torque-sweep"):
        torque = _drive(take.run)
        if torque is not None and take.run.select("angle", location="motor") and _periods(torque) >= 6.0:
            found.append(float(np.nanstd(torque.samples)))
    levels = _distinct(found, 0.25, relative=True)
    return Held(len(levels) >= 3, f"{len(levels)} level{'s' if len(levels) != 1 else ''}" if levels else "")


def _logging_rate(takes: Sequence[Take], rig: Nameplate) -> Held:
    best = 0.0
    for take in _of(takes, "torque-sweep"):
        torque = _drive(take.run)
        for signal in take.run.select("linear-acceleration"):
            if torque is not None and torque.device == signal.device:
                best = max(best, torque.sampling_rate)
    return Held(best >= 1000.0, f"{best:.4g} Hz on one device" if best else "")


def _sweep_levels(takes: Sequence[Take], rig: Nameplate) -> Held:
    """Sweeps of the motor's torque over 6:1 in amplitude, two of each."""
    found = sorted(take.level for take in _of(takes, "torque-sweep") if take.level > 0.0)
    span = found[-1] / found[0] if found else 1.0
    levels = _distinct(found, 0.25, relative=True)
    said = f"{len(found)} sweeps over {span:.2g}:1" if found else ""
    return Held(span >= SWEEP_SPAN and len(found) >= 2 * len(levels), said)


def _time_shuffled(takes: Sequence[Take], rig: Nameplate) -> Held:
    """Levels in random order, the level of the first hits taken again among the last."""
    hits = _hits(takes)
    if len(hits) < 10:
        return Held(False, f"{len(hits)} hits" if hits else "")
    again = any(0.5 < take.level / hits[0].level < 2.0 for take in hits[-3:])
    enough = random_order(takes) >= TRENDLESS and again and level_span(takes)[0] >= 2.0
    return Held(enough, "order of levels " + ("random" if random_order(takes) >= TRENDLESS else "sorted"))


def _undriven(takes: Sequence[Take], rig: Nameplate) -> Held:
    longest = max((_length(take.run) for take in _of(takes, "free")), default=0.0)
    return Held(longest >= 30.0, f"{longest:.3g} s" if longest else "")


def _length(run: Run) -> float:
    return max((stream.length / stream.sampling_rate for stream in run.streams if stream.length), default=0.0)


def _drive(run: Run) -> Signal | None:
    for quantity in ("torque", "current", "phase-current", "voltage"):
        found = run.select(quantity, location="motor", role="input")
        if found:
            return found[0]
    return None


def _speeds(takes: Sequence[Take], *, with_torque: bool) -> list[float]:
    """Speeds of the motor held for at least a quarter of a motion [rad/s], with their sign."""
    speeds = []
    for take in _of(takes, "speed-motion"):
        angles = take.run.select("angle", location="motor")
        if not angles or (with_torque and _drive(take.run) is None):
            continue
        angle = angles[0]
        # over a twentieth of the record an encoder's steps count for little
        step = max(1, angle.samples.size // 20)
        speed = (angle.samples[step::step] - angle.samples[:-step:step]) * angle.sampling_rate / step
        for sign in (1.0, -1.0):
            moving = sign * speed[sign * speed > 0.3 * np.nanmax(np.abs(speed))]
            if moving.size >= 5:
                speeds.append(sign * float(np.median(moving)))
    return speeds


def _slow_share(signal: Signal) -> float:
    """Share of a signal's power below 2 Hz [-]."""
    x = np.nan_to_num(signal.samples - np.nanmean(signal.samples))
    power = np.abs(np.fft.rfft(x)) ** 2
    frequency = np.fft.rfftfreq(x.size, 1.0 / signal.sampling_rate)
    return float(power[frequency < 2.0].sum() / max(power.sum(), 1e-300))


def _periods(signal: Signal) -> float:
    """How often a signal repeats itself in its record; 0 where it doesn't (autocorrelation above 0.9)."""
    x = np.nan_to_num(signal.samples - np.nanmean(signal.samples))
    size = 2 * x.size
    correlation = np.fft.irfft(np.abs(np.fft.rfft(x, size)) ** 2, size)[: x.size]
    correlation /= max(correlation[0], 1e-300)
    correlation /= 1.0 - np.arange(x.size) / x.size
    begins = np.flatnonzero(correlation < 0.5)
    if begins.size == 0:
        return 0.0
    lags = np.flatnonzero(correlation[: x.size // 2] > 0.9)
    lags = lags[lags > begins[0]]
    return float(x.size / lags[0]) if lags.size else 0.0


def _distinct(values: Sequence[float], apart: float, *, relative: bool = False) -> list[float]:
    """Values that differ by more than ``apart``, rising."""
    kept: list[float] = []
    for value in sorted(values):
        if not kept or value - kept[-1] > (apart * abs(kept[-1]) if relative else apart):
            kept.append(value)
    return kept


_CHECKS: Final[Mapping[str, Callable[[Sequence[Take], Nameplate], Held]]] = {
    "levels": _levels,
    "preload": _preload,
    "mass": _mass,
    "posture": _posture,
    "brake": _brake,
    "sensor-moved": _sensor_moved,
    "slow-ramp": _slow_ramp,
    "torque-reversal": _torque_reversal,
    "multisine": _multisine,
    "logging-rate": _logging_rate,
    "time-shuffled": _time_shuffled,
    "undriven": _undriven,
    "sweep-levels": _sweep_levels,
    "constant-speeds": _constant_speeds,
}
