"""What carries the joint, met in several postures: visible along its direction, out of sight across it."""

import math
from dataclasses import replace

import numpy as np
import pytest

from jointscope.diagnosis import kernel as k
from jointscope.diagnosis.effects import ActiveEffect, catalogue
from jointscope.diagnosis.effects.postures import NEXT_TO_NOTHING
from jointscope.diagnosis.predict import build, predict_outputs
from jointscope.diagnosis.prepare import prepare


@pytest.fixture
def postures(builders, plant):
    """Hits in three postures of a horizontal arm."""
    level = replace(plant, weight=1e-9)
    runs = [builders.hammer_run(level, 100.0, f"a{i}", duration=0.5) for i in range(3)]
    runs = [replace(run, arm_angle=angle) for run, angle in zip(runs, (0.0, 0.6, 0.5 * math.pi), strict=True)]
    return prepare(builders.campaign_of(runs))


def spec_of(problem, variant):
    return next(s for s in catalogue(problem) if s.variant == variant)


def mount(problem, direction=0.0, percussion=0.7):
    return ActiveEffect(spec_of(problem, "sliding-mount-turned"), (20.0, 0.1, 0.02, percussion, direction))


def test_a_sliding_mount_is_felt_by_the_square_of_the_cosine_and_moves_a_sensor_by_the_same_lever(postures):
    theta = postures.base.start
    for run in postures.runs[:2]:
        P = build(run, theta, (mount(postures),), postures).P
        assert P[k.BASE_SHARE] == pytest.approx(0.1 * math.cos(run.initial_angle) ** 2)
        assert P[k.BASE_TURN] == 0.0
        assert P[k.BASE_SLIDE] == pytest.approx(0.7)
    across = build(postures.runs[2], theta, (mount(postures),), postures).P
    assert across[k.BASE_SHARE] == pytest.approx(0.1 * NEXT_TO_NOTHING**2, rel=1e-6)


def test_along_its_direction_it_is_the_mount_of_one_posture_and_half_a_turn_away_the_same(postures):
    theta, run = postures.base.start, postures.runs[0]
    plain = ActiveEffect(spec_of(postures, "sliding-mount"), (20.0, 0.1, 0.02, 0.7))
    ways = [(plain,), (mount(postures),), (mount(postures, math.pi),)]
    first, *others = [predict_outputs(run, theta, effects, postures)[0] for effects in ways]
    for other in others:
        np.testing.assert_allclose(other, first, rtol=0.0, atol=1e-12 * np.abs(first).max())


def test_a_carrier_far_from_its_axis_slides_and_one_on_its_axis_turns_in_every_posture(postures):
    theta, spec = postures.base.start, spec_of(postures, "carrier-turned")
    for run in postures.runs[:2]:
        far = build(run, theta, (ActiveEffect(spec, (20.0, 0.1, 0.02, 0.7, 0.0, 0.0)),), postures).P
        slides = build(run, theta, (mount(postures),), postures).P
        np.testing.assert_array_equal(far, slides)
        near = build(run, theta, (ActiveEffect(spec, (20.0, 0.1, 0.02, 0.7, 0.0, 50.0)),), postures).P
        assert near[k.BASE_SHARE] == pytest.approx(0.1, rel=0.02)
        assert near[k.BASE_TURN] == pytest.approx(1.0, abs=0.02)


def test_one_posture_does_not_show_it(builders, plant):
    problem = prepare(builders.campaign_of([builders.hammer_run(plant, 100.0, "a", duration=0.5)]))
    reason = spec_of(problem, "sliding-mount-turned").possible(problem)
    assert reason is not None and "one posture" in reason
