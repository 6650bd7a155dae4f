"""What a session says, as lines for the bench and as JSON lines for machines (``jointscope-watch/1``)."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from typing import Any, Final

from jointscope.diagnosis.next_experiment import MENU
from jointscope.experiments.watch.coverage import EXPERIMENTS, Coverage, EffectCoverage
from jointscope.experiments.watch.judging import Take
from jointscope.experiments.watch.precision import Known
from jointscope.experiments.watch.session import Event, Judged, Standing, Unusable

FORMAT: Final = "jointscope-watch/1"
_SHORT: Final = {
    "levels": "hits over 10:1 in peak force, in random order",
    "preload": "small hits at three static torques of either sign",
    "mass": "the same runs with a known mass on the arm",
    "posture": "the same runs at three arm angles",
    "brake": "the same hits with the brake open and closed",
    "sensor-moved": "the same hits with the accelerometer moved, a second one on the base",
    "slow-ramp": "slow moves both ways at five speeds",
    "torque-reversal": "a slow torque ramp through zero with both angles",
    "multisine": "a periodic multisine torque at three levels",
    "logging-rate": "torque and acceleration on one device at 1 kHz",
    "time-shuffled": "the first level again at the end, levels in random order",
    "undriven": "30 s with the drive off",
    "sweep-levels": "torque sweeps over 6:1 in amplitude, two of each",
    "constant-speeds": "moves at three constant speeds",
}


def as_lines(event: Event, told: Collection[str] = ()) -> list[str]:
    """For a terminal; of what is missing only the lines that are not among ``told`` already."""
    if isinstance(event, Judged):
        return _take_lines(event)
    if isinstance(event, Unusable):
        return [f"       {event.file}: {event.why}"]
    return [
        *_known_lines(event),
        *(line for line in missing_lines(event) if line not in told),
        *_next_lines(event),
    ]


def _take_lines(event: Judged) -> list[str]:
    take = event.take
    level = "" if math.isnan(take.level) else f", {take.level:.4g} {take.level_unit}"
    like = f", like {event.like}" if event.like else ""
    again = ", taken again" if event.again else ""
    lines = [f"{take.verdict.upper():6s} {take.run.id} ({take.run.experiment}{level}{like}{again})"]
    for reason in take.reasons:
        where = f" {reason.channel}" if reason.channel else ""
        lines.append(f"       {reason.name}{where}: {reason.detail}")
        lines.append(f"         -> {reason.advice}")
        if reason.toml:
            lines.append(f"         paste: {reason.toml}")
    return lines


def _known_lines(event: Standing) -> list[str]:
    repeat = f", {event.repeats} to repeat" if event.repeats else ""
    head = f"-- {event.takes} usable take{'s' if event.takes != 1 else ''}{repeat}"
    return [head, *(f"   {_known_line(known)}" for known in event.known)]


def missing_lines(event: Standing) -> list[str]:
    """What the takes lack for each family of effects, and how far the recordings are that would part look-alikes."""
    found = event.coverage
    if found.refused:
        return [f"   effects: {found.refused}"]
    lines = []
    for family in dict.fromkeys(one.family for one in found.effects):
        members = [one for one in found.effects if one.family == family]
        lines += [f"   {line}" for line in _family_lines(family, members)]
    wanted = {key for one in found.effects for _, key in one.apart}
    for key in (key for key in MENU if key in wanted):
        so_far = f"; so far {found.menu[key].so_far}" if found.menu[key].so_far else ""
        lines.append(f"     {key:15s} {_SHORT.get(key, MENU[key])}{so_far}")
    if found.alone:
        names = ", ".join(EXPERIMENTS[name] for name in found.alone)
        lines.append(f"   one more each, so that one can be held out: {names}")
    return lines


def _next_lines(event: Standing) -> list[str]:
    return [f"   next: {event.next_take}"] if event.next_take else ["   nothing is missing"]


def _known_line(known: Known) -> str:
    if known.value is None or known.interval is None:
        return f"{known.symbol:4s} missing: {known.missing}"
    half = f"+-{100.0 * known.half_width:.2g} %"
    state = f"still: {known.missing}" if known.missing else "done"
    return f"{known.symbol:4s} {known.value:.5g} {known.unit} {half}; {state}"


def _family_lines(family: str, members: Sequence[EffectCoverage]) -> list[str]:
    """What a family's effects lack: first those that nothing shows, then what would part the others from look-alikes."""
    lines = []
    for why in dict.fromkeys(one.missing for one in members if not one.shown):
        names = ", ".join(one.name for one in members if one.missing == why)
        lines.append(f"can't be shown: {names}: {why}")
    shown = [one for one in members if one.shown]
    if shown:
        keys = dict.fromkeys(key for one in shown for _, key in one.apart)
        parted = f"; to part them from look-alikes: {', '.join(keys)}" if keys else ", parted from look-alikes"
        lines.append(f"can be shown: {', '.join(one.name for one in shown)}{parted}")
    return [f"{family if not number else '':12s} {line}" for number, line in enumerate(lines)]


# --- JSON ------------------------------------------------------------------------------------------------------------


def as_json(event: Event) -> dict[str, Any]:
    """One line of JSON."""
    if isinstance(event, Judged):
        return {
            "format": FORMAT,
            "event": "take",
            "again": event.again,
            "like": event.like or None,
            **_take(event.take),
        }
    if isinstance(event, Unusable):
        return {"format": FORMAT, "event": "file", "file": event.file, "why": event.why}
    return {
        "format": FORMAT,
        "event": "standing",
        "usable": event.takes,
        "repeat": event.repeats,
        "parameters": [_known(known) for known in event.known],
        **_coverage(event.coverage),
        "next": event.next_take,
    }


def _take(take: Take) -> dict[str, Any]:
    return {
        "run": take.run.id,
        "experiment": take.run.experiment,
        "files": [stream.file for stream in take.run.streams],
        "verdict": take.verdict,
        "level": None if math.isnan(take.level) else take.level,
        "level_unit": take.level_unit or None,
        "reasons": [
            {
                "name": reason.name, "channel": reason.channel or None, "detail": reason.detail,
                "verdict": reason.verdict, "advice": reason.advice, "toml": reason.toml,
            }
            for reason in take.reasons
        ],
    }  # fmt: skip


def _known(known: Known) -> dict[str, Any]:
    return {
        "symbol": known.symbol,
        "parameter": known.name,
        "unit": known.unit or None,
        "value": known.value,
        "interval95": None if known.interval is None else list(known.interval),
        "more_hits": known.more_hits,
        "missing": known.missing or None,
    }


def _coverage(found: Coverage) -> dict[str, Any]:
    return {
        "effects": [
            {
                "effect": one.effect,
                "location": one.location,
                "family": one.family,
                "can_be_shown": one.shown,
                "missing": one.missing or None,
                "parted_by": [
                    {"from": other, "record": key, "so_far": found.menu[key].so_far or None}
                    for other, key in one.apart
                ],
            }
            for one in found.effects
        ],
        "menu": {
            key: {"recording": MENU[key], "enough": held.enough, "so_far": held.so_far or None}
            for key, held in found.menu.items()
        },
        "one_more": list(found.alone),
        "refused": found.refused or None,
    }
