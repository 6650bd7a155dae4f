"""Hits on the brake say K, c and J whatever the moving motor does; a base that all runs have misled is told by them.

And without them by the stiffness that the campaign states; no other base is told anything.
"""

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from jointscope.diagnosis.base import refit_base
from jointscope.diagnosis.brake_first import braked_hits, of_the_brake
from jointscope.diagnosis.coordinates import coordinates
from jointscope.diagnosis.effects import catalogue
from jointscope.diagnosis.noise import white
from jointscope.diagnosis.objective import Objective, whitened
from jointscope.diagnosis.other_base import as_stated, from_other_base
from jointscope.diagnosis.predict import predict_outputs
from jointscope.diagnosis.prepare import prepare
from jointscope.diagnosis.refit import Fit
from jointscope.diagnosis.search import Effort, profile_loss

ORDER, AMPLITUDE, PHASE = 2.0, 6e-4, 0.4


def errs(plant):
    """The reducer's kinematic error, twice per motor turn, as torques on motor and arm."""

    def extra(t, x):
        torque = plant.K * AMPLITUDE * math.sin(ORDER * plant.n * x[0] + PHASE)
        return -torque, torque

    return extra


@pytest.fixture(scope="module")
def misled(builders, plant):
    """Three hits on the brake and two sweeps of a reducer with a kinematic error."""
    moving = replace(plant, extra=errs(plant))
    hits = [builders.hammer_run(plant, 100.0 + 80.0 * k, f"h{k}") for k in range(3)]
    sweeps = [builders.sweep_run(moving, a, f"s{a:g}", q0=-0.6) for a in (20.0, 40.0)]
    return prepare(builders.campaign_of([*hits, *sweeps]))


def objective_of(problem, pool):
    plain = Objective(problem, predict_outputs, tuple(range(len(problem.runs))), pool)
    noise = white(plain.prepared)
    return whitened(plain, noise, None), noise


def at(objective, theta):
    """The base as if it had been fitted there."""
    where = coordinates(objective.problem)
    x = where.pack(theta, ())
    w = objective.residual(x, where)
    return Fit(where, x, w, np.zeros((w.size, where.n)), math.nan, False, False, 1)


def test_a_base_that_is_lost_is_told_by_hits_on_the_brake(misled, plant):
    lost = misled.theta(stiffness=0.05 * plant.K, damping=5.0 * plant.c, load_inertia=1.3 * plant.J_L)
    with ThreadPoolExecutor(2) as pool:
        objective, _ = objective_of(misled, pool)
        found = of_the_brake(objective, at(objective, lost))
    told = dict(zip(misled.base.names, found, strict=True))
    assert told["stiffness"] == pytest.approx(plant.K, rel=2e-3)
    assert told["load_inertia"] == pytest.approx(plant.J_L, rel=2e-3)
    assert told["damping"] == pytest.approx(plant.c, rel=0.1)


def test_a_base_that_foretells_its_hits_is_left(misled, plant):
    near = misled.theta(stiffness=plant.K, damping=plant.c, load_inertia=plant.J_L, load_damping=2.0)
    with ThreadPoolExecutor(2) as pool:
        objective, _ = objective_of(misled, pool)
        assert of_the_brake(objective, at(objective, near)) is None


def test_without_hits_on_the_brake_or_without_a_motor_that_moves_nothing_is_told(misled, plant):
    with ThreadPoolExecutor(2) as pool:
        objective, _ = objective_of(misled, pool)
        hits = braked_hits(objective)
        assert [objective.prepared[i].run.id for i in hits] == ["h0", "h1", "h2"]
        moved = [i for i in range(len(misled.runs)) if i not in hits]
        assert braked_hits(objective.restricted(hits)) == []
        assert braked_hits(objective.restricted(moved)) == []
        assert braked_hits(objective.restricted([*hits[:2], *moved])) == []


def test_an_error_that_misleads_the_base_is_found_from_the_brake(misled, plant):
    lost = misled.theta(stiffness=0.05 * plant.K, damping=5.0 * plant.c, load_inertia=1.3 * plant.J_L)
    effort = Effort(beam=0, children=0, pairs=0, size=1)
    with ThreadPoolExecutor(2) as pool:
        stage = refit_base(misled, predict_outputs, tuple(range(len(misled.runs))), pool)
        objective, noise = objective_of(misled, pool)
        base = at(objective, lost)
        found = from_other_base(stage, objective, noise, base, catalogue(misled), effort)
        leading = sorted(found, key=lambda h: h.loss)[:2]
        assert leading[1].loss < profile_loss(objective, base.w)
    # Half a motor turn tells neither its order nor the error itself from a weight of unknown direction.
    best = next(h for h in leading if h.names == ("transmission-error@transmission",))
    theta, _ = best.fit.coordinates.unpack(best.fit.x)
    assert dict(zip(misled.base.names, theta, strict=True))["stiffness"] == pytest.approx(plant.K, rel=0.01)


def test_without_hits_a_base_that_is_lost_is_told_by_what_is_stated(misled, plant):
    stated = misled.rig.stiffness_reference
    with ThreadPoolExecutor(2) as pool:
        objective, _ = objective_of(misled, pool)
        for factor in (0.45, 2.2):
            found = as_stated(objective, at(objective, misled.theta(stiffness=factor * stated)))
            assert dict(zip(misled.base.names, found, strict=True))["stiffness"] == pytest.approx(stated)
        for factor in (0.55, 1.0, 1.9):  # a nameplate may be off by as much
            assert as_stated(objective, at(objective, misled.theta(stiffness=factor * stated))) is None


def test_laws_sought_from_the_stated_stiffness_keep_near_it(misled, plant):
    effort = Effort(beam=0, children=0, pairs=0, size=1)
    with ThreadPoolExecutor(2) as pool:
        stage = refit_base(misled, predict_outputs, tuple(range(len(misled.runs))), pool)
        whole, noise = objective_of(misled, pool)
        hits = braked_hits(whole)
        objective = whole.restricted([i for i in range(len(misled.runs)) if i not in hits])
        near, lost = (
            at(objective, misled.theta(stiffness=f * misled.rig.stiffness_reference)) for f in (1.3, 12.0)
        )
        assert from_other_base(stage, objective, noise, near, catalogue(misled), effort) == []
        found = from_other_base(stage, objective, noise, lost, catalogue(misled), effort)
    stiffness = [h.fit.coordinates.unpack(h.fit.x)[0][misled.base.names.index("stiffness")] for h in found]
    assert len(found) > 5
    assert np.median(stiffness) == pytest.approx(plant.K, rel=0.1)
