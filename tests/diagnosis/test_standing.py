"""Which hypotheses stand: over the best law of each part, and beyond what a search finds by chance."""

import math
from types import SimpleNamespace

import pytest

from jointscope.diagnosis import adjudicate

STANDS, FAILS = SimpleNamespace(gain=200.0, stands=True), SimpleNamespace(gain=0.0, stands=False)


@pytest.mark.parametrize(
    ("local", "gain", "held", "stays"),
    [
        (True, 100.0, 0.0, False),
        (True, 140.0, 0.0, True),
        (False, 40.0, 0.0, True),
        (True, 35.0, 140.0, True),
        (True, 25.0, 140.0, False),
        (True, 35.0, 100.0, False),
        (True, 100.0, math.nan, False),
    ],
)
def test_a_place_is_picked_out_of_a_travel(monkeypatch, local, gain, held, stays):
    """A stop may be sought anywhere: the best of all places gains more than one that was known, or all of it unseen."""
    spec = SimpleNamespace(name="end-stop", location="load", family="stiffness", local=local)
    child, base = SimpleNamespace(hypothesis=SimpleNamespace(specs=(spec,))), SimpleNamespace(names=())
    monkeypatch.setattr(adjudicate, "compare", lambda *_: SimpleNamespace(gain=gain, held_gain=held))
    assert adjudicate._beyond_the_search(None, child, [base]) is stays


@pytest.mark.parametrize(("over_best", "stands"), [(1.0, True), (0.0, False)])
def test_a_set_stands_over_the_best_law_of_each_part_and_not_over_every_law(monkeypatch, over_best, stands):
    """Beside an inferior law of its part it makes a small share; beside the best law it must stand."""
    base, inferior, best, pair = (
        SimpleNamespace(names=names, hypothesis=SimpleNamespace(specs=(), sensible=True))
        for names in ((), ("a@load",), ("a@load",), ("a@load", "b@motor"))
    )
    scores = {id(base): 0.0, id(inferior): 400.0, id(best): 600.0, id(pair): 800.0}
    over = {id(base): STANDS, id(inferior): FAILS, id(best): STANDS if over_best else FAILS}
    monkeypatch.setattr(adjudicate, "score", lambda _, j: scores[id(j)])
    monkeypatch.setattr(adjudicate, "compare", lambda _, part, child: over[id(part)] if child is pair else STANDS)
    monkeypatch.setattr(adjudicate, "_rings", lambda *_: False)
    monkeypatch.setattr(adjudicate, "_revealed", lambda *_: True)
    found = adjudicate.standing(SimpleNamespace(base=base, judged=(base, best, inferior, pair)))
    assert (pair in found) is stands
    assert best in found and inferior in found
