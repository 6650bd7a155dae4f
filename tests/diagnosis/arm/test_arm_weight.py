"""What hangs on a link beyond what the arm's file says: its torque, and where nothing can be said of it."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
import planar  # type: ignore[import-not-found]

from jointscope.diagnosis.arm.effects import arm_catalogue
from jointscope.diagnosis.arm.plant import Links
from jointscope.diagnosis.arm.predict import predict_outputs
from jointscope.diagnosis.arm.prepare import prepare_arm
from jointscope.diagnosis.arm.weight import own_weight
from jointscope.diagnosis.effects.spec import ActiveEffect

G = 9.80665


@pytest.fixture
def problem(tmp_path):
    return prepare_arm(planar.swept(tmp_path))


def laws(problem):
    return {s.variant: s for s in arm_catalogue(problem) if s.name == "gravity"}


def test_a_links_own_weight_is_that_of_its_centre_about_the_joint(problem):
    assert own_weight(problem, 0, 0) == pytest.approx(12.0 * G * 0.25, rel=1e-6)
    bent = 0.7  # rad, of the forearm at the posture
    reach = np.hypot(0.5 + 0.2 * np.cos(bent), 0.2 * np.sin(bent))
    assert own_weight(problem, 0, 1) == pytest.approx(5.0 * G * reach, rel=1e-6)
    assert own_weight(problem, 1, 1) == 0.0  # no run drives it


def test_it_adds_what_holds_that_weight_at_every_joint(problem):
    plant, both = problem.arm_runs[0].plant, np.array([True, True])
    filed = Links((0.0, 0.0), (1.0, 1.0))
    plain = plant.reduced(both, filed, None)
    loaded = plant.reduced(both, replace(filed, heavier=(1, 0.3)), None)
    np.testing.assert_allclose(loaded.gravity - plain.gravity, 0.3 * plant.weights[:, 1, :2], atol=1e-12)
    np.testing.assert_array_equal(loaded.inverse, plain.inverse)


@pytest.mark.parametrize("variant", ["own-link", "last-link"])
def test_without_a_moment_it_is_the_base(problem, variant):
    spec = laws(problem)[variant]
    (run,) = problem.runs
    base = predict_outputs(run, problem.base.start, (), problem)
    nothing = predict_outputs(run, problem.base.start, (ActiveEffect(spec, (0.0,)),), problem)
    for y, same in zip(base, nothing, strict=True):
        np.testing.assert_array_equal(y, same)


def test_hits_alone_say_nothing_of_a_weight(tmp_path):
    braked = {"a": "brake", "b": "brake"}
    times, trajectory, _, _ = planar.stepped(planar.planar_arm(tmp_path), braked, 1.2)
    hit = prepare_arm(planar.campaign_of(tmp_path, (planar.hit_run(times, trajectory, braked),)))
    assert not laws(hit)


def test_a_forearm_that_is_heavier_in_mujoco_is_that_weight_beside_its_inertia(tmp_path):
    """Three tenths of the forearm's mass more; the base weighs its inertia, the law its weight."""
    soft = planar.MJCF.replace('gainprm="60000"', 'gainprm="600"').replace("0 -60000 -2000", "0 -600 -150")
    heavier = soft.replace('mass="5" diaginertia="0.08 0.08 0.01"', 'mass="6.5" diaginertia="0.104 0.104 0.013"')
    held = {"a": "drive", "b": "drive"}
    times = np.arange(round(1.5 / planar.STEP)) * planar.STEP
    torque = 250.0 * np.sin(2.0 * np.pi * np.clip(times - 0.2, 0.0, 1.0)) ** 3
    _, trajectory, _, _ = planar.stepped(planar.planar_arm(tmp_path, heavier), held, 1.5, torque=torque)
    run = planar.driven_run(times, trajectory, held, np.zeros_like(times), "speed-motion")
    (tmp_path / "arm.xml").write_text(soft, encoding="utf-8")
    problem = replace(prepare_arm(planar.campaign_of(tmp_path, (run,))), carried=np.array([-1, 1]))
    law = laws(problem)["last-link"]
    theta = problem.base.start.copy()
    for name, value in (
        ("stiffness:a", 4e4),
        ("stiffness:b", 9e3),
        ("damping:a", 40.0),
        ("damping:b", 8.0),
        ("link_mass:b", 1.3),
    ):
        theta[problem.base.names.index(name)] = value

    offset = problem.base.names.index("torque_offset")
    balanced = theta[offset]  # holds the arm at its start without the weight

    def misfit(moment, offset_torque):
        theta[offset] = offset_torque
        return max(planar.misfit(problem, theta, (ActiveEffect(law, (moment,)),)))

    moment = 0.3 * own_weight(problem, 0, 1)
    assert misfit(moment, 0.0) < 0.5 * min(misfit(0.0, balanced), misfit(0.0, 0.0))
