"""An arm that bends at an elbow: two bodies' own equations, and what lies inboard of it."""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from jointscope.diagnosis import kernel as k
from jointscope.diagnosis.assembly import beyond
from jointscope.diagnosis.effects import ActiveEffect, catalogue
from jointscope.diagnosis.predict import predict_outputs

sys.path.insert(0, str(Path(__file__).parent))
from packed_joint import KW, modes, packed, run  # type: ignore[import-not-found]

NEAR, FAR, HIT = 0.55, 0.95, 0.8


def law(problem, variant):
    return next(s for s in catalogue(problem) if s.variant == variant and s.name == "link-flexibility")


def readings(problem, taken, *effects):
    found = predict_outputs(taken, problem.base.start, effects, problem)
    return {o.radius: y for o, y in zip(taken.outputs, found, strict=True) if o.quantity == "linear-acceleration"}


@pytest.mark.parametrize(("elbow", "radius"), [(0.3, 0.9), (0.6, 0.9), (0.7, 0.5)])
def test_the_mode_is_the_two_bodies_own_equations(elbow, radius):
    """J q'' + c psi'' = -K q + r F, m psi'' + c q'' = -k psi + (r - r_e)+ F; a point reads r q'' + (r - r_e)+ psi''."""
    K, J, c, m, frequency = KW["K"], KW["J_L"], 0.2, 0.1, 62.0
    kappa, w = c / m, 2.0 * math.pi * frequency
    P, S = packed(LINK_J=c * c / m, LINK_OMEGA=w, LINK_ZETA=0.0, LINK_HIT=kappa * beyond(radius, elbow))
    modes(S, k.AT_LINK)

    def hit(t):
        return 200.0 * np.exp(-(((np.asarray(t) - 0.02) / 0.002) ** 2))

    t, out = run(P, S, ul=lambda t: radius * hit(t), duration=0.3, rate=8192.0)
    M, push = np.array([[J, c], [c, m]]), np.array([radius, max(radius - elbow, 0.0)])

    def accelerations(u, x):
        return np.linalg.solve(M, push * hit(u) - np.array([K * x[0], m * w * w * x[1]]))

    motion = solve_ivp(
        lambda u, x: np.concatenate([x[2:], accelerations(u, x)]),
        (0.0, t[-1]),
        np.zeros(4),
        method="DOP853",
        rtol=1e-10,
        atol=1e-14,
        max_step=5e-4,
        t_eval=t,
    ).y
    for place in (0.5, 0.9):
        ours = place * (out[:, k.X_A] + kappa * beyond(place, elbow) * out[:, k.X_LINK])
        lever = np.array([place, max(place - elbow, 0.0)])
        theirs = np.array([lever @ accelerations(u, x) for u, x in zip(t, motion.T, strict=True)])
        np.testing.assert_allclose(ours, theirs, atol=2e-3 * np.max(np.abs(theirs)))


@pytest.mark.parametrize("elbow", [0.3, 0.6, 0.85])
def test_each_sensor_sees_the_law_of_two_shapes_with_its_own(two, elbow):
    taken, inertia, shape = two.runs[0], 0.1 * two.base.start[2], 4.0
    mode = (2.0 * two.scales.frequency, inertia, 0.02)
    bent = readings(two, taken, ActiveEffect(law(two, "elbow"), (*mode, shape, elbow)))
    for radius in (NEAR, FAR):
        shapes = (shape * beyond(HIT, elbow), shape * beyond(radius, elbow))
        alike = readings(two, taken, ActiveEffect(law(two, "two-shapes"), (*mode, *shapes)))
        np.testing.assert_allclose(bent[radius], alike[radius], rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(("clamp", "curve"), [(0.0, 2.5), (0.3, 1.7)])
def test_of_a_bar_that_bends_along_its_length_too(two, clamp, curve):
    taken, inertia, shape = two.runs[0], 0.1 * two.base.start[2], 4.0
    mode = (2.0 * two.scales.frequency, inertia, 0.02)
    bent = readings(two, taken, ActiveEffect(law(two, "cantilever"), (*mode, shape, clamp, curve)))
    for radius in (NEAR, FAR):
        shapes = (shape * (HIT - clamp) ** curve / HIT, shape * (radius - clamp) ** curve / radius)
        alike = readings(two, taken, ActiveEffect(law(two, "two-shapes"), (*mode, *shapes)))
        np.testing.assert_allclose(bent[radius], alike[radius], rtol=1e-12, atol=1e-12)


def test_a_bar_of_the_first_power_is_an_elbow(two):
    taken, inertia = two.runs[0], 0.1 * two.base.start[2]
    values = (2.0 * two.scales.frequency, inertia, 0.02, 4.0, 0.3)
    straight = readings(two, taken, ActiveEffect(law(two, "cantilever"), (*values, 1.0)))
    for radius, expected in readings(two, taken, ActiveEffect(law(two, "elbow"), values)).items():
        np.testing.assert_allclose(straight[radius], expected, rtol=1e-12, atol=1e-12)


def test_what_is_inboard_follows_none_of_it():
    assert beyond(0.5, 0.6) == 0.0 and beyond(math.inf, 0.6) == 0.0
    assert beyond(0.9, 0.0) == 1.0 and beyond(0.9, 0.45) == pytest.approx(0.5)


def test_an_elbow_is_asked_for_where_several_places_tell_it(two, problem):
    assert law(two, "elbow").possible(two) is None
    reason = law(problem, "elbow").possible(problem)
    assert reason is not None and "several radii" in reason
    starts = {values[-1] for values in law(two, "elbow").starts(two)}
    assert sum(elbow < NEAR for elbow in starts) == 1 and sum(NEAR < elbow < FAR for elbow in starts) == 2
