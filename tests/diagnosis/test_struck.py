"""A mode that motions ask for and hits don't show is none."""

from types import SimpleNamespace

import numpy as np
import pytest

from jointscope.diagnosis.struck import ENOUGH, SHOWN, modes, unheard


def runs(hits, others):
    kinds = ["hammer"] * hits + ["speed-motion"] * others
    return [SimpleNamespace(run=SimpleNamespace(experiment=kind)) for kind in kinds]


@pytest.mark.parametrize(
    ("hits", "others", "of_hits", "silent"),
    [
        (8, 4, 0.0, True),
        (8, 4, SHOWN + 1.0, False),
        (ENOUGH - 1, 4, 0.0, False),
        (8, 0, 0.0, False),
        (0, 4, 0.0, False),
    ],
)
def test_hits_decide_where_there_are_enough_and_others_beside_them(hits, others, of_hits, silent):
    gains = np.array([of_hits / max(hits, 1)] * hits + [100.0] * others)
    assert unheard(runs(hits, others), gains) is silent


def test_only_modes_that_a_hammer_shows_are_asked():
    specs = [
        SimpleNamespace(name="link-flexibility", location="load", family="mode", revealed_by=("hammer",)),
        SimpleNamespace(name="coulomb-friction", location="motor", family="dissipative", revealed_by=("hammer",)),
        SimpleNamespace(name="other", location="base", family="mode", revealed_by=("speed-motion",)),
    ]
    assert modes(SimpleNamespace(specs=specs)) == {"link-flexibility@load"}
