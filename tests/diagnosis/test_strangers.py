"""Physics outside the contract's table: silent where it is nothing, and what each law says."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from jointscope.diagnosis import kernel as k
from jointscope.diagnosis.acquisition import cold_drag, heated, relaxing_pull
from jointscope.diagnosis.effects import REGISTRY, STRANGERS, ActiveEffect, at_rig
from jointscope.diagnosis.predict import predict_outputs


def outputs(problem, theta, *effects):
    return [y for run in problem.runs for y in predict_outputs(run, theta, effects, problem)]


def stranger(problem, name, variant, *values):
    spec = next(at_rig(s, problem) for s in STRANGERS if (s.name, s.variant) == (name, variant))
    return ActiveEffect(spec, values)


@pytest.mark.parametrize("spec", STRANGERS, ids=lambda s: f"{s.name}/{s.variant}")
def test_physics_outside_the_table_is_finite_and_moves_something(spec, problem, truth):
    """At its medium size; none bears the name of an effect of the contract."""
    assert spec.name not in {listed.name for listed in REGISTRY}
    spec = at_rig(spec, problem)
    start = list(spec.starts(problem)[0])
    size = spec.scale(problem)[2] / (10.0 if spec.name == "brake-slip" else 1.0)
    start.insert(spec.amplitude, size)
    base, moved = outputs(problem, truth), outputs(problem, truth, ActiveEffect(spec, tuple(start)))
    assert all(np.isfinite(y).all() for run in moved for y in run)
    if spec.possible(problem) is None:
        assert any(
            np.abs(a - b).max() > 0.0 for x, y in zip(base, moved, strict=True) for a, b in zip(x, y, strict=True)
        )


def test_a_brake_that_never_slips_is_a_held_motor(problem, truth):
    """Above every torque nothing moves."""
    base = outputs(problem, truth)
    held = outputs(problem, truth, stranger(problem, "brake-slip", "dry", 1e3 * problem.scales.torque))
    for a, b in zip(base, held, strict=True):
        for x, y in zip(a, b, strict=True):
            assert np.abs(x - y).max() < 1e-3 * max(np.abs(x).max(), 1e-9)


def test_a_motor_that_warms_loses_its_torque_by_the_torque_squared():
    """At a constant torque u the constant falls by share (u/u_0)^2 (1 - exp(-t/T)); cold, and without a share, by nothing."""
    rate, t = 1000.0, np.arange(3000) / 1000.0
    for u in (20.0, -35.0):
        lost = 1.0 - heated(np.full(t.size, u), 50.0, 0.3, 0.8, rate) / u
        expected = 0.3 * (u / 50.0) ** 2 * (1.0 - np.exp(-t / 0.8))
        assert np.max(np.abs(lost - expected)) < 2e-3 * expected[-1]
    assert np.array_equal(heated(np.full(t.size, 5.0), 50.0, 0.0, 0.8, rate), np.full(t.size, 5.0))


@pytest.mark.parametrize("speed", [True, False])
def test_cold_grease_drags_less_the_more_it_was_worked(speed):
    """At a constant speed v by c exp(-(v/v_0)^2 t/T) v, v_0 half of the largest; read from an angle as from a speed."""
    rate, v, c, T = 500.0, -0.8, 40.0, 1.5
    t = np.arange(2001) / (2.0 * rate)
    observed = np.full(t.size, v) if speed else v * t
    run = SimpleNamespace(grid_rate=rate, observed_half=observed, observed=SimpleNamespace(rate_signal=speed))
    problem = SimpleNamespace(scales=SimpleNamespace(motor_speed=2.0))
    drag = cold_drag(SimpleNamespace(run=run, problem=problem, chain=SimpleNamespace(thinning=(c, T))))
    np.testing.assert_allclose(drag, c * np.exp(-(v**2) * t / T) * v, rtol=1e-3)


def test_a_dress_pack_pulls_by_a_spring_and_its_cube():
    """At the table's nodes exactly; nothing where it hangs free, and as much to either side."""
    spec = next(s for s in STRANGERS if s.name == "dress-pack")
    scales = SimpleNamespace(angle_low=-0.4, angle_high=0.6)
    packed = SimpleNamespace(P=np.zeros(k.N_P), S=np.zeros(k.N_S, dtype=np.int64))
    packed.problem = SimpleNamespace(scales=scales)
    spec.apply(packed, (12.0, 0.3, 0.1), 0.0)
    turned = np.linspace(-0.4, 0.6, k.N_NODES)
    found = np.array([k.tabled(packed.P, angle) for angle in turned])
    np.testing.assert_allclose(
        found, -12.0 * (turned - 0.1) * (0.7 + 0.3 * (2.0 * (turned - 0.1)) ** 2), atol=1e-12
    )
    assert found[k.N_NODES // 2] == pytest.approx(0.0, abs=1e-12)
    assert found[::-1] == pytest.approx(-found)


@pytest.mark.parametrize("speed", [True, False])
def test_a_spring_that_lets_go_pulls_no_more_than_a_damper_does(speed):
    """Turned at a constant speed v by k v T (1 - exp(-t/T)), T its time constant; read from an angle as from a speed."""
    rate, v, stiffness, T = 500.0, -0.8, 40.0, 0.5
    t = np.arange(2001) / (2.0 * rate)
    observed = np.full(t.size, v) if speed else 0.3 + v * t
    run = SimpleNamespace(grid_rate=rate, observed_half=observed, observed=SimpleNamespace(rate_signal=speed))
    pull = relaxing_pull(SimpleNamespace(run=run, chain=SimpleNamespace(relaxing=(stiffness, T))))
    expected = stiffness * v * T * (1.0 - np.exp(-t / T))
    assert np.max(np.abs(pull - expected)) < 3e-3 * abs(expected[-1])
