"""Dahl's bristle at a rotor: its closed form, and both ways of stepping with it."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
import planar  # type: ignore[import-not-found]

from jointscope.diagnosis.arm import kernel
from jointscope.diagnosis.arm.effects import arm_catalogue
from jointscope.diagnosis.arm.predict import assembled, rest_state
from jointscope.diagnosis.arm.prepare import prepare_arm
from jointscope.diagnosis.arm.small import run_small
from jointscope.diagnosis.effects.spec import ActiveEffect
from jointscope.diagnosis.kernel.laws import hysteresis
from jointscope.diagnosis.kernel.layout import DAHL


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    return prepare_arm(planar.swept(tmp_path_factory.mktemp("presliding")))


def test_a_bristle_is_a_spring_at_first_and_slides_at_last():
    assert kernel.bristle(0.0, 1e-9, 1e-4) == pytest.approx(1e-5, rel=1e-4)
    assert kernel.bristle(-1.0, 1.0, 1e-4) == pytest.approx(1.0)
    assert kernel.bristle(0.3, 0.0, 1e-4) == pytest.approx(0.3)
    assert kernel.bristle(-0.4, 7e-5, 1e-4) == pytest.approx(hysteresis(-0.4, 7e-5, 1e-4, DAHL, 0.0), rel=1e-12)
    whole = kernel.bristle(0.2, -3e-4, 1e-4)
    assert kernel.bristle(kernel.bristle(0.2, -1e-4, 1e-4), -2e-4, 1e-4) == pytest.approx(whole)


def stepped(problem, effects, finer=1):
    """The accelerometers by the exact transition and by Runge-Kutta, on the run's grid and ``finer``, and the rotor's angle."""
    run, theta = problem.arm_runs[0], problem.base.start
    assembly = assembled(run, theta, effects, problem)
    table = run.plant.reduced(assembly.elastic, assembly.links, assembly.mount)
    P, kinds, x = rest_state(assembly, table)
    driven = int(np.flatnonzero(table.joints == run.driven)[0])
    tie, rate = run.tie * (2.0 * np.pi) ** 2, 1.4 * run.tie * 2.0 * np.pi
    steps, nodes = finer * run.steps, np.arange(2 * run.steps + 1)
    between = np.linspace(0.0, nodes[-1], 2 * steps + 1)
    torque, tied, load = (
        np.interp(between, nodes, u)
        for u in (run.motor_half, tie * run.path + rate * run.path_rate, run.load_half)
    )
    small = run_small(
        table,
        P,
        kinds,
        driven,
        tie,
        rate,
        torque + tied - P[driven, kernel.REST_TORQUE],
        finer * run.grid_rate,
        steps,
    )
    readings, rotor = np.empty((steps + 1, 2)), np.zeros(steps + 1)
    kernel.travel(
        table.inverse, table.gravity, table.slope, table.product, table.motion, table.tilt, table.bias, table.static,
        table.hit, -1, 0.0, 1.0, P, kinds, driven, load, torque, tied, tie, rate, 1.0 / (finer * run.grid_rate),
        readings, rotor, x,
    )  # fmt: skip
    return small[::finer, :-1] + run.plant.static[0], readings[::finer], rotor[::finer]


@pytest.mark.parametrize(
    ("name", "variant", "values"),
    [
        ("coulomb-friction", "presliding", (8.0, 0.0, 3e-5)),
        ("coulomb-friction", "presliding", (8.0, 0.3, 2e-4)),
        ("stribeck-friction", "presliding", (6.0, 1.5, 0.01, 1e-4)),
    ],
)
def test_two_ways_of_stepping_agree_to_second_order(swept, name, variant, values):
    laws = (s for s in arm_catalogue(swept) if (s.name, s.variant, s.location) == (name, variant, "motor:a"))
    effect = ActiveEffect(next(laws), values)
    size = float(np.std(stepped(swept, (effect,))[1] - stepped(swept, ())[1]))
    apart = [float(np.std(np.subtract(*stepped(swept, (effect,), finer)[:2]))) for finer in (1, 4)]
    assert size > 0.1 and apart[0] < 0.002 * size
    assert apart[1] < apart[0] / 8.0


def test_a_short_reach_is_a_stick(swept):
    """Over an angle that the rotor covers in no time the bristle is Coulomb's friction."""
    laws = {s.variant: s for s in arm_catalogue(swept) if (s.name, s.location) == ("coulomb-friction", "motor:a")}
    plain, stick = (stepped(swept, active, 8)[1] for active in ((), (ActiveEffect(laws["stick"], (8.0,)),)))
    apart = [
        float(np.std(stick - stepped(swept, (ActiveEffect(laws["presliding"], (8.0, 0.0, reach)),), 8)[1]))
        for reach in (5e-6, 1e-6)
    ]
    assert apart[1] < 0.6 * apart[0] < 0.15 * float(np.std(stick - plain))


def test_friction_unlike_in_the_two_directions_leaves_the_rotor_aside(swept):
    """What holds more against one direction pushes a rotor that shakes to the other side, by both ways of stepping."""
    laws = {s.variant: s for s in arm_catalogue(swept) if (s.name, s.location) == ("coulomb-friction", "motor:a")}
    means = []
    for asymmetry in (-0.4, 0.4):
        _, _, rotor = stepped(swept, (ActiveEffect(laws["stick-unlike"], (8.0, asymmetry)),))
        means.append(float(np.mean(rotor)))
    assert means[0] > means[1]
