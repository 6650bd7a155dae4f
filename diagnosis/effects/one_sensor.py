"""A fault of one accelerometer among several: the others say what the machine did.

Every law of ``sensors`` that an accelerometer may have, once more for those at each radius alone. Its name is the law's and
the radius [m], ``mount-at-0.92``: places are told by where they are, not by the order of their channels.

Facts used as tests: what is read elsewhere stays as it was; the same fault at every radius is the fault of all.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from jointscope.diagnosis.assembly import SAME_RADIUS, Sensor
from jointscope.diagnosis.effects import sensors
from jointscope.diagnosis.effects.spec import Apply, EffectSpec, Values

if TYPE_CHECKING:
    from jointscope.diagnosis.assembly import Assembly
    from jointscope.diagnosis.problem import Output, Problem

AT = "-at-"
MOST = 4  # radii, beyond which no one's fault is looked for


def one_sensor_laws(problem: Problem) -> tuple[EffectSpec, ...]:
    """The laws of the accelerometers at each radius; none where all are at one."""
    radii = accelerometer_radii(o for run in problem.runs for o in run.outputs)
    if not 1 < len(radii) <= MOST:
        return ()
    return tuple(_at(spec, radius) for spec in _LAWS for radius in radii)


def named(name: str, variant: str) -> EffectSpec | None:
    """The law of that name as ``model.json`` holds it; ``None`` where it is none of one accelerometer."""
    law, at, radius = variant.partition(AT)
    found = next((spec for spec in _LAWS if at and (spec.name, spec.variant) == (name, law)), None)
    try:
        return None if found is None else _at(found, float(radius))
    except ValueError:  # no number: no law of this version
        return None


_LAWS = tuple(spec for spec in sensors.SPECS if spec.variant in sensors.PUT)


def accelerometer_radii(outputs: Iterable[Output]) -> list[float]:
    """Radii [m] of the arm's linear accelerometers among ``outputs``, in order."""
    found = {
        float(f"{o.radius:.4g}")
        for o in outputs
        if o.quantity == "linear-acceleration" and o.location != "motor" and o.radius is not None
    }
    return sorted(found)


def _at(spec: EffectSpec, radius: float) -> EffectSpec:
    put = sensors.PUT[spec.variant]

    def apply(assembly: Assembly, values: Values, weight: float) -> None:
        put(assembly.chain.sensors_at.setdefault(radius, Sensor()), values)

    applied: Apply = apply
    found = replace(
        spec,
        variant=f"{spec.variant}{AT}{radius:.4g}",
        law=f"{spec.law}, of the accelerometer at {radius:.4g} m",
        apply=applied,
    )
    if spec.name != "sensor-saturation":
        return found
    whole = spec.scale

    def levels(problem: Problem) -> tuple[float, float, float]:
        share = _peak(problem, radius) / max(problem.scales.acceleration, 1e-9)
        first, second, third = (share * level for level in whole(problem))
        return min(sensors.flat_tops(problem, radius), default=first), second, third

    return replace(found, scale=levels)


def _peak(problem: Problem, radius: float) -> float:
    """The largest reading [m/s^2] at a radius."""
    outputs = (o for run in problem.runs for o in run.outputs if o.data.size)
    near = (o for o in outputs if o.radius is not None and abs(o.radius - radius) < SAME_RADIUS)
    return max((float(np.nanmax(np.abs(o.data))) for o in near), default=1e-9)
