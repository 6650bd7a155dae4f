"""What a law's numbers say in the contract's own terms, where it is one of the contract's forms in other words."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from jointscope.diagnosis.intervals import Estimate

if TYPE_CHECKING:
    from jointscope.diagnosis.effects import ActiveEffect, EffectSpec

Part = tuple["EffectSpec", "ActiveEffect", slice]

THIRD = 0.05  # from three, what a power may be off and its spring still be a cubic one


def as_cubic(effect: ActiveEffect, estimates: Sequence[Estimate], stiffness: float) -> tuple[Estimate, str] | None:
    """k_3 and its unit of a spring K Delta (1 + g |Delta/a|^2), whose growth may as well be that of a third power.

    Args:
        effect: A law with its fitted values.
        estimates: Of these values.
        stiffness: K [N m/rad] or [N/m].

    Returns:
        ``None`` for any other law, and for other powers.
    """
    if effect.spec.name != "stiffness-nonlinearity" or effect.spec.variant != "power":
        return None
    growth, exponent, reference = effect.values
    if abs(exponent - 3.0) > THIRD:
        return None
    per_growth = stiffness / reference**2
    known = estimates[0]
    unit = "N m/rad^3" if effect.spec.parameters[2].unit == "rad" else "N/m^3"
    return Estimate(growth * per_growth, known.low * per_growth, known.high * per_growth), unit


def largest_first(parts: Sequence[Part]) -> list[Part]:
    """Laws with their values, of several that measure one effect by one number the largest before the others.

    Two forms of a friction that share it between them are one friction in the contract, whose number the larger one has.
    """

    def measure(part: Part) -> tuple[str, str, str, str]:
        spec = part[0]
        amplitude = spec.parameters[spec.amplitude]
        return spec.name, str(spec.location), amplitude.name, amplitude.unit

    order = {key: k for k, key in reversed(list(enumerate(map(measure, parts))))}
    return sorted(parts, key=lambda part: (order[measure(part)], -abs(part[1].values[part[0].amplitude])))
