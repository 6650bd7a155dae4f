"""What carries the joint, met in several postures: visible along its direction, out of sight across it."""

import math
from dataclasses import replace

import numpy as np
import pytest

from jointscope.diagnosis import kernel as k
from jointscope.diagnosis.candidates import candidates_for
from jointscope.diagnosis.effects import ActiveEffect, catalogue
from jointscope.diagnosis.effects.postures import NEXT_TO_NOTHING, ON_AXIS
from jointscope.diagnosis.freer import FREER
from jointscope.diagnosis.lent import same_numbers
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
        heavier = 1.0 + 0.1 * math.sin(run.initial_angle) ** 2
        assert P[k.BASE_SHARE] == pytest.approx(0.1 * math.cos(run.initial_angle) ** 2 / heavier)
        assert P[k.BASE_TURN] == 0.0
        assert P[k.BASE_SLIDE] == pytest.approx(0.7)
    across = build(postures.runs[2], theta, (mount(postures),), postures).P
    assert across[k.BASE_SHARE] == pytest.approx(0.1 * NEXT_TO_NOTHING**2 / 1.1, rel=1e-6)


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


def test_a_carrier_of_one_posture_is_sought_in_all_from_where_every_posture_moves_alike(postures):
    """A law of one posture has no directions: from its base, an axis in a wrong place was further off than no carrier."""
    spec, one = spec_of(postures, "carrier-turned"), spec_of(postures, "carrier")
    assert spec.variant in FREER[one.variant]
    found = ActiveEffect(one, (22.0, 0.2, 0.03, 0.9))
    lent = same_numbers(candidates_for(postures, (spec,)), found)
    assert {(a.values[0], a.values[1], a.values[2]) for a in lent} == {(22.0, 0.2, 0.03)}
    assert {a.values[5] for a in lent} == {0.5, ON_AXIS}
    assert len({a.values[4:] for a in lent}) == len(lent) == 6
    alike = next(a for a in lent if a.values[4:] == (0.0, ON_AXIS))
    for run in postures.runs:
        P = build(run, postures.base.start, (alike,), postures).P
        assert P[k.BASE_SHARE] == pytest.approx(0.2, rel=0.13)
        assert P[k.BASE_TURN] == pytest.approx(1.0, abs=0.07)


@pytest.mark.parametrize("distance", [None, 0.25, 1.1])
def test_frequencies_are_those_of_two_rigid_bodies_in_every_posture(postures, distance):
    """Joint and carrier on their springs, the joint's motor held: a mount that slides, or a carrier at a distance [m]."""
    m, centre, J_L, K, k_2, own = 6.0, 0.5, 3.0, 1.9e5, 4e5, 5.0  # own: the carrier's inertia, or its mass
    at = 0.2  # where it is felt most
    theta = postures.base.start.copy()
    names = list(postures.base.names)
    theta[names.index("stiffness")], theta[names.index("load_inertia")] = K, J_L

    def matrix(q):
        cosine = math.cos(q - at)
        if distance is None:
            coupling, inertia = m * centre * cosine, own + m
        else:
            lever = m * centre * distance * cosine
            coupling, inertia = J_L + lever, own + J_L + m * distance**2 + 2.0 * lever
        return np.array([[inertia, coupling], [coupling, J_L]])

    def frequencies(mass, stiffness):
        return np.sqrt(np.sort(np.linalg.eigvals(np.linalg.solve(mass, np.diag(stiffness))).real))

    M = matrix(at)
    effective = M[0, 0] - M[0, 1] ** 2 / J_L
    kappa = 0.0 if distance is None else J_L / (m * centre * distance)
    values = (math.sqrt(k_2 / effective) / (2.0 * math.pi), M[0, 1] ** 2 / (J_L * effective), 0.02)
    variant, tail = ("sliding-mount-turned", ()) if distance is None else ("carrier-turned", (kappa,))
    effect = ActiveEffect(spec_of(postures, variant), (*values, J_L / (m * centre), at, *tail))
    for run in postures.runs[:2]:
        P = build(run, theta, (effect,), postures).P
        carried = J_L / P[k.BASE_SHARE]
        modal = np.array([[carried + J_L, J_L], [J_L, J_L]])
        expected = frequencies(matrix(run.initial_angle), (k_2, K))
        np.testing.assert_allclose(frequencies(modal, (carried * P[k.BASE_OMEGA] ** 2, K)), expected, rtol=1e-9)


def test_one_posture_does_not_show_it(builders, plant):
    problem = prepare(builders.campaign_of([builders.hammer_run(plant, 100.0, "a", duration=0.5)]))
    reason = spec_of(problem, "sliding-mount-turned").possible(problem)
    assert reason is not None and "one posture" in reason
