"""A line of the mains in a torque log is the recording's own; any other line that moves nothing was folded there."""

import math
from types import SimpleNamespace

import pytest

from jointscope.diagnosis.logged_hum import mains_line, without_logged_hum


def logging(variant, line):
    names = ("rate", "line", "age")
    spec = SimpleNamespace(
        name="torque-logging", variant=variant, parameters=[SimpleNamespace(name=name) for name in names]
    )
    return SimpleNamespace(spec=spec, values=(1000.0, line, 0.0))


@pytest.mark.parametrize(
    ("variant", "line", "hum"),
    [
        ("folded", 50.02, True),
        ("folded", 120.1, True),
        ("folded", 299.7, True),
        ("folded", 47.3, False),
        ("folded", 51.0, False),
        ("folded", 350.0, False),  # beyond the multiples that a cable picks up
        ("averaged", 50.0, False),
    ],
)
def test_only_a_line_at_a_multiple_of_the_mains_is_hum(variant, line, hum):
    assert (mains_line((logging(variant, line),)) is not None) is hum


def test_beside_another_effect_the_line_is_left_where_it_was_named():
    assert mains_line((logging("folded", 50.0), logging("averaged", math.nan))) is None
    assert mains_line(()) is None


@pytest.mark.parametrize("verdict", ["none", "unknown"])
def test_where_nothing_was_named_nothing_changes(verdict):
    diagnosis = SimpleNamespace(decision=SimpleNamespace(verdict=verdict))
    assert without_logged_hum(diagnosis) is diagnosis
