"""One answer against its truth: what was said, what is right, by how much the numbers are off."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from jointscope.experiments.prove.diagnosing import Answer

BANDS: Final = (("trivial", 100.0), ("easy", 30.0), ("medium", 10.0), ("hard", 4.0), ("below", 0.0))

VISIBLE: Final = 4.0  # z below which an effect counts as none
NINETY: Final = 1.644854 / 1.959964  # half-width of a 90 % interval over that of a 95 % interval

FAMILIES: Final[Mapping[str, str]] = {
    "coulomb-friction": "dissipative", "stribeck-friction": "dissipative", "load-dependent-friction": "dissipative",
    "quadratic-damping": "dissipative", "structural-damping": "dissipative", "backlash": "stiffness",
    "stiffness-nonlinearity": "stiffness", "stiffness-drift": "stiffness", "end-stop": "stiffness",
    "hysteresis": "hysteretic", "transmission-error": "periodic", "torque-ripple": "periodic",
    "external-vibration": "periodic", "drive-lag": "timing", "delay": "timing", "clock-drift": "timing",
    "torque-logging": "timing", "torque-gain": "gain", "sensor-gain": "gain", "payload": "inertia",
    "gravity": "gravity", "sensor-tilt": "gravity", "link-flexibility": "mode", "base-compliance": "mode",
    "neighbour-flexibility": "mode", "sensor-resonance": "mode", "sensor-saturation": "saturation",
}  # fmt: skip


@dataclass(frozen=True)
class Judged:
    """A case, said and true.

    Attributes:
        band: By z_d: trivial, easy, medium, hard, below; ``null`` without an effect.
        truth: ``name@location`` of the concealed effects, sorted; empty for nulls.
        said: ``name@location`` of the named effects, sorted.
        exact: Whether the answer is right as a whole (see :func:`judge`).
        location: Whether the place is right; ``None`` where there is none to be right about.
        any_named: Pairs: at least one named and none wrong.
        probability: What the answer gave for its verdict as a whole; NaN where it gave nothing.
        gain: (E_base - E_tool)/(E_base - E_floor) on the held-out runs, E_floor the error of the truth itself, from
            the noise that was added; NaN where it can't be had.
        gain_fitted: The same towards the true structure fitted to the same runs by the same tool, where the diagnosis
            states that structure's held-out error in its ranking.
        worse: Whether the held-out error grew; ``None`` where nothing was held out.
        error: |relative error| of the main parameter, NaN unless the effect was named and has one.
        covered: Whether the interval, scaled from 95 to 90 %, holds it; ``None`` likewise.
        z: Distance of the truth from the refitted base [standard deviations].
        laws: The concealed effects' laws.
        nearest: The rival that z_d is the distance from.
        shifted: Whether the answer reports base parameters that were off.
    """

    case: str
    kind: str
    band: str
    experiments: str
    hard: bool
    departs: bool
    listed: bool
    z_d: float
    z: float
    laws: tuple[str, ...]
    nearest: str
    status: str
    verdict: str
    reason: str
    seconds: float
    truth: tuple[str, ...]
    said: tuple[str, ...]
    exact: bool
    location: bool | None
    any_named: bool
    probability: float
    gain: float
    gain_fitted: float
    worse: bool | None
    error: float
    covered: bool | None
    shifted: bool


def band_of(truth: Mapping[str, Any]) -> str:
    """The case's band of hardness."""
    strength = truth["strength"]
    if strength is None:
        return "null"
    return next(name for name, least in BANDS if strength["z_d"] >= least)


def judge(truth: Mapping[str, Any], answer: Answer) -> Judged:
    """Score one case.

    Right as a whole: a null answered "none"; named effects equal to the concealed ones, name and location; an
    unlisted effect answered "unknown"; below z_d = 4, where nothing can be told apart, "unknown", or a set that holds
    the truth, or the truth itself; below z = 4, where nothing can be seen, "none" too.
    """
    said_all = answer.diagnosis or {}
    verdict = str(said_all.get("verdict", answer.status))
    labels = tuple(sorted(f"{e['effect']}@{e['location']}" for e in truth["effects"]))
    said = _said(said_all)
    band = band_of(truth)
    kind = str(truth["kind"]) if labels else "null"
    listed = all(effect["listed"] for effect in truth["effects"])
    strength = truth["strength"] or {}
    exact = _right(kind, band, listed, labels, said, verdict, said_all)
    if strength and strength["z"] < VISIBLE and verdict == "none":
        exact = True
    named = bool(said) and set(said) <= set(labels)
    gain, worse = _held_out(said_all, truth)
    error, covered = _parameter(said_all, truth) if named else (math.nan, None)
    probability = said_all.get("verdict_probability")
    return Judged(
        case=truth["case"], kind=kind, band=band, experiments=truth["experiments"],
        hard=bool(truth.get("hard", truth["kind"] == "hard-null")),
        departs=any(effect["departs"] for effect in truth["effects"]), listed=listed,
        z_d=strength.get("z_d", math.nan), z=strength.get("z", math.nan),
        laws=tuple(str(effect.get("law", "")) for effect in truth["effects"]), nearest=str(strength.get("nearest", "")),
        status=answer.status, verdict=verdict,
        reason=str(said_all.get("unknown_reason") or ""), seconds=answer.seconds, truth=labels, said=said, exact=exact,
        location=_place(truth, said_all), any_named=named,
        probability=float(probability) if isinstance(probability, (int, float)) else math.nan,
        gain=gain, gain_fitted=_gain_fitted(said_all, labels), worse=worse, error=error, covered=covered,
        shifted=bool(said_all.get("parameter_shift")),
    )  # fmt: skip


def _said(diagnosis: Mapping[str, Any]) -> tuple[str, ...]:
    if diagnosis.get("verdict") != "effects":
        return ()
    return tuple(sorted(f"{e['effect']}@{e['location']}" for e in diagnosis.get("effects", ())))


def _right(
    kind: str, band: str, listed: bool, labels: tuple[str, ...], said: tuple[str, ...], verdict: str,
    diagnosis: Mapping[str, Any],
) -> bool:  # fmt: skip
    if kind == "null":
        return verdict == "none"
    if not listed:
        return verdict == "unknown"
    if said and said == labels:
        return True
    if band != "below":
        return False
    if verdict == "unknown":
        offered = diagnosis.get("candidates")
        return not offered or any(sorted(candidate) == sorted(labels) for candidate in offered)
    return False


def _place(truth: Mapping[str, Any], diagnosis: Mapping[str, Any]) -> bool | None:
    places = {effect["location"] for effect in truth["effects"]}
    if len(places) != 1:
        return None
    if diagnosis.get("verdict") == "effects" and diagnosis.get("effects"):
        return {effect["location"] for effect in diagnosis["effects"]} == places
    where = diagnosis.get("where") or {}
    return where.get("location") in places


def _held_out(diagnosis: Mapping[str, Any], truth: Mapping[str, Any]) -> tuple[float, bool | None]:
    held = diagnosis.get("held_out")
    if not held:
        return math.nan, None
    base, tool = held.get("base_error"), held.get("augmented_error")
    floors = [value for run in held.get("runs", ()) for value in truth["floor"].get(run, {}).values()]
    if not isinstance(base, (int, float)) or not isinstance(tool, (int, float)):
        return math.nan, None
    worse = tool > 1.001 * base
    if not truth["effects"] or not floors or base <= 1.02 * (floor := sum(floors) / len(floors)):
        return math.nan, worse
    return (base - tool) / (base - floor), worse


def _parameter(diagnosis: Mapping[str, Any], truth: Mapping[str, Any]) -> tuple[float, bool | None]:
    """Error of the main parameter of the first effect that was named and has a comparable number."""
    by_label = {f"{e['effect']}@{e['location']}": e for e in truth["effects"]}
    for effect in diagnosis.get("effects", ()):
        known = by_label.get(f"{effect['effect']}@{effect['location']}")
        if known is None or known["main"] not in known["parameters"]:
            continue
        said = (effect.get("parameters") or {}).get(known["main"])
        true = known["parameters"][known["main"]]
        if not said or not isinstance(said.get("value"), (int, float)) or true == 0.0:
            continue
        if said.get("unit") == "per run":  # its sign is nobody's to know: no recording says which run came first
            true = math.copysign(true, said["value"])
        interval = said.get("interval95")
        inside = _inside(said["value"], interval, true) if interval and None not in interval else None
        if known["main"] == "gain":  # how far off the gain is matters, not the 1 it starts from
            return abs(said["value"] - true) / abs(true - 1.0), inside
        return abs(said["value"] - true) / abs(true), inside
    return math.nan, None


def _inside(value: float, interval95: Sequence[float], true: float) -> bool:
    """Whether the interval holds ``true`` once its sides are scaled from 95 to 90 %."""
    low, high = (value + NINETY * (end - value) for end in interval95)
    return bool(low <= true <= high)


def _gain_fitted(diagnosis: Mapping[str, Any], labels: tuple[str, ...]) -> float:
    """Gain relative to the true structure fitted by the tool itself, from its ranking; NaN where that isn't stated."""
    held = diagnosis.get("held_out") or {}
    stated = [
        entry["held_out_error"] for entry in diagnosis.get("ranking", ())
        if labels and tuple(sorted(entry["effects"])) == labels and entry.get("held_out_error") is not None
    ]  # fmt: skip
    base, tool = held.get("base_error"), held.get("augmented_error")
    if not stated or base is None or tool is None or base <= 1.02 * stated[0]:
        return math.nan
    return float((base - tool) / (base - stated[0]))


def family(label: str) -> str:
    """Family of a ``name@location``; ``unlisted`` for what no catalogue lists."""
    return FAMILIES.get(label.split("@")[0], "unlisted")
