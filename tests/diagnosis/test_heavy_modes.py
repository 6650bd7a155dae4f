"""A mode as heavy as the arm is started where the joint beside it rings as the base that stood in for it does."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import eigh

from jointscope.diagnosis.effects import ActiveEffect, catalogue
from jointscope.diagnosis.heavy_modes import (
    beside_mount,
    beside_neighbour,
    between_mount,
    between_neighbour,
    heavy_modes,
)
from jointscope.diagnosis.prepare import prepare
from jointscope.diagnosis.refit import fitted_on

SQUARED, INERTIA = (2.0 * np.pi * 25.0) ** 2, 3.0


def modes(mass, stiffness, sensed):
    """Squared frequencies and what each mode answers to a hit where it is sensed [1/(kg m^2)]."""
    squares, shapes = eigh(stiffness, mass)
    return squares, (sensed @ shapes) ** 2


def mount(K, J, own, share):
    """Wind-up and mount, of which the arm moves by the sum."""
    J_b = J / share
    return modes(np.array([[J, J], [J, J + J_b]]), np.diag([K, J_b * own]), np.array([1.0, 1.0]))


def neighbour(K, J, own, share):
    """Wind-up and the neighbour against the arm, on which neither hammer nor sensor rides."""
    J_p = share * J
    return modes(np.array([[J, J_p], [J_p, J_p]]), np.diag([K, J_p * own]), np.array([1.0, 0.0]))


@pytest.mark.parametrize(
    ("beside", "structure", "factor"),
    [
        *((beside_mount, mount, f) for f in (0.5, 0.8, 1.7, 3.0)),
        *((beside_neighbour, neighbour, f) for f in (0.4, 1.1, 1.7, 3.0)),
    ],
)
@pytest.mark.parametrize("share", [0.05, 0.4, 0.8])
def test_the_joint_beside_the_mode_rings_and_answers_as_the_base_did(beside, structure, factor, share):
    own = SQUARED * factor**2
    found = beside(SQUARED, INERTIA, own, share)
    assert found is not None
    squares, answers = structure(*found, own, share)
    at = int(np.argmin(np.abs(squares / SQUARED - 1.0)))
    assert squares[at] == pytest.approx(SQUARED, rel=1e-9)
    assert answers[at] == pytest.approx(1.0 / INERTIA, rel=1e-9)


def test_no_joint_rings_there_beside_a_mount_that_would_have_to_be_pulled():
    """Between w^2 = lambda and (1 + s) lambda the coupling alone moves the resonance further."""
    assert beside_mount(SQUARED, INERTIA, 1.2 * SQUARED, 0.5) is None
    assert beside_mount(SQUARED, INERTIA, 1.6 * SQUARED, 0.5) is not None
    assert beside_neighbour(SQUARED, INERTIA, SQUARED, 0.2) is None
    assert beside_neighbour(SQUARED, INERTIA, 0.64 * SQUARED, 0.4) is None  # 1 + s r < 0


def test_a_light_mode_changes_nothing():
    for beside in (beside_mount, beside_neighbour):
        K, J = beside(SQUARED, INERTIA, 4.0 * SQUARED, 1e-7)
        assert (K, J) == pytest.approx((SQUARED * INERTIA, INERTIA), rel=1e-5)


def turning_mount(problem, share):
    spec = next(s for s in catalogue(problem) if s.variant == "turning-mount")
    return ActiveEffect(spec, (1.5 * problem.scales.frequency, share, 0.02))


def test_a_rocking_mount_as_heavy_as_the_arm_is_found_and_the_joint_with_it(problem, recorded, base_and_trials):
    effect = turning_mount(problem, 0.8)
    objective, base, _, candidates = base_and_trials(recorded(problem, 2e-3, effects=(effect,)), (effect,))
    found = heavy_modes(objective, base, candidates)
    best = min((h for h in found if h.specs[0].variant == "turning-mount"), key=lambda h: h.loss)
    assert best.fit.chi2 < 0.01 * base.chi2
    theta, (mode,) = best.fit.coordinates.unpack(best.fit.x)
    assert mode.values[:2] == pytest.approx(effect.values[:2], rel=0.02)
    for name in ("stiffness", "load_inertia"):
        at = problem.base.names.index(name)
        assert theta[at] == pytest.approx(problem.base.start[at], rel=0.02)


def test_nothing_is_tried_where_the_base_is_near_the_data(problem, recorded, base_and_trials):
    objective, base, _, candidates = base_and_trials(recorded(problem, 2e-3), ())
    assert heavy_modes(objective, base, candidates) == []


@pytest.mark.parametrize(("factor", "share", "rides"), [(0.8, 0.35, 1.0), (1.7, 0.35, 0.8), (2.5, 0.6, 0.5)])
def test_the_joint_under_an_outer_part_that_hammer_and_sensor_ride_on(factor, share, rides):
    """q'' + phi p'' is hit and seen, p the outer part against the arm."""
    own = SQUARED * factor**2
    K, J = beside_neighbour(SQUARED, INERTIA, own, share, rides)
    J_p = share * J
    squares, answers = modes(np.array([[J, J_p], [J_p, J_p]]), np.diag([K, J_p * own]), np.array([1.0, rides]))
    at = int(np.argmin(np.abs(squares / SQUARED - 1.0)))
    assert squares[at] == pytest.approx(SQUARED, rel=1e-9)
    assert answers[at] == pytest.approx(1.0 / INERTIA, rel=1e-9)


@pytest.mark.parametrize(
    ("beside", "between", "structure"),
    [(beside_mount, between_mount, mount), (beside_neighbour, between_neighbour, neighbour)],
)
@pytest.mark.parametrize("share", [0.05, 0.18, 0.7])
@pytest.mark.parametrize("own", [40.0, 61.0, 90.0])
def test_two_resonances_and_the_modes_own_frequency_give_its_share_and_the_joint(
    beside, between, structure, share, own
):
    own = (2.0 * np.pi * own) ** 2
    one, other = structure(SQUARED * INERTIA, INERTIA, own, share)[0]
    assert one < own < other
    assert between(one, other, own) == pytest.approx(share, rel=1e-9)
    assert between(other, one, own) == pytest.approx(share, rel=1e-9)
    _, answers = structure(SQUARED * INERTIA, INERTIA, own, share)
    K, J = beside(other, 1.0 / answers[1], own, share)  # the base took the upper one
    assert (K, J) == pytest.approx((SQUARED * INERTIA, INERTIA), rel=1e-9)


def test_no_share_puts_both_resonances_at_one_frequency():
    assert between_mount(SQUARED, SQUARED, 2.0 * SQUARED) is None
    assert between_neighbour(SQUARED, 2.0 * SQUARED, SQUARED) is None


@pytest.fixture
def elbow(builders, plant):
    """Hits in three postures of a joint that a neighbour carries, whose axis lies beside its own."""
    level = replace(plant, weight=1e-9)
    runs = [builders.hammer_run(level, 100.0, f"a{i}", duration=0.7) for i in range(3)]
    return prepare(
        builders.campaign_of(
            [replace(run, arm_angle=angle) for run, angle in zip(runs, (0.0, 0.8, 1.5), strict=True)]
        )
    )


def test_a_neighbour_that_carries_the_joint_is_found_in_several_postures(elbow, recorded, base_and_trials):
    """From the base's one resonance, what one posture lacks of it stood for all of it: a payload's."""
    spec = next(s for s in catalogue(elbow) if s.variant == "carrier-turned")
    effect = ActiveEffect(spec, (2.05 * elbow.scales.frequency, 0.51, 0.027, 0.625, 0.0, 1.25))
    objective, base, _, candidates = base_and_trials(recorded(elbow, 2e-3, effects=(effect,)), (effect,))
    found = [h for h in heavy_modes(objective, base, candidates) if h.specs[0].variant == spec.variant]
    fit = min((fitted_on(objective, h.fit, 80, 600) for h in found), key=lambda fit: fit.chi2)
    assert fit.chi2 < 1.2 * len(fit.w) < 0.2 * base.chi2
    _, (mode,) = fit.coordinates.unpack(fit.x)
    assert mode.values[:2] == pytest.approx(effect.values[:2], rel=0.15)
