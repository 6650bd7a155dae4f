"""A torque's gain and a weight beyond the stated one: the other is found in the place of the one that a search ended with."""

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from jointscope.diagnosis.coordinates import coordinates
from jointscope.diagnosis.effects import ActiveEffect, catalogue
from jointscope.diagnosis.gain_or_weight import GAIN, WEIGHT, gain_or_weight
from jointscope.diagnosis.noise import white
from jointscope.diagnosis.objective import Objective, whitened
from jointscope.diagnosis.predict import predict_outputs
from jointscope.diagnosis.refit import Fit
from jointscope.diagnosis.search import Hypothesis, name_of, profile_loss

MORE = 0.3  # of the stated weight, beside it


@pytest.fixture(scope="module")
def laws(problem):
    wanted = (GAIN, WEIGHT, "coulomb-friction@motor")
    found = {}
    for spec in catalogue(problem):
        if name_of(spec) in wanted and len(spec.parameters) == 1:
            found.setdefault(name_of(spec), spec)
    return found


@pytest.fixture(scope="module")
def stated(problem):
    return float(problem.theta()[problem.base.names.index("gravity_moment")])


@pytest.fixture(scope="module")
def heavier(problem, recorded, laws, stated):
    """A sweep of an arm that weighs more than is stated, with friction at its motor."""
    moved = replace(problem, runs=tuple(run for run in problem.runs if run.motor_moves))
    there = (
        ActiveEffect(laws[WEIGHT], (MORE * stated,)),
        ActiveEffect(laws["coulomb-friction@motor"], (3.0,)),
    )
    return recorded(moved, 1e-3, effects=there)


def hypothesis(objective, theta, effects):
    where = coordinates(objective.problem, tuple(e.spec for e in effects))
    x = where.pack(theta, effects)
    w = objective.residual(x, where)
    fit = Fit(where, x, w, np.zeros((w.size, where.n)), math.nan, False, False, 1)
    return Hypothesis(where.effects, fit, profile_loss(objective, w))


def objective_of(problem, pool):
    plain = Objective(problem, predict_outputs, tuple(range(len(problem.runs))), pool)
    return whitened(plain, white(plain.prepared), None)


def test_the_weight_is_found_where_the_gain_led(heavier, laws, stated):
    gain = 1.0 / (1.0 + MORE)
    trials = [ActiveEffect(law, law.scale(heavier)[:1]) for law in laws.values()]
    names = list(heavier.base.names)
    theta = heavier.base.start.copy()
    for name in ("stiffness", "damping", "load_inertia", "motor_damping", "load_damping"):
        theta[names.index(name)] *= gain
    wrong = (ActiveEffect(laws[GAIN], (gain,)), ActiveEffect(laws["coulomb-friction@motor"], (3.0 * gain,)))
    with ThreadPoolExecutor(2) as pool:
        objective = objective_of(heavier, pool)
        led = hypothesis(objective, theta, wrong)
        (found,) = gain_or_weight(objective, [led], trials)
        base = hypothesis(objective, heavier.base.start, ())
        assert gain_or_weight(objective, [base], trials) == []  # holds neither
        (back,) = gain_or_weight(objective, [found], trials)
    _, effects = found.fit.coordinates.unpack(found.fit.x)
    values = {name_of(e.spec): e.values[0] for e in effects}
    assert set(found.names) == {WEIGHT, "coulomb-friction@motor"}
    assert found.loss < led.loss
    assert values[WEIGHT] == pytest.approx(MORE * stated, rel=0.05)
    assert values["coulomb-friction@motor"] == pytest.approx(3.0, rel=0.05)
    _, again = back.fit.coordinates.unpack(back.fit.x)
    assert {name_of(e.spec): e.values[0] for e in again}[GAIN] == pytest.approx(gain, rel=0.1)


def test_without_a_stated_weight_there_is_nothing_to_swap(heavier, laws):
    names = list(heavier.base.names)
    start = heavier.base.start.copy()
    start[names.index("gravity_moment")] = 0.0
    level = replace(heavier, base=replace(heavier.base, start=start))
    trials = [ActiveEffect(law, law.scale(heavier)[:1]) for law in laws.values()]
    with ThreadPoolExecutor(2) as pool:
        objective = objective_of(level, pool)
        led = hypothesis(objective, start, (ActiveEffect(laws[GAIN], (0.8,)),))
        assert gain_or_weight(objective, [led], trials) == []


@pytest.mark.parametrize("beside", [-1.0, -1.5, 4.0])
def test_no_gain_makes_up_for_a_weight_that_is_none_or_turned_round_or_far_larger(heavier, laws, stated, beside):
    trials = [ActiveEffect(law, law.scale(heavier)[:1]) for law in laws.values()]
    with ThreadPoolExecutor(2) as pool:
        objective = objective_of(heavier, pool)
        led = hypothesis(objective, heavier.base.start, (ActiveEffect(laws[WEIGHT], (beside * stated,)),))
        assert gain_or_weight(objective, [led], trials) == []
