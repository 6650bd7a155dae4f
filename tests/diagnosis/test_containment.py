"""A law that contains another and says the same is left open, whatever its further numbers cost."""

from types import SimpleNamespace

import pytest

from jointscope.diagnosis import containment, verdict
from jointscope.diagnosis.adequacy import Adequacy
from jointscope.diagnosis.containment import holds, left_open, unowned


def named(name, *, occam=0.0, sensible=True):
    """As much of a judged set as telling two laws apart looks at."""
    spec = SimpleNamespace(name=name.partition("@")[0], location=name.partition("@")[2], variant="plain")
    return SimpleNamespace(
        names=(name,), hypothesis=SimpleNamespace(specs=(spec,), sensible=sensible), occam=occam, occam_held=0.0,
        chi2=0.0, left_held=(), fit=SimpleNamespace(x=None, coordinates=SimpleNamespace(unpack=lambda x: (None, ()))),
    )  # fmt: skip


def against(behind):
    """The wider law's case: ten nats for two numbers, and what it is behind by, half of it in held-out runs."""
    return SimpleNamespace(gain=-10.0 - 0.5 * behind, held_gain=-0.5 * behind)


@pytest.mark.parametrize(
    ("behind", "sensible", "open_"), [(2.0, True, True), (20.0, True, False), (2.0, False, False)]
)
def test_of_two_laws_that_say_the_same_the_simpler_is_named_and_not_sworn_to(monkeypatch, behind, sensible, open_):
    inner = named("coulomb-friction@load", occam=5.0)
    outer = named("stribeck-friction@load", occam=15.0, sensible=sensible)
    base = SimpleNamespace(names=())
    judgement = SimpleNamespace(judged=(base, inner, outer), base=base, noise=SimpleNamespace(blocks={}))
    for module in (containment, verdict):
        monkeypatch.setattr(module, "compare", lambda *_: against(behind))
    assert left_open(judgement, inner, outer.names) is open_
    scores = {inner.names: 4000.0, outer.names: 3975.0}
    monkeypatch.setattr(verdict, "standing", lambda judgement: [inner])
    monkeypatch.setattr(verdict, "score", lambda judgement, j: scores[j.names])
    monkeypatch.setattr(verdict, "distance", lambda *_: 100.0)
    monkeypatch.setattr(verdict, "adequacy_of", lambda *_: Adequacy((), 1.0, 0.0, 0.0))
    decision = verdict.decide(judgement)
    assert decision.verdict == "effects" and decision.chosen is inner
    assert (decision.probability < 0.9) is open_
    assert decision.probability > 0.5


@pytest.mark.parametrize(
    ("outer", "inner", "is_one"),
    [
        ("stribeck-friction@load", "coulomb-friction@load", True),
        ("coulomb-friction@load", "stribeck-friction@load", False),
        ("stribeck-friction@motor", "coulomb-friction@load", False),
        ("neighbour-flexibility@neighbour", "base-compliance@base", False),
    ],
)
def test_the_inner_law_is_the_outer_one_at_the_edge_of_its_range_at_the_same_place(outer, inner, is_one):
    assert holds(named(outer), named(inner)) is is_one


def hit_at(*postures, experiment="hammer"):
    runs = tuple(
        SimpleNamespace(initial_angle=q, spring=True, run=SimpleNamespace(experiment=experiment)) for q in postures
    )
    return SimpleNamespace(objective=SimpleNamespace(problem=SimpleNamespace(runs=runs)))


@pytest.mark.parametrize(
    ("judgement", "behind", "open_"),
    [
        (hit_at(0.0, 0.0), 1.0, True),
        (hit_at(0.0, 0.0), 20.0, False),  # the neighbour fits worse
        (hit_at(0.0, 0.7), 1.0, False),  # two postures tell
        (hit_at(0.0, 0.0, experiment="torque-sweep"), 1.0, False),  # a mount feels what drives the motor
    ],
)
def test_whose_a_mode_is_hits_in_one_posture_cannot_say(monkeypatch, judgement, behind, open_):
    mount = named("base-compliance@base", occam=5.0)
    neighbour = named("neighbour-flexibility@neighbour", occam=15.0)
    monkeypatch.setattr(containment, "compare", lambda *_: against(behind))
    assert unowned(judgement, mount, neighbour) is open_
    assert not unowned(judgement, neighbour, mount)
