"""Expected gain of a recording: its laws, and a menu item that settles what another cannot."""

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from jointscope.diagnosis.coordinates import coordinates
from jointscope.diagnosis.discrimination import TRUSTED, Candidate, Item, distances, expected_gain, holds
from jointscope.diagnosis.effects import ActiveEffect, catalogue
from jointscope.diagnosis.foretelling import foretell, planned_noise, planned_whitener
from jointscope.diagnosis.menu import chirp, hit, lab_of, multisine, planned, speeds
from jointscope.diagnosis.next_experiment import choose, needed
from jointscope.diagnosis.noise import (
    ANGULAR_FLOOR,
    RIGID_FLOOR,
    NoiseModel,
    block_key,
    block_noise,
    dynamic_level,
    white,
)


def spec_of(problem, name, location="transmission"):
    return next(s for s in catalogue(problem) if (s.name, s.location) == (name, location))


def test_a_recording_that_tells_nothing_brings_nothing():
    p = np.array([0.5, 0.3, 0.2])
    assert expected_gain(p, np.zeros((3, 3))) == pytest.approx(0.0, abs=1e-12)


def test_gain_grows_with_distance_up_to_certainty():
    p = np.array([0.6, 0.4])
    apart = np.array([[0.0, 1.0], [1.0, 0.0]])
    gains = [expected_gain(p, d * apart) for d in (0.0, 10.0, 100.0, 1e6)]
    assert gains == sorted(gains)
    assert gains[-1] == pytest.approx(1.0 - float(p @ p))


def test_the_odds_move_by_the_trusted_half_distance_over_the_temperature():
    d = np.array([[0.0, 30.0], [0.0, 0.0]])
    odds = math.exp(TRUSTED * 30.0 / 2.0 / 3.0)
    assert expected_gain(np.array([0.5, 0.5]), d, temperature=3.0) == pytest.approx(
        0.5 * (odds / (1 + odds) - 0.5)
    )


def test_a_set_follows_what_it_holds():
    dry, steep, play = "coulomb-friction@motor", "stribeck-friction@motor", "backlash@transmission"
    assert holds((dry,), ()) and holds((dry, play), (play,)) and holds((steep,), (dry,))
    assert not holds((dry,), (steep,)) and not holds((dry,), (play,)) and not holds((), (dry,))
    assert not holds(("stribeck-friction@load",), (dry,))


def test_programmes_keep_their_amplitudes_and_bands():
    t = np.arange(0, 3, 1e-3)
    assert np.max(hit(50.0, 0.006)(np.arange(0, 0.2, 1e-5))) == pytest.approx(50.0, rel=1e-4)
    assert np.max(np.abs(chirp(2.0, 3.0)(t))) <= 2.0
    x = multisine(1.0)(np.arange(0, 2, 1 / 2000.0))
    assert 0.6 < np.max(np.abs(x)) < 1.4
    lines = np.abs(np.fft.rfft(x[2000:]))[:100]
    assert lines[2::2].max() < 1e-6 * lines.max()  # odd harmonics only: even ones show even nonlinearity
    v = speeds((0.5, -0.5), 4.0)(t)
    assert v[0] == 0.0 and v.max() == pytest.approx(0.5) and v.min() == pytest.approx(-0.5)


def test_certain_answers_ask_for_nothing():
    assert not needed("none", 0.97, [((), 0.97)])
    assert needed("none", 0.6, [((), 0.6)])
    assert not needed("effects", 0.99, [(("backlash@transmission",), 0.99)])
    assert needed("unknown", 0.6, [(("backlash@transmission",), 0.5)])


def test_near_equals_go_by_the_table_and_nothing_worthwhile_by_nobody():
    pair = (("backlash@transmission",), ("coulomb-friction@load",))
    sweep, levels = Item("multisine", 0.50, 90.0, pair), Item("levels", 0.49, 5.0, pair)
    assert choose((sweep, levels)).key == "levels"
    assert choose((sweep, replace(levels, expected_gain=0.3))).key == "multisine"
    assert choose((replace(sweep, expected_gain=0.01),)) is None


def test_the_lab_does_not_depend_on_the_order_of_runs(problem):
    one, other = lab_of(problem), lab_of(replace(problem, runs=problem.runs[::-1]))
    for name in (
        "daq_rate",
        "log_rate",
        "pulse",
        "force",
        "angle",
        "torque",
        "speed",
        "drives",
        "vertical",
        "ratio",
    ):
        assert getattr(one, name) == getattr(other, name)
    assert one.accelerometer.radius == other.accelerometer.radius


def test_every_planned_take_can_be_foretold(problem):
    lab = lab_of(problem)
    menu = planned(lab)
    assert {"levels", "posture", "brake", "multisine", "slow-ramp"} <= menu.keys()
    for takes in menu.values():
        for take in takes:
            found = foretell(take, lab, problem.base.start, (), problem)
            assert found is not None
            assert all(np.all(np.isfinite(y)) for y in found.outputs)


def test_levels_tell_a_cubic_spring_from_a_linear_one_better_than_one_level(problem):
    lab = lab_of(problem)
    cubic = spec_of(problem, "stiffness-nonlinearity")
    effects = (ActiveEffect(cubic, (cubic.scale(problem)[1],)),)

    def candidate(names, effects):
        where = coordinates(problem, tuple(e.spec for e in effects))
        x = where.pack(problem.base.start, effects)
        return Candidate(names, 0.5, problem.base.start, effects, where, x, 1e-4 * np.eye(where.n))

    judgement = SimpleNamespace(noise=white(problem.runs))
    both = [candidate((), ()), candidate(("stiffness-nonlinearity@transmission",), effects)]
    levels = planned(lab)["levels"]
    with ThreadPoolExecutor(1) as pool:
        many = distances(levels, lab, both, problem, judgement, pool)
        one = distances((replace(levels[2], count=20),), lab, both, problem, judgement, pool)
    assert many is not None and one is not None
    assert many[1, 0] > 2.0 * one[1, 0] > 0.0  # the base refits to one level, not to several
    assert many[0, 1] == 0.0  # the richer set holds the base and follows it


def test_hits_of_a_planned_run_forgive_gain_and_timing(problem):
    lab = lab_of(problem)
    take = planned(lab)["levels"][2]
    found = foretell(take, lab, problem.base.start, (), problem)
    noise = planned_noise(white(problem.runs), (found.run,))
    whitener = planned_whitener(found.run, noise, found.outputs)
    gained = [0.01 * (y - y[0]) for y in found.outputs]
    bent = [0.01 * np.abs(y - y[0]) for y in found.outputs]
    assert np.linalg.norm(whitener(gained)) < 0.9 * np.linalg.norm(whitener(bent))


@pytest.mark.parametrize(("followed_to", "floor"), [(3.0, ANGULAR_FLOOR), (20.0, RIGID_FLOOR)])
def test_a_planned_angle_is_modelled_as_closely_as_a_recorded_one(problem, followed_to, floor):
    """A free inertia's angle, followed to 20 Hz, keeps its wider floor in plans too."""
    run = next(r for r in problem.runs if any(o.quantity == "angle" for o in r.outputs))
    angle = replace(next(o for o in run.outputs if o.quantity == "angle"), followed_to=followed_to)
    planned_run = replace(run, outputs=(angle,))
    block = planned_noise(NoiseModel({}, 0.01, 3e-5), [planned_run]).blocks[block_key(planned_run, angle)]
    assert block.sigma == pytest.approx(floor * dynamic_level(angle))
    assert block_noise((angle,), (np.zeros(angle.data.size),), 0).sigma == pytest.approx(block.sigma, rel=1e-5)
