"""How far physics outside the table leads what the table holds."""

from types import SimpleNamespace

import pytest

from jointscope.diagnosis.effects import STRANGERS
from jointscope.diagnosis.outside import FAR, far_ahead


def ranked(score, name):
    spec = next((s for s in STRANGERS if s.name == name), SimpleNamespace(name=name))
    judged = SimpleNamespace(names=(f"{name}@load",), hypothesis=SimpleNamespace(specs=(spec,)))
    return SimpleNamespace(score=score, judged=judged)


@pytest.mark.parametrize(
    ("verdict", "top", "listed", "far"),
    [
        ("unknown", 5000.0, 4000.0, True),
        ("unknown", 5000.0, 4850.0, False),  # by 3 % of its score, which another form of a listed law may have
        ("unknown", 300.0, 290.0 - FAR, True),
        ("unknown", 300.0, 310.0 - FAR, False),
        ("effects", 5000.0, 4000.0, False),
    ],
)
def test_it_must_lead_clearly_for_the_table_to_be_closed(verdict, top, listed, far):
    ranking = (ranked(top, STRANGERS[0].name), ranked(listed, "coulomb-friction"))
    assert far_ahead(SimpleNamespace(verdict=verdict, ranking=ranking)) is far


def test_another_stranger_behind_it_is_no_rival():
    ranking = tuple(ranked(score, spec.name) for score, spec in zip((5000.0, 4990.0), STRANGERS[:2], strict=True))
    assert far_ahead(SimpleNamespace(verdict="unknown", ranking=ranking))


def test_what_the_table_holds_is_sought_on():
    assert not far_ahead(
        SimpleNamespace(verdict="unknown", ranking=(ranked(5000.0, "backlash"), ranked(10.0, "gravity")))
    )
