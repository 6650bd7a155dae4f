"""A structure of several modes: its response is their sum, they are found in the hits, and friction is none of them."""

import dataclasses
import math
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from jointscope.diagnosis.base import refit_base
from jointscope.diagnosis.candidates import residuals_of
from jointscope.diagnosis.effects import BENDS, ActiveEffect
from jointscope.diagnosis.errors import channel_errors
from jointscope.diagnosis.modal import several_bends
from jointscope.diagnosis.model_file import model_json, read_model_json
from jointscope.diagnosis.predict import free_prediction, predict_outputs
from jointscope.diagnosis.predict_file import predict_campaign
from jointscope.diagnosis.prepare import prepare
from jointscope.diagnosis.split import split_runs
from jointscope.diagnosis.superposition import modal_acceleration

MODES = ((83.0, 0.01), (140.0, 0.006), (210.0, 0.008))  # Hz, damping ratio
SHARES = ((0.5, -0.7), (-0.4, 0.3), (0.3, 0.6))  # of each mode at two places
OWN = 0.6  # of the joint's mode at the second place
RADIUS, PEAKS = 0.95, (100.0, 180.0, 260.0, 300.0)


def two_modes():
    """Frequency, damping and shares of two modes at both places, then the second place's shape."""
    return (*(number for (f, z), s in zip(MODES[:2], SHARES[:2], strict=True) for number in (f, z, *s)), OWN)


def law(modes, places):
    return next(s for s in BENDS if s.variant == f"{modes}-bends-{places}-places")


@pytest.fixture(scope="module")
def structure(builders):
    """The builders' hits with a second accelerometer, both of which see three more modes that SciPy integrates."""
    rng = np.random.default_rng(11)
    plant = builders.Plant(weight=1e-3)
    runs = []
    for run, peak in zip(hits_of(builders, plant), PEAKS, strict=True):
        stream = run.streams[0]
        t = stream.start + np.arange(stream.length) / stream.sampling_rate
        moved = [mode_of(t, peak, plant.J_L, *mode) for mode in MODES]
        (first,) = (c for c in stream.channels if c.quantity == "linear-acceleration")
        others = tuple(c for c in stream.channels if c is not first)
        places = []
        for place, own in enumerate((1.0, OWN)):
            y = own * first.samples + RADIUS * sum(s[place] * a for s, a in zip(SHARES, moved, strict=True))
            y = y + 0.01 * np.std(y) * rng.standard_normal(y.size)
            places.append(dataclasses.replace(first, column=f"a{place}", samples=y))
        stream = dataclasses.replace(stream, channels=(*others, *places))
        runs.append(dataclasses.replace(run, streams=(stream,)))
    return builders.campaign_of(runs, dataclasses.replace(builders.NAMEPLATE, plane="horizontal"))


def mode_of(t, peak, inertia, frequency, damping):
    """p'' of one mode under the builders' hit at 0.8 m [rad/s^2]."""
    w = 2.0 * math.pi * frequency

    def force(u):
        return 0.8 * peak / inertia * np.exp(-(((u - 0.1) / 0.002) ** 2))

    def rates(u, x):
        return [x[1], force(u) - 2.0 * damping * w * x[1] - w * w * x[0]]

    x = solve_ivp(
        rates, (0.0, t[-1]), [0.0, 0.0], method="DOP853", rtol=1e-9, atol=1e-12, max_step=1e-3, t_eval=t
    ).y
    return force(t) - 2.0 * damping * w * x[1] - w * w * x[0]


def hits_of(builders, plant):
    return [builders.hammer_run(plant, peak, f"hit {k}", repeat_of="hit") for k, peak in enumerate(PEAKS)]


def found_in(campaign):
    problem = prepare(campaign)
    stage = refit_base(problem, predict_outputs, split_runs(problem).estimate, ThreadPoolExecutor(1))
    return several_bends(stage, residuals_of(stage.objective, stage.predictions)), problem


def test_a_mode_answers_a_sine_by_its_accelerance():
    rate, f, frequency, damping = 8000.0, 70.0, 90.0, 0.05
    t = np.arange(int(rate)) / rate
    a = modal_acceleration(np.sin(2 * np.pi * f * t), frequency, damping, rate)[-800:]
    late = t[-800:]
    amplitude = 2.0 / late.size * abs(np.sum(a * np.exp(-2j * np.pi * f * late)))
    w, w0 = 2 * np.pi * f, 2 * np.pi * frequency
    assert amplitude == pytest.approx(abs(w**2 / (w0**2 - w**2 + 2j * damping * w0 * w)), rel=1e-3)


def test_each_place_reads_the_sum_of_the_modes(structure):
    problem = prepare(structure)
    run, theta = problem.runs[0], problem.base.start

    def read(*values):
        spec = law((len(values) - 1) // 4, 2)
        return predict_outputs(run, theta, (ActiveEffect(spec, values),), problem)

    base = predict_outputs(run, theta, (), problem)
    rows = [(f, z, *s) for (f, z), s in zip(MODES[:2], SHARES[:2], strict=True)]
    both, first, second = read(*rows[0], *rows[1], OWN), read(*rows[0], 1.0), read(*rows[1], 1.0)
    for place, own in enumerate((1.0, OWN)):
        wanted = own * base[place] + (first[place] - base[place]) + (second[place] - base[place])
        np.testing.assert_allclose(both[place], wanted, atol=1e-9 * np.max(np.abs(wanted)))
    silent = read(MODES[0][0], MODES[0][1], 0.0, 0.0, 1.0)
    np.testing.assert_allclose(silent[1], base[1], atol=1e-12 * np.max(np.abs(base[1])))


def test_the_modes_of_a_structure_are_found_in_its_hits(structure):
    (spec,), problem = found_in(structure)
    assert spec.variant == "3-bends-2-places"
    (rest,) = spec.starts(problem)
    values = [*rest[: spec.amplitude], spec.scale(problem)[1], *rest[spec.amplitude :]]
    found = sorted(tuple(values[4 * r : 4 * r + 4]) for r in range(3))
    for (f, zeta, *shares), mode, wanted in zip(found, MODES, SHARES, strict=True):
        assert f == pytest.approx(mode[0], rel=2e-3)
        assert zeta == pytest.approx(mode[1], rel=0.15)
        assert np.sign(shares).tolist() == np.sign(wanted).tolist()


@pytest.mark.parametrize("torque", [0.0, 3.0], ids=["nothing", "dry friction"])
def test_what_bends_a_peak_is_no_second_peak(builders, edited, torque):
    rng = np.random.default_rng(3)
    rubbing = builders.Plant(extra=lambda t, x: (0.0, -torque * math.tanh(x[3] / 1e-3)))

    def noisy(c):
        noise = 0.01 * np.std(c.samples) * rng.standard_normal(c.samples.size)
        return dataclasses.replace(c, samples=c.samples + noise) if c.role == "output" else c

    found, _ = found_in(builders.campaign_of([edited(run, noisy) for run in hits_of(builders, rubbing)]))
    assert found == ()


def test_the_file_brings_the_modes_back(structure):
    problem = prepare(structure)
    effect = ActiveEffect(law(2, 2), two_modes())
    content = model_json(problem, problem.base.start, (effect,))
    _, theta, (again,) = read_model_json(content, problem)
    assert again.values == effect.values
    a, b = (predict_outputs(problem.runs[1], theta, (e,), problem)[1] for e in (effect, again))
    assert np.array_equal(a, b)


@pytest.mark.parametrize("sign", [1.0, -1.0], ids=["as is", "inverted"])
def test_a_prediction_comes_in_each_sensors_own_sign_and_zero(builders, edited, plant, sign):
    """Of new recordings only the inputs are read: how a sensor counts is in the model's file."""

    def as_wired(c):
        return dataclasses.replace(c, samples=sign * c.samples + 0.4) if c.role == "output" else c

    campaign = builders.campaign_of([edited(run, as_wired) for run in hits_of(builders, plant)])
    problem = prepare(campaign)
    theta = problem.theta(stiffness=plant.K, damping=plant.c + plant.b_l, load_inertia=plant.J_L)
    made = predict_campaign(model_json(problem, theta, ()), campaign)
    for run in campaign.runs:
        for signal, (_, y) in zip(run.select(role="output"), made[run.id], strict=True):
            np.testing.assert_allclose(y[:-50], signal.samples[:-50], atol=0.1 * np.std(signal.samples))


def test_held_out_errors_know_an_inverted_sensor(builders, edited, plant):
    """The error of the base on the recordings that it was started from, one sensor reversed, is as small as ever."""

    def reversed_(c):
        return dataclasses.replace(c, samples=-c.samples) if c.role == "output" else c

    problem = prepare(builders.campaign_of([edited(run, reversed_) for run in hits_of(builders, plant)]))
    stage = refit_base(problem, predict_outputs, split_runs(problem).estimate, ThreadPoolExecutor(1))
    theta, _ = stage.fit.coordinates.unpack(stage.fit.x)
    errors = channel_errors(problem, free_prediction, (0, 1), theta, (), stage.noise)
    assert max(e.error for e in errors) < 0.02
