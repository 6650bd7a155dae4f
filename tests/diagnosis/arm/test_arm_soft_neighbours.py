"""Every brake's reducer as a spring: what that is on the arm as its file has it."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
import planar  # type: ignore[import-not-found]

from jointscope.diagnosis.arm.predict import predict_outputs
from jointscope.diagnosis.arm.prepare import prepare_arm, softened
from jointscope.diagnosis.arm.soft_neighbours import spring

HOLD = {"a": "brake", "b": "brake"}


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    folder = tmp_path_factory.mktemp("soft")
    times, trajectory, _, _ = planar.stepped(planar.planar_arm(folder), HOLD, 0.6)
    return planar.campaign_of(folder, (planar.hit_run(times, trajectory, HOLD),))


def rigid_at_b(problem):
    """The problem of an arm whose file has joint b rigid."""
    facts = replace(problem.stated, elastic=np.array([True, False]))
    return replace(problem, facts=facts, stated=facts)


def test_an_arm_whose_file_has_every_spring_is_not_asked(campaign):
    assert softened(prepare_arm(campaign)) is None


def test_a_joint_that_a_run_says_is_locked_is_not_asked(campaign):
    problem = rigid_at_b(prepare_arm(campaign))
    run = replace(problem.arm_runs[0], locked=np.array([False, True]))
    assert softened(replace(problem, runs=(run,))) is None


def test_a_spring_of_the_base_is_the_neighbour_that_is_named(campaign):
    """The softened arm predicts what the arm as its file has it predicts with the spring as an effect."""
    problem = rigid_at_b(prepare_arm(campaign))
    soft = softened(problem)
    assert soft is not None
    theta = soft.base.start
    named = spring(problem, soft, theta, 1)
    assert (named.spec.name, named.spec.location) == ("neighbour-flexibility", "neighbour:b")
    expected = predict_outputs(soft.arm_runs[0], theta, (), soft)
    found = predict_outputs(problem.arm_runs[0], theta, (named,), problem)
    rigid = predict_outputs(problem.arm_runs[0], theta, (), problem)
    for y, z, without in zip(expected, found, rigid, strict=True):
        np.testing.assert_allclose(z, y, atol=1e-6 * float(np.std(y)))
        assert float(np.std(without - y)) > 0.05 * float(np.std(y))


def test_a_spring_that_flies_apart_within_a_step_is_not_finite_and_says_nothing(campaign):
    """In silence: warnings are errors here."""
    problem = prepare_arm(campaign)
    theta = problem.base.start.copy()
    theta[problem.place("damping", 0)] = -1e9
    predicted = predict_outputs(problem.arm_runs[0], theta, (), problem)
    assert not any(np.all(np.isfinite(y)) for y in predicted)
