"""Scores of a run: clocks whose start is unknown, transients that don't count."""

from dataclasses import replace

import numpy as np
import pytest

from jointscope.prediction.base_model import predict_run
from jointscope.prediction.run_scores import score_run
from jointscope.recordings.bandlimited import bandlimited

T = np.arange(2048) / 1024.0


def recorded_late(bench, delay, uncertainty):
    """A sweep whose accelerometer's device stamps late by ``delay`` [s]."""
    torque = np.exp(-0.5 * ((T - 1.0) / 0.2) ** 2) * np.sin(2 * np.pi * 25.0 * T)
    inputs = bench.stream(1024.0, bench.channel("torque", "motor", "input", torque, column="T"))
    output = bench.channel("angular-acceleration", "arm", "output", np.zeros(T.size), column="a")
    run = bench.run("torque-sweep", inputs, bench.stream(1024.0, output, start_uncertainty=uncertainty))
    model = bench.model(bench.horizontal())
    values = predict_run(model, run).channels[0].values
    late = replace(output, samples=bandlimited(values, 1024.0)(T - delay))
    stream = replace(run.streams[1], channels=(late,))
    return predict_run(model, replace(run, streams=(inputs, stream)))


@pytest.mark.parametrize(("delay", "uncertainty"), [(0.0037, 0.005), (-0.0021, 0.005), (0.11, np.inf)])
def test_the_offset_of_an_uncertain_clock_is_a_nuisance(bench, delay, uncertainty):
    (score,) = score_run(recorded_late(bench, delay, uncertainty))
    assert score.clock_offset == pytest.approx(delay, abs=2e-5)
    assert score.error < 2e-3


def test_an_exact_clock_is_taken_at_its_word(bench):
    (score,) = score_run(recorded_late(bench, 0.0037, 0.0))
    assert score.clock_offset == 0.0
    assert score.error > 0.3


def test_the_start_of_a_run_that_began_in_motion_does_not_count(bench):
    prediction = recorded_late(bench, 0.0, 0.0)
    samples = prediction.channels[0].signal.samples.copy()
    samples[:300] += 50.0
    channel = replace(prediction.channels[0].signal.channel, samples=samples)
    signal = replace(prediction.channels[0].signal, channel=channel)
    spoiled = replace(prediction, channels=(replace(prediction.channels[0], signal=signal),))
    assert score_run(spoiled)[0].error > 0.5
    assert score_run(replace(spoiled, run=replace(spoiled.run, initial="estimate")))[0].error < 1e-6


def test_bands_below_the_legitimate_one_are_not_scored(bench):
    prediction = replace(recorded_late(bench, 0.0, 0.0), legitimate=(12.0, 512.0))
    (score,) = score_run(prediction)
    assert [band.low for band in score.bands] == [12.0, 12.0]
