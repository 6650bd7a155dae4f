"""The wrong answers sorted into classes, one example each: what it looked like, why it was mistaken, what would tell."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

from jointscope.experiments.prove.judging import Judged
from jointscope.sim.concealed import catalogue

CLASSES: Final[Mapping[str, str]] = {
    "crashed or timed out": "No answer came; it counts as wrong whatever was true.",
    "false alarm": "Nothing was concealed and an effect was named: noise, a rough nameplate or the scatter of the hits was"
    " taken for physics.",
    "a mismatch seen in a null": "Nothing was concealed and the answer was 'unknown': something was seen that is noise, and"
    " no effect was made responsible for it.",
    "missed": "An effect was concealed and the answer was 'none': what it leaves after the base is refitted was judged to"
    " be noise, or too small to matter.",
    "unlisted, given a listed name": "What no catalogue lists was given the name of the listed effect that comes nearest;"
    " the test of whether that effect explains all of it was passed.",
    "left open, the truth in the set": "The answer was 'unknown' with a set that holds the truth, although the recordings"
    " tell its members apart.",
    "left open, the truth not in the set": "The answer was 'unknown' with a set that lacks the truth.",
    "taken for something unlisted": "A listed effect was answered 'unknown, outside the catalogue': none of its candidate"
    " laws explained it well enough.",
    "named though it can't be told": "Below z_d = 4 a rival with parameters of its own explains the recordings as well; one"
    " of them was named all the same, and it was the wrong one.",
    "something named beside the truth": "The truth was named, and a further effect with it that isn't there.",
    "one of two": "Of two concealed effects one was named and the other left out.",
    "one of two, with a wrong one": "Of two concealed effects one was named, the other replaced by one that isn't there.",
    "right name, wrong place": "The effect was named at another place than the one it sits in.",
    "taken for a look-alike": "The name is that of a known look-alike of the truth.",
    "wrong name, right place": "The place is right; the law named there is another, and no known look-alike.",
    "something else named": "Neither the name nor the place is that of the truth.",
}


TELLS: Final[Mapping[str, str]] = {
    "coulomb-friction": "sweeps at two levels or more, and slow motions that reverse",
    "stribeck-friction": "a motion that spends seconds below 0.05 rad/s in either direction",
    "load-dependent-friction": "the same motion with and without a payload, in all four quadrants of torque and speed",
    "quadratic-damping": "hits over a decade of level: its damping grows with the amplitude, others' don't",
    "backlash": "hits over a decade of level, and again under a constant preload, which makes it vanish",
    "stiffness-nonlinearity": "a slow ramp of torque against the braked joint, with the wind-up measured",
    "hysteresis": "quasi-static torque loops at two amplitudes, and hits over a decade of level",
    "structural-damping": "hits with two payloads: a loss factor stays, a viscous ratio doesn't",
    "transmission-error": "slow motions at two speeds: its lines follow the position",
    "torque-ripple": "slow motions at two speeds with the motor angle logged",
    "drive-lag": "a sweep to higher frequencies with the motor angle logged: a lag also loses gain, a delay doesn't",
    "torque-gain": "hits on the same rig, whose force cell gives the inertia that the torque is measured against",
    "gravity": "the same experiment at two postures, and the holding torque at rest",
    "payload": "hits with and without a known added mass",
    "link-flexibility": "hits at two places along the arm, and the accelerometer moved",
    "base-compliance": "an accelerometer on the base, or hits on the base",
    "neighbour-flexibility": "hits at two postures, and with the neighbour's brake on and off",
    "end-stop": "a motion that stays clear of the range in question",
    "stiffness-drift": "equal hits at the beginning and the end of the session, levels in random order",
    "external-vibration": "a record of the machine at rest, longer than a hit's",
    "delay": "a common trigger or one signal recorded by both devices",
    "clock-drift": "one run of a minute, with a signal recorded by both devices at its beginning and end",
    "sensor-tilt": "the accelerometer turned by 90 degrees, or a motion that turns it in gravity",
    "sensor-resonance": "the accelerometer glued instead of clamped, or a second one beside it",
    "sensor-saturation": "the same hits at half the level, or the next larger range",
    "sensor-gain": "a hit on a free known mass with the same sensors",
    "torque-logging": "the torque logged at a higher rate, or by the DAQ",
}


def failure(j: Judged, diagnosis: Mapping[str, Any] | None) -> str | None:
    """The class of a wrong answer; ``None`` of a right one."""
    if j.exact:
        return None
    if j.status != "answered":
        return "crashed or timed out"
    if not j.truth:
        return "false alarm" if j.said else "a mismatch seen in a null"
    if j.verdict == "none":
        return "missed"
    if j.verdict == "unknown":
        offered = (diagnosis or {}).get("candidates")
        if not offered:
            return "taken for something unlisted"
        held = any(tuple(sorted(candidate)) == j.truth for candidate in offered)
        return f"left open, the truth {'' if held else 'not '}in the set"
    if not j.listed:
        return "unlisted, given a listed name"
    if j.band == "below":
        return "named though it can't be told"
    return _misnamed(set(j.truth), set(j.said))


def _misnamed(truth: set[str], said: set[str]) -> str:
    if truth <= said:
        return "something named beside the truth"
    if said < truth:
        return "one of two"
    if truth & said:
        return "one of two, with a wrong one"
    if {label.split("@")[0] for label in truth} & {label.split("@")[0] for label in said}:
        return "right name, wrong place"
    if said & {rival for label in truth for rival in catalogue.rivals(label)}:
        return "taken for a look-alike"
    if {label.split("@")[1] for label in truth} & {label.split("@")[1] for label in said}:
        return "wrong name, right place"
    return "something else named"


def failures(
    judged: Sequence[Judged],
    diagnoses: Mapping[str, Mapping[str, Any] | None],
    truths: Mapping[str, Mapping[str, Any]],
) -> list[dict[str, Any]]:
    """Every class that occurs, commonest first, each with its surest answer as the example."""
    members: dict[str, list[Judged]] = {}
    for j in judged:
        kind = failure(j, diagnoses[j.case])
        if kind is not None:
            members.setdefault(kind, []).append(j)
    out = []
    for kind, cases in sorted(members.items(), key=lambda item: -len(item[1])):
        surest = max(cases, key=lambda j: -1.0 if math.isnan(j.probability) else j.probability)
        out.append({
            "class": kind, "meaning": CLASSES[kind], "cases": len(cases),
            "bands": {band: sum(j.band == band for j in cases) for band in sorted({j.band for j in cases})},
            "example": example(surest, diagnoses[surest.case] or {}, truths[surest.case]),
        })  # fmt: skip
    return out


def example(j: Judged, diagnosis: Mapping[str, Any], truth: Mapping[str, Any]) -> dict[str, Any]:
    """What one wrong answer looked like."""
    held = diagnosis.get("held_out") or {}
    ranking = diagnosis.get("ranking") or []
    return {
        "case": j.case, "experiments": j.experiments, "band": j.band, "hard": j.hard, "z": j.z, "z_d": j.z_d,
        "truth": [
            {
                "effect": f"{effect['effect']}@{effect['location']}", "law": effect["law"],
                "departs": effect["departs"], "main": effect["main"],
                "value": effect["parameters"].get(effect["main"]),
            }
            for effect in truth["effects"]
        ],
        "nearest": j.nearest, "materiality": (truth["strength"] or {}).get("materiality"), "verdict": j.verdict,
        "said": list(j.said), "reason": j.reason, "probability": j.probability,
        "ranking": [
            {"effects": entry["effects"], "probability": entry.get("probability")} for entry in ranking[:4]
        ],
        "candidates": diagnosis.get("candidates"), "place_of_truth": _place_in(ranking, j.truth),
        "held_out": {key: held.get(key) for key in ("base_error", "augmented_error", "noise_floor")} if held else None,
        "where": (diagnosis.get("where") or {}).get("location"), "next_experiment": diagnosis.get("next_experiment"),
        "why": why(j, ranking, truth),
        "tells": {name: TELLS[name] for name in sorted({e["effect"] for e in truth["effects"]}) if name in TELLS},
    }  # fmt: skip


def _place_in(ranking: Sequence[Mapping[str, Any]], truth: tuple[str, ...]) -> int | None:
    for place, entry in enumerate(ranking, start=1):
        if tuple(sorted(entry["effects"])) == truth:
            return place
    return None


def why(j: Judged, ranking: Sequence[Mapping[str, Any]], truth: Mapping[str, Any]) -> str:
    """What the sealed truth says about why this could be mistaken."""
    words: list[str] = []
    if j.status != "answered":
        return "There is no answer to look at."
    if not j.truth:
        words.append(
            "The noise is coloured and grows with the level, hits scatter more, and the nameplate is far off."
            if j.hard else "The noise is nearly white and the nameplate close: no excuse is built into this case."
        )  # fmt: skip
    if j.nearest and j.nearest in j.said:
        words.append(f"The answer is the very rival from which the truth is least distinct: {j.z_d:.1f} standard"
                     " deviations once both are fitted.")  # fmt: skip
    elif j.nearest and j.band != "null":
        words.append(f"The nearest rival is {j.nearest}, {j.z_d:.1f} standard deviations away; the base alone is"
                     f" {j.z:.0f} away.")  # fmt: skip
    material = (truth["strength"] or {}).get("materiality")
    if material is not None and material < 0.01:
        words.append(f"It moves the acceleration by {100 * material:.1f} % only.")
    departing = [effect["law"] for effect in truth["effects"] if effect["departs"]]
    if departing:
        words.append(
            f"The concealed law ({', '.join(departing)}) departs from the textbook's under the same name."
        )
    place = _place_in(ranking, j.truth)
    if j.listed and j.truth:
        if place is None:
            words.append("The truth is nowhere in the ranking: it was given up before the last comparison.")
        else:
            stated = ranking[place - 1].get("probability")
            words.append(f"The truth stands in place {place} of the ranking"
                         + (f" with probability {stated:.2f}." if stated is not None else "."))  # fmt: skip
    return " ".join(words)
