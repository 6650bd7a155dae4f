"""A carriage that a drive moves to and fro: its friction from recordings whose truth is known in closed form.

The motion is chosen and the force follows from it, so that no integrator stands between the truth and the recording.
"""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from jointscope.diagnosis import assembly
from jointscope.diagnosis import held_out_detail as detail_of
from jointscope.diagnosis.base import refit_base, rewhiten
from jointscope.diagnosis.coordinates import coordinates
from jointscope.diagnosis.effects import ActiveEffect, catalogue
from jointscope.diagnosis.held_out_detail import held_out_detail
from jointscope.diagnosis.pipeline import diagnose
from jointscope.diagnosis.predict import free_prediction, inverse_force, predict_outputs
from jointscope.diagnosis.prepare import prepare
from jointscope.diagnosis.refit import least_squares
from jointscope.recordings.campaign import Campaign, Channel, Nameplate, Run, Stream

RATE = 1000.0
M, B, SIDED, T_C, ZERO = 95.0, 204.0, -0.18, 20.4, 0.3  # kg, N s/m, -, N, N


def path(duration: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Position, speed and acceleration [m, m/s, m/s^2] of smoothed runs to and fro at several speeds, pauses touched."""
    t = np.arange(int(duration * RATE)) / RATE
    phases = np.zeros(t.size)
    for k, speed in enumerate((0.04, 0.12, -0.04, -0.08, 0.08, -0.12)):
        phases += np.where((t % 6.0 >= k) & (t % 6.0 < k + 1), speed, 0.0)
    window = np.hanning(181)
    v = np.convolve(phases, window / window.sum(), mode="same")
    return np.cumsum(v) / RATE, v, np.gradient(v) * RATE


def carriage(duration: float = 9.0, *, real: bool = False, seed: int = 3, level: float = 1.0) -> Run:
    """The recording; ``real``: friction lower at creep, coloured force noise, an encoder's steps, half a sample late."""
    q, v, a = path(duration)
    rng = np.random.default_rng(seed)
    shape = np.sign(v)
    force = M * a + B * (v + SIDED * np.abs(v)) - ZERO
    if real:
        shape = np.tanh(v / 4e-4) * (1.0 - 0.15 * np.exp(-np.abs(v) / 6e-3))
        force = force + lfilter([1.0], [1.0, -0.98], 0.06 * rng.standard_normal(v.size))
        q = np.round(q / 2.5e-7) * 2.5e-7
    force = force + level * T_C * shape
    if real:
        force = np.interp(np.arange(v.size) + 0.5, np.arange(v.size), force)
    stream = Stream(
        file="carriage.csv",
        sampling_rate=RATE,
        length=v.size,
        channels=(
            Channel(column="f", quantity="force", unit="N", location="load", role="input", samples=force),
            Channel(column="x", quantity="position", unit="m", location="load", role="output", samples=q),
        ),
    )
    return Run(id="take", experiment="speed-motion", streams=(stream,), initial="estimate")


def problem_of(*runs: Run):
    rig = Nameplate(topology="single-dof", motion="translational", plane="horizontal", ground_spring=False)
    return prepare(Campaign(path=Path("carriage"), rig=rig, runs=runs))


def law(problem, variant: str):
    return next(
        s
        for s in catalogue(problem)
        if (s.name, s.variant) == ("coulomb-friction", variant) and s.location == "load"
    )


def fitted(problem, spec, start: tuple[float, ...]):
    """Parameters and effect under white weights of the innovation."""
    where = coordinates(problem, (spec,))
    with ThreadPoolExecutor(1) as pool:
        stage = refit_base(problem, predict_outputs, (0,), pool)
        theta, _ = stage.fit.coordinates.unpack(stage.fit.x)
        fit = least_squares(stage.objective, where, where.pack(theta, (ActiveEffect(spec, start),)), iterations=20)
        objective, _, _ = rewhiten(stage.objective, fit, stage.noise, 0)
        fit = least_squares(objective, where, fit.x, iterations=20)
    theta, effects = where.unpack(fit.x)
    return dict(zip(problem.base.names, theta, strict=True)), effects[0].values


def truth(problem):
    theta = problem.theta(load_inertia=M, load_damping=B, torque_offset=ZERO)
    return theta, (ActiveEffect(law(problem, "one-sided"), (T_C, SIDED)),)


def test_the_force_of_a_free_carriage_has_an_unknown_zero_and_a_fast_observer():
    problem = problem_of(carriage())
    free = {n for n, f in zip(problem.base.names, problem.base.free, strict=True) if f}
    assert free == {"load_inertia", "load_damping", "torque_offset"}
    assert assembly.observer_corner(problem.runs[0]) == assembly.RIGID_OBSERVER_HZ
    assert law(problem, "one-sided").possible(problem) is None
    assert "standstill" in law(problem, "asymmetric").possible(problem)
    gravity = [s for s in catalogue(problem) if s.name == "gravity"]
    assert all(s.possible(problem) for s in gravity)


def test_the_observer_of_a_slow_recorder_stays_within_its_rate():
    run = carriage()
    slow = replace(run.streams[0], sampling_rate=100.0)
    assert assembly.observer_corner(problem_of(replace(run, streams=(slow,))).runs[0]) == pytest.approx(4.0)


def test_one_sided_damping_ends_at_the_speeds_that_balance_the_force():
    """F = b (1 +- s) v: under a constant force the two directions end at F / b (1 + s) and F / b (1 - s)."""
    found = []
    for sign in (1.0, -1.0):
        run = carriage(6.0)
        samples = np.full(run.streams[0].length, sign * 30.0)
        force, position = run.streams[0].channels
        stream = replace(run.streams[0], channels=(replace(force, samples=samples), position))
        problem = problem_of(replace(run, streams=(stream,)))
        theta = problem.theta(load_inertia=M, load_damping=B, torque_offset=0.0)
        x = free_prediction(
            problem.runs[0], theta, (ActiveEffect(law(problem, "one-sided"), (1e-9, SIDED)),), problem
        )[0]
        found.append((x[-1] - x[-101]) / 0.1)
    assert found == pytest.approx([30.0 / (B * (1.0 + SIDED)), -30.0 / (B * (1.0 - SIDED))], rel=1e-3)


def test_the_true_model_leaves_nothing_of_the_force_nor_of_the_innovation():
    problem = problem_of(carriage())
    theta, effects = truth(problem)
    recorded, modelled = inverse_force(problem.runs[0], theta, effects, problem)
    assert np.sqrt(np.mean((recorded - modelled) ** 2) / np.mean(recorded**2)) < 0.01
    detail = held_out_detail(problem, (0,), (theta, ()), (theta, effects))
    assert detail["inverse_error"] < 0.01 < 0.1 < detail["base_inverse_error"]
    assert "20 Hz" in detail["inverse_filter"]
    assert detail["position_error"]["position@load"]["unit"] == "m"
    assert "wind_up_error" not in detail


def test_friction_is_found_to_two_percent_in_a_recording_like_a_real_one():
    """Lower friction at creep, coloured noise, encoder steps and a held command: T within 2 %, b within 5 %."""
    problem = problem_of(carriage(12.0, real=True))
    base, (torque, sided) = fitted(problem, law(problem, "one-sided"), (15.0, -0.1))
    assert torque == pytest.approx(T_C, rel=0.02)
    assert base["load_damping"] == pytest.approx(B, rel=0.05)
    assert base["load_inertia"] == pytest.approx(M, rel=0.02)
    assert sided == pytest.approx(SIDED, abs=0.02)


def test_without_friction_none_is_found():
    problem = problem_of(carriage(12.0, real=True, level=0.0))
    _, (torque, _) = fitted(problem, law(problem, "one-sided"), (5.0, -0.1))
    assert abs(torque) < 0.02 * T_C


def test_a_slow_observer_weighs_creep_and_reversals_more():
    """The corner is what keeps the estimate near the plateau: at a joint's 3 Hz the same recording gives more bias."""
    problem = problem_of(carriage(12.0, real=True))
    _, (fast, _) = fitted(problem, law(problem, "one-sided"), (15.0, -0.1))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(assembly, "RIGID_OBSERVER_HZ", 3.0)
        slow_problem = problem_of(carriage(12.0, real=True))
        _, (slow, _) = fitted(slow_problem, law(slow_problem, "one-sided"), (15.0, -0.1))
    assert abs(fast - T_C) < abs(slow - T_C)
    assert math.isfinite(slow)


def test_the_noise_of_the_forces_log_is_no_physics():
    """An accelerometer finer than the force's log shows that log's noise in everything the force explains: nothing is missing."""
    noise, rng, t = 0.15, np.random.default_rng(11), np.arange(6000) / RATE
    w = 2.0 * math.pi * np.array([0.5, 1.3, 3.1])[:, None]
    runs = []
    for k in range(4):
        size = (1.0 + 0.3 * k) * np.array([0.05, 0.02, 0.004])[:, None]
        q, v, a = (
            np.sum(x, axis=0)
            for x in (size * np.sin(w * t), size * w * np.cos(w * t), -size * w**2 * np.sin(w * t))
        )
        samples = {
            "f": M * a + B * v + noise * rng.standard_normal(t.size),
            "x": q + 1e-6 * rng.standard_normal(t.size),
            "a": a + 0.5 * noise / M * rng.standard_normal(t.size),
        }
        run = carriage(6.0)
        force, position = run.streams[0].channels
        accelerometer = replace(position, column="a", quantity="acceleration", unit="m/s^2")
        channels = tuple(replace(c, samples=samples[c.column]) for c in (force, position, accelerometer))
        runs.append(replace(run, id=f"take{k}", streams=(replace(run.streams[0], channels=channels),)))
    problem = problem_of(*runs)
    assert problem.runs[0].load.noise == pytest.approx(noise, rel=0.1)
    with ThreadPoolExecutor(1) as pool:
        assert diagnose(problem, predict_outputs, catalogue(problem), pool).decision.verdict == "none"


def test_a_settled_sensor_does_not_remember_the_noise_of_the_forces_first_sample():
    """An ac-coupled sensor has settled at rest: had it settled at the first sample, its error would take seconds to go."""
    t = np.arange(3000) / RATE
    push = np.where(t > 0.5, 20.0 * np.sin(2.0 * math.pi * 3.0 * (t - 0.5)), 0.0)
    predicted = []
    for first in (0.0, 5.0):
        force, position = carriage(3.0).streams[0].channels
        channels = (
            replace(force, samples=push + first * (t == 0.0)),
            replace(position, samples=np.zeros(t.size)),
            replace(
                position, column="a", quantity="acceleration", unit="m/s^2", coupling="ac", low_cutoff=0.2,
                samples=push / M,
            ),
        )  # fmt: skip
        stream = replace(carriage(3.0).streams[0], channels=channels, length=t.size)
        run = replace(carriage(3.0), streams=(stream,), initial="rest")
        problem = problem_of(run)
        prepared = problem.runs[0]
        which = next(i for i, o in enumerate(prepared.outputs) if o.quantity == "acceleration")
        predicted.append(predict_outputs(prepared, problem.theta(load_inertia=M), (), problem)[which])
    quiet, spiked = predicted
    assert spiked[100:] == pytest.approx(quiet[100:], abs=0.02 * 5.0 / M)


def test_a_decay_with_its_drive_off_has_no_inverse_error(monkeypatch):
    """Of no force nothing is a share: a free pendulum among the held-out runs had ended in a division by zero."""
    forces = iter([(np.zeros(9), np.ones(9)), (np.full(9, 2.0), np.ones(9))])
    monkeypatch.setattr(detail_of, "inverse_force", lambda *_: next(forces))
    assert math.isnan(detail_of._inverse(None, ((), ()), None))
    assert detail_of._inverse(None, ((), ()), None) == 0.5
