"""A trial read anew scores as if it were simulated again: exactly under its own noise, nearly under a coloured one."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from jointscope.diagnosis.base import refit_base, rewhiten
from jointscope.diagnosis.candidates import candidates_for
from jointscope.diagnosis.carried import carried
from jointscope.diagnosis.effects import catalogue
from jointscope.diagnosis.noise import MAX_ORDER
from jointscope.diagnosis.predict import predict_outputs
from jointscope.diagnosis.refit import with_fresh_jacobian
from jointscope.diagnosis.screen import screen, tangent
from jointscope.diagnosis.search import Effort, screen_on
from jointscope.diagnosis.split import split_runs

NOISE = 2e-3  # of each channel's rms
NAMES = ("coulomb-friction", "stiffness-nonlinearity", "delay", "sensor-gain", "hysteresis", "quadratic-damping")


@pytest.fixture
def screened(problem, recorded):
    own = recorded(problem, NOISE)
    with ThreadPoolExecutor(2) as pool:
        stage = refit_base(own, predict_outputs, split_runs(own).estimate, pool)
        fit = with_fresh_jacobian(stage.objective, stage.fit)
        candidates = candidates_for(own, [s for s in catalogue(own) if s.name in NAMES])
        yield stage, fit, screen_on(stage.objective, fit, candidates, Effort())


def directions(trials):
    return {(id(t.spec), t.active.values): t for t in trials}


def test_under_its_own_noise_a_trial_is_what_it_was(screened):
    _, fit, before = screened
    rows = before.objective
    few = tangent(before.w_few, fit.jacobian[: len(before.w_few)] * 0.0)
    again = carried(before.trials, rows, rows, few)
    assert len(again) == len(before.trials)
    for old, new in zip(before.trials, again, strict=True):
        assert new.active is old.active
        assert new.size == pytest.approx(old.size, rel=1e-4)
        assert float(old.direction @ new.direction) == pytest.approx(1.0, abs=1e-5)


def test_under_coloured_noise_it_is_what_a_simulation_says(screened):
    stage, fit, before = screened
    coloured, _, _ = rewhiten(stage.objective, fit, stage.noise, MAX_ORDER)
    there = with_fresh_jacobian(coloured, replace(fit, fresh=False))
    positions = [coloured.runs.index(run) for run in before.objective.runs]
    few, rows = coloured.restricted(positions), coloured.rows(positions)
    parents = tangent(there.w[rows], there.jacobian[rows])
    read = directions(carried(before.trials, before.objective, few, parents))
    simulated = directions(screen(few, there, parents, there.w[rows], [t.active for t in before.trials]))
    alike = [
        float(read[key].direction @ trial.direction)
        for key, trial in simulated.items()
        if key in read and trial.absorbed < 0.999  # of what the base reproduces only rounding is left
    ]
    assert len(alike) > 10
    assert np.median(alike) > 0.999
    assert min(alike) > 0.95
