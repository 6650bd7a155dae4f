"""A base that ran away is held where it was expected while effects are sought, and let go beside them."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import pytest

from jointscope.diagnosis.base import refit_base
from jointscope.diagnosis.predict import predict_outputs
from jointscope.diagnosis.prepare import prepare
from jointscope.diagnosis.search import Hypothesis
from jointscope.diagnosis.tethered import beside, run_away, tethered


@pytest.fixture(scope="module")
def stage(builders, recorded):
    """Two hits and two sweeps of one joint, started at 1.15 times its stiffness and fitted."""
    plant = builders.Plant()
    hits = [builders.hammer_run(plant, 100.0 + 20.0 * k, f"h{k}") for k in range(2)]
    sweeps = [builders.sweep_run(plant, 40.0 + 5.0 * k, f"s{k}") for k in range(2)]
    own = recorded(prepare(builders.campaign_of([*hits, *sweeps])), 0.01, seed=3)
    k = own.base.names.index("stiffness")
    start = own.base.start.copy()
    start[k] *= 1.15
    own = replace(own, base=replace(own.base, start=start))
    with ThreadPoolExecutor(1) as pool:
        yield refit_base(own, predict_outputs, (0, 1, 2, 3), pool), k


def wandered(stage, k, factor):
    """The stage with the stiffness at ``factor`` times its start."""
    where = stage.fit.coordinates
    theta, _ = where.unpack(stage.fit.x)
    theta[k] = factor * stage.objective.problem.base.start[k]
    return replace(stage, fit=replace(stage.fit, x=where.pack(theta, ())))


@pytest.mark.parametrize(("factor", "away"), [(1.0, False), (2.5, False), (4.0, True), (0.2, True)])
def test_a_base_has_run_away_beyond_three_times_its_start(stage, factor, away):
    fitted, k = stage
    assert run_away(wandered(fitted, k, factor)) == ((k,) if away else ())


def test_what_ran_away_is_held_at_its_start_and_the_rest_is_fitted(stage):
    fitted, k = stage
    held = tethered(wandered(fitted, k, 20.0), (k,))
    theta, _ = held.fit.coordinates.unpack(held.fit.x)
    start = held.objective.problem.base.start
    assert theta[k] == pytest.approx(start[k])
    assert held.fit.chi2 < 0.5 * float(
        sum(w @ w for w in [held.objective.residual(held.fit.coordinates.pack(start, ()), held.fit.coordinates)])
    )


def test_let_go_it_comes_to_the_very_optimum(stage):
    """To a thousandth of the stiffness, from a start 15 % off."""
    fitted, k = stage
    held = tethered(wandered(fitted, k, 20.0), (k,))
    found = beside(fitted.objective, [], [Hypothesis((), held.fit, 0.0)])
    theta, _ = found[0].fit.coordinates.unpack(found[0].fit.x)
    best, _ = fitted.fit.coordinates.unpack(fitted.fit.x)
    assert theta[k] == pytest.approx(best[k], rel=1e-3)
