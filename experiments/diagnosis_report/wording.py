"""The answer in a lab engineer's words: what each effect is called, its size in the units of the trade, what to do."""

from __future__ import annotations

import math
import re
from typing import Any

ARCMIN_PER_RAD = 60.0 * 180.0 / math.pi

CALLED = {
    "coulomb-friction": "dry friction",
    "stribeck-friction": "dry friction with a higher breakaway torque",
    "load-dependent-friction": "friction that grows with the transmitted torque",
    "quadratic-damping": "drag that grows with the square of the speed",
    "backlash": "backlash (lost motion)",
    "stiffness-nonlinearity": "a stiffness that changes with the torque",
    "hysteresis": "hysteresis",
    "structural-damping": "structural damping in place of viscous damping",
    "transmission-error": "a transmission error that repeats with position",
    "torque-ripple": "torque ripple or cogging",
    "drive-lag": "a torque that lags the logged one",
    "torque-gain": "a torque constant or efficiency that is off",
    "gravity": "a gravity torque that the model lacks",
    "payload": "an added inertia in some of the runs",
    "link-flexibility": "a bending mode of the arm",
    "base-compliance": "a mount that moves",
    "neighbour-flexibility": "the elasticity of a neighbouring joint",
    "end-stop": "contact with an end stop",
    "stiffness-drift": "a stiffness that changes over time",
    "external-vibration": "a periodic disturbance from outside",
    "delay": "a delay between the recording devices",
    "clock-drift": "recording clocks that run at different rates",
    "sensor-tilt": "a tilted accelerometer",
    "sensor-resonance": "a resonance of the accelerometer's mount",
    "sensor-saturation": "clipping or compression of the accelerometer",
    "sensor-gain": "a wrong sensor sensitivity or radius",
    "torque-logging": "a torque log that is held or averaged at a low rate",
}
PLACES = {
    "motor": "in the motor",
    "transmission": "in the reducer",
    "load": "at the arm",
    "base": "at the base",
    "neighbour": "in the neighbouring joint",
    "acquisition": "in the measuring chain, not in the joint",
}
FIELD_NAMES = {
    "stiffness": "torsional stiffness K",
    "inertia": "load inertia J_L",
    "damping": "joint damping c",
    "damping_total": "joint and bearing damping c + b_l",
    "motor_inertia": "motor and reducer inertia J_M, at the output",
    "motor_damping": "viscous friction of the motor side b_m",
    "load_damping": "viscous friction of the arm side b_l",
    "gravity_moment": "static moment m g r",
    "torque_scale": "torque constant over the stated one",
    "backlash.gap": "lost motion (total play)",
    "coulomb-friction.torque": "Coulomb friction torque",
    "coulomb-friction.asymmetry": "difference between the directions",
    "stribeck-friction.torque": "Coulomb friction torque",
    "stribeck-friction.breakaway": "breakaway (starting) torque",
    "stribeck-friction.stribeck_velocity": "Stribeck velocity",
    "load-dependent-friction.coefficient": "loss per transmitted torque (1 - efficiency)",
    "hysteresis.torque": "hysteresis torque (half the loop's height)",
    "stiffness-nonlinearity.cubic": "hardening (+) or softening (-) of K",
    "structural-damping.loss_factor": "loss factor eta",
    "transmission-error.amplitude": "kinematic error (transmission accuracy), peak",
    "torque-ripple.amplitude": "cogging or ripple torque, peak",
    "drive-lag.time_constant": "current loop's time constant",
    "torque-gain.gain": "true over stated torque constant or efficiency",
    "gravity.moment": "static moment m g r that is missing",
    "payload.inertia": "payload inertia about the joint",
    "payload.percussion_radius": "payload's distance, J/(m r) about the joint",
    "link-flexibility.frequency": "bending mode of the arm",
    "base-compliance.frequency": "mounting resonance",
    "neighbour-flexibility.frequency": "neighbouring joint's mode",
    "delay.delay": "lateness of the other device",
    "clock-drift.ppm": "clock rate error",
    "sensor-tilt.angle": "misalignment of the accelerometer",
    "sensor-resonance.frequency": "mounted resonance of the accelerometer",
    "sensor-saturation.level": "clipping level",
    "sensor-gain.gain": "true over stated sensitivity or radius",
    "torque-logging.rate": "refresh rate of the torque log",
}
"""The trade's names beside the contract's: of the joint's parameters, and of effects' as ``effect.parameter``."""
SENSORS = ("sensor-tilt", "sensor-resonance", "sensor-saturation", "sensor-gain")


def called(name: str, *, translational: bool = False) -> str:
    """``effect@location`` in words; a name that is not in the list is shown as it is."""
    effect, _, location = name.partition("@")
    place = "at the carriage" if translational and location == "load" else PLACES.get(location, location)
    return f"{CALLED.get(effect, effect)} {place}".strip()


def field_name(owner: str, parameter: str) -> str:
    """The trade's name of a parameter of ``joint`` or of ``effect@location``; empty where it has no other."""
    key = parameter if owner == "joint" else f"{owner.partition('@')[0]}.{parameter}"
    return FIELD_NAMES.get(key, "")


def figure(value: float | None, digits: int = 3) -> str:
    """A number to ``digits`` figures, without exponent where it can be read without one."""
    if value is None or not math.isfinite(value):
        return "not determined"
    if value != 0.0 and not 1e-3 <= abs(value) < 1e6:
        return f"{value:.{digits}g}"
    decimals = max(0, digits - 1 - (math.floor(math.log10(abs(value))) if value else 0))
    return f"{value:.{decimals}f}"


def interval(parameter: dict[str, Any], factor: float = 1.0) -> str:
    """The 95 % interval as ``low to high``."""
    low, high = parameter["interval95"]
    if low is None or high is None:
        return "not determined"
    return f"{figure(low * factor, 4)} to {figure(high * factor, 4)}"


def trade_unit(unit: str) -> tuple[str, float] | None:
    """The unit that catalogues use beside the SI one, and the factor: arcmin for angles, N m/arcmin for stiffness."""
    if unit == "rad":
        return "arcmin", ARCMIN_PER_RAD
    if unit == "N m/rad":
        return "N m/arcmin", 1.0 / ARCMIN_PER_RAD
    return None


def sized(name: str, parameter: dict[str, Any]) -> str:
    """``name value unit (value in the trade's unit)``, with its interval."""
    unit = "" if parameter["unit"] == "1" else f" {parameter['unit']}"
    text = f"{name.replace('_', ' ')} {figure(parameter['value'])}{unit}"
    other = trade_unit(parameter["unit"])
    if other and parameter["value"] is not None:
        text += f" = {figure(parameter['value'] * other[1])} {other[0]}"
    return f"{text} (95 %: {interval(parameter)}{unit})"


def percent(share: float | None) -> str:
    """A relative error as a percentage."""
    if share is None:
        return "unknown"
    return f"{figure(100.0 * share, 2 if share < 0.1 else 3)} %"


def verdict_sentence(answer: dict[str, Any], *, translational: bool) -> str:
    """What is wrong, where, how large and how sure, in one sentence."""
    sure = f"{100.0 * answer['verdict_probability']:.0f} %"
    if answer["verdict"] == "none":
        off = ", ".join(name.replace("_", " ") for name in answer["parameter_shift"])
        shifts = f" The nameplate was off, however, in {off}: see the table of parameters." if off else ""
        return (
            "Nothing is missing from the model: with its parameters refitted it meets the recordings to within their "
            f"noise (probability {sure}){_fit(answer, 'base_error')}.{shifts}"
        )
    if answer["verdict"] == "unknown":
        return _unknown(answer, sure, translational)
    parts = []
    for effect in answer["effects"]:
        first = next(iter(effect["parameters"].items()), None)
        size = f", {sized(*first)}" if first else ""
        parts.append(called(f"{effect['effect']}@{effect['location']}", translational=translational) + size)
    kind = (
        "The model leaves out"
        if answer["held_out"]
        else "A candidate only, as no run could be held out: the model leaves out"
    )
    fit = _fit(answer, "augmented_error")
    return f"{kind} {'; and '.join(parts)}; probability {sure}{fit}.{_beside(answer, translational)}"


def _unknown(answer: dict[str, Any], sure: str, translational: bool) -> str:
    candidates = answer.get("candidates") or []
    if answer["unknown_reason"] == "not-identifiable" and candidates:
        places = {name.partition("@")[2] for names in candidates for name in names}
        one_place = len(places) == 1  # said once, as the law alone is open
        what = "something"
        if one_place:
            what += " " + called(f"@{places.pop()}", translational=translational)
        listed = "; or ".join(
            " with ".join(
                called(name.partition("@")[0] if one_place else name, translational=translational)
                for name in names
            )
            for names in candidates[:4]
        )
        return (
            f"The model leaves out {what}, but these recordings can't tell which of these it is: {listed} "
            f"(probability that it is one of them {sure}){_fit(answer, 'augmented_error', 'with the best of them')}."
        )
    return (
        "The recordings differ from the model by more than their noise, and no effect of the catalogue explains it "
        f"(probability {sure}).{_resembles(answer)}{_following(answer, translational)}"
    )


def _resembles(answer: dict[str, Any]) -> str:
    """Physics outside the catalogue that explains more than anything in it."""
    found = answer.get("resembles")
    if not found:
        return ""
    return f" {found['law'][0].upper()}{found['law'][1:]} explains more than anything in the catalogue."


def _following(answer: dict[str, Any], translational: bool) -> str:
    """What shows it: an effect that does not keep its size, or a residual that still follows the input."""
    if answer.get("changes"):
        said = in_words(answer["changes"][0]["sentence"], translational=translational)
        return f" {said[0].upper()}{said[1:]}."
    left = answer.get("remainder") or []
    if left:
        return f" In {left[0]['sentence']}."
    apart = answer.get("between_runs") or []
    return f" {apart[0]['sentence'][0].upper()}{apart[0]['sentence'][1:]}." if apart else ""


def _beside(answer: dict[str, Any], translational: bool) -> str:
    """What a further effect may be, where the recordings leave that open."""
    named = {f"{e['effect']}@{e['location']}" for e in answer["effects"]}
    others = [[n for n in names if n not in named] for names in answer.get("candidates") or []]
    listed = [" with ".join(called(n, translational=translational) for n in names) for names in others if names]
    return f" Beside it these recordings can't tell: {'; or '.join(listed[:4])}." if listed else ""


def _fit(answer: dict[str, Any], key: str, what: str = "with it") -> str:
    held = answer["held_out"]
    if not held or held[key] is None:
        return ""
    count = len(held["runs"])
    runs = f"the {count} held-out runs" if count > 1 else "the held-out run"
    if key == "base_error" or held["base_error"] is None:
        return f"; on {runs} the fit is {percent_fit(held[key])}"
    return f"; {what} in the model the fit on {runs} rises from {percent_fit(held['base_error'])} to {percent_fit(held[key])}"


def percent_fit(error: float) -> str:
    """100 (1 - relative error) %, to the digits that still tell two good fits apart."""
    fit = 100.0 * (1.0 - error)
    digits = 1 if error > 0.02 else 2
    return f"{fit:.{digits}f} %"


def in_words(sentence: str, *, translational: bool) -> str:
    """A sentence about ``effect@location`` names with the names in words."""

    def word(found: re.Match[str]) -> str:
        return called(found[0], translational=translational)

    sentence = re.sub(r"tells whether (\S+@\S+) is there at all", r"tells whether there is \1", sentence)
    return re.sub(r"[a-z-]+@[a-z]+", word, sentence).rstrip(".")


def next_step(answer: dict[str, Any], *, translational: bool = False) -> str:
    """What to do now."""
    if answer["next_experiment"]:
        return f"record {in_words(answer['next_experiment'], translational=translational)}."
    if answer["verdict"] == "none":
        return "Use the refitted parameters below. No further recording is needed for this question."
    if answer["verdict"] == "unknown":
        return (
            "Look at the residuals below for what they grow with (speed, position, level, frequency), and record again "
            "with that one quantity varied and the rest held."
        )
    acquisition = all(e["location"] == "acquisition" for e in answer["effects"])
    if acquisition:
        return "Put the measuring chain right, or keep the correction in model.json, before you change the joint's model."
    return (
        "Add it to your model: model.json and augmented.xml hold it; jointscope confirm replays the held-out runs "
        "in MuJoCo with and without it."
    )
