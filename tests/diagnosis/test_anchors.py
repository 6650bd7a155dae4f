"""Each partner of the strongest effect is tried beside that effect's next best laws, once each and from its numbers."""

from types import SimpleNamespace

import numpy as np
import pytest

from jointscope.diagnosis import anchors
from jointscope.diagnosis.effects import REGISTRY, ActiveEffect
from jointscope.diagnosis.search import Hypothesis


def law(name, variant):
    return next(s for s in REGISTRY if (s.name, s.variant) == (name, variant))


FIRST, SECOND, TUNED = (law("drive-lag", v) for v in ("first-order", "second-order", "magnitude-optimum"))
LOSS, GAIN = law("structural-damping", "relaxation"), law("torque-gain", "constant")
CANDIDATES = [ActiveEffect(s, tuple(p.lower for p in s.parameters)) for s in (FIRST, SECOND, TUNED, LOSS, GAIN)]


def fitted(loss, *specs, size=1e-3):
    """A hypothesis at ``loss`` whose effects have ``size`` for every value."""
    effects = tuple(ActiveEffect(s, (size,) * len(s.parameters)) for s in specs)
    where = SimpleNamespace(unpack=lambda x: (np.zeros(1), effects))
    return Hypothesis(specs, SimpleNamespace(coordinates=where, x=None, w=None), loss)


@pytest.fixture
def tried(monkeypatch):
    asked = []

    def fit(objective, base, actives, effort, bases, reach):
        assert reach == 5.0
        asked.append(tuple(actives))
        return SimpleNamespace(w=None)

    monkeypatch.setattr(anchors, "fit_child", fit)
    monkeypatch.setattr(anchors, "profile_loss", lambda objective, w: 0.0)
    monkeypatch.setattr(anchors, "within_reach", lambda objective, base, leader: 5.0)

    def run(*hypotheses):
        found = anchors.beside_other_laws(None, None, hypotheses, CANDIDATES, None)
        assert [h.specs for h in found] == [tuple(a.spec for a in actives) for actives in asked]
        return asked

    return run


def test_every_partner_beside_the_other_orders_of_the_lag(tried):
    asked = tried(
        fitted(-110.0, GAIN, SECOND, size=2e-3),
        fitted(-108.0, SECOND, LOSS, size=3e-3),
        fitted(-100.0, SECOND),
        fitted(-90.0, FIRST),
        fitted(-80.0, TUNED),
        fitted(-5.0, GAIN),
    )
    assert [tuple(a.spec for a in actives) for actives in asked] == [
        (GAIN, FIRST), (GAIN, TUNED), (LOSS, FIRST), (LOSS, TUNED),
    ]  # fmt: skip
    assert [actives[1].values[0] for actives in asked] == [2e-3, 2e-3, 3e-3, 3e-3]  # the lag as it was found there


def test_what_was_fitted_is_not_fitted_again(tried):
    asked = tried(
        fitted(-110.0, GAIN, SECOND), fitted(-109.0, FIRST, GAIN), fitted(-100.0, SECOND), fitted(-90.0, FIRST)
    )
    assert asked == []


def test_nothing_where_one_effect_leads_or_no_member_was_fitted_alone(tried):
    assert tried(fitted(-100.0, SECOND), fitted(-90.0, FIRST)) == []
    assert tried(fitted(-110.0, GAIN, SECOND), fitted(-90.0, LOSS)) == []
    assert tried() == []
