"""A line's overtones are fitted where what is left repeats with one of them, and nowhere else."""

from types import SimpleNamespace

import pytest

from jointscope.diagnosis import overtones as module
from jointscope.diagnosis.effects import ActiveEffect, catalogue

RATIO = 80.0


def law(problem, variant):
    return next(s for s in catalogue(problem) if (s.name, s.variant) == ("transmission-error", variant))


def asked(monkeypatch, problem, active, left, stands=True):
    """The laws that the chosen set was grown by."""
    grown_by = []

    def grown(objective, base, leader, candidates, effort):
        grown_by.extend({c.spec.variant for c in candidates})
        return []

    monkeypatch.setattr(module, "grown", grown)
    rig = SimpleNamespace(reduction_ratio=RATIO)
    monkeypatch.setattr(module, "candidates_for", lambda _, laws: [SimpleNamespace(spec=s) for s in laws])
    judgement = SimpleNamespace(
        objective=SimpleNamespace(problem=SimpleNamespace(rig=rig)), base=SimpleNamespace(fit=None)
    )
    where = SimpleNamespace(unpack=lambda _: (None, (active,)))
    chosen = SimpleNamespace(fit=SimpleNamespace(coordinates=where, x=None), hypothesis=None)
    module.overtones(judgement, chosen, [SimpleNamespace(order=left, stands=stands)], catalogue(problem), None)
    return sorted(grown_by)


@pytest.mark.parametrize(("left", "found"), [(320.5, True), (481.0, True), (240.0, False), (160.0, False)])
def test_twice_and_three_times_a_line_s_order_are_its_overtones(monkeypatch, problem, left, found):
    active = ActiveEffect(law(problem, "motor-order"), (4e-4, 2.001, 0.4))
    laws = asked(monkeypatch, problem, active, left)
    orders = [f"{turn}-order{kind}-harmonic" for turn in ("motor", "output") for kind in ("", "-reacting")]
    assert laws == (orders if found else [])


def test_nothing_is_asked_of_what_chance_leaves_or_of_a_line_that_has_them(monkeypatch, problem):
    active = ActiveEffect(law(problem, "output-order"), (4e-4, 160.0, 0.4))
    assert asked(monkeypatch, problem, active, 320.0) != []
    assert asked(monkeypatch, problem, active, 320.0, stands=False) == []
    rich = ActiveEffect(law(problem, "output-order-harmonic"), (4e-4, 160.0, 0.4, 0.0, 0.0, 0.0, 0.0))
    assert asked(monkeypatch, problem, rich, 320.0) == []
    friction = next(s for s in catalogue(problem) if (s.name, s.variant) == ("coulomb-friction", "plain"))
    assert asked(monkeypatch, problem, ActiveEffect(friction, (1.0,)), 320.0) == []
