"""A law of an arm's catalogue: an effect at a place of a joint, by what it puts into the model of a run.

An effect's location carries its joint, ``transmission:elbow_joint``; the answer parts them again.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, cast

from jointscope.diagnosis.effects.spec import Apply, EffectSpec, Family, Location, ParameterSpec, Values, one_start

if TYPE_CHECKING:
    from jointscope.diagnosis.arm.predict import ArmAssembly

Put = Callable[["ArmAssembly", Values], None]
SEPARATOR = ":"


def split_location(location: str) -> tuple[str, str | None]:
    """``transmission:elbow_joint`` as place and joint."""
    place, _, joint = location.partition(SEPARATOR)
    return place, joint or None


def applied(put: Put) -> Apply:
    """``put`` as a law is applied: alike in every run."""

    def apply(assembly: object, values: Values, weight: float) -> None:
        put(cast("ArmAssembly", assembly), values)

    return apply


def arm_law(
    name: str,
    place: str,
    joint: str | None,
    variant: str,
    family: Family,
    parameters: tuple[ParameterSpec, ...],
    put: Put,
    law: str,
    scale: tuple[float, float, float],
    starts: tuple[Values, ...],
    revealed_by: tuple[str, ...],
    look_alikes: tuple[str, ...],
) -> EffectSpec:
    """The law ``name`` at ``place``, of ``joint`` or of none, started at every shape of ``starts`` and size of ``scale``."""
    location = place if joint is None else f"{place}{SEPARATOR}{joint}"
    return EffectSpec(
        name=name,
        location=cast("Location", location),
        variant=variant,
        family=family,
        parameters=parameters,
        law=law,
        revealed_by=revealed_by,
        look_alikes=look_alikes,
        apply=applied(put),
        scale=lambda problem: scale,
        starts=one_start if starts == ((),) else lambda problem: starts,
        possible=lambda problem: None,
    )
