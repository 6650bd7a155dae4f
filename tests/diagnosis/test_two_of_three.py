"""Of three effects that lead together, the two that are an answer by themselves are named, and no others."""

from dataclasses import dataclass
from types import SimpleNamespace

import pytest

from jointscope.diagnosis import two_of_three
from jointscope.diagnosis.verdict import Decision, Ranked

PAIR, THREE, OTHER = ("a@motor", "b@load"), ("a@motor", "b@load", "c@acquisition"), ("b@load", "d@base")


@dataclass(frozen=True)
class Judgement:
    judged: tuple


def said(names, verdict, score, candidates=()):
    judged = SimpleNamespace(names=names)
    reason = "outside-catalogue" if verdict == "unknown" else None
    ranking = (Ranked(names, 1.0, score, judged, None),)
    return Decision(verdict, judged, 1.0, ranking, reason, candidates, SimpleNamespace())


@pytest.mark.parametrize(
    ("whole", "within", "named"),
    [
        (said(THREE, "unknown", 1000.0), said(PAIR, "effects", 700.0), PAIR),
        (
            said(THREE, "unknown", 1000.0),
            said(PAIR, "effects", 600.0),
            None,
        ),  # the third adds two thirds of what they explain
        (said(THREE, "unknown", 1000.0), said(PAIR, "unknown", 700.0), None),  # they are no answer alone
        (
            said(THREE, "unknown", 1000.0),
            said(PAIR, "effects", 700.0, (PAIR, OTHER)),
            None,
        ),  # nor told from rivals
        (said(THREE, "unknown", 1000.0), said(OTHER, "effects", 700.0), None),  # another pair leads without three
        (said(THREE, "unknown", 1000.0), said(("a@motor",), "effects", 700.0), None),
        (said(PAIR, "unknown", 1000.0), said(PAIR, "effects", 1000.0), None),  # not three that lead
    ],
)
def test_two_are_named_where_they_hold_by_themselves(monkeypatch, whole, within, named):
    seen = []

    def decide(judgement):
        seen.append(judgement.judged)
        return whole if len(seen) == 1 else within

    monkeypatch.setattr(two_of_three, "decide", decide)
    monkeypatch.setattr(two_of_three, "resembled", lambda _: None)
    judged = tuple(SimpleNamespace(names=names) for names in ((), PAIR, THREE))
    found = two_of_three.answered(Judgement(judged))
    if named is None:
        assert found is whole
        return
    assert (found.verdict, found.chosen.names, found.unknown_reason) == ("effects", named, None)
    assert all(len(j.names) < 3 for j in seen[1])  # decided without sets of three ...
    assert [(r.names, r.probability) for r in found.ranking] == [
        (PAIR, 1.0),
        (THREE, 0.0),
    ]  # ... which stay listed
