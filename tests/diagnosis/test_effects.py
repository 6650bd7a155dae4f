"""The catalogue: complete, silent at its null values, and true to the contract's sign conventions."""

from __future__ import annotations

import math

import numpy as np
import pytest

from jointscope.diagnosis import kernel as k
from jointscope.diagnosis.effects import (
    DRIFT_PER_RUN,
    LATENT,
    PAYLOADS,
    REGISTRY,
    ActiveEffect,
    catalogue,
    with_run_weights,
)
from jointscope.diagnosis.effects.periodic import harmonics
from jointscope.diagnosis.predict import build, integrate, predict_outputs
from jointscope.diagnosis.prepare import prepare

CONTRACT = {
    "coulomb-friction": ("motor", "load"),
    "stribeck-friction": ("motor", "load"),
    "load-dependent-friction": ("transmission",),
    "quadratic-damping": ("load",),
    "backlash": ("transmission",),
    "stiffness-nonlinearity": ("transmission",),
    "hysteresis": ("transmission",),
    "structural-damping": ("transmission",),
    "transmission-error": ("transmission",),
    "torque-ripple": ("motor",),
    "drive-lag": ("motor",),
    "torque-gain": ("motor",),
    "gravity": ("load",),
    "payload": ("load",),
    "link-flexibility": ("load",),
    "base-compliance": ("base",),
    "neighbour-flexibility": ("neighbour",),
    "end-stop": ("load",),
    "stiffness-drift": ("transmission",),
    "external-vibration": ("base",),
    "delay": ("acquisition",),
    "clock-drift": ("acquisition",),
    "sensor-tilt": ("acquisition",),
    "sensor-resonance": ("acquisition",),
    "sensor-saturation": ("acquisition",),
    "sensor-gain": ("acquisition",),
    "torque-logging": ("acquisition",),
}
MAIN = {
    "coulomb-friction": "torque", "stribeck-friction": "torque", "load-dependent-friction": "coefficient",
    "quadratic-damping": "coefficient", "backlash": "gap", "hysteresis": "torque", "structural-damping": "loss_factor",
    "transmission-error": "amplitude", "drive-lag": "time_constant", "torque-gain": "gain", "gravity": "moment",
    "payload": "inertia", "link-flexibility": "frequency", "base-compliance": "frequency",
    "neighbour-flexibility": "frequency", "end-stop": "angle", "stiffness-drift": "rate",
    "external-vibration": "frequency", "delay": "delay", "clock-drift": "ppm", "sensor-tilt": "angle",
    "sensor-resonance": "frequency", "sensor-saturation": "level", "sensor-gain": "gain", "torque-logging": "rate",
}  # fmt: skip
ALL = (*REGISTRY, *PAYLOADS, DRIFT_PER_RUN)


def effect(problem, name, variant=None, *, size=None, location=None, run_weights=None, **values):
    """An active effect by name; parameters not given take their first start and the wanted (medium) size."""
    specs = [s for s in ALL if s.name == name and variant in (None, s.variant) and location in (None, s.location)]
    spec = specs[0] if run_weights is None else with_run_weights(specs[0], run_weights, problem)
    numbers = list(spec.starts(problem)[0])
    numbers.insert(spec.amplitude, spec.scale(problem)[1 if size is None else size])
    for i, parameter in enumerate(spec.parameters):
        numbers[i] = values.get(parameter.name, numbers[i])
    return ActiveEffect(spec, tuple(float(n) for n in numbers))


def outputs(problem, theta, *effects):
    return [y for run in problem.runs for y in predict_outputs(run, theta, effects, problem)]


def test_every_row_of_the_contract_is_there():
    assert {(s.name, s.location) for s in ALL} == {(n, at) for n, places in CONTRACT.items() for at in places}
    for spec in ALL:
        if spec.name in MAIN and spec.variant != "load-proportional":
            assert spec.parameters[0].name == MAIN[spec.name]
        assert sum(p.null is not None for p in spec.parameters) == 1
        assert spec.law and spec.revealed_by and spec.look_alikes
        assert set(spec.look_alikes) <= set(CONTRACT) - {spec.name}


def test_variants_are_distinct():
    keys = [(s.name, s.location, s.variant) for s in ALL]
    assert len(keys) == len(set(keys))


@pytest.mark.parametrize("spec", ALL, ids=lambda s: f"{s.name}@{s.location}/{s.variant}")
def test_null_is_the_base_exactly_and_sizes_move_it(spec, problem, truth):
    """Zero amplitude is the base to the last bit; medium and large ones are finite and inside the bounds."""
    if spec in (*PAYLOADS, DRIFT_PER_RUN):
        spec = with_run_weights(spec, (0.0, 1.0, 1.0), problem)
    else:
        spec = next(
            s
            for s in catalogue(problem)
            if (s.name, s.location, s.variant) == (spec.name, spec.location, spec.variant)
        )
    base = outputs(problem, truth)
    start = list(spec.starts(problem)[0])
    null = [*start[: spec.amplitude], spec.parameters[spec.amplitude].null, *start[spec.amplitude :]]
    for a, b in zip(base, outputs(problem, truth, ActiveEffect(spec, tuple(null))), strict=True):
        assert np.array_equal(a, b)
    sizes = spec.scale(problem)
    before = 0.0
    for size in sizes[1:]:
        values = [*start[: spec.amplitude], size, *start[spec.amplitude :]]
        for value, parameter in zip(values, spec.parameters, strict=True):
            assert parameter.lower <= value <= parameter.upper, parameter
        moved = outputs(problem, truth, ActiveEffect(spec, tuple(values)))
        assert all(np.isfinite(y).all() for y in moved)
        change = sum(float(np.sum((a - b) ** 2) / np.sum(b**2)) for a, b in zip(moved, base, strict=True))
        if spec.possible(problem) is None and spec.name != "end-stop":
            assert change > (
                0.0 if spec.family == "mode" else before
            )  # a strong mode moves away from the resonance
        before = change


def test_starts_fit_the_parameters(problem):
    for spec in catalogue(problem):
        for start in spec.starts(problem):
            assert len(start) == len(spec.parameters) - 1
            others = [p for i, p in enumerate(spec.parameters) if i != spec.amplitude]
            assert all(p.lower <= v <= p.upper for p, v in zip(others, start, strict=True)), (spec.name, start)


def test_out_of_reach_has_a_reason(builders, plant):
    """Hits with the brake on show nothing of the motor, of travel, or of a second clock."""
    problem = prepare(builders.campaign_of([builders.hammer_run(plant, 100.0, "a", duration=0.5)]))
    blocked = {(s.name, s.location) for s in catalogue(problem) if s.possible(problem) is not None}
    assert {
        ("coulomb-friction", "motor"), ("stribeck-friction", "motor"), ("torque-ripple", "motor"),
        ("transmission-error", "transmission"), ("drive-lag", "motor"), ("torque-gain", "motor"),
        ("delay", "acquisition"), ("clock-drift", "acquisition"), ("torque-logging", "acquisition"), ("gravity", "load"),
    } <= blocked  # fmt: skip
    assert ("backlash", "transmission") not in blocked and ("hysteresis", "transmission") not in blocked


# --- sign conventions ------------------------------------------------------------------------------------------------


def test_gap_is_total(problem, truth):
    """Without load the arm floats over `gap`, not over half of it."""
    run = problem.runs[0]
    P = build(run, truth, (effect(problem, "backlash", "free-flight", gap=2e-4),), problem).P
    edges = [k.windup(P, sign * 1e-6) for sign in (-1.0, 1.0)]
    assert edges[1] - edges[0] == pytest.approx(2e-4, rel=1e-3)


def test_friction_is_at_the_output(problem, truth):
    """Both locations count in output torque; asymmetry = (T+ - T-)/(T+ + T-)."""
    for location, first in (("motor", k.FM_PLUS), ("load", k.FL_PLUS)):
        active = effect(problem, "coulomb-friction", "asymmetric", location=location, torque=10.0, asymmetry=0.2)
        P = build(problem.runs[-1], truth, (active,), problem).P
        plus, minus = P[first], P[first + 1]
        assert (plus + minus) / 2 == pytest.approx(10.0)
        assert (plus - minus) / (plus + minus) == pytest.approx(0.2)


def sweep(problem):
    return next(run for run in problem.runs if run.mode == "observer")


def test_a_late_device_means_the_torque_acted_before_its_stamp(problem, truth):
    """delay > 0: the log is advanced, so the predicted acceleration leads the base's by the delay."""
    run = sweep(problem)
    base = predict_outputs(run, truth, (), problem)[0]
    moved = predict_outputs(run, truth, (effect(problem, "delay", delay=1e-3),), problem)[0]
    t = run.outputs[0].times
    shift = np.interp(t + 1e-3, t, base)
    middle = (t > 0.5) & (t < 1.2)
    assert np.std((moved - shift)[middle]) < 0.1 * np.std((moved - base)[middle])


def test_a_fast_clock_stretches_the_log(problem, truth):
    """ppm > 0: the stamp t (1 + ppm) was taken at t, so the lead grows with time."""
    run = sweep(problem)
    base = predict_outputs(run, truth, (), problem)[0]
    moved = predict_outputs(run, truth, (effect(problem, "clock-drift", ppm=1000.0),), problem)[0]
    t = run.outputs[0].times
    shift = np.interp(t * (1 + 1e-3), t, base)
    middle = (t > 0.5) & (t < 1.2)
    assert np.std((moved - shift)[middle]) < 0.15 * np.std((moved - base)[middle])


def test_gains_are_true_over_stated(problem, truth):
    """A sensitivity 10 % above its stated value makes records 10 % larger; a torque constant so makes torque larger."""
    hit, run = problem.runs[0], sweep(problem)
    (base,) = predict_outputs(hit, truth, (), problem)
    (more,) = predict_outputs(hit, truth, (effect(problem, "sensor-gain", "accelerometer", gain=1.1),), problem)
    np.testing.assert_allclose(more, 1.1 * base, rtol=1e-9, atol=1e-9)
    (less,) = predict_outputs(hit, truth, (effect(problem, "sensor-gain", "force", gain=1.25),), problem)
    np.testing.assert_allclose(less, base / 1.25, atol=2e-4 * np.abs(base).max())
    states = [integrate(build(run, truth, e, problem)) for e in ((), (effect(problem, "torque-gain", gain=1.1),))]
    np.testing.assert_allclose(states[1][:, k.X_TAU], 1.1 * states[0][:, k.X_TAU], rtol=1e-12)


def test_a_tilted_dc_sensor_reads_the_tilt_at_standstill(builders, plant):
    """At rest the reading is g cos(q - angle): positive tilt turns the axis towards the outside."""
    import dataclasses

    run = builders.hammer_run(plant, 0.0, "a", q0=0.4, duration=0.3)
    stream = run.streams[0]
    force, acc = stream.channels
    force = dataclasses.replace(force, samples=force.samples + 1e-9)
    acc = dataclasses.replace(acc, coupling="dc", low_cutoff=None)
    run = dataclasses.replace(run, streams=(dataclasses.replace(stream, channels=(force, acc)),))
    problem = prepare(builders.campaign_of([run]))
    (y,) = predict_outputs(
        problem.runs[0], problem.base.start, (effect(problem, "sensor-tilt", angle=0.1),), problem
    )
    np.testing.assert_allclose(y, 9.80665 * math.cos(0.4 - 0.1), rtol=1e-6)


def test_saturation_leaves_everything_below_its_level(problem, truth):
    run = problem.runs[1]
    (base,) = predict_outputs(run, truth, (), problem)
    level = 0.5 * np.abs(base).max()
    (cut,) = predict_outputs(run, truth, (effect(problem, "sensor-saturation", level=level),), problem)
    np.testing.assert_array_equal(cut, np.clip(base, -level, level))


def test_no_level_lies_far_below_what_is_read(problem):
    """A model that flies off fits quiet runs best with a sensor that reads next to nothing."""
    clip = next(s for s in catalogue(problem) if (s.name, s.variant) == ("sensor-saturation", "clip"))
    peaks = [np.abs(o.data).max() for run in problem.runs for o in run.outputs if "acceleration" in o.quantity]
    lower, upper = clip.limits(problem)["level"]
    assert lower == pytest.approx(0.4 * max(peaks))
    assert upper > max(peaks)


def test_a_compressed_accelerometer_is_cubic_below_and_clips_with_a_sharp_knee(problem, truth):
    run = problem.runs[1]
    (base,) = predict_outputs(run, truth, (), problem)
    peak = np.abs(base).max()

    def read(level, knee):
        active = effect(problem, "sensor-saturation", "compressing", level=level, knee=knee)
        return predict_outputs(run, truth, (active,), problem)[0]

    np.testing.assert_allclose(
        read(20.0 * peak, 2.0), base * (1.0 - 0.5 * (base / (20.0 * peak)) ** 2), atol=1e-5 * peak
    )
    np.testing.assert_allclose(read(0.5 * peak, 12.0), np.clip(base, -0.5 * peak, 0.5 * peak), atol=0.03 * peak)


def test_a_lifted_payload_is_an_inertia_and_a_weight(problem, truth):
    """The same as gravity's moment inertia g / percussion_radius beside the inertia, in the sweep that carries it."""
    weights = (0.0, 0.0, 1.0)
    lifted = outputs(problem, truth, effect(problem, "payload", "lifted", run_weights=weights, inertia=0.3,
                     percussion_radius=0.6))  # fmt: skip
    parts = outputs(problem, truth, effect(problem, "payload", "some-runs", run_weights=weights, inertia=0.3),
                    effect(problem, "gravity", "level", moment=0.3 * 9.80665 / 0.6))  # fmt: skip
    for one, other in zip(lifted[2:], parts[2:], strict=True):
        np.testing.assert_allclose(one, other, atol=1e-9 * np.abs(other).max())
    base = outputs(problem, truth)
    assert np.array_equal(base[0], lifted[0]) and np.array_equal(base[1], lifted[1])


def test_payload_moves_only_the_runs_that_carry_it(problem, truth, plant):
    base = outputs(problem, truth)
    loaded = outputs(problem, truth, effect(problem, "payload", run_weights=(0.0, 1.0, 0.0), inertia=0.3))
    assert np.array_equal(base[0], loaded[0]) and np.array_equal(base[2], loaded[2])
    heavy = problem.theta(**{n: truth[problem.base.names.index(n)] for n in ("stiffness", "damping", "motor_damping",
                          "load_damping")}, load_inertia=plant.J_L + 0.3)  # fmt: skip
    np.testing.assert_allclose(loaded[1], outputs(problem, heavy)[1], atol=1e-12)


def test_vibration_is_found_at_any_phase(problem, truth, builders):
    """A tone of any phase in the data is reproduced without its phase being a parameter."""
    import dataclasses

    run = problem.runs[0]
    (base,) = predict_outputs(run, truth, (), problem)
    f, amplitude = 27.3, 2.0
    active = effect(problem, "external-vibration", "torque", frequency=f, amplitude=amplitude)
    H = 0.95 * -((2 * np.pi * f) ** 2) / (1.9e5 - 3.0 * (2 * np.pi * f) ** 2 + 2j * np.pi * f * 62.0)
    for phase in (0.3, 2.9):
        t = run.outputs[0].times
        tone = np.real(amplitude * H * np.exp(1j * (2 * np.pi * f * t + phase)))
        shaken = dataclasses.replace(run, outputs=(dataclasses.replace(run.outputs[0], data=base + tone),))
        (y,) = predict_outputs(shaken, truth, (active,), problem)
        assert np.std(y - base - tone) < 0.01 * np.std(tone)


def test_every_pair_of_mechanical_effects_runs_together(problem, truth):
    """Effects combine: three at once stay finite and are not the base."""
    run = sweep(problem)
    trio = (
        effect(problem, "backlash", "free-flight"),
        effect(problem, "hysteresis", "bouc-wen"),
        effect(problem, "link-flexibility", "one-shape"),
    )
    base = predict_outputs(run, truth, (), problem)
    for combined in (trio, (*trio[:2], effect(problem, "structural-damping", "relaxation"))):
        y = predict_outputs(run, truth, combined, problem)
        assert all(np.isfinite(a).all() for a in y)
        assert not np.array_equal(y[0], base[0])


def test_an_order_and_its_harmonic_are_the_sum_that_the_law_says():
    """a sin x + h_s sin 2x + h_c cos 2x + g_s sin 3x + g_c cos 3x, x = order angle + phase, line by line."""
    a, order, phase, sine, cosine, third_sine, third_cosine = 2.0, 3.0, 0.7, 0.3, -0.4, -0.2, 0.1
    angle = np.linspace(0.0, 5.0, 101)
    x = order * angle + phase
    lines = harmonics((a, order, phase, sine, cosine, third_sine, third_cosine))
    total = sum(b * np.sin(k_ * angle + p) for b, k_, p in lines)
    second = sine * np.sin(2 * x) + cosine * np.cos(2 * x)
    third = third_sine * np.sin(3 * x) + third_cosine * np.cos(3 * x)
    np.testing.assert_allclose(total, a * np.sin(x) + second + third, atol=1e-12)
    assert harmonics((a, order, phase)) == ((a, order, phase),)


def test_a_latent_law_of_wind_up_is_a_spring_where_it_is_straight(problem, truth):
    """Nodes on a line through zero add that line's slope to K; all nodes zero are the base exactly."""
    from jointscope.diagnosis.effects.latent import node_range

    spec = next(s for s in LATENT if s.variant == "wind-up")
    low, high = node_range(problem, "transmission", "wind-up")
    extra = 5e3
    base = outputs(problem, truth)
    for a, b in zip(base, outputs(problem, truth, ActiveEffect(spec, (0.0,) * 9)), strict=True):
        assert np.array_equal(a, b)
    line = ActiveEffect(spec, tuple(float(v) for v in extra * np.linspace(low, high, 9)))
    stiffer = truth.copy()
    stiffer[0] += extra
    hit = problem.runs[0]
    (y,), (z,) = predict_outputs(hit, truth, (line,), problem), predict_outputs(hit, stiffer, (), problem)
    assert np.std(y - z) < 0.02 * np.std(z - base[0])


@pytest.mark.parametrize("spec", LATENT, ids=lambda s: f"{s.location}/{s.variant}")
def test_latent_laws_run(spec, problem, truth):
    size = spec.scale(problem)[2]
    values = tuple(size * math.sin(i) for i in range(9))
    assert all(np.isfinite(y).all() for y in outputs(problem, truth, ActiveEffect(spec, values)))
