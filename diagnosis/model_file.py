"""``model.json`` of a diagnosis (``kind = "diagnosis"``): the base's parameters and the effects, enough to predict.

{ "format": "jointscope-model/1", "kind": "diagnosis",
  "rig": { nameplate },
  "base": { "stiffness": K [N m/rad], ... every base parameter, the drive's nuisance among them },
  "effects": [ { "effect": name, "location": ..., "variant": ..., "parameters": { name: value } } ] }
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.effects import REGISTRY, ActiveEffect
from jointscope.errors import RefusedError
from jointscope.recordings.campaign import Nameplate

FORMAT = "jointscope-model/1"
KIND = "diagnosis"

Vector = NDArray[np.float64]


def model_json(
    rig: Nameplate, names: tuple[str, ...], theta: Vector, effects: tuple[ActiveEffect, ...]
) -> dict[str, Any]:
    """The file's content as plain data."""
    return {
        "format": FORMAT,
        "kind": KIND,
        "rig": {key: value for key, value in asdict(rig).items() if value is not None},
        "base": {name: float(value) for name, value in zip(names, theta, strict=True)},
        "effects": [
            {
                "effect": effect.spec.name,
                "location": effect.spec.location,
                "variant": effect.spec.variant,
                "parameters": {
                    p.name: float(v) for p, v in zip(effect.spec.parameters, effect.values, strict=True)
                },
            }
            for effect in effects
        ],
    }


def read_model_json(
    model: Mapping[str, Any], names: tuple[str, ...]
) -> tuple[Nameplate, Vector, tuple[ActiveEffect, ...]]:
    """Nameplate, base parameters in the order of ``names`` and effects.

    Raises:
        RefusedError: Another kind of model, a base parameter is missing, or an effect is not in the catalogue.
    """
    if model.get("kind") != KIND:
        raise RefusedError(
            f"model.json: kind = {model.get('kind')!r}: must be {KIND!r}; write one with jointscope diagnose"
        )
    known = {entry.name for entry in fields(Nameplate)}
    rig = Nameplate(**{key: value for key, value in model["rig"].items() if key in known})
    base = model["base"]
    missing = [name for name in names if name not in base]
    if missing:
        raise RefusedError(f"model.json: base.{missing[0]} is missing; diagnose the campaign again")
    theta = np.array([float(base[name]) for name in names])
    return rig, theta, tuple(_effect(entry) for entry in model["effects"])


def _effect(entry: Mapping[str, Any]) -> ActiveEffect:
    for spec in REGISTRY:
        if (spec.name, spec.location, spec.variant) == (
            entry["effect"],
            entry["location"],
            entry.get("variant", ""),
        ):
            parameters = entry["parameters"]
            return ActiveEffect(spec, tuple(float(parameters[p.name]) for p in spec.parameters))
    raise RefusedError(
        f"model.json: effect {entry['effect']!r} at {entry['location']!r} (variant {entry.get('variant', '')!r}) is not "
        "in this version's catalogue; diagnose the campaign again"
    )
