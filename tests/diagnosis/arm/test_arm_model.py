"""The arm's reduced model against MuJoCo, against itself, and in its limits."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).parent))
import planar  # type: ignore[import-not-found]

from jointscope.diagnosis.arm import kernel
from jointscope.diagnosis.arm.effects import arm_catalogue
from jointscope.diagnosis.arm.linear import Figures, response
from jointscope.diagnosis.arm.predict import assembled, moved, predict_outputs, rest_state
from jointscope.diagnosis.arm.prepare import prepare_arm
from jointscope.diagnosis.arm.problem import ArmProblem
from jointscope.diagnosis.effects.spec import ActiveEffect

Real = NDArray[np.float64]
BRAKED = {"a": "brake", "b": "brake"}
DRIVEN = {"a": "drive", "b": "drive"}
FIGURES = {
    "stiffness:a": 40000.0, "stiffness:b": 9000.0, "damping:a": 40.0, "damping:b": 8.0, "rotor_inertia:a": 12.0,
    "rotor_inertia:b": 5.0, "motor_damping:a": 2.0, "motor_damping:b": 1.0, "drive_stiffness:b": 20000.0,
    "drive_damping:b": 800.0, "torque_offset": 0.0,
}  # fmt: skip


def true_theta(problem: ArmProblem, **changed: float) -> Real:
    """The base parameters of the simulated arm."""
    theta = problem.base.start.copy()
    for name, value in {**FIGURES, **changed}.items():
        theta[problem.base.names.index(name)] = value
    return theta


@pytest.fixture(scope="module")
def hit(tmp_path_factory: pytest.TempPathFactory) -> ArmProblem:
    folder = tmp_path_factory.mktemp("hit")
    times, trajectory, _, _ = planar.stepped(planar.planar_arm(folder), BRAKED, 1.2)
    return prepare_arm(planar.campaign_of(folder, (planar.hit_run(times, trajectory, BRAKED),)))


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> ArmProblem:
    return prepare_arm(planar.swept(tmp_path_factory.mktemp("sweep")))


@pytest.fixture(scope="module")
def far(tmp_path_factory: pytest.TempPathFactory) -> ArmProblem:
    """Joint a swings by half a radian under torque, against a soft drive."""
    folder = tmp_path_factory.mktemp("far")
    soft = planar.MJCF.replace('gainprm="60000"', 'gainprm="600"').replace("0 -60000 -2000", "0 -600 -150")
    arm = planar.planar_arm(folder, soft)
    times = np.arange(round(1.5 / planar.STEP)) * planar.STEP
    torque = 250.0 * np.sin(2.0 * np.pi * 1.0 * np.clip(times - 0.2, 0.0, 1.0)) ** 3
    _, trajectory, _, _ = planar.stepped(arm, DRIVEN, 1.5, torque=torque)
    assert np.ptp(trajectory.rotor("a")) > 0.3
    run = planar.driven_run(times, trajectory, DRIVEN, np.zeros_like(times), "speed-motion")
    return prepare_arm(planar.campaign_of(folder, (run,)))


def test_a_hit_is_what_mujoco_makes_of_it(hit: ArmProblem) -> None:
    assert max(planar.misfit(hit, true_theta(hit))) < 0.01
    assert max(planar.misfit(hit, true_theta(hit, **{"stiffness:b": 9900.0}))) > 0.1  # and not of another arm


def test_a_sweep_is_what_mujoco_makes_of_it(swept: ArmProblem) -> None:
    assert max(planar.misfit(swept, true_theta(swept))) < 0.02


def test_a_motion_is_what_mujoco_makes_of_it(far: ArmProblem) -> None:
    run = far.arm_runs[0]
    assert run.plant.moving == 0 and run.plant.mass.shape[0] > 10
    assert max(planar.misfit(far, true_theta(far))) < 0.02


def test_velocity_products_matter_in_a_motion(far: ArmProblem) -> None:
    run = far.arm_runs[0]
    still = replace(
        run, plant=replace(run.plant, product=0.0 * run.plant.product, bias=0.0 * run.plant.bias, _cache={})
    )
    whole, without = (predict_outputs(r, true_theta(far), (), far) for r in (run, still))
    assert max(float(np.std(a - b) / np.std(a)) for a, b in zip(whole, without, strict=True)) > 0.01


def test_start_values_find_the_resonances_from_a_third_off(hit: ArmProblem) -> None:
    assert hit.facts.stiffness == pytest.approx([40000.0, 9000.0], rel=0.05)


def test_every_effect_at_zero_is_the_base_exactly(hit: ArmProblem, swept: ArmProblem) -> None:
    for problem in (hit, swept):
        theta = true_theta(problem)
        base = predict_outputs(problem.runs[0], theta, (), problem)
        for spec in arm_catalogue(problem):
            values = list(spec.starts(problem)[0])
            null = spec.parameters[spec.amplitude].null
            assert null is not None
            values.insert(spec.amplitude, null)
            found = predict_outputs(problem.runs[0], theta, (ActiveEffect(spec, tuple(values)),), problem)
            for a, b in zip(base, found, strict=True):
                np.testing.assert_array_equal(a, b, err_msg=f"{spec.name}@{spec.location}")


def test_a_stiff_neighbour_is_a_rigid_one(hit: ArmProblem) -> None:
    """With joint b rigid the arm has one resonance, sqrt(K_a/M_aa), and a very stiff b comes to the same."""
    rigid = replace(hit, facts=replace(hit.facts, elastic=np.array([True, False])))
    alone = predict_outputs(hit.runs[0], true_theta(rigid), (), rigid)
    stiff = predict_outputs(hit.runs[0], true_theta(hit, **{"stiffness:b": 4e6, "damping:b": 200.0}), (), hit)
    for a, b in zip(alone, stiff, strict=True):
        assert float(np.std(a - b) / np.std(a)) < 0.02
    assembly = assembled(hit.arm_runs[0], true_theta(rigid), (), rigid)
    ringing = moved(assembly).readings[2000:, 0]
    spectrum = np.abs(np.fft.rfft(ringing - ringing.mean(), 1 << 17))
    peak = float(np.argmax(spectrum)) * hit.arm_runs[0].grid_rate / (1 << 17)
    M = float(hit.arm_runs[0].plant.mass[0, 0, 0])
    assert peak == pytest.approx(np.sqrt(40000.0 / M) / (2.0 * np.pi), rel=0.02)


def test_flexibility_of_a_rigid_neighbour_is_found_again_at_its_frequency(hit: ArmProblem) -> None:
    """The law with K_b = M_bb (2 pi f)^2 is the elastic model itself."""
    rigid = replace(hit, facts=replace(hit.facts, elastic=np.array([True, False])))
    spec = next(s for s in arm_catalogue(rigid) if s.name == "neighbour-flexibility")
    assert spec.location == "neighbour:b"
    M = float(hit.locked_inertia[1])
    frequency, ratio = np.sqrt(9000.0 / M) / (2.0 * np.pi), 8.0 / (2.0 * np.sqrt(9000.0 * M))
    found = predict_outputs(hit.runs[0], true_theta(rigid), (ActiveEffect(spec, (frequency, ratio, 1.0)),), rigid)
    for a, b in zip(predict_outputs(hit.runs[0], true_theta(hit), (), hit), found, strict=True):
        np.testing.assert_allclose(a, b, atol=1e-9 * float(np.max(np.abs(a))))


def _both_kernels(problem: ArmProblem, effects: tuple[ActiveEffect, ...]) -> tuple[Real, Real]:
    """The same run by the exact transition and by Runge-Kutta."""
    run, theta = problem.arm_runs[0], true_theta(problem)
    assembly = assembled(run, theta, effects, problem)
    table = run.plant.reduced(assembly.elastic, assembly.links, assembly.mount)
    P, kinds, x = rest_state(assembly, table)
    readings, rotor = np.empty((run.steps + 1, 2)), np.zeros(run.steps + 1)
    driven = int(np.flatnonzero(table.joints == run.driven)[0]) if run.driven >= 0 else -1
    omega = 2.0 * np.pi
    tie, rate = run.tie * omega**2, 1.4 * run.tie * omega
    kernel.travel(
        table.inverse, table.gravity, table.slope, table.product, table.motion, table.tilt, table.bias, table.static,
        table.hit, -1, 0.0, 1.0, P, kinds, driven, run.load_half, run.motor_half, tie * run.path + rate * run.path_rate,
        tie, rate, 1.0 / run.grid_rate, readings, rotor, x,
    )  # fmt: skip
    return moved(assembly).readings, readings


@pytest.mark.parametrize(
    ("name", "place", "struck", "close"),
    [
        ("backlash", "transmission:b", True, 0.02),
        ("stiffness-nonlinearity", "transmission:b", True, 0.01),
        ("coulomb-friction", "motor:a", False, 0.03),
        ("coulomb-friction", "motor:b", False, 0.03),
        ("stribeck-friction", "motor:a", False, 0.04),
    ],
)
def test_two_ways_of_stepping_agree(
    hit: ArmProblem, swept: ArmProblem, name: str, place: str, struck: bool, close: float
) -> None:
    problem = hit if struck else swept
    spec = next(s for s in arm_catalogue(problem) if s.name == name and s.location == place)
    values = list(spec.starts(problem)[0])
    values.insert(spec.amplitude, spec.scale(problem)[1])
    plain = _both_kernels(problem, ())
    size = float(np.std(plain[1]))
    assert float(np.std(plain[0] - plain[1])) < 2e-3 * size
    bent = _both_kernels(problem, (ActiveEffect(spec, tuple(values)),))
    effect = float(np.std(bent[1] - plain[1]))
    assert effect > 1e-3 * size
    assert float(np.std((bent[0] - plain[0]) - (bent[1] - plain[1]))) < max(0.1 * effect, close * size)


def test_friction_beyond_what_drives_it_is_a_brake(swept: ArmProblem) -> None:
    """A driven rotor under less than its breakaway torque stands still; so does the arm."""
    run, theta = swept.arm_runs[0], true_theta(swept)
    free = moved(assembled(run, theta, (), swept))
    assembly = assembled(run, theta, (), swept)
    assembly.P[0, kernel.COULOMB] = assembly.P[0, kernel.BREAKAWAY] = 1e4
    held = moved(assembly)
    assert float(np.max(np.abs(held.rotor))) < 1e-3 * float(np.max(np.abs(free.rotor)))
    assert float(np.std(held.readings - held.readings[0])) < 1e-2 * float(np.std(free.readings - free.readings[0]))


def test_a_drive_as_hard_as_a_brake_holds_like_one(hit: ArmProblem) -> None:
    """Each held rotor stands on its own drive's stiffness, whichever joints are elastic: k_p to infinity is a brake."""
    run, hz = hit.arm_runs[0], np.geomspace(5.0, 100.0, 40)
    stiff = np.array([1e3, 1e15])  # of the drives of a and b: the soft one must not be taken for the hard one
    figures = Figures(
        np.array([40000.0, 9000.0]), np.array([40.0, 8.0]), np.array([12.0, 5.0]), np.array([2.0, 1.0]), stiff,
        np.zeros(2),
    )  # fmt: skip
    only_b = np.array([False, True])
    held = replace(run, kinds=np.array([kernel.BRAKED, kernel.HELD]))
    braked = response(run, figures, only_b, hz)
    np.testing.assert_allclose(response(held, figures, only_b, hz), braked, rtol=1e-6)
    soft = replace(figures, drive_stiffness=stiff[::-1].copy())
    assert np.max(np.abs(response(held, soft, only_b, hz) - braked)) > 0.1 * np.max(np.abs(braked))
