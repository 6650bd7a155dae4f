"""The nearest pair that shares an effect with the leading one is tried in the other laws of what it has of its own."""

from dataclasses import dataclass
from types import SimpleNamespace

import pytest

from jointscope.diagnosis import rounds

CANDIDATES = [
    SimpleNamespace(spec=SimpleNamespace(name=name, location=place))
    for name, place in (("drive-lag", "motor"), ("delay", "acquisition"), ("clock-drift", "acquisition"))
]
LEADER = ("clock-drift@acquisition", "sensor-resonance@acquisition")
LAG = ("clock-drift@acquisition", "drive-lag@motor")


@dataclass(frozen=True)
class Arena:
    hypotheses: tuple
    base: SimpleNamespace
    objective: None = None


def fitted(names, loss):
    return SimpleNamespace(names=names, loss=loss)


def asked(monkeypatch, *hypotheses):
    """(pair, names of the laws) that are tried, and whether the arena was settled anew; the base lies 1000 nats behind."""
    seen = []

    def reshaped(objective, base, pair, candidates, known, effort):
        seen.append((pair.names, [rounds.name_of(c.spec) for c in candidates]))
        return ["another form"]

    monkeypatch.setattr(rounds, "reshaped", reshaped)
    monkeypatch.setattr(rounds, "settled", lambda arena, found, effort: ("anew", found))
    arena = Arena(hypotheses, SimpleNamespace(loss=1000.0, fit=None))
    return seen, rounds._rival_reshaped(arena, CANDIDATES, None) != arena


def test_a_look_alike_is_tried_in_its_own_laws_and_what_both_share_is_left(monkeypatch):
    seen, anew = asked(monkeypatch, fitted(LEADER, 0.0), fitted(LAG, 15.0))
    assert seen == [(LAG, ["drive-lag@motor"])]
    assert anew


@pytest.mark.parametrize(
    ("leader", "rival", "loss"),
    [
        (LEADER, LAG, 25.0),  # more than two per cent of what the leader gains
        (LEADER, ("backlash@transmission", "drive-lag@motor"), 15.0),  # nothing in common
        (LEADER, LEADER, 15.0),  # the leader's own names
        (LEADER, ("drive-lag@motor",), 15.0),  # a single effect
        (LEADER[:1], LAG, 15.0),  # which leads
    ],
)
def test_nothing_else_is(monkeypatch, leader, rival, loss):
    assert asked(monkeypatch, fitted(leader, 0.0), fitted(rival, loss)) == ([], False)
