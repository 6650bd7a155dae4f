"""Two effects of which either alone explains all, once refitted, are no pair; they are tried again."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from jointscope.sim.concealed import concealment, strength
from jointscope.sim.concealed.nearest import Refits
from jointscope.sim.concealed.strength import Strength

ANY = cast(Any, None)


def _pair(monkeypatch: pytest.MonkeyPatch, distances: list[float], target: float) -> tuple[int, float]:
    """How many twos are tried, and z_d of the one that is kept, when the tried ones leave ``distances``."""
    tried: list[float] = []

    def two(*_: object) -> tuple[object, ...]:
        tried.append(distances[len(tried)])
        return (len(tried),)

    monkeypatch.setattr(concealment, "_two", two)
    monkeypatch.setattr(
        concealment, "without_either", lambda *_: Strength(z=200.0, z_d=tried[-1], nearest="a@b", materiality=0.1)
    )
    _, measured = concealment._pair(ANY, ANY, ANY, target, np.random.default_rng(0))
    return len(tried), measured.z_d


def test_a_pair_that_shows_is_kept_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    assert _pair(monkeypatch, [20.0, 50.0, 50.0], 30.0) == (1, 20.0)


def test_a_pair_of_which_one_alone_explains_all_is_tried_again(monkeypatch: pytest.MonkeyPatch) -> None:
    assert _pair(monkeypatch, [0.5, 25.0, 30.0], 30.0) == (2, 25.0)


def test_where_none_shows_the_nearest_to_what_is_wanted_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    assert _pair(monkeypatch, [0.5, 3.0, 1.0], 30.0) == (3, 3.0)


@pytest.mark.parametrize(("refit", "left"), [(2.0, 2.0), (90.0, 40.0)])
def test_its_distance_is_what_the_better_of_the_two_leaves_when_it_is_refitted(
    monkeypatch: pytest.MonkeyPatch, refit: float, left: float
) -> None:
    """r = (30, 40): one effect explains the first coordinate, the other nothing, to first order."""
    directions = {"one": np.array([1.0, 0.0]), "other": np.array([0.0, 0.0])}
    monkeypatch.setattr(strength, "direction", lambda yard, effect: directions[effect.label])
    monkeypatch.setattr(strength, "look", lambda yard, effects: SimpleNamespace(record=None))
    monkeypatch.setattr(strength, "refitted_base", lambda yard, sight: np.array([30.0, 40.0]))
    monkeypatch.setattr(strength, "materiality", lambda *_: 0.1)
    monkeypatch.setattr(concealment, "nearest_refit", lambda *_: Refits("one", refit, 2))
    effects = cast(Any, [SimpleNamespace(label=label) for label in directions])
    measured = concealment.without_either(ANY, ANY, effects)
    assert measured.z == pytest.approx(50.0) and measured.z_d == pytest.approx(left)


def test_a_mount_is_not_put_under_a_neighbour() -> None:
    """Each is built as if it carried the arm alone: one upon the other never came to rest, at a frequency of neither."""
    labels = ["backlash@transmission", "base-compliance@base", "neighbour-flexibility@neighbour"]
    assert concealment._partners("base-compliance@base", labels) == ["backlash@transmission"]
    assert concealment._partners("neighbour-flexibility@neighbour", labels) == ["backlash@transmission"]
    assert concealment._partners("backlash@transmission", labels) == labels[1:]
