"""The catalogue: every effect of the diagnosis contract at each of its locations, one small file per family.

``REGISTRY`` holds the specs as written; :func:`catalogue` fits their bounds and units to the rig at hand.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial, singledispatch
from typing import TYPE_CHECKING

from jointscope.diagnosis.effects import (
    bends,
    drive,
    elbow,
    friction,
    load,
    loaded,
    modes,
    one_sensor,
    periodic,
    play,
    postures,
    recorder,
    sensors,
    standstill,
    strangers,
    transmission,
    vibration,
)
from jointscope.diagnosis.effects.latent import LATENT
from jointscope.diagnosis.effects.load import PAYLOADS
from jointscope.diagnosis.effects.spec import ActiveEffect, EffectSpec, ParameterSpec
from jointscope.diagnosis.effects.transmission import DRIFT_PER_RUN

if TYPE_CHECKING:
    from jointscope.diagnosis.effects.spec import Values
    from jointscope.diagnosis.problem import Problem

__all__ = [
    "BENDS",
    "DRIFT_PER_RUN",
    "LATENT",
    "PAYLOADS",
    "REGISTRY",
    "STRANGERS",
    "ActiveEffect",
    "EffectSpec",
    "ParameterSpec",
    "at_rig",
    "catalogue",
    "payloads",
    "with_run_weights",
]

REGISTRY: tuple[EffectSpec, ...] = (
    *friction.COULOMB,
    *standstill.COULOMB,
    *friction.STRIBECK,
    *standstill.STRIBECK,
    *friction.LOAD_AND_DRAG,
    *loaded.SPECS,
    *play.SPECS,
    *transmission.SPECS,
    *periodic.SPECS,
    *drive.SPECS,
    *load.SPECS,
    *modes.SPECS,
    elbow.ELBOW,
    elbow.CANTILEVER,
    *postures.SPECS,
    *vibration.SPECS,
    *recorder.SPECS,
    *sensors.SPECS,
)

BENDS: tuple[EffectSpec, ...] = bends.SPECS

STRANGERS: tuple[EffectSpec, ...] = strangers.SPECS

_TRANSLATIONAL = (("kg m^2", "kg"), ("N m", "N"), ("rad", "m"))


@singledispatch
def catalogue(problem: Problem) -> tuple[EffectSpec, ...]:
    """``REGISTRY``, and the laws of each accelerometer of several, with the bounds and units of the rig at hand.

    An arm of several joints has a catalogue of its own (``arm.effects``).
    """
    return tuple(at_rig(spec, problem) for spec in (*REGISTRY, *one_sensor.one_sensor_laws(problem)))


@singledispatch
def payloads(problem: Problem) -> tuple[EffectSpec, ...]:
    """The laws of what some runs carry; an arm of several joints has its own."""
    return PAYLOADS


def with_run_weights(spec: EffectSpec, weights: tuple[float, ...], problem: Problem) -> EffectSpec:
    """One of ``PAYLOADS`` or ``DRIFT_PER_RUN`` for given runs: the amplitude's factor in each, in the order of problem.runs."""
    return replace(at_rig(spec, problem), run_weights=weights)


def at_rig(spec: EffectSpec, problem: Problem) -> EffectSpec:
    """The law with the bounds and units of the rig at hand, and what makes it this effect there."""
    limits = spec.limits(problem)
    sensible = spec.sensible if spec.sensible_at is None else partial(_sensible, spec, problem)
    parameters = []
    for parameter in spec.parameters:
        lower, upper = limits.get(parameter.name, (parameter.lower, parameter.upper))
        unit = parameter.unit
        if problem.rig.motion == "translational":
            for rotational, translational in _TRANSLATIONAL:
                unit = unit.replace(rotational, translational)
        parameters.append(replace(parameter, lower=lower, upper=upper, unit=unit))
    return replace(spec, parameters=tuple(parameters), sensible=sensible, sensible_at=None)


def _sensible(spec: EffectSpec, problem: Problem, values: Values) -> bool:
    return spec.sensible(values) and (spec.sensible_at is None or spec.sensible_at(problem, values))
