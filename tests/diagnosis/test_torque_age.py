"""When a logged torque acts: some microseconds beside its log's clock, which is no effect; longer times are."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from jointscope.diagnosis.acquisition import aged
from jointscope.diagnosis.base import refit_base
from jointscope.diagnosis.coordinates import coordinates
from jointscope.diagnosis.effects import catalogue
from jointscope.diagnosis.parameters import AGE
from jointscope.diagnosis.predict import predict_outputs
from jointscope.diagnosis.refit import unspent
from jointscope.diagnosis.screen import screen, tangent, trial_effects


def test_a_signal_made_late_by_a_part_of_a_step_is_off_by_the_third_order():
    """The parabola's error is s (1 - s^2) / 6 of the third difference, and halving the step divides it by eight."""

    def error(rate):
        t = np.arange(0.0, 0.2, 1.0 / rate)
        late = aged(np.sin(2.0 * np.pi * 80.0 * t), 2e-5 * rate)
        return np.max(np.abs(late - np.sin(2.0 * np.pi * 80.0 * (t - 2e-5)))[1:-1])

    rate, w = 1e4, 2.0 * np.pi * 80.0
    s = 2e-5 * rate
    assert error(rate) == pytest.approx(s * (1.0 - s * s) / 6.0 * (w / rate) ** 3, rel=0.02)
    assert error(rate) / error(0.5 * rate) == pytest.approx(
        0.25, rel=0.15
    )  # s goes with the rate: the square is left


def late(problem, age):
    """The problem's own predictions with its torque late by ``age`` [s], as its data."""
    theta = problem.theta(torque_age=age)
    runs = []
    for run in problem.runs:
        predicted = predict_outputs(run, theta, (), problem)
        outputs = tuple(
            o if o.observed else replace(o, data=y) for o, y in zip(run.outputs, predicted, strict=True)
        )
        runs.append(replace(run, outputs=outputs))
    return replace(problem, runs=tuple(runs))


def fitted(problem):
    with ThreadPoolExecutor(2) as pool:
        stage = refit_base(problem, predict_outputs, tuple(range(len(problem.runs))), pool)
        theta, _ = stage.fit.coordinates.unpack(stage.fit.x)
        return stage.fit, float(theta[problem.base.names.index("torque_age")])


def test_the_base_finds_a_time_of_some_microseconds(problem, recorded):
    """Recovered to a microsecond beside noise of 0.1 % of the signal; without one it finds none."""
    noisy = recorded(problem, 1e-3)
    assert fitted(noisy)[1] == pytest.approx(0.0, abs=1e-6)
    assert fitted(late(problem, 1.3e-5))[1] == pytest.approx(1.3e-5, abs=1e-6)


def test_what_is_longer_is_left_to_the_effects_that_are_times(problem):
    """At its bound the nuisance gives no more, so that a delay is seen whole; within it the two are one."""
    delay = next(s for s in catalogue(problem) if (s.name, s.variant) == ("drive-lag", "first-order"))
    absorbed = {}
    for age in (1e-5, 2e-4):
        moved = late(problem, age)
        with ThreadPoolExecutor(2) as pool:
            stage = refit_base(moved, predict_outputs, tuple(range(len(moved.runs))), pool)
            trials = trial_effects(delay, moved, (0,))
            parents = tangent(stage.fit.w, unspent(stage.fit))
            absorbed[age] = screen(stage.objective, stage.fit, parents, stage.fit.w, trials)[0].absorbed
        if age > AGE:
            theta, _ = stage.fit.coordinates.unpack(stage.fit.x)
            assert theta[moved.base.names.index("torque_age")] == AGE
    assert absorbed[1e-5] > 0.99 > 0.9 > absorbed[2e-4]


def test_an_effect_that_is_a_time_stands_for_it(problem):
    """Fitted together the two would share a delay between them: the nuisance stays at nothing, and its column is empty."""
    age = problem.base.names.index("torque_age")
    for spec in catalogue(problem):
        where = coordinates(problem, (spec,))
        column = int(np.flatnonzero(where.free == age)[0])
        assert (column in where.held) == (
            spec.name in ("delay", "drive-lag", "torque-logging") and spec.variant != "encoder"
        )
        if column in where.held:
            assert where.lower[column] == where.upper[column] == 0.0
