"""``model.json`` of a diagnosis (``kind = "diagnosis"``): the base's parameters and the effects, enough to predict.

{ "format": "jointscope-model/1", "kind": "diagnosis",
  "rig": { nameplate },
  "base": { "stiffness": K [N m/rad], ... every base parameter, the drive's nuisance among them },
  "effects": [ { "effect": name, "location": ..., "variant": ..., "parameters": { name: value },
                 "runs": { run id: weight, for effects of some runs }, "range": [ends of an unnamed law's nodes] } ],
  "sensors": [ { "quantity", "location", "direction", "radius", "nth", "polarity": -1 if it counts the other way round,
                 "scale": of its record per SI where its unit is unknown,
                 "offset": what it reads at rest [SI], "weighs": false where its record refutes its weight } ] }
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.effects import (
    BENDS,
    DRIFT_PER_RUN,
    LATENT,
    PAYLOADS,
    REGISTRY,
    ActiveEffect,
    with_run_weights,
)
from jointscope.diagnosis.effects.latent import node_range
from jointscope.diagnosis.effects.one_sensor import named
from jointscope.diagnosis.run_preparation import gravity_at
from jointscope.errors import RefusedError
from jointscope.recordings.campaign import Nameplate, Run, Signal

if TYPE_CHECKING:
    from jointscope.diagnosis.prepare import Problem
    from jointscope.diagnosis.problem import Output

FORMAT = "jointscope-model/1"
KIND = "diagnosis"

Vector = NDArray[np.float64]


def model_json(problem: Problem, theta: Vector, effects: tuple[ActiveEffect, ...]) -> dict[str, Any]:
    """The file's content as plain data."""
    return {
        "format": FORMAT,
        "kind": KIND,
        "rig": {key: value for key, value in asdict(problem.rig).items() if value is not None},
        "base": {name: float(value) for name, value in zip(problem.base.names, theta, strict=True)},
        "effects": [_entry(effect, problem) for effect in effects],
        "sensors": _sensors(problem),
    }


def _sensors(problem: Problem) -> list[dict[str, Any]]:
    """Channels that count the other way round, don't read zero at rest (mean over the runs) or weigh nothing, each once."""
    seen: dict[tuple[Any, ...], tuple[dict[str, Any], Output, bool, list[float]]] = {}
    for run in problem.runs:
        signals = {(s.device, s.stream.channels.index(s.channel)): s for s in run.run.signals}
        for output in run.declared:
            signal = signals[output.channel]
            sensor = sensor_of(run.run, signal)
            weighs = output.gravity == gravity_at(signal.channel, problem.rig)
            found = seen.setdefault(tuple(sensor.values()), (sensor, output, weighs, []))
            found[-1].append(signal.channel.taken_off)
    return [
        {
            **sensor,
            "polarity": output.polarity,
            **({} if output.calibrated else {"scale": output.scale}),
            "offset": float(np.mean(levels)),
            "weighs": weighs,
        }
        for sensor, output, weighs, levels in seen.values()
        if output.polarity < 0.0 or any(levels) or not weighs or output.scale != 1.0
    ]


def sensor_of(run: Run, signal: Signal) -> dict[str, Any]:
    """What tells a sensor from the rig's others in any recording: quantity, place, direction, and which of those alike."""

    def place(other: Signal) -> dict[str, Any]:
        channel = other.channel
        return {key: getattr(channel, key) for key in ("quantity", "location", "direction", "radius")}

    alike = [(s.device, s.channel.column) for s in run.signals if place(s) == place(signal)]
    return {**place(signal), "nth": alike.index((signal.device, signal.channel.column))}


def _entry(effect: ActiveEffect, problem: Problem) -> dict[str, Any]:
    spec = effect.spec
    entry: dict[str, Any] = {
        "effect": spec.name,
        "location": spec.location,
        "variant": spec.variant,
        "parameters": {p.name: float(v) for p, v in zip(spec.parameters, effect.values, strict=True)},
    }
    if spec.run_weights is not None:
        entry["runs"] = {
            run.run.id: weight for run, weight in zip(problem.runs, spec.run_weights, strict=True) if weight
        }
    if spec.name == LATENT[0].name:
        entry["range"] = list(node_range(problem, spec.location, spec.variant))
    return entry


def read_model_json(
    model: Mapping[str, Any], problem: Problem
) -> tuple[Nameplate, Vector, tuple[ActiveEffect, ...]]:
    """Nameplate, base parameters in the order of ``problem.base.names`` and effects as they act in ``problem``.

    Raises:
        RefusedError: Another kind of model, a base parameter is missing, or an effect is not in the catalogue.
    """
    if model.get("kind") != KIND:
        raise RefusedError(
            f"model.json: kind = {model.get('kind')!r}: must be {KIND!r}; write one with jointscope diagnose"
        )
    known = {entry.name for entry in fields(Nameplate)}
    rig = Nameplate(**{key: value for key, value in model["rig"].items() if key in known})
    base = {"drive_trust": 0.0, **model["base"]}  # which files of earlier versions don't have
    missing = [name for name in problem.base.names if name not in base]
    if missing:
        raise RefusedError(f"model.json: base.{missing[0]} is missing; diagnose the campaign again")
    theta = np.array([float(base[name]) for name in problem.base.names])
    return rig, theta, tuple(_effect(entry, problem) for entry in model["effects"])


def _effect(entry: Mapping[str, Any], problem: Problem) -> ActiveEffect:
    name, location, variant = entry["effect"], entry["location"], entry.get("variant", "")
    own = named(name, variant)
    for spec in (*REGISTRY, *LATENT, *PAYLOADS, *BENDS, DRIFT_PER_RUN, *(() if own is None else (own,))):
        if (spec.name, spec.location, spec.variant) == (name, location, variant):
            stated = entry["parameters"]
            missing = [p.name for p in spec.parameters if p.name not in stated]
            if missing:
                raise RefusedError(
                    f"model.json: effect {name!r} at {location!r}: parameters.{missing[0]} is missing; "
                    "diagnose the campaign again"
                )
            values = tuple(float(stated[p.name]) for p in spec.parameters)
            if spec.name == LATENT[0].name:
                values = _on_these_nodes(values, entry["range"], node_range(problem, spec.location, spec.variant))
            if spec in (*PAYLOADS, DRIFT_PER_RUN):  # a run that the file does not name is as the base has it
                runs = entry.get("runs", {})
                weights = tuple(float(runs.get(run.run.id, 0.0)) for run in problem.runs)
                return ActiveEffect(with_run_weights(spec, weights, problem), values)
            return ActiveEffect(spec, values)
    raise RefusedError(
        f"model.json: effect {name!r} at {location!r} (variant {variant!r}) is not in this version's catalogue; "
        "diagnose the campaign again"
    )


def _on_these_nodes(
    values: tuple[float, ...], old: Sequence[float], new: tuple[float, float]
) -> tuple[float, ...]:
    """A table read at the nodes of another campaign's range; constant beyond its own."""
    nodes = np.linspace(new[0], new[1], len(values))
    table = np.interp(nodes, np.linspace(float(old[0]), float(old[1]), len(values)), values)
    return tuple(float(v) for v in table)
