"""A loop beside the spring of an arm's reducer: its closed forms, its work, and both ways of stepping with it."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
import planar  # type: ignore[import-not-found]
from test_arm_presliding import stepped  # type: ignore[import-not-found]

from jointscope.diagnosis.arm import kernel
from jointscope.diagnosis.arm.effects import arm_catalogue
from jointscope.diagnosis.arm.predict import predict_outputs
from jointscope.diagnosis.arm.prepare import prepare_arm
from jointscope.diagnosis.effects.spec import ActiveEffect

ANGLE = 1e-4


def row(slips):
    P = np.zeros(kernel.COLUMNS)
    P[kernel.LOOP_TORQUE], P[kernel.LOOP_ANGLE], P[kernel.LOOP_SLIPS] = 1.0, ANGLE, slips
    return P


def walked(slips, path):
    """z along a path of wind-ups that starts at 0."""
    held, found, before = np.zeros(kernel.SLIPS), [], 0.0
    for wind_up in path:
        found.append(kernel.loop(held, wind_up - before, row(slips), True))
        before = wind_up
    return np.array(found)


def turns(amplitude, count, steps=2000):
    return amplitude * np.sin(2.0 * np.pi * count * np.arange(1, steps * count + 1) / (steps * count))


@pytest.mark.parametrize("slips", [0.0, 1.0])
def test_a_loop_is_a_spring_at_first_and_yields_at_last(slips):
    assert walked(slips, [1e-9])[0] == pytest.approx(1e-9 / ANGLE, rel=1e-4)
    assert walked(slips, [-1.0])[0] == pytest.approx(-1.0)
    at_once, in_parts = walked(slips, [3e-4])[0], walked(slips, [0.4e-4, 1.7e-4, 3e-4])[-1]
    assert at_once == pytest.approx(in_parts)
    held = np.zeros(kernel.SLIPS)
    kernel.loop(held, 1e-4, row(slips), False)
    assert not held.any()


@pytest.mark.parametrize("slips", [0.0, 1.0])
def test_the_loop_closes_and_loses_the_same_at_any_rate(slips):
    losses = []
    for steps in (500, 4000):
        path = turns(2.5e-4, 3, steps)
        z = walked(slips, path)
        whole = slice(-steps - 1, None)
        assert z[-1] == pytest.approx(z[-1 - steps], abs=1e-6)
        losses.append(float(np.trapezoid(z[whole], path[whole])))
    assert losses[1] == pytest.approx(losses[0], rel=2e-3) and losses[0] > 0.0


def test_each_spring_that_slips_loses_four_times_its_limit_times_what_it_slips():
    path = turns(2.5e-4, 2)
    z = walked(1.0, path)
    turn = slice(-2001, None)  # the point where the turn began, too
    levels = 2.0 * np.arange(1, kernel.SLIPS + 1) / (kernel.SLIPS + 1)
    expected = np.mean([4.0 * level * max(2.5e-4 - level * ANGLE, 0.0) for level in levels])
    assert float(np.trapezoid(z[turn], path[turn])) == pytest.approx(float(expected), rel=2e-3)
    small = turns(0.3e-4, 2)  # below the first slip nothing is lost
    kept = walked(1.0, small)
    assert abs(float(np.trapezoid(kept[turn], small[turn]))) < 1e-5 * 0.3e-4


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    return prepare_arm(planar.swept(tmp_path_factory.mktemp("loop")))


def law(problem, variant):
    found = [s for s in arm_catalogue(problem) if (s.name, s.variant) == ("hysteresis", variant)]
    return next(s for s in found if s.location == "transmission:a")


@pytest.mark.parametrize("variant", ["dahl", "maxwell-slip"])
def test_two_ways_of_stepping_agree_with_a_loop(swept, variant):
    effect = ActiveEffect(law(swept, variant), (6.0, 9000.0))
    size = float(np.std(stepped(swept, (effect,))[1] - stepped(swept, ())[1]))
    apart = [float(np.std(np.subtract(*stepped(swept, (effect,), finer)[:2]))) for finer in (1, 4)]
    assert size > 0.1 and apart[0] < 0.01 * size
    assert apart[1] < apart[0] / 4.0


@pytest.mark.parametrize("variant", ["dahl", "maxwell-slip"])
def test_a_loop_that_never_yields_is_a_stiffer_spring(swept, variant):
    """Far below its torque the loop is K + stiffness, which another spring is too: the same motion to first order."""
    theta = swept.base.start
    place = swept.place("stiffness", 0)
    stiffer = np.array(theta)
    stiffer[place] += 1000.0
    effect = ActiveEffect(law(swept, variant), (1e5, 1000.0))
    run = swept.arm_runs[0]
    loop, spring, plain = (
        predict_outputs(run, at, effects, swept)[0]
        for at, effects in ((theta, (effect,)), (stiffer, ()), (theta, ()))
    )
    assert float(np.std(loop - spring)) < 0.01 * float(np.std(loop - plain))
