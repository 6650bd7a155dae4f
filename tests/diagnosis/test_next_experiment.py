"""The proposal of a recording: separators of known look-alikes, symmetry, and silence where nothing is open."""

import pytest

from jointscope.diagnosis.effects import REGISTRY
from jointscope.diagnosis.next_experiment import MENU, next_experiment, separators

NAMES = sorted({f"{spec.name}@{spec.location}" for spec in REGISTRY})
PLAY, DRY = ("backlash@transmission",), ("coulomb-friction@motor",)


def test_any_two_candidates_are_separated_alike_from_either_side():
    for one in NAMES:
        for other in NAMES:
            assert separators(one, other) == separators(other, one)
            assert set(separators(one, other)) <= MENU.keys()
            assert (one == other) == (separators(one, other) == ())


@pytest.mark.parametrize(
    ("one", "other", "first"),
    [
        ("backlash@transmission", "coulomb-friction@motor", "levels"),
        ("backlash@transmission", "stiffness-nonlinearity@transmission", "preload"),
        ("delay@acquisition", "drive-lag@motor", "logging-rate"),
        ("gravity@load", "sensor-tilt@acquisition", "posture"),
        ("link-flexibility@load", "sensor-resonance@acquisition", "sensor-moved"),
        ("coulomb-friction@motor", "coulomb-friction@load", "brake"),
    ],
)
def test_known_look_alikes(one, other, first):
    assert separators(one, other)[0] == first


def test_nothing_is_proposed_where_nothing_is_open():
    assert next_experiment("none", [((), 0.6), (PLAY, 0.4)]) is None
    assert next_experiment("effects", [(PLAY, 0.97), (DRY, 0.03)]) is None
    assert next_experiment("unknown", []) is None


def test_the_likeliest_pair_decides_whatever_the_order():
    ranking = [(PLAY, 0.5), (DRY, 0.4), (("gravity@load",), 0.05)]
    told = next_experiment("unknown", ranking)
    assert told is not None and told.startswith(MENU["levels"])
    assert next_experiment("unknown", ranking[::-1]) == told


def test_what_both_sets_hold_is_not_asked_about():
    shared = ("delay@acquisition",)
    told = next_experiment("effects", [(PLAY + shared, 0.6), (DRY + shared, 0.4)])
    assert told is not None and "delay" not in told
