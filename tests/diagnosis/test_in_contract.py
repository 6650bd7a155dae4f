"""A power law of a third power is a cubic spring by its own numbers, and no other law is."""

import pytest

from jointscope.diagnosis.assembly import BASE_INDEX
from jointscope.diagnosis.effects import REGISTRY, ActiveEffect
from jointscope.diagnosis.in_contract import as_cubic, largest_first
from jointscope.diagnosis.intervals import Estimate

POWER = next(s for s in REGISTRY if (s.name, s.variant) == ("stiffness-nonlinearity", "power"))
KNOWN = (Estimate(0.5, 0.4, 0.6), Estimate(3.0, 2.9, 3.1), Estimate(1e-3, 1e-3, 1e-3))


def test_a_third_power_is_a_cubic_spring():
    """K Delta (1 + g (Delta/a)^2) = K Delta + k_3 Delta^3 with k_3 = K g/a^2."""
    estimate, unit = as_cubic(ActiveEffect(POWER, (0.5, 3.0, 1e-3)), KNOWN, 1e5)
    assert (estimate.value, estimate.low, estimate.high) == pytest.approx((5e10, 4e10, 6e10))
    assert unit == "N m/rad^3"
    assert BASE_INDEX["stiffness"] == 0  # theta's first is K


def test_other_powers_and_other_laws_are_none():
    assert as_cubic(ActiveEffect(POWER, (0.5, 2.6, 1e-3)), KNOWN, 1e5) is None
    cubic = next(s for s in REGISTRY if (s.name, s.variant) == ("stiffness-nonlinearity", "cubic"))
    assert as_cubic(ActiveEffect(cubic, (1e10,)), KNOWN[:1], 1e5) is None


def test_of_two_forms_of_one_effect_the_larger_one_says_its_size():
    """A friction of 25.8 N m with presliding and 0.2 N m without is one of 26, not of 0.2; other effects keep their places."""
    plain, sliding = (
        next(s for s in REGISTRY if (s.name, s.location, s.variant) == ("coulomb-friction", "motor", variant))
        for variant in ("plain", "presliding")
    )
    parts = [
        (plain, ActiveEffect(plain, (0.2,)), slice(0, 1)),
        (POWER, ActiveEffect(POWER, (0.5, 3.0, 1e-3)), slice(1, 4)),
        (sliding, ActiveEffect(sliding, (25.8, 6e-6)), slice(4, 6)),
    ]
    assert [part[0] for part in largest_first(parts)] == [sliding, plain, POWER]
    assert [part[0] for part in largest_first(parts[1:])] == [POWER, sliding]
    assert largest_first([]) == []
