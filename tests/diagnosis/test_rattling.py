"""When play is looked for by the first periods after each hit."""

from types import SimpleNamespace

import pytest

from jointscope.diagnosis import rattling
from jointscope.diagnosis.rattling import PLAY, may_rattle

SOFT = "stiffness-nonlinearity@transmission"


def arena(lead, play):
    """A search in which a soft spring gains ``lead`` nats over the base, and play alone ``play``."""
    found = [SimpleNamespace(names=(SOFT,), loss=-lead), SimpleNamespace(names=(PLAY,), loss=-play)]
    return SimpleNamespace(base=SimpleNamespace(loss=0.0), hypotheses=sorted(found, key=lambda h: h.loss))


@pytest.mark.parametrize(
    ("lead", "play", "left", "asked"),
    [
        (1000.0, 300.0, 0.1, True),  # some of what the leader has
        (24000.0, 3000.0, 0.7, True),  # little of it, but the leader leaves most of the hits
        (24000.0, 3000.0, 0.2, False),
        (24000.0, 40.0, 0.7, False),  # next to nothing
    ],
)
def test_play_is_asked_for_where_it_has_some_or_where_the_leader_has_not_the_hits(
    monkeypatch, lead, play, left, asked
):
    monkeypatch.setattr(rattling, "left_of_hits", lambda arena, best: left)
    assert may_rattle(arena(lead, play)) is asked
