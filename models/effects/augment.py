"""From a diagnosis' ``model.json`` to the rig's MJCF with every effect in it, and what is left for replay to do."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import mujoco

from jointscope.errors import InputError
from jointscope.models.effects import acquisition, drive, friction, load, modes, transmission
from jointscope.models.effects.building import Building, Parameters, begin

FORMAT = "jointscope-effects/1"
DRIFT_HZ = 0.3  # below it the drive's law holds the rigid body in a replay, above it the logged torque acts

Writer = Callable[[Building, str, str, Parameters], str]

# effect: how it is written, the parameter that switches it off, and the value at which it does (None: infinite)
_EFFECTS: dict[str, tuple[Writer, tuple[str, ...], float | None]] = {
    "coulomb-friction": (friction.coulomb, ("torque",), 0.0),
    "stribeck-friction": (friction.stribeck, ("torque",), 0.0),
    "load-dependent-friction": (friction.load_dependent, ("coefficient",), 0.0),
    "quadratic-damping": (friction.quadratic, ("coefficient",), 0.0),
    "backlash": (transmission.backlash, ("gap",), 0.0),
    "stiffness-nonlinearity": (transmission.nonlinear_stiffness, ("cubic", "soft_share", "growth"), 0.0),
    "hysteresis": (transmission.hysteresis, ("torque",), 0.0),
    "structural-damping": (transmission.structural, ("loss_factor",), 0.0),
    "stiffness-drift": (transmission.drift, ("rate",), 0.0),
    "transmission-error": (transmission.kinematic_error, ("amplitude",), 0.0),
    "torque-ripple": (drive.ripple, ("amplitude", "share"), 0.0),
    "drive-lag": (drive.lag, ("time_constant",), 0.0),
    "torque-gain": (drive.gain, ("gain",), 1.0),
    "gravity": (load.gravity, ("moment",), 0.0),
    "payload": (load.payload, ("inertia",), 0.0),
    "end-stop": (load.end_stop, ("stiffness",), 0.0),
    "link-flexibility": (modes.link, ("inertia", "share_of_1"), 0.0),
    "neighbour-flexibility": (modes.neighbour, ("modal_share",), 0.0),
    "base-compliance": (modes.mount, ("modal_share",), 0.0),
    "latent-law": (load.tabled, ("low",), math.nan),
    "external-vibration": (acquisition.vibration, ("amplitude",), 0.0),
    "delay": (acquisition.delay, ("delay",), 0.0),
    "clock-drift": (acquisition.clock_drift, ("ppm",), 0.0),
    "sensor-tilt": (acquisition.tilt, ("angle",), 0.0),
    "sensor-resonance": (acquisition.resonance, ("frequency",), None),
    "sensor-saturation": (acquisition.saturation, ("level",), None),
    "sensor-gain": (acquisition.sensitivity, ("gain",), 1.0),
    "torque-logging": (acquisition.torque_log, ("rate",), None),
}


@dataclass(frozen=True, eq=False)
class Augmented:
    """A rig with its effects.

    Attributes:
        spec: MJCF, with every effect that MJCF has an element for.
        description: Content of ``effects.json``: what each effect became, and the laws that replay adds.
    """

    spec: mujoco.MjSpec
    description: dict[str, Any]


def augment(model: Mapping[str, Any]) -> Augmented:
    """Write the effects of a diagnosis into the rig's MJCF.

    Args:
        model: Content of ``model.json`` (kind "diagnosis"): ``rig``, ``base``, ``effects``. An
            effect's ``runs`` gives the factor of its amplitude by run id (payload, drift per run).

    Raises:
        InputError: The model is of another kind, an effect is unknown, or it lacks a parameter.
    """
    if model.get("kind") != "diagnosis":
        raise InputError(
            "model.json",
            "kind",
            "must be 'diagnosis'; write one with jointscope diagnose",
            value=model.get("kind"),
        )
    base = model["base"]
    building = begin(model, base)
    for entry in model["effects"]:
        _write(building, entry)
    spec = building.finish()
    return Augmented(
        spec,
        {
            "format": FORMAT,
            "rig": {
                "topology": model["rig"]["topology"],
                "motion": model["rig"]["motion"],
                "plane": model["rig"].get("plane", "vertical"),
                "reduction_ratio": building.ratio,
            },
            "spring": building.spring_numbers(),
            "native": building.native,
            "laws": building.laws,
            "drive": drive_numbers(model, base),
            "torque_offset": float(base.get("torque_offset") or 0.0) / building.ratio,
        },
    )


def alone(model: Mapping[str, Any]) -> dict[str, Any]:
    """The same model without effects, at the parameters that fit best without them (``base_alone``, where it is known)."""
    return {**model, "base": model.get("base_alone") or model["base"], "effects": []}


def _write(building: Building, entry: Mapping[str, Any]) -> None:
    name, location, variant = entry["effect"], entry["location"], entry.get("variant", "")
    if name not in _EFFECTS:
        raise InputError("model.json", f"effects: {name}@{location}", "has no counterpart in MuJoCo")
    writer, amplitudes, null = _EFFECTS[name]
    parameters = {key: float(value) for key, value in entry["parameters"].items() if value is not None}
    if entry.get("range") is not None:  # of the variable that a law without a name depends on
        parameters["low"], parameters["high"] = (float(value) for value in entry["range"])
    sizes = [parameters[key] for key in amplitudes if key in parameters]
    if all(size == null or not math.isfinite(size) for size in sizes):
        if not sizes and null is not None:
            raise InputError("model.json", f"effects: {name}@{location}: {amplitudes[0]}", "is missing")
        return  # switched off
    before = len(building.laws)
    try:
        element = writer(
            building, "load" if building.single and location == "motor" else location, variant, parameters
        )
    except KeyError as missing:
        raise InputError("model.json", f"effects: {name}@{location}: {missing.args[0]}", "is missing") from None
    for law in building.laws[before:]:
        law["effect"] = f"{name}@{location}"
        if entry.get("runs") is not None:
            law["runs"] = {str(run): float(weight) for run, weight in entry["runs"].items()}
    if element:
        building.native.append({"effect": f"{name}@{location}", "law": variant, "element": element})


def drive_numbers(model: Mapping[str, Any], base: Mapping[str, float]) -> dict[str, float | None] | None:
    """The drive's speed law on the motor shaft and its share in a replayed torque; ``None`` where there is none."""
    gain = float(base.get("drive_gain") or 0.0)
    if gain <= 0.0:
        return None
    n = float(model["rig"].get("reduction_ratio") or 1.0)
    limit = float(base.get("drive_limit") or 0.0)
    single = model["rig"]["topology"] == "single-dof"
    total = base["load_inertia"] + (0.0 if single else base["motor_inertia"])
    return {
        "proportional": gain / n**2,
        "integral": float(base.get("drive_integral") or 0.0) / n**2,
        "acceleration_feedforward": float(base.get("drive_acceleration") or 0.0) / n**2,
        "velocity_feedforward": float(base.get("drive_velocity") or 0.0) / n**2,
        "torque_limit": limit / n if 0.0 < limit < math.inf else None,
        "share": max(
            min(1.0, total * 2.0 * math.pi * DRIFT_HZ / (abs(base["efficiency"]) * gain)),
            float(base.get("drive_trust") or 0.0),
        ),
    }
