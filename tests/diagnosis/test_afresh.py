"""An arm that runs into a stop, where the base that is the least wrong of all hardly moves."""

from dataclasses import replace

import pytest

from jointscope.diagnosis.afresh import afresh
from jointscope.diagnosis.assembly import BASE_INDEX
from jointscope.diagnosis.base import EARLY_ORDER, rewhiten
from jointscope.diagnosis.candidates import candidates_for
from jointscope.diagnosis.effects import ActiveEffect, catalogue
from jointscope.diagnosis.noise import white
from jointscope.diagnosis.refit import with_fresh_jacobian
from jointscope.diagnosis.search import Effort


def beside_a_lost_base(recorded_problem, fitted, effects, heavier):
    """The objective, and a base ``heavier`` times as heavy as the arm, under the noise that it leaves."""
    objective, at = fitted(recorded_problem, *effects)
    theta = recorded_problem.base.start.copy()
    theta[BASE_INDEX["load_inertia"]] *= heavier
    objective, _, _ = rewhiten(objective, at(theta), white(recorded_problem.runs), EARLY_ORDER)
    return objective, with_fresh_jacobian(objective, replace(at(theta), fresh=False))


@pytest.fixture
def stop(problem):
    """A stop where the hits reach to, a third as stiff as the joint."""
    spec = next(s for s in catalogue(problem) if s.name == "end-stop" and s.variant == "upper")
    s = problem.scales
    angle = s.held_high - 0.2 * (s.held_high - s.held_low)
    return ActiveEffect(spec, (angle, 0.33 * float(problem.base.start[BASE_INDEX["stiffness"]]), 0.3 / s.speed))


def test_a_stop_is_found_where_the_base_is_lost(problem, recorded, fitted, stop):
    data = recorded(problem, 0.01, effects=(stop,))
    objective, base = beside_a_lost_base(data, fitted, (stop,), 40.0)
    found = afresh(objective, base, candidates_for(data, (stop.spec,)), Effort())
    (hypothesis,) = found
    theta, (active,) = hypothesis.fit.coordinates.unpack(hypothesis.fit.x)
    assert hypothesis.fit.chi2 < 0.1 * base.chi2
    assert active.values[1] == pytest.approx(stop.values[1], rel=0.1)
    place = BASE_INDEX["load_inertia"]
    assert theta[place] == pytest.approx(problem.base.start[place], rel=0.02)


def test_nothing_is_tried_where_the_base_is_near(problem, recorded, fitted, stop):
    data = recorded(problem, 0.01)
    objective, base = beside_a_lost_base(data, fitted, (), 1.0)
    assert afresh(objective, base, candidates_for(data, (stop.spec,)), Effort()) == []
