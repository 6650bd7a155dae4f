"""A bend far from the joint's own resonance is fitted from where most is left; nothing is tried where the base is near."""

import numpy as np
import pytest

from jointscope.diagnosis.effects import ActiveEffect, catalogue
from jointscope.diagnosis.modes_apart import modes_apart
from jointscope.diagnosis.search import Effort

NAME = "link-flexibility"


def bend(problem, share, shape):
    """An arm in two bodies at 1.6 times the joint's frequency, hit and sensed at one place of it."""
    spec = next(s for s in catalogue(problem) if s.name == NAME and s.variant == "one-shape")
    inertia = problem.base.start[problem.base.names.index("load_inertia")]
    return ActiveEffect(spec, (1.6 * problem.scales.frequency, share * inertia, 0.02, shape))


@pytest.fixture
def tried(base_and_trials):
    def made(problem, effects):
        objective, base, left, candidates = base_and_trials(problem, effects)
        return base, modes_apart(objective, base, candidates, left, Effort())

    return made


@pytest.mark.parametrize("shape", [1.0, 1.5])
def test_the_bend_is_found(problem, recorded, tried, shape):
    effect = bend(problem, 0.14, shape)
    base, found = tried(recorded(problem, 2e-3, effects=(effect,)), (effect,))
    best = min((h for h in found if h.specs[0].name == NAME), key=lambda h: h.loss)
    assert best.fit.chi2 < 0.01 * base.chi2
    (law,) = best.fit.coordinates.unpack(best.fit.x)[1]
    assert law.values[0] == pytest.approx(effect.values[0], rel=0.01)
    assert len({id(h.specs[0]) for h in found}) == len(found)


def test_what_is_near_the_data_has_no_mode_tried(problem, recorded, tried):
    base, found = tried(recorded(problem, 2e-3), ())
    assert found == []
    assert np.isfinite(base.chi2)
