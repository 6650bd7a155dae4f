"""Flanks of a play that give way or do not pull, where a level arm rests between them, and how a gap is found from hits."""

import math
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad

from jointscope.diagnosis import kernel as k
from jointscope.diagnosis.assembly import rests
from jointscope.diagnosis.base import refit_base
from jointscope.diagnosis.bent_play import bent_play
from jointscope.diagnosis.effects import ActiveEffect, catalogue
from jointscope.diagnosis.predict import build, predict_outputs
from jointscope.diagnosis.prepare import prepare
from jointscope.diagnosis.ring_downs import over_first_periods, ring_downs

sys.path.insert(0, str(Path(__file__).parent))
from packed_joint import KW, packed, run  # type: ignore[import-not-found]

HALF, DEPTH = 4e-5, 3e-5
NAMES = ("backlash", "stiffness-nonlinearity")


def flank(x):
    """Torque at a depth x of contact: K x^(3/2) / (x + x_h)^(1/2)."""
    return KW["K"] * x**1.5 / math.sqrt(x + DEPTH)


@pytest.mark.parametrize("amplitude", [5e-5, 1e-4, 6e-4])
def test_the_period_between_rounded_flanks_is_its_quadrature(amplitude):
    """4 int dx (2 (V(A) - V(x)) / J)^(-1/2), flight and contact; energy stays."""
    P, S = packed(GAP_HALF=HALF, GAP_ROUND=DEPTH)
    t, out = run(P, S, x=(0, 0, amplitude, 0), duration=0.5, rate=16384.0)
    q = out[:, k.X_Q]
    deepest = amplitude - HALF

    def energy(x):
        return quad(flank, 0.0, x, epsabs=0.0, epsrel=1e-10)[0]

    whole = energy(deepest)

    def slower(u):  # x = deepest (1 - u^2) takes the end's singularity away
        x = deepest * (1.0 - u * u)
        return 2.0 * u * deepest / math.sqrt(2.0 * (whole - energy(x)) / KW["J_L"])

    contact = quad(slower, 1e-6, 1.0, epsrel=1e-6)[0]
    flight = HALF / math.sqrt(2.0 * whole / KW["J_L"])
    i = np.flatnonzero(q[:-1] * q[1:] < 0)
    crossings = t[i] - q[i] * (t[i + 1] - t[i]) / (q[i + 1] - q[i])
    period = 2.0 * np.mean(np.diff(crossings))
    assert period == pytest.approx(4.0 * (contact + flight), rel=2e-4)
    assert np.max(np.abs(q[len(q) // 2 :])) == pytest.approx(amplitude, rel=1e-3)


@pytest.mark.parametrize("sheds", [0.0, 1.0])
def test_a_flank_pulls_only_where_it_may(sheds):
    """A damper of half the critical one holds back what leaves; then the torque's sign is the flank's, always."""
    P, S = packed(GAP_HALF=HALF, GAP_SHEDS=sheds, C=0.5 * 2.0 * math.sqrt(KW["K"] * KW["J_L"]))
    _, out = run(P, S, x=(0, 0, 3e-4, 0), duration=0.2, rate=16384.0)
    torque, wind_up = out[:, k.X_TS], out[:, k.X_QS] - out[:, k.X_Q]
    pulled = torque * wind_up < -1e-12
    assert pulled.any() == (sheds == 0.0)
    assert np.all(torque[np.abs(wind_up) < HALF] == 0.0)


def test_without_depth_and_for_a_law_in_both_kernels_the_flanks_are_the_dead_zones():
    """The rounded law tends to the sharp one with its depth; the loop for several modes agrees with that for one."""
    sharp, S = packed(GAP_HALF=HALF, C=30.0)
    rounded, _ = packed(GAP_HALF=HALF, C=30.0, GAP_ROUND=1e-9, GAP_FADE=1.0)
    ends = [run(P, S, x=(0, 0, 3e-4, 0), duration=0.1, rate=16384.0)[1][:, k.X_Q] for P in (sharp, rounded)]
    assert np.max(np.abs(ends[0] - ends[1])) < 2e-3 * 3e-4
    P, S = packed(GAP_HALF=HALF, C=30.0, GAP_ROUND=DEPTH, GAP_FADE=1.0, GAP_SHEDS=1.0)
    _, one = run(P, S, x=(0, 0, 3e-4, 0), duration=0.1)
    S = S.copy()
    S[k.AT_BRANCH], S[k.N_BRANCH], S[k.N_X] = S[k.N_X], 1, S[k.N_X] + 1
    P = P.copy()
    P[k.BRANCH_0 + 1] = 1.0  # a branch without stiffness asks for the loop that holds any number of states
    _, several = run(P, S, x=(0, 0, 3e-4, 0), duration=0.1)
    assert np.max(np.abs(one[:, k.X_Q] - several[:, k.X_Q])) < 1e-9


def _hyperbolic(x, corner):
    return x - 0.5 * (math.hypot(x + HALF, corner) - math.hypot(x - HALF, corner))


def _softplus(x, corner):
    """The integral of a dead zone's slope whose edges are two logistic steps."""
    return float(np.logaddexp(0.0, (x - HALF) / -corner) - np.logaddexp(0.0, (-x - HALF) / -corner)) * -corner


@pytest.mark.parametrize("amplitude", [3e-5, 1e-4, 6e-4])
@pytest.mark.parametrize(("stretch", "corner"), [(_hyperbolic, 0.5 * HALF), (_softplus, -0.2 * HALF)])
def test_the_period_over_a_bent_dead_zone_is_its_quadrature(stretch, corner, amplitude):
    """4 int dq (2 (V(A) - V(q)) / J)^(-1/2) with V of the torque that bends for corners leave; energy stays."""
    P, S = packed(GAP_HALF=HALF, GAP_CORNER=corner)
    t, out = run(P, S, x=(0, 0, amplitude, 0), duration=0.5, rate=16384.0)
    q = out[:, k.X_Q]

    def torque(x):
        return KW["K"] * stretch(x, corner)

    def slower(u):
        x = amplitude * (1.0 - u * u)
        left = quad(torque, x, amplitude, epsabs=0.0, epsrel=1e-10)[0]
        return 2.0 * u * amplitude / math.sqrt(2.0 * left / KW["J_L"])

    i = np.flatnonzero(q[:-1] * q[1:] < 0)
    crossings = t[i] - q[i] * (t[i + 1] - t[i]) / (q[i + 1] - q[i])
    period = 2.0 * np.mean(np.diff(crossings))
    assert period == pytest.approx(4.0 * quad(slower, 1e-6, 1.0, epsrel=1e-6)[0], rel=2e-4)
    assert np.max(np.abs(q[len(q) // 2 :])) == pytest.approx(amplitude, rel=1e-3)


def test_a_bend_tends_to_the_corner_and_to_the_soft_spring():
    """Sharp with its width; well inside it a spring of K (1 - (1 + corner^2)^(-1/2)); one model in both kernels."""
    sharp, S = packed(GAP_HALF=HALF, C=30.0)
    bends, _ = packed(GAP_HALF=HALF, C=30.0, GAP_CORNER=1e-3 * HALF, GAP_FADE=1.0)
    ends = [run(P, S, x=(0, 0, 3e-4, 0), duration=0.1, rate=16384.0)[1][:, k.X_Q] for P in (sharp, bends)]
    assert np.max(np.abs(ends[0] - ends[1])) < 2e-3 * 3e-4
    P, S = packed(GAP_HALF=HALF, GAP_CORNER=HALF)
    t, out = run(P, S, x=(0, 0, 0.01 * HALF, 0), duration=0.5)
    soft = KW["K"] * (1.0 - 1.0 / math.sqrt(2.0))
    assert out[:, k.X_Q] == pytest.approx(0.01 * HALF * np.cos(math.sqrt(soft / KW["J_L"]) * t), abs=5e-4 * HALF)
    P, S = packed(GAP_HALF=HALF, C=30.0, GAP_CORNER=0.5 * HALF, GAP_FADE=1.0)
    _, one = run(P, S, x=(0, 0, 3e-4, 0), duration=0.1)
    S = S.copy()
    S[k.AT_BRANCH], S[k.N_BRANCH], S[k.N_X] = S[k.N_X], 1, S[k.N_X] + 1
    P = P.copy()
    P[k.BRANCH_0 + 1] = 1.0
    _, several = run(P, S, x=(0, 0, 3e-4, 0), duration=0.1)
    assert np.max(np.abs(one[:, k.X_Q] - several[:, k.X_Q])) < 1e-9


def level(builders, gap, depth, flanks, noise):
    """Hits on a level arm behind rounded flanks, begun on the flanks of the given sides, by an integrator of its own."""
    plant = builders.Plant(weight=0.0, K=1e-9, c=0.0)
    runs = []
    rng = np.random.default_rng(7)
    for number, side in enumerate(flanks):
        start = 0.5 * gap * side

        def extra(t, x, start=start):
            delta, rate = start - x[2], -x[3]
            depth_now = abs(delta) - 0.5 * gap
            if depth_now <= 0.0:
                return 0.0, 1e-12  # where nothing acts at all, solve_ivp divides nothing by nothing
            share = depth_now / (depth_now + depth)
            pull = 1.9e5 * depth_now * math.sqrt(share) * math.copysign(1.0, delta) + 60.0 * share * rate
            return 0.0, pull

        hit = builders.hammer_run(replace(plant, extra=extra), 90.0 + 45.0 * number, f"hit-{number}")
        stream = hit.streams[0]
        channels = tuple(
            c
            if c.quantity == "force"
            else replace(c, samples=c.samples + noise * np.std(c.samples) * rng.standard_normal(c.samples.size))
            for c in stream.channels
        )
        runs.append(replace(hit, streams=(replace(stream, channels=channels),)))
    rig = replace(builders.NAMEPLATE, plane="horizontal")
    return prepare(builders.campaign_of(runs, rig))


def laws_of_play(problem, *variants):
    return [spec for spec in catalogue(problem) if spec.name == "backlash" and spec.variant in variants]


def test_a_gap_is_found_from_hits_that_begin_on_either_flank(builders):
    """Within 3 % over the first periods, where the base is off by most of the signal; the rounded law leads the sharp ones.

    Over whole ring-downs the flanks, which pull and of which the law's don't, add up to a gap that is 14 % small.
    """
    gap, depth = 4e-5, 1.5e-5
    problem = level(builders, gap, depth, (1, -1, -1, 1), 0.01)
    with ThreadPoolExecutor(2) as pool:
        stage = refit_base(problem, predict_outputs, tuple(range(len(problem.runs))), pool)
        laws = laws_of_play(problem, "free-flight", "damped", "rounded")
        base, _ = stage.fit.coordinates.unpack(stage.fit.x)
        begun = over_first_periods(replace(stage.objective, whiteners=()), stage.noise, base, laws[-1])
        found = ring_downs(stage, stage.objective, stage.fit, laws)
    best = min(found, key=lambda h: h.fit.chi2)
    assert [spec.variant for spec in best.specs] == ["rounded"]
    theta, (active,) = begun.coordinates.unpack(begun.x)
    assert active.values[0] == pytest.approx(gap, rel=0.03)
    theta, (active,) = best.fit.coordinates.unpack(best.fit.x)
    assert active.values[0] == pytest.approx(gap, rel=0.16)
    assert theta[problem.base.names.index("stiffness")] == pytest.approx(1.9e5, rel=0.03)
    assert best.fit.chi2 < 0.15 * stage.fit.chi2


def test_hits_on_a_joint_without_play_have_none(problem, recorded):
    """The fits may end no better than the base, or better by what noise gives a few parameters: 15 nats at most."""
    noisy = recorded(problem, 0.01)
    with ThreadPoolExecutor(2) as pool:
        stage = refit_base(noisy, predict_outputs, tuple(range(len(noisy.runs))), pool)
        found = ring_downs(
            stage, stage.objective, stage.fit, laws_of_play(noisy, "free-flight", "rounded", "hyperbolic")
        )
    assert all(0.5 * (stage.fit.chi2 - h.fit.chi2) < 15.0 for h in found)


def test_a_bent_spring_beside_play_is_found_from_what_play_alone_is_fitted_to(problem, recorded):
    """Quiet ring-downs, of which play alone leaves much: the two are found from a base that knows neither."""
    laws = {spec.variant: spec for spec in catalogue(problem) if spec.name in NAMES}
    wind_up = problem.scales.wind_up
    concealed = (
        ActiveEffect(laws["free-flight"], (0.01 * wind_up,)),
        ActiveEffect(laws["piecewise"], (0.11, 0.3 * wind_up)),
    )
    quiet = recorded(problem, 1e-3, effects=concealed)
    with ThreadPoolExecutor(2) as pool:
        stage = refit_base(quiet, predict_outputs, tuple(range(len(quiet.runs))), pool)
        alone = min(
            ring_downs(stage, stage.objective, stage.fit, laws_of_play(quiet, "free-flight", "rounded")),
            key=lambda h: h.loss,
        )
        both = bent_play(stage, stage.objective, stage.fit, alone, [laws["piecewise"], laws["cubic"]])
    best = min(both, key=lambda h: h.loss)
    assert best.names == ("backlash@transmission", "stiffness-nonlinearity@transmission")
    assert best.fit.chi2 < 0.1 * alone.fit.chi2
    _, (_, bent) = best.fit.coordinates.unpack(best.fit.x)
    assert bent.values[0] == pytest.approx(0.11, rel=0.3)


def test_beside_play_alone_no_bent_spring_is_found(problem, recorded):
    """The gap is found; what a spring's bend gains beside it is noise's, 15 nats at most."""
    laws = {spec.variant: spec for spec in catalogue(problem) if spec.name in NAMES}
    wind_up = problem.scales.wind_up
    quiet = recorded(problem, 1e-3, effects=(ActiveEffect(laws["free-flight"], (0.01 * wind_up,)),))
    with ThreadPoolExecutor(2) as pool:
        stage = refit_base(quiet, predict_outputs, tuple(range(len(quiet.runs))), pool)
        alone = min(
            ring_downs(stage, stage.objective, stage.fit, laws_of_play(quiet, "free-flight", "rounded")),
            key=lambda h: h.loss,
        )
        both = bent_play(stage, stage.objective, stage.fit, alone, [laws["piecewise"], laws["cubic"]])
    assert alone.fit.chi2 < 0.2 * stage.fit.chi2
    assert all(0.5 * (alone.fit.chi2 - h.fit.chi2) < 15.0 for h in both)


def test_where_nothing_hits_a_held_joint_there_is_no_ring_down(builders, plant):
    driven = prepare(builders.campaign_of([builders.sweep_run(plant, 30.0, "s")]))
    with ThreadPoolExecutor(1) as pool:
        stage = refit_base(driven, predict_outputs, (0,), pool)
        assert ring_downs(stage, stage.objective, stage.fit, catalogue(driven)) == []


def test_a_weight_holds_the_arm_against_a_flank(problem, truth, builders):
    """On a level rig a hit may begin on either flank or between them; where a weight rests on one, there."""
    play = next(s for s in catalogue(problem) if (s.name, s.variant) == ("backlash", "free-flight"))
    active = (ActiveEffect(play, (1e-4,)),)
    assert rests(build(problem.runs[0], truth, active, problem)) == (None,)
    flat = level(builders, 1e-4, 1e-5, (1,), 0.0)
    theta = flat.theta(stiffness=1.9e5, damping=60.0, load_inertia=3.0)
    assert rests(build(flat.runs[0], theta, active, flat)) == (None, -5e-5, 5e-5)
    assert rests(build(flat.runs[0], theta, (), flat)) == (None,)


def test_an_impact_is_damped_in_proportion_to_its_torque():
    """T = T_e (1 + impact x'), Hunt and Crossley's: what speed adds is impact |T_e| x', nothing within the play."""
    impact, v = 4.0, 0.03
    for branches in (0, 1):  # in both kernels
        found = []
        for depth, speed in ((6e-4, 0.0), (6e-4, v), (6e-4, -v), (0.0, v)):
            P, S = packed(GAP_HALF=HALF, C=0.0, GAP_CORNER=0.2 * HALF, GAP_FADE=1.0, GAP_IMPACT=impact)
            if branches:
                S[k.AT_BRANCH], S[k.N_BRANCH], S[k.N_X] = S[k.N_X], 1, S[k.N_X] + 1
                P[k.BRANCH_0 + 1] = 1.0
            _, out = run(P, S, x=(0, 0, depth, speed), duration=0.01)
            found.append(float(out[0, k.X_TS]))
        still, out_, in_, free = found
        assert still < 0.0  # it pulls the arm back
        assert out_ - still == pytest.approx(-impact * abs(still) * v, rel=1e-9)
        assert in_ - still == pytest.approx(impact * abs(still) * v, rel=1e-9)
        assert abs(free) < 1e-9 * abs(still)
