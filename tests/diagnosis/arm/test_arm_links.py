"""Links whose inertia is another than the file says, what they carry, and the mount under them."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
import planar  # type: ignore[import-not-found]

from jointscope.diagnosis.arm.effects import arm_catalogue, arm_payloads
from jointscope.diagnosis.arm.geometry import arm_facts
from jointscope.diagnosis.arm.plant import Links, Mount
from jointscope.diagnosis.arm.predict import predict_outputs
from jointscope.diagnosis.arm.prepare import prepare_arm
from jointscope.diagnosis.effects.spec import ActiveEffect
from jointscope.errors import InputError
from jointscope.models.arm.reference import mounted_reference

BRAKED = {"a": "brake", "b": "brake"}
POSTURES = ({"a": 0.0, "b": 0.0}, {"a": 0.4, "b": -1.1})
FILED = Links((0.0, 0.0), (1.0, 1.0))


def hits(folder, mjcf, stated=planar.MJCF, count=1):
    """Prepared hits of ``mjcf``, by the model ``stated``."""
    times, trajectory, _, _ = planar.stepped(planar.planar_arm(folder, mjcf), BRAKED, 1.2)
    run = planar.hit_run(times, trajectory, BRAKED)
    (folder / "arm.xml").write_text(stated, encoding="utf-8")
    runs = tuple(replace(run, id=str(k)) for k in range(count))
    return prepare_arm(planar.campaign_of(folder, runs))


@pytest.fixture
def reference(tmp_path):
    return mounted_reference(planar.planar_arm(tmp_path), np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0]))


@pytest.mark.parametrize("posture", POSTURES)
def test_the_links_shares_make_up_the_whole(reference, posture):
    np.testing.assert_allclose(reference.shares(posture).sum(axis=0), reference.mass_matrix(posture), atol=1e-8)
    np.testing.assert_allclose(reference.weights(posture).sum(axis=0), reference.gravity(posture), atol=1e-8)


def test_a_mount_that_turns_carries_the_arm_about_its_axis(reference):
    """Upright: I + m z^2 of both bodies about the origin, and m z for its slide."""
    M = reference.mass_matrix(POSTURES[0])
    assert M[2, 2] == pytest.approx(0.3 + 12.0 * 0.25**2 + 0.08 + 5.0 * 0.7**2, rel=1e-6)
    assert M[3, 3] == pytest.approx(17.0, rel=1e-6)
    assert M[2, 3] == pytest.approx(12.0 * 0.25 + 5.0 * 0.7, rel=1e-6)
    np.testing.assert_allclose(M[:2, 2], M[:2, 0], rtol=1e-6)  # joint a turns about the same axis here


def test_inertia_about_a_links_own_joint_is_added_where_the_link_turns(tmp_path):
    plant = hits(tmp_path, planar.MJCF).arm_runs[0].plant
    both = np.array([True, True])
    filed = np.linalg.inv(plant.reduced(both, FILED, None).inverse[0])
    heavier = np.linalg.inv(plant.reduced(both, Links((0.0, 0.1), (1.0, 1.0)), None).inverse[0])
    np.testing.assert_allclose(heavier - filed, 0.1 * np.ones((2, 2)), atol=1e-9)
    scaled = np.linalg.inv(plant.reduced(both, Links((0.0, 0.0), (1.0, 1.3)), None).inverse[0])
    np.testing.assert_allclose(scaled - filed, 0.3 * plant.shares[0, 1, :2, :2], atol=1e-9)


def test_a_heavier_forearm_is_weighed(tmp_path):
    """Simulated with 0.05 kg m^2 more in the forearm; the model with that added is as near as the true file's."""
    heavy = planar.MJCF.replace('diaginertia="0.08 0.08 0.01"', 'diaginertia="0.13 0.13 0.01"')
    problem = hits(tmp_path, heavy)
    b = problem.base.names.index("link_inertia:b")
    assert problem.base.free[b]
    theta = problem.base.start.copy()
    for name, value in (
        ("stiffness:a", 40000.0),
        ("stiffness:b", 9000.0),
        ("damping:a", 40.0),
        ("damping:b", 8.0),
    ):
        theta[problem.base.names.index(name)] = value

    def misfit(added):
        theta[b] = 1.0 + added / problem.locked_inertia[1]
        return max(planar.misfit(problem, theta))

    assert misfit(0.05) < 0.01 < 0.1 < misfit(0.0)


def test_a_mount_as_stiff_as_rock_is_none(tmp_path):
    problem = hits(tmp_path, planar.MJCF)
    mass = problem.arm_runs[0].plant.mass[0]
    spec = next(s for s in arm_catalogue(problem) if s.name == "base-compliance")
    alone = predict_outputs(problem.runs[0], problem.base.start, (), problem)
    stiff = ActiveEffect(spec, (1e4, 0.05, 0.2, 0.0))
    soft = ActiveEffect(spec, (15.0, 0.05, 0.2, 0.0))
    for y, rigid, moves in zip(
        alone,
        predict_outputs(problem.runs[0], problem.base.start, (stiff,), problem),
        predict_outputs(problem.runs[0], problem.base.start, (soft,), problem),
        strict=True,
    ):
        assert np.std(y - rigid) < 0.01 * np.std(y) < np.std(y - moves)
    lever = np.array([1.0, 0.2])
    table = problem.arm_runs[0].plant.reduced(np.array([True, True]), FILED, Mount(0.2, 0.5))
    assert np.linalg.inv(table.inverse[0])[2, 2] == pytest.approx(1.5 * lever @ mass[2:, 2:] @ lever)


def test_what_the_last_link_carries_acts_in_the_loaded_runs_only(tmp_path):
    problem = hits(tmp_path, planar.MJCF, count=2)
    (light,) = arm_payloads(problem)
    loaded = ActiveEffect(replace(light, run_weights=(0.0, 1.0)), (0.1,))
    theta = problem.base.start
    (empty, full) = (predict_outputs(run, theta, (loaded,), problem) for run in problem.runs)
    for y, same, other in zip(predict_outputs(problem.runs[0], theta, (), problem), empty, full, strict=True):
        np.testing.assert_array_equal(y, same)
        assert np.std(y - other) > 0.05 * np.std(y)
    j, plant = problem.facts.tested, problem.arm_runs[0].plant
    more = 0.1 / plant.shares[0, 1, j, j]
    both = np.array([True, True])
    M = np.linalg.inv(plant.reduced(both, replace(FILED, carried=(more, 0.0)), None).inverse[0])
    filed = np.linalg.inv(plant.reduced(both, FILED, None).inverse[0])
    assert (M - filed)[j, j] == pytest.approx(0.1)


@pytest.mark.parametrize("name", ["b_flex", "spring_of_b", "q7"])
def test_a_spring_behind_a_rotor_is_its_reducer_whatever_its_name(tmp_path, name):
    path = tmp_path / "arm.xml"
    mjcf = planar.MJCF.replace("b_elastic", name)
    times, trajectory, _, _ = planar.stepped(planar.planar_arm(tmp_path), BRAKED, 0.4)
    path.write_text(mjcf, encoding="utf-8")
    facts = arm_facts(planar.campaign_of(tmp_path, (planar.hit_run(times, trajectory, BRAKED),)))
    assert facts.joints == ("a", "b") and facts.elastic.all()
    assert facts.stiffness == pytest.approx([40000.0, 9000.0]) and facts.damping == pytest.approx([40.0, 8.0])


@pytest.mark.parametrize(("stiffness", "elastic"), [(9000.0, True), (20.0, False)])
def test_a_hinge_on_a_spring_is_elastic_and_a_balancer_is_none(tmp_path, stiffness, elastic):
    times, trajectory, _, _ = planar.stepped(planar.planar_arm(tmp_path), BRAKED, 0.4)
    alone = planar.MJCF.replace('<joint name="b_elastic" axis="0 1 0" stiffness="9000" damping="8"/>', "")
    alone = alone.replace('name="b" axis="0 1 0"', f'name="b" axis="0 1 0" stiffness="{stiffness}"')
    (tmp_path / "arm.xml").write_text(alone, encoding="utf-8")
    facts = arm_facts(planar.campaign_of(tmp_path, (planar.hit_run(times, trajectory, BRAKED),)))
    assert facts.joints == ("a", "b") and bool(facts.elastic[1]) is elastic
    assert facts.stiffness[1] == (stiffness if elastic else 0.0)


def test_a_hinge_without_a_name_is_refused_in_one_line(tmp_path):
    times, trajectory, _, _ = planar.stepped(planar.planar_arm(tmp_path), BRAKED, 0.4)
    nameless = planar.MJCF.replace('<joint name="b_elastic" ', "<joint ")
    (tmp_path / "arm.xml").write_text(nameless, encoding="utf-8")
    with pytest.raises(InputError, match=r"arm\.xml.*without a name.*name every joint"):
        arm_facts(planar.campaign_of(tmp_path, (planar.hit_run(times, trajectory, BRAKED),)))
