"""A stiffness that varies with the arm's angle is read off the runs' own stiffnesses, and only where postures tell."""

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import pytest

from jointscope.diagnosis.base import refit_base
from jointscope.diagnosis.by_posture import by_posture
from jointscope.diagnosis.effects import STRANGERS, at_rig
from jointscope.diagnosis.predict import predict_outputs
from jointscope.diagnosis.prepare import prepare

NOISE = 0.01  # of each channel's rms
SHARE, ORDER, PHASE = 0.03, 3.0, 0.8


@pytest.fixture
def met(builders, plant):
    """The maker of a campaign of one hit per posture, its stiffness K (1 + s sin(3 q + phase))."""

    def make(angles, share):
        runs = []
        for k, angle in enumerate(angles):
            own = plant.K * (1.0 + share * math.sin(ORDER * angle + PHASE))
            there = replace(plant, weight=1e-9, K=own)
            runs.append(replace(builders.hammer_run(there, 100.0, f"h{k}", duration=0.5), arm_angle=angle))
        return prepare(builders.campaign_of(runs, replace(builders.NAMEPLATE, plane="horizontal")))

    return make


def found(problem):
    with ThreadPoolExecutor(2) as pool:
        stage = refit_base(problem, predict_outputs, tuple(range(len(problem.runs))), pool)
        return by_posture(stage, [at_rig(spec, problem) for spec in STRANGERS])


def test_share_order_and_phase_are_those_of_the_runs_own_stiffness(met):
    best, *_ = found(met((-1.2, -0.7, -0.1, 0.4, 0.9, 1.5), SHARE))
    share, order, phase = best.values
    assert best.spec.variant == "output-order"
    assert order == ORDER
    assert share == pytest.approx(SHARE, rel=0.1)
    assert phase == pytest.approx(PHASE, abs=0.1)


def test_a_stiffness_that_does_not_vary_asks_for_next_to_nothing(met):
    assert all(trial.values[0] < 1e-3 for trial in found(met((-1.2, -0.7, -0.1, 0.4, 0.9, 1.5), 0.0)))


def test_three_postures_tell_nothing_of_a_line(met):
    assert found(met((-0.7, 0.0, 0.9, -0.7, 0.0, 0.9), SHARE)) == []
