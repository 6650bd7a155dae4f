"""A line that only the torque log has: found, taken off, and told from what acts."""

from dataclasses import replace

import numpy as np
import pytest

from jointscope.diagnosis.acquisition import relogged
from jointscope.diagnosis.effects import ActiveEffect, catalogue
from jointscope.diagnosis.folded import folded_line, without_line
from jointscope.diagnosis.predict import predict_outputs
from jointscope.diagnosis.prepare import prepare
from jointscope.sim.effects.torque_log import unfolded

RATE, RIPPLE = 500.0, 412.0  # Hz; the ripple stands in the log at 88 Hz
LINE = RATE - RIPPLE


def sweep(seconds=4.0, rate=RATE, top=60.0):
    t = np.arange(int(seconds * rate)) / rate
    return t, np.hanning(t.size) * np.sin(2.0 * np.pi * top * t**2 / (2.0 * seconds))


def folded(amplitude=0.05, seconds=4.0, phase=0.4):
    t, clean = sweep(seconds)
    return clean, clean + amplitude * np.sin(2.0 * np.pi * RIPPLE * t + phase)


def test_a_ripple_above_half_the_rate_is_found_where_it_folds():
    logs = [(folded(phase=p, seconds=s)[1], RATE) for p, s in ((0.4, 4.0), (2.0, 3.0), (5.0, 4.0))]
    assert folded_line(logs) == pytest.approx(LINE, abs=0.02)


@pytest.mark.parametrize("top", [20.0, 60.0, 120.0])
def test_a_sweep_has_no_line(top):
    rng = np.random.default_rng(3)
    logs = [(sweep(top=top)[1] + 0.002 * rng.standard_normal(2000), RATE) for _ in range(3)]
    assert folded_line(logs) == 0.0


def test_a_line_of_one_log_among_many_is_none():
    logs = [(folded()[1], RATE), *((sweep()[1], RATE) for _ in range(3))]
    assert folded_line(logs) == 0.0


@pytest.mark.parametrize("take_off", [without_line, unfolded])
def test_what_drives_the_machine_stays(take_off):
    clean, logged = folded()
    left = take_off(logged, RATE, LINE) - clean
    assert np.sqrt(np.mean(left**2)) < 0.1 * np.sqrt(np.mean((logged - clean) ** 2))


def test_what_a_drive_holds_for_a_cycle_acts_half_of_it_later():
    t, clean = sweep(top=40.0)
    cycle = 1e-3
    late = np.interp(t - 0.5 * cycle, t, clean)
    there = relogged(clean, RATE, RATE, RATE, "folded", -0.5 * cycle)
    of_sim = unfolded(clean, RATE, LINE, -0.5 * cycle)
    inside = slice(100, -100)
    for restored in (there, of_sim):
        assert np.std((restored - late)[inside]) < 0.25 * np.std((clean - late)[inside])


@pytest.fixture(scope="module")
def struck(bench, edited):
    """The bench with a ripple folded down in its logs."""

    def rippled(channel):
        if channel.quantity != "torque":
            return channel
        t = np.arange(channel.samples.size) / RATE
        return replace(
            channel, samples=channel.samples + 0.1 * np.std(channel.samples) * np.sin(2.0 * np.pi * RIPPLE * t)
        )

    return prepare(replace(bench, runs=tuple(edited(run, rippled) for run in bench.runs)))


def test_the_law_is_there_only_where_the_logs_have_the_line(struck, problem):
    [law] = [s for s in catalogue(struck) if s.variant == "folded" and s.possible(struck) is None]
    assert law.starts(struck)[0][0] == pytest.approx(LINE, abs=0.1)
    assert not [s for s in catalogue(problem) if s.variant == "folded" and s.possible(problem) is None]


@pytest.mark.parametrize("acts", [False, True])
def test_a_line_that_acts_is_not_taken_off(struck, problem, acts):
    """What the arm did is foretold from the log as it stands where the ripple acts, and from the log without it elsewhere."""
    law = next(s for s in catalogue(struck) if s.variant == "folded" and s.possible(struck) is None)
    folds = ActiveEffect(law, (RATE, *law.starts(struck)[0]))
    theta = struck.base.start
    for logged, clean in zip(struck.runs, problem.runs, strict=True):
        if logged.motor is None or not logged.motor_moves:
            continue
        was = predict_outputs(logged if acts else clean, theta, (), struck if acts else problem)
        apart = [
            sum(float(np.sum(np.square((y - x) / np.std(x)))) for x, y in zip(was, found, strict=True))
            for found in (predict_outputs(logged, theta, effects, struck) for effects in ((), (folds,)))
        ]
        assert (apart[0] < 0.1 * apart[1]) if acts else (apart[1] < 0.1 * apart[0])
