"""From relations that fail to the mistake that explains them: the fewest channels and the most natural factor."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from jointscope.identification.quality_relations import Party, Relation
from jointscope.models.parameters import STANDARD_GRAVITY
from jointscope.recordings.campaign import Channel, Nameplate, Run, Signal
from jointscope.recordings.finding import Finding
from jointscope.recordings.toml_text import channel_line
from jointscope.recordings.units import POUND_FORCE, POUND_FORCE_FOOT, si_factor, units_for

_DEGREE, _RPM, _TURN = math.pi / 180.0, 2.0 * math.pi / 60.0, 2.0 * math.pi
GENERAL: Final = {
    "sqrt 2": math.sqrt(2.0), "3/2": 1.5, "9.80665": STANDARD_GRAVITY, "4.448": POUND_FORCE, "2 pi": _TURN,
    "60/2 pi": 1.0 / _RPM, "180/pi": 1.0 / _DEGREE,
}  # fmt: skip
# what each quantity is mistaken for most: factors SI = factor * declared, in SI of the declared unit
_NATURAL: Final[dict[str, tuple[float, ...]]] = {
    "angle": (_DEGREE, _TURN),
    "angular-velocity": (_RPM, _DEGREE, _TURN),
    "speed-command": (_RPM, _DEGREE, _TURN),
    "angular-acceleration": (_DEGREE, _TURN),
    "linear-acceleration": (STANDARD_GRAVITY, 1.0 / STANDARD_GRAVITY),
    "acceleration": (STANDARD_GRAVITY, 1.0 / STANDARD_GRAVITY),
    "force": (POUND_FORCE, STANDARD_GRAVITY),
    "torque": (POUND_FORCE_FOOT, STANDARD_GRAVITY),
    "current": (math.sqrt(2.0), 1.5),
}
_OFF_THE_LIST = 15.0  # a scale wrong by more than this is reported though no factor of the list explains it


@dataclass(frozen=True, eq=False)
class Correction:
    """Multiply ``signals`` by ``factor``; ``rank`` orders the plausible before the far-fetched."""

    signals: tuple[Signal, ...]
    factor: float
    rank: float
    name: str


def factor_findings(run: Run, relations: Sequence[Relation], rig: Nameplate) -> list[Finding]:
    """``inverted-polarity`` and ``suspicious-unit`` of one run, one mistake after the other until none is left."""
    found: list[Finding] = []
    current = list(relations)
    for _ in range(4):
        failing = [relation for relation in current if relation.hard and not relation.holds()]
        if not failing:
            break
        chosen = _best(current, failing, rig)
        if chosen is None:
            found += _off_the_list(run, failing)
            break
        why = [relation for relation in failing if relation.holds(_corrected(relation, chosen))]
        found += [_finding(run, signal, chosen, why[0], rig) for signal in chosen.signals]
        current = [Relation(r.parties, _corrected(r, chosen), r.low, r.high, r.says, r.hard) for r in current]
    return found


def _corrected(relation: Relation, correction: Correction) -> float:
    power = sum(p.exponent for p in relation.parties if any(_same(p.signal, s) for s in correction.signals))
    return relation.gain * correction.factor**power


def _same(a: Signal, b: Signal) -> bool:
    return a.channel is b.channel


def _badness(relations: Sequence[Relation], correction: Correction | None = None) -> float:
    gains = [r.gain if correction is None else _corrected(r, correction) for r in relations]
    return sum((1.0 if r.hard else 0.5) for r, gain in zip(relations, gains, strict=True) if not r.holds(gain))


def _best(relations: Sequence[Relation], failing: Sequence[Relation], rig: Nameplate) -> Correction | None:
    """The correction that leaves the fewest contradictions; of several, the most plausible."""
    before, ranked = _badness(relations), []
    for correction in _candidates(failing, relations, rig):
        after = _badness(relations, correction)
        mends = any(r.holds(_corrected(r, correction)) for r in failing)
        if mends and after <= before - 0.5:
            ranked.append((after, correction.rank, _distance(relations, correction), correction))
    return min(ranked, key=lambda entry: entry[:3])[3] if ranked else None


def _distance(relations: Sequence[Relation], correction: Correction) -> float:
    touched = [r for r in relations if any(_same(p.signal, s) for p in r.parties for s in correction.signals)]
    return sum(abs(math.log(abs(_corrected(r, correction)) / r.centre)) for r in touched if math.isfinite(r.high))


def _candidates(
    failing: Sequence[Relation], relations: Sequence[Relation], rig: Nameplate
) -> Iterator[Correction]:
    accused = _distinct(p.signal for r in failing for p in r.parties)
    for signal in accused:
        for factor, rank, name in _factors(signal.channel, rig):
            yield Correction((signal,), factor, rank + _seat(signal), name)
    everyone = _distinct(p.signal for r in relations for p in r.parties)
    for location in ("arm", "motor", "load"):
        group = tuple(s for s in everyone if s.channel.location == location and s.channel.role == "output")
        if len(group) > 1:
            for factor, rank, name in _factors(group[0].channel, rig):
                if rank < 2.0:
                    yield Correction(group, factor, 3.0 + rank + _seat(group[0]), name)


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
    size = abs(why.gain / why.centre)
    size = size if size >= 1.0 else 1.0 / size
    detail = f"off by a factor of {size:.4g} ({why.says}); times {correction.name} all agree"
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


def _off_the_list(run: Run, failing: Sequence[Relation]) -> Iterator[Finding]:
    """A drive's torque or current far off without a listed factor: most likely a share of a rated value."""
    for relation in failing:
        gain = relation.gain / relation.centre
        drive = next((p for p in relation.parties if p.exponent == 1 and _is_share(p)), None)
        if drive is None or not math.isfinite(relation.high) or 1.0 / _OFF_THE_LIST < abs(gain) < _OFF_THE_LIST:
            continue
        channel = drive.signal.channel
        key, unit = ("rated_torque", "N m") if channel.quantity == "torque" else ("rated_current", "A")
        rated = 1000.0 / abs(gain) * si_factor(channel)
        detail = (
            f"off by a factor of {abs(gain):.3g} ({relation.says}), which is no unit of the list: "
            f"values in permille of a rated {rated:.2g} {unit} (or in percent of {rated / 10.0:.2g} {unit}) would fit; "
            f"take {key} from the drive's data sheet"
        )
        line = channel_line(channel, unit="permille", scale=None, **{key: float(f"{rated:.2g}")})
        yield Finding("suspicious-unit", run.id, channel.column, detail, line)
        return


def _is_share(party: Party) -> bool:
    return party.signal.channel.quantity in ("torque", "current") and party.signal.channel.calibrated
