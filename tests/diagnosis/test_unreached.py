"""What no held-out run can show is judged by the fitted runs that show it, each by itself."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import pytest

from jointscope.diagnosis.adjudicate import compare, judge
from jointscope.diagnosis.base import refit_base
from jointscope.diagnosis.coordinates import coordinates
from jointscope.diagnosis.effects import ActiveEffect, catalogue
from jointscope.diagnosis.predict import predict_outputs
from jointscope.diagnosis.prepare import prepare
from jointscope.diagnosis.refit import least_squares
from jointscope.diagnosis.search import Hypothesis
from jointscope.diagnosis.split import split_runs


def judged(builders, recorded, sweeps, size, held_sweeps=0):
    """The case of friction at the motor of ``size`` [-] in sweeps, where hits with the brake on are held out."""
    plant = builders.Plant()
    hits = [builders.hammer_run(plant, 100.0 + 40.0 * k, f"h{k}") for k in range(4)]
    hits[1:3] = [replace(hit, role="validate") for hit in hits[1:3]]
    driven = [builders.sweep_run(plant, 40.0 + 5.0 * k, f"s{k}") for k in range(sweeps)]
    driven[:held_sweeps] = [replace(run, role="validate") for run in driven[:held_sweeps]]
    own = prepare(builders.campaign_of([*hits, *driven]))
    spec = next(s for s in catalogue(own) if (s.name, s.location) == ("coulomb-friction", "motor"))
    active = ActiveEffect(spec, (size * spec.scale(own)[1], *spec.starts(own)[0]))
    own = recorded(own, 0.1, seed=3, effects=(active,))
    split, where = split_runs(own), coordinates(own, (spec,))
    with ThreadPoolExecutor(1) as pool:
        stage = refit_base(own, predict_outputs, split.estimate, pool)
        fit = least_squares(stage.objective, where, where.pack(own.base.start, (active,)))
        judgement = judge(stage, [Hypothesis((spec,), fit, 0.5 * fit.chi2)], split.held_out)
    child = next(j for j in judgement.judged if j.names)
    return compare(judgement, judgement.base, child)


@pytest.mark.parametrize(("sweeps", "size", "stands"), [(3, 0.03, True), (1, 0.003, False), (3, 0.0, False)])
def test_what_only_fitted_runs_can_show_takes_two_of_them(builders, recorded, sweeps, size, stands):
    against = judged(builders, recorded, sweeps, size)
    assert against.foretold_held < 20.0
    assert against.stands is stands
    assert against.unreached is stands


def test_hits_that_cannot_show_friction_of_the_motor_have_no_vote(builders, recorded):
    """The base's parameters move a little with it, and what the hits lose or gain by that says nothing."""
    against = judged(builders, recorded, 4, 0.004, held_sweeps=1)
    assert against.foretold_held > 5.0
    assert against.votes == 1 and against.share_of_runs == 1.0  # of three held-out runs
