"""From relations that fail to the mistake that explains them: the fewest channels and the most natural factor."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from jointscope.identification.quality_relation import Relation
from jointscope.models.parameters import STANDARD_GRAVITY
from jointscope.recordings.campaign import Channel, Nameplate, Run, Signal
from jointscope.recordings.finding import Finding
from jointscope.recordings.toml_text import channel_line
from jointscope.recordings.units import POUND_FORCE, si_factor, units_for

_DEGREE, _RPM, _TURN = math.pi / 180.0, 2.0 * math.pi / 60.0, 2.0 * math.pi
GENERAL: Final = {
    "sqrt 2": math.sqrt(2.0), "3/2": 1.5, "9.80665": STANDARD_GRAVITY, "4.448": POUND_FORCE, "2 pi": _TURN,
    "60/2 pi": 1.0 / _RPM, "180/pi": 1.0 / _DEGREE,
}  # fmt: skip
_DRIVES = ("torque", "current", "phase-current", "voltage", "force")
_TURNED = ("angle", "angular-velocity", "speed-command", "angular-acceleration")
# which quantities a general factor can be a mistake of: no unit of acceleration is a pound or a turn
_MISTAKEN: Final[dict[str, tuple[str, ...]]] = {
    "sqrt 2": _DRIVES[:4],
    "3/2": _DRIVES[:4],
    "9.80665": (*_DRIVES, "linear-acceleration", "acceleration"),
    "4.448": _DRIVES,
    "2 pi": (*_TURNED, "torque", "current"),
    "60/2 pi": (*_TURNED, "torque", "current"),
    "180/pi": (*_TURNED, "torque", "current"),
}
# what each quantity is mistaken for most: factors SI = factor * declared, in SI of the declared unit
_NATURAL: Final[dict[str, tuple[float, ...]]] = {
    "angle": (_DEGREE, _TURN),
    "angular-velocity": (_RPM, _DEGREE, _TURN),
    "speed-command": (_RPM, _DEGREE, _TURN),
    "angular-acceleration": (_DEGREE, _TURN),
    "linear-acceleration": (STANDARD_GRAVITY, 1.0 / STANDARD_GRAVITY),
    "acceleration": (STANDARD_GRAVITY, 1.0 / STANDARD_GRAVITY),
    "force": (POUND_FORCE, STANDARD_GRAVITY),
    "torque": (STANDARD_GRAVITY,),
    "current": (math.sqrt(2.0), 1.5),
}
Build = Callable[[Run], list[Relation]]
OFF_BY = "off by a factor of"
_NEAR = 1.7  # of 1, within which a gain must come that a factor explains
_TRIED = 8  # likeliest corrections that are worked through in full
_OFF_THE_LIST = 15.0  # a scale wrong by more than this is reported though no factor of the list explains it


@dataclass(frozen=True, eq=False)
class Correction:
    """Multiply ``signals`` by ``factor``; ``rank`` orders the plausible before the far-fetched."""

    signals: tuple[Signal, ...]
    factor: float
    rank: float
    name: str


def factor_search(run: Run, rig: Nameplate, build: Build) -> tuple[list[Finding], Run, list[Correction]]:
    """``inverted-polarity`` and ``suspicious-unit`` of one run, one mistake after the other until none is left.

    Args:
        build: Makes the relations of a run. They are made anew after each correction: gravity's share depends on the
            angles.

    Returns:
        The findings, the run as it would be with every one of them mended, for what is checked after this, and the
        corrections that mended it.
    """
    found: list[Finding] = []
    made: list[Correction] = []
    for _ in range(4):
        relations = build(run)
        failing = [relation for relation in relations if relation.hard and not relation.holds()]
        chosen = _best(run, relations, failing, rig, build) if failing else None
        if chosen is None:
            share = _off_the_list(run, failing, relations)
            return found + ([] if share is None else [share]), run, made
        why = next(relation for relation in failing if relation.holds(_corrected(relation, chosen)))
        found += [_finding(run, signal, chosen, why, rig) for signal in chosen.signals]
        made.append(chosen)
        run = mended(run, chosen)
    return found, run, made


def correction_finding(
    run: Run, signal: Signal, correction: Correction, relations: Sequence[Relation], rig: Nameplate
) -> Finding:
    """The finding of a correction that other runs have settled, with a relation of this run that the channel breaks."""
    broken = [r for r in relations if not r.holds() and any(_same(p.signal, signal) for p in r.parties)]
    line = corrected_line(signal.channel, correction.factor, rig)
    says = broken[0].says if broken else "together with the other corrections"
    name = "inverted-polarity" if correction.factor == -1.0 else "suspicious-unit"
    wrong = "moves against the rest" if correction.factor == -1.0 else f"times {correction.name} all agree"
    return Finding(
        name, run.id, signal.channel.column, f"{wrong} ({says}), as in the runs that say it alone", line
    )


def mended(run: Run, correction: Correction) -> Run:
    """The run with a correction made."""
    columns = {signal.channel.column for signal in correction.signals}

    def channel(c: Channel) -> Channel:
        if c.column not in columns or c.samples is None:
            return c
        samples: Any = np.asarray(c.samples) * correction.factor
        return replace(c, samples=samples)

    streams = tuple(replace(stream, channels=tuple(map(channel, stream.channels))) for stream in run.streams)
    return replace(run, streams=streams)


def _corrected(relation: Relation, correction: Correction) -> float:
    power = sum(p.exponent for p in relation.parties if any(_same(p.signal, s) for s in correction.signals))
    return relation.gain * correction.factor**power


def _same(a: Signal, b: Signal) -> bool:
    return a.channel is b.channel


def badness(relations: Sequence[Relation], correction: Correction | None = None) -> float:
    """Contradictions, soft ones by half, were ``correction`` made."""
    gains = [r.gain if correction is None else _corrected(r, correction) for r in relations]
    return sum((1.0 if r.hard else 0.5) for r, gain in zip(relations, gains, strict=True) if not r.holds(gain))


def _best(
    run: Run, relations: Sequence[Relation], failing: Sequence[Relation], rig: Nameplate, build: Build
) -> Correction | None:
    """The correction that leaves the fewest contradictions; of several, the most plausible."""
    before, likely = badness(relations), []
    for correction in _candidates(failing, relations, rig):
        after = badness(relations, correction)
        if after < before and any(_explains(r, correction) for r in failing):
            distance = round(_distance(relations, correction), 1)
            likely.append((after, correction.rank, distance, _seat(correction.signals[0]), correction))
    likely.sort(key=lambda entry: entry[:4])
    if rig.plane == "horizontal" and likely:
        return likely[0][4] if likely[0][0] <= before - 0.5 else None
    ranked = []
    for _, rank, distance, seat, correction in likely[:_TRIED]:
        after = badness(build(mended(run, correction)))  # gains are not quite linear where gravity acts
        if after <= before - 0.5:
            ranked.append((after, rank, distance, seat, correction))
    return min(ranked, key=lambda entry: entry[:4])[4] if ranked else None


def _explains(relation: Relation, correction: Correction) -> bool:
    """Whether a relation holds once corrected, and its gain is then near 1: a window may be wide for a nameplate's sake."""
    gain = _corrected(relation, correction)
    return relation.holds(gain) and (
        not math.isfinite(relation.high) or abs(math.log(abs(gain))) < math.log(_NEAR)
    )


def _distance(relations: Sequence[Relation], correction: Correction) -> float:
    touched = [r for r in relations if any(_same(p.signal, s) for p in r.parties for s in correction.signals)]
    return sum(abs(math.log(abs(_corrected(r, correction)))) for r in touched if math.isfinite(r.high))


def _candidates(
    failing: Sequence[Relation], relations: Sequence[Relation], rig: Nameplate
) -> Iterator[Correction]:
    accused = _distinct(p.signal for r in failing for p in r.parties)
    for signal in accused:
        for factor, rank, name in _factors(signal.channel, rig):
            yield Correction((signal,), factor, rank, name)
    everyone = _distinct(p.signal for r in relations for p in r.parties)
    for location in ("arm", "motor", "load"):
        group = tuple(s for s in everyone if s.channel.location == location and s.channel.role == "output")
        if len(group) > 1:
            for factor, rank, name in _factors(group[0].channel, rig):
                if rank < 2.0:
                    yield Correction(group, factor, 3.0 + rank, name)


def _distinct(signals: Iterator[Signal]) -> list[Signal]:
    found: list[Signal] = []
    for signal in signals:
        if not any(_same(signal, other) for other in found):
            found.append(signal)
    return found


def _seat(signal: Signal) -> float:
    """Which of two equally good suspects comes first: the arm's sensor before the motor's, outputs before inputs."""
    seats = {"arm": 0.0, "load": 0.1, "motor": 0.2}
    return seats.get(signal.channel.location, 0.3) + (0.05 if signal.channel.role == "input" else 0.0)


def _factors(channel: Channel, rig: Nameplate) -> Iterator[tuple[float, float, str]]:
    """Factor, rank and name of everything a channel may have to be multiplied by."""
    yield -1.0, 0.0, "-1"
    if not channel.calibrated:
        return
    for factor in _NATURAL.get(channel.quantity, ()):
        yield factor, 1.0, _name(factor)
    for key, share in (("rated_torque", 1000.0), ("rated_torque", 100.0), ("rated_current", 1000.0)):
        rated = getattr(channel, key)
        if rated is not None and channel.unit not in ("%", "permille"):
            yield (
                rated / share,
                1.0,
                "permille of the rated value" if share == 1000.0 else "percent of the rated value",
            )
    n = rig.reduction_ratio
    if n is not None and n > 2.0:
        for power, exponent in itertools.product((1, 2), (1, -1)):
            # a torque logged at the output is n times the motor's; an angle logged at the other shaft likewise
            natural = power == 1 and channel.location == "motor" and channel.quantity != "current"
            yield (
                n ** (power * exponent),
                1.5 if natural else 2.5,
                f"{'1/' if exponent < 0 else ''}n{'^2' if power == 2 else ''}",
            )
    for name, size in GENERAL.items():
        if channel.quantity not in _MISTAKEN[name]:
            continue
        yield size, 2.0, name
        yield 1.0 / size, 2.0, f"1/({name})"


def _name(factor: float) -> str:
    for name, size in GENERAL.items():
        if math.isclose(factor, size):
            return name
        if math.isclose(factor, 1.0 / size):
            return f"1/({name})"
    return f"{factor:.6g}"


def _finding(run: Run, signal: Signal, correction: Correction, why: Relation, rig: Nameplate) -> Finding:
    channel = signal.channel
    line = corrected_line(channel, correction.factor, rig)
    if correction.factor == -1.0:
        detail = f"moves against the rest ({why.says}); reversed, all agree"
        return Finding("inverted-polarity", run.id, channel.column, detail, line)
    size = abs(why.gain)
    size = size if size >= 1.0 else 1.0 / size
    detail = f"{OFF_BY} {size:.4g} ({why.says}); times {correction.name} all agree"
    return Finding("suspicious-unit", run.id, channel.column, detail, line)


def corrected_line(channel: Channel, factor: float, rig: Nameplate) -> str | None:
    """The channel's line of TOML with a unit or a scale that is ``factor`` times the declared one.

    ``None`` for a reversed channel of unknown scale: the format has no sign without a scale.
    """
    if not channel.calibrated:
        return None
    wanted = factor * si_factor(channel)
    for unit in units_for(channel.quantity, channel.form):
        if unit in ("1", "mV", "counts", "%", "permille"):
            continue
        plain = Channel(
            column=channel.column,
            quantity=channel.quantity,
            unit=unit,
            location=channel.location,
            role=channel.role,
        )
        if math.isclose(si_factor(plain), wanted, rel_tol=1e-6):
            return channel_line(channel, unit=unit, scale=None, sensitivity=None, counts_per_turn=None)
    if channel.quantity == "torque" and rig.reduction_ratio is not None:
        if math.isclose(factor * rig.reduction_ratio, 1.0) and channel.side == "motor":
            return channel_line(channel, side="output")
        if channel.rated_torque is not None and math.isclose(wanted, channel.rated_torque / 1000.0):
            return channel_line(channel, unit="permille")
        if channel.rated_torque is not None and math.isclose(wanted, channel.rated_torque / 100.0):
            return channel_line(channel, unit="%")
    if channel.quantity in ("current", "phase-current") and math.isclose(factor, math.sqrt(2.0)):
        return channel_line(channel, per="rms")
    if channel.sensitivity is not None:
        return channel_line(channel, sensitivity=channel.sensitivity / factor)
    return channel_line(
        channel,
        unit="1",
        scale=float(f"{wanted:.12g}"),
        counts_per_turn=None,
        rated_torque=None,
        rated_current=None,
    )


def _off_the_list(run: Run, failing: Sequence[Relation], relations: Sequence[Relation]) -> Finding | None:
    """A drive's torque or current far off without a listed factor: most likely a share of a rated value."""
    for relation in failing:
        drive = next((p.signal for p in relation.parties if p.exponent == 1 and _is_share(p.signal)), None)
        gain = abs(relation.gain)
        if drive is None or not math.isfinite(relation.high) or 1.0 / _OFF_THE_LIST < gain < _OFF_THE_LIST:
            continue
        # the torque that holds the arm says it more exactly than the inertia, unless friction holds it too
        alone = [
            abs(r.gain)
            for r in relations
            if not r.hard and [p.signal.channel for p in r.parties] == [drive.channel]
        ]
        gain = next((g for g in alone if relation.holds(gain / g)), gain)
        channel = drive.channel
        key, unit = ("rated_torque", "N m") if channel.quantity == "torque" else ("rated_current", "A")
        rated = 1000.0 / gain * si_factor(channel)
        detail = (
            f"off by a factor of {gain:.4g} ({relation.says}), which is none of the list: "
            f"values in permille of a rated {rated:.3g} {unit} (or in percent of {rated / 10.0:.3g} {unit}) would fit; "
            f"take {key} from the drive's data sheet"
        )
        scales: dict[str, object] = {"unit": "permille", "scale": None, key: float(f"{rated:.3g}")}
        return Finding("suspicious-unit", run.id, channel.column, detail, channel_line(channel, **scales))
    return None


def _is_share(signal: Signal) -> bool:
    return signal.channel.quantity in ("torque", "current") and signal.channel.calibrated
