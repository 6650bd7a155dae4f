"""Where a torque log's zero is: off by a little where it is calibrated, and then no weight."""

from dataclasses import replace

import numpy as np
import pytest

from jointscope.diagnosis.predict import predict_outputs
from jointscope.diagnosis.prepare import prepare


def test_the_zero_of_a_calibrated_log_is_off_by_a_little_at_most(bench, edited, problem, truth):
    """A constant on the log is the base's own torque offset; more than its bound of 3 % is no instrument's."""
    off = 0.01 * max(float(np.max(np.abs(run.motor.samples))) for run in problem.runs if run.motor is not None)

    def shift(c):
        return replace(c, samples=c.samples + off / problem.rig.reduction_ratio) if c.quantity == "torque" else c

    moved = prepare(replace(bench, runs=tuple(edited(run, shift) for run in bench.runs)))
    where = problem.base.names.index("torque_offset")
    theta = truth.copy()
    theta[where] = -off
    for shifted, sound in zip(moved.runs, problem.runs, strict=True):
        outputs = zip(
            shifted.outputs,
            predict_outputs(shifted, theta, (), moved),
            predict_outputs(sound, truth, (), problem),
            strict=True,
        )
        for output, y, expected in outputs:
            assert np.std((y - expected)[output.mask]) < 2e-3 * output.data[output.mask].std()
    largest = max(float(np.max(np.abs(run.motor_half))) for run in problem.runs if run.motor is not None)
    assert problem.base.upper[where] == pytest.approx(0.03 * largest, rel=0.01)
    assert problem.base.lower[where] == -problem.base.upper[where]


def test_a_weight_that_nobody_knows_takes_a_calibrated_zero_with_it(bench):
    """In one posture the two are one, and the zero is off by less."""
    blind = prepare(replace(bench, rig=replace(bench.rig, arm_mass=None)))
    free = dict(zip(blind.base.names, blind.base.free, strict=True))
    assert free["gravity_moment"] and not free["torque_offset"]
