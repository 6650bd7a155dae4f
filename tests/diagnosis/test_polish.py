"""Refits under the common noise: no part of a set may be a worse fit than the base, which is a part of every set."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from jointscope.diagnosis.effects import ActiveEffect, catalogue
from jointscope.diagnosis.polish import beside_the_data, no_part_below_the_base, worth_judging
from jointscope.diagnosis.search import Hypothesis

NOISE = 2e-3  # of each channel's rms


def law(problem, name, variant):
    return next(s for s in catalogue(problem) if s.name == name and s.variant == variant)


@pytest.fixture
def sets(problem, recorded, fitted):
    """Base, a part and the set of a joint that softens and whose sensor resonates; ``part`` at given base parameters."""
    cubic, mount = law(problem, "stiffness-nonlinearity", "cubic"), law(problem, "sensor-resonance", "mount")
    bent, ringing = ActiveEffect(cubic, (3.0 * cubic.scale(problem)[1],)), ActiveEffect(mount, (120.0, 0.05))
    data = recorded(problem, NOISE, effects=(bent, ringing))
    objective, at = fitted(data, bent, ringing)
    theta = data.base.start

    def made(part_theta):
        return objective, [
            Hypothesis((), at(theta), 0.0),
            Hypothesis((mount,), at(part_theta, ringing), 0.0),
            Hypothesis((cubic, mount), at(theta, bent, ringing), 0.0),
        ]

    return theta, made


def test_a_part_in_a_valley_of_its_own_is_fitted_from_the_base(sets):
    theta, made = sets
    lost = theta.copy()
    lost[0] *= 0.5
    objective, (base, part, whole) = made(lost)
    assert part.fit.chi2 > base.fit.chi2 > whole.fit.chi2
    again = no_part_below_the_base(objective, [base, part, whole])
    assert again[0] is base and again[2] is whole
    assert again[1].specs == part.specs
    assert again[1].fit.chi2 < base.fit.chi2


def test_parts_that_explain_something_and_sets_without_a_larger_one_stay(sets):
    theta, made = sets
    objective, fits = made(theta)
    assert fits[1].fit.chi2 < fits[0].fit.chi2
    assert no_part_below_the_base(objective, fits) == fits
    lost = theta.copy()
    lost[0] *= 0.5
    objective, (base, part, _) = made(lost)
    assert no_part_below_the_base(objective, [base, part]) == [base, part]  # nothing stands over it


def standing_at(names, loss):
    return SimpleNamespace(names=names, loss=loss)


def test_what_is_far_behind_a_leader_beyond_doubt_is_not_judged_but_for_its_parts():
    base, leader = standing_at((), 1000.0), standing_at(("a@load", "b@motor"), 0.0)
    near, far = standing_at(("c@load",), 700.0), standing_at(("d@load",), 900.0)
    part = standing_at(("a@load",), 999.0)
    others = [standing_at(("e@load",), 300.0), standing_at(("f@load",), 400.0)]
    assert worth_judging([base, leader, near, far, part, *others]) == [base, leader, near, part, *others]


def test_where_nothing_leads_beyond_doubt_everything_is_judged():
    base, leader, far = standing_at((), 299.0), standing_at(("a@load",), 0.0), standing_at(("d@load",), 298.0)
    assert worth_judging([base, leader, far]) == [base, leader, far]
    assert worth_judging([base]) == [base]


def test_of_the_laws_of_one_set_those_far_behind_its_best_are_not_judged():
    base, leader = standing_at((), 20_000.0), standing_at(("a@load",), 0.0)
    form, wrong = standing_at(("a@load",), 1900.0), standing_at(("a@load",), 2100.0)
    other, its_form, its_wrong = (standing_at(("b@motor",), loss) for loss in (9000.0, 10_500.0, 11_500.0))
    judged = worth_judging([base, leader, form, wrong, other, its_form, its_wrong])
    assert judged == [base, leader, form, other, its_form]


def test_a_base_that_predicts_next_to_nothing_is_no_refit_of_one_that_is_near_the_data(sets):
    """Under scatter of the hits all of a ring may be a hit's gain; a refit that stays with the data is taken."""
    theta, made = sets
    objective, (base, _, _) = made(theta)
    heavy, near = theta.copy(), theta.copy()
    heavy[objective.problem.base.names.index("load_inertia")] *= 20.0
    heavy[objective.problem.base.names.index("stiffness")] *= 20.0
    near[0] *= 1.001
    where = base.fit.coordinates

    def at(values):
        return Hypothesis((), replace(base.fit, x=where.pack(values, ())), 0.0)

    kept = beside_the_data(objective, base, at(heavy))
    assert (kept.fit.x == base.fit.x).all() and kept.fit.fresh
    assert len(kept.fit.w) == kept.fit.jacobian.shape[0]
    assert beside_the_data(objective, base, at(near)).fit.x == pytest.approx(where.pack(near, ()))
