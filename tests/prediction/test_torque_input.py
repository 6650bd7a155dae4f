"""Torque read from what a drive records."""

import numpy as np
import pytest

from jointscope.errors import RefusedError
from jointscope.prediction.torque_input import torque_input
from jointscope.prediction.torque_log import Samples, TorqueLog, undistorted

RATE = 10_000.0


def phases(i_q, electrical):
    return [-i_q * np.sin(electrical - 2 * np.pi * k / 3) for k in range(3)]


def motion(n=20_000):
    t = np.arange(n) / RATE
    return t, 5 * 141.0 * (0.3 + np.sin(np.pi * np.clip(t - 0.2, 0, 1.5) / 1.5) ** 2)


def with_currents(bench, currents, rig=None):
    channels = [
        bench.channel("phase-current", "motor", "input", i, column=c)
        for i, c in zip(currents, "uvw", strict=False)
    ]
    return bench.run("speed-motion", bench.stream(RATE, *channels))


def test_three_phases_keep_the_sign_of_a_current_that_crosses_zero(bench, rng):
    t, angle = motion()
    i_q = 2.0 + 3.5 * np.sin(2 * np.pi * 3.0 * t) * np.exp(-t)
    i_q[:500] = 2.0
    currents = [i + 0.01 * rng.standard_normal(t.size) for i in phases(i_q, angle)]
    rig = bench.horizontal(torque_constant=0.458, pole_pairs=5)
    found = torque_input(bench.model(rig), with_currents(bench, currents), angle[0] / 5)
    assert np.max(np.abs(found.value(t) - 0.458 * i_q)) < 0.03
    assert found.note == ""


def test_two_phases_are_as_good_as_three(bench):
    t, angle = motion(4000)
    i_q = 1.0 + 0.2 * np.sin(60 * t)
    rig = bench.horizontal(torque_constant=0.458, pole_pairs=5)
    found = torque_input(bench.model(rig), with_currents(bench, phases(i_q, angle)[:2]), angle[0] / 5)
    assert found.value(t)[100:-100] == pytest.approx(0.458 * i_q[100:-100], abs=1e-3)


def test_one_phase_gives_the_envelope_and_says_so(bench):
    t = np.arange(20_000) / RATE
    i_q = -1.5
    rig = bench.horizontal(torque_constant=0.458, pole_pairs=5)
    run = with_currents(bench, [-i_q * np.sin(600 * t)])
    found = torque_input(bench.model(rig), run, 0.0)
    assert found.value(t)[2000:-2000] == pytest.approx(0.458 * 1.5, rel=0.01)
    assert "sign is lost" in found.note


def test_a_current_without_a_torque_constant_is_refused_by_name(bench):
    run = bench.run(
        "torque-sweep", bench.stream(1000.0, bench.channel("current", "motor", "input", np.ones(100), column="iq"))
    )
    with pytest.raises(RefusedError, match=r"'iq'.*torque_constant"):
        torque_input(bench.model(bench.horizontal()), run, 0.0)


def test_a_declared_input_that_is_not_in_the_file_is_refused_by_name(bench):
    run = bench.run("torque-sweep", bench.stream(1000.0, bench.channel("torque", "motor", "input", column="T")))
    with pytest.raises(RefusedError, match="'T' is declared but not in"):
        torque_input(bench.model(bench.horizontal()), run, 0.0)


def test_torque_on_the_output_side_is_divided_by_the_ratio(bench):
    channel = bench.channel("torque", "motor", "input", np.full(100, 141.0), side="output")
    found = torque_input(
        bench.model(bench.horizontal()), bench.run("torque-sweep", bench.stream(1e3, channel)), 0.0
    )
    assert found.value(np.array([0.05])) == pytest.approx(1.0)


def chirp(t):
    return np.sin(2 * np.pi * (4.0 * t + 0.5 * 25.0 * t**2)) * np.hanning(t.size)


def test_an_averaged_log_is_deconvolved():
    fine_rate, step = 50_000.0, 100
    t = np.arange(150_000) / fine_rate
    truth = chirp(t)
    sums = np.concatenate([[0.0], np.cumsum(0.5 * (truth[1:] + truth[:-1]))]) / step
    at = np.arange(step, t.size, step)
    log = Samples((sums[at] - sums[at - step]), 500.0, t[step])
    raw = np.max(np.abs(log.values - truth[at]))
    right = undistorted(log, TorqueLog(kind="average"))
    assert raw > 0.2
    assert np.max(np.abs(right.values - truth[at])) < 1e-3
    assert right.start == log.start


@pytest.mark.parametrize("file_rate", [1000.0, 2000.0, 1024.0])
def test_a_held_log_is_taken_back_to_its_updates(file_rate):
    t = np.arange(int(3 * file_rate)) / file_rate
    fine = np.arange(300_000) / 100_000.0
    truth = chirp(fine)
    updates = truth[:: int(100_000 / 500)]
    held = updates[np.minimum((t * 500.0 + 1e-9).astype(int), updates.size - 1)]
    right = undistorted(Samples(held, file_rate, 0.0), TorqueLog(kind="hold", rate=500.0))
    assert right.rate == 500.0
    assert abs(right.start) <= 0.5 / file_rate
    at = np.arange(right.values.size) / 500.0
    count = min(right.values.size, updates.size)
    assert right.values[:count] == pytest.approx(np.interp(at, fine, truth)[:count], abs=1e-9)


def test_instantaneous_samples_are_left_alone(rng):
    x = Samples(rng.standard_normal(100), 500.0, 0.0)
    assert undistorted(x, TorqueLog()) is x


def test_a_log_faster_than_its_file_is_refused():
    with pytest.raises(ValueError, match="can't be read"):
        undistorted(Samples(np.zeros(100), 250.0, 0.0), TorqueLog(kind="hold", rate=500.0))
