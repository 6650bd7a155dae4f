"""Inexact starts: they go where the base fits, never far from where their stream puts them."""

from dataclasses import replace

import numpy as np
import pytest

from jointscope.diagnosis import alignment
from jointscope.diagnosis.alignment import WITHIN, aligned, moved, realigned

SPREAD = 1e-3


@pytest.fixture
def uncertain(problem):
    """The sweep's second device starts within a millisecond."""
    runs = []
    for run in problem.runs:
        streams = tuple(
            replace(s, start_uncertainty=SPREAD if len(run.run.streams) > 1 and k == 1 else 0.0)
            for k, s in enumerate(run.run.streams)
        )
        runs.append(replace(run, run=replace(run.run, streams=streams)))
    return replace(problem, runs=tuple(runs))


def offsets(problem):
    return [offset for run in problem.runs for offset in run.offsets.values()]


def test_a_start_that_is_right_stays(uncertain, truth):
    assert offsets(realigned(aligned(uncertain, truth), truth)) == pytest.approx([0.0], abs=3e-5)


def test_a_late_log_is_put_back(uncertain, truth):
    late = replace(uncertain, runs=tuple(replace(moved(r, 1, 8e-4), offsets={}) if len(r.run.streams) > 1 else r
                                         for r in uncertain.runs))  # fmt: skip
    assert offsets(realigned(aligned(late, truth), truth)) == pytest.approx([-8e-4], abs=4e-5)


def test_what_the_base_lacks_pulls_no_clock_past_its_uncertainty(uncertain, truth, monkeypatch):
    """An error that falls on and on with the offset: five rounds end within three standard deviations, by hook or crook."""
    pull = lambda run, device, offset, problem, theta: -1e6 * offset  # noqa: E731
    monkeypatch.setattr(alignment, "_cost", pull)
    problem = aligned(uncertain, truth)
    for _ in range(5):
        problem = realigned(problem, truth)
    assert offsets(problem) == pytest.approx([WITHIN * SPREAD], abs=2e-5)


def test_an_unlikely_start_costs_as_much_as_a_normal_one_would(uncertain):
    run = next(r for r in uncertain.runs if len(r.run.streams) > 1)
    cost = [alignment._unlikely(moved(run, 1, k * SPREAD), 1) for k in (0, 1, 2)]
    np.testing.assert_allclose(cost, [0.0, 0.5, 2.0])
    unknown = replace(run.run.streams[1], start_uncertainty=np.inf)
    free = replace(run, run=replace(run.run, streams=(run.run.streams[0], unknown)))
    assert alignment._unlikely(moved(free, 1, 0.1), 1) == 0.0
