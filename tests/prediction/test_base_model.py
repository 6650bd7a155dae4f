"""Laws of a whole run's prediction: closed forms, equilibrium, what may be read, open and closed loops, bands."""

import math
from dataclasses import replace

import numpy as np
import pytest

from jointscope.errors import RefusedError
from jointscope.identification.drive_law import Drive
from jointscope.identification.model_file import BaseModel, Term, joint_values
from jointscope.models.joint import hammer_accelerance
from jointscope.prediction.base_model import outputs_of, predict_run
from jointscope.prediction.closed_form import acceleration_per_torque, predicted_spectrum
from jointscope.prediction.closed_loop import LARGEST_SHARE, SMALLEST_SHARE, law_share
from jointscope.prediction.drift import resting_offset
from jointscope.prediction.spectra import spectrum
from jointscope.prediction.uncertainty import parameter_bands
from jointscope.recordings.campaign import Nameplate

RATE = 1024.0
T = np.arange(4096) / RATE


def pulse(centre=0.3, width=0.004):
    return np.exp(-0.5 * ((T - centre) / width) ** 2)


def hit(bench, peak=400.0, **extra):
    channels = (
        bench.channel("force", "arm", "input", peak * pulse(), column="F", radius=0.8),
        bench.channel("linear-acceleration", "arm", "output", column="a", radius=0.95),
    )
    return bench.run("hammer", bench.stream(RATE, *channels, length=T.size), brake=True, **extra)


def swept(bench, torque, *outputs, rate=RATE, id="sweep", **extra):
    declared = outputs or (bench.channel("angular-acceleration", "arm", "output", column="a"),)
    inputs = bench.channel("torque", "motor", "input", torque, column="T")
    return bench.run("torque-sweep", bench.stream(rate, inputs, *declared), id=id, **extra)


def test_a_hit_follows_the_hammer_closed_form(bench):
    model = bench.model(bench.horizontal())
    predicted = predict_run(model, hit(bench), declared=True).channels[0].values
    f = np.array([5.0, 20.0, 40.0, 60.0])
    kernel = np.exp(-2j * np.pi * np.outer(f, T))
    ratio = (kernel @ predicted) / (kernel @ (0.8 * 400.0 * pulse()))
    expected = 0.95 * hammer_accelerance(model.as_joint(), 2j * np.pi * f)
    assert np.abs(ratio / expected - 1.0) == pytest.approx(0.0, abs=1e-5)


def test_a_sweep_s_spectrum_is_the_paper_s_product(bench):
    """(11): far from its ends a torque's spectrum times eta n G_a is the acceleration's spectrum."""
    model = bench.model(bench.horizontal())
    torque = 0.5 * np.sin(2 * np.pi * (4.0 * T + 10.0 * T**2)) * np.sin(np.pi * T / T[-1]) ** 2
    run = swept(bench, torque)
    timed = spectrum(predict_run(model, run, declared=True).channels[0].values, RATE, "boxcar")
    product = predicted_spectrum(model, spectrum(torque, RATE, "boxcar"))
    band = timed.band(10.0, 75.0)
    assert np.abs(timed.amplitude[band] / product.amplitude[band] - 1.0) == pytest.approx(0.0, abs=2e-3)


def test_twice_the_torque_is_twice_the_motion_without_gravity(bench):
    model = bench.model(bench.horizontal())
    one, two = (
        predict_run(model, swept(bench, k * pulse()), declared=True).channels[0].values for k in (1.0, 2.0)
    )
    assert two == pytest.approx(2.0 * one, abs=1e-9)


@pytest.mark.parametrize("q", [-1.0, 0.0, 0.9])
def test_the_holding_torque_holds_the_arm_and_a_dc_sensor_reads_gravity(bench, q):
    hold = 12.0 * 9.80665 * 0.4 * math.cos(q) / (0.7 * 141.0)
    outputs = (
        bench.channel("linear-acceleration", "arm", "output", column="a", radius=0.95),
        bench.channel("angle", "arm", "output", column="q"),
    )
    run = swept(bench, np.full(1024, hold), *outputs, arm_angle=q)
    a, angle = predict_run(bench.model(), run, declared=True).channels
    assert a.values == pytest.approx(9.80665 * math.cos(q), abs=1e-3)
    assert angle.values == pytest.approx(q, abs=1e-4)


def test_what_a_sensor_recorded_does_not_change_what_is_predicted(bench, rng):
    """An output is never read: noise in its place gives the same prediction, bit for bit."""
    a = bench.channel("linear-acceleration", "arm", "output", column="a", radius=0.95)
    recorded = replace(a, samples=rng.standard_normal(T.size))
    torque = 0.1 * pulse()
    without = predict_run(bench.model(), swept(bench, torque, a), declared=True).channels[0].values
    with_noise = predict_run(bench.model(), swept(bench, torque, recorded)).channels[0].values
    assert np.array_equal(without, with_noise)


def test_undeclared_outputs_are_left_out_unless_asked_for(bench):
    run = hit(bench)
    assert outputs_of(run) == ()
    assert len(outputs_of(run, declared=True)) == 1
    assert predict_run(bench.model(), run).channels == ()


def test_a_log_at_another_rate_and_clock_predicts_the_same(bench):
    model = bench.model(bench.horizontal())

    def torque(t):
        return 0.5 * np.exp(-0.5 * ((t - 1.0) / 0.1) ** 2) * np.sin(2 * np.pi * 60.0 * t)

    slow = 0.0137 + np.arange(1990) / 500.0
    a = bench.channel("angular-acceleration", "arm", "output", column="a")
    together = bench.run(
        "torque-sweep", bench.stream(RATE, bench.channel("torque", "motor", "input", torque(T)), a)
    )
    apart = bench.run(
        "torque-sweep",
        bench.stream(500.0, bench.channel("torque", "motor", "input", torque(slow)), start=0.0137),
        bench.stream(RATE, a, length=T.size),
    )
    one, two = (predict_run(model, run, declared=True).channels[0].values for run in (together, apart))
    assert np.max(np.abs(one - two)) < 1e-4 * np.max(np.abs(one))


def test_a_channel_whose_file_is_empty_is_predicted_over_the_inputs_span(bench):
    run = bench.run(
        "torque-sweep",
        bench.stream(500.0, bench.channel("torque", "motor", "input", np.zeros(1000))),
        bench.stream(RATE, bench.channel("angular-acceleration", "arm", "output"), length=0),
    )
    channel = predict_run(bench.model(bench.horizontal()), run, declared=True).channels[0]
    assert channel.times[-1] == pytest.approx(999 / 500.0, abs=1.0 / RATE)


def test_a_mass_on_a_slide_obeys_newton(bench):
    """Single dof, translational, no spring: a = F/m minus drag."""
    rig = Nameplate(topology="single-dof", motion="translational", plane="horizontal", ground_spring=False)
    model = BaseModel(rig=rig, joint=joint_values(rig, load_inertia=95.0, load_damping=0.0), input_unit="N")
    force = bench.channel("force", "load", "input", 50.0 * pulse(), column="F")
    outputs = (
        bench.channel("acceleration", "load", "output", column="a"),
        bench.channel("velocity", "load", "output", column="v"),
    )
    run = bench.run("free", bench.stream(RATE, force, *outputs))
    a, v = predict_run(model, run, declared=True).channels
    assert a.values == pytest.approx(50.0 / 95.0 * pulse(), abs=1e-6)
    assert v.values[-1] == pytest.approx(50.0 / 95.0 * 0.004 * math.sqrt(2 * math.pi), rel=1e-6)


def test_a_prescribed_motion_predicts_the_force_that_it_needs(bench):
    """Ground spring, position as input: F = m x'' + c x' + k x."""
    rig = Nameplate(topology="single-dof", motion="translational", plane="horizontal", ground_spring=True)
    values = joint_values(rig, load_inertia=2.0, stiffness=5e4, damping=10.0)
    model = BaseModel(rig=rig, joint=values, input_unit="N")
    w = 2 * np.pi * 11.0
    x = 1e-3 * np.sin(w * T) * np.sin(np.pi * T / T[-1]) ** 2
    inputs = bench.channel("position", "load", "input", x, column="x")
    output = bench.channel("force", "load", "output", column="F")
    force = predict_run(model, bench.run("free", bench.stream(RATE, inputs, output)), declared=True).channels[0]
    rate, acceleration = (np.gradient(x, T, edge_order=2), np.gradient(np.gradient(x, T), T))
    inner = slice(50, -50)
    expected = 2.0 * acceleration + 10.0 * rate + 5e4 * x
    assert force.values[inner] == pytest.approx(expected[inner], abs=0.02 * np.max(np.abs(expected)))


def test_modes_in_parallel_add_up(bench):
    """Two equal terms of twice the inertia, stiffness and damping are one joint of the single values, braked."""
    model = bench.model(bench.horizontal(load_damping=0.0))
    double = Term(inertia=2 * 3.02, damping=2 * 59.76, stiffness=2 * 193_665.0)
    pair = replace(model, terms=(double, double))
    one, two = (predict_run(m, hit(bench), declared=True).channels[0].values for m in (model, pair))
    assert two == pytest.approx(one, abs=1e-6 * np.max(np.abs(one)))


def test_the_parallel_closed_form_is_the_sum_of_its_terms(bench):
    model = bench.model()
    f = np.linspace(1.0, 80.0, 50)
    single = replace(model, terms=(Term(inertia=3.02, damping=59.76, stiffness=193_665.0),))
    assert acceleration_per_torque(single, f) == pytest.approx(acceleration_per_torque(model, f))


def test_an_unknown_motor_inertia_is_refused_where_it_matters_only(bench):
    rig = bench.horizontal(motor_inertia=None, reducer_inertia=None)
    model = bench.model(rig)
    assert predict_run(model, hit(bench), declared=True).channels
    with pytest.raises(RefusedError, match="motor_inertia"):
        predict_run(model, swept(bench, pulse()), declared=True)


def test_bands_grow_with_the_covariance_and_vanish_without(bench):
    model, run = bench.model(bench.horizontal()), hit(bench)
    plain = predict_run(model, run, declared=True)
    assert parameter_bands(model, run, plain, declared=True)[0].deviations.size == 0

    def band(sd):
        sure = replace(model, parameters=("stiffness",), covariance=np.array([[sd**2]]))
        return parameter_bands(sure, run, plain, declared=True)[0].standard_deviation

    assert band(20.0) == pytest.approx(2.0 * band(10.0), rel=1e-3, abs=1e-7)


def test_a_band_is_the_scatter_of_predictions_over_draws(bench, rng):
    covariance = np.array([[80.0**2, 0.3 * 80.0 * 0.002], [0.3 * 80.0 * 0.002, 0.002**2]])
    model = replace(
        bench.model(bench.horizontal()), parameters=("stiffness", "load_inertia"), covariance=covariance
    )
    run = hit(bench)
    central = predict_run(model, run, declared=True)
    band = parameter_bands(model, run, central, declared=True)[0].standard_deviation
    # draws made to have exactly the stated covariance, so that a few of them are as good as thousands
    unit = rng.standard_normal((12, 2))
    unit -= unit.mean(axis=0)
    unit = unit @ np.linalg.inv(np.linalg.cholesky(unit.T @ unit / 12)).T
    drawn = []
    for step in unit @ np.linalg.cholesky(covariance).T:
        values = {name: model.joint[name] + float(d) for name, d in zip(model.parameters, step, strict=True)}
        moved = replace(model, joint={**model.joint, **values})
        drawn.append(predict_run(moved, run, declared=True).channels[0].values)
    strong = band > 0.3 * band.max()
    assert np.median(np.std(drawn, axis=0)[strong] / band[strong]) == pytest.approx(1.0, abs=0.02)


def test_an_offset_is_found_in_the_rest_before_the_motion(rng):
    noise = 0.002 * rng.standard_normal(1500)
    motion = np.where(np.arange(1500) > 100, np.sin(0.05 * np.arange(1500)), 0.0)
    offset, error = resting_offset(0.42 + 0.01 + motion + noise, 0.42)
    assert offset == pytest.approx(0.01, abs=4 * error)
    assert error < 0.0004
    nothing, _ = resting_offset(0.42 + motion + noise, 0.42)
    assert nothing == 0.0


def test_a_difference_too_large_for_an_offset_is_left_alone(rng):
    log = 0.52 + 0.002 * rng.standard_normal(1500)
    assert resting_offset(log, 0.42)[0] == 0.0


def test_an_open_loop_that_drifts_states_where_it_holds(bench, rng):
    """Held above the horizontal by its logged torque alone, an arm falls by any offset; a hanging one swings back."""
    t = np.arange(2400) / 500.0
    shake = 0.1 * np.sin(2 * np.pi * 20.0 * t) * (t > 0.2) + 0.002 * rng.standard_normal(t.size)
    a = bench.channel("angular-acceleration", "arm", "output", column="a")

    def predicted(q):
        hold = 12.0 * 9.80665 * 0.4 * math.cos(q) / (0.7 * 141.0)
        return predict_run(bench.model(), swept(bench, hold + shake, a, rate=500.0, arm_angle=q), declared=True)

    up, down = predicted(1.0), predicted(-1.0)
    assert up.legitimate[0] > 0.5
    assert "open loop" in up.notes[0]
    assert down.legitimate[0] == 0.0
    assert down.notes == ()


@pytest.mark.parametrize(
    ("residual", "noise", "share"),
    [
        (0.001, 0.001, LARGEST_SHARE),
        (0.1, 0.001, SMALLEST_SHARE),
        (0.0, 0.0, LARGEST_SHARE),
        (0.1, 0.0, SMALLEST_SHARE),
    ],
)
def test_the_law_s_share_follows_what_it_leaves_unexplained(residual, noise, share):
    drive = Drive(proportional=0.08, integral=1.6, residual=residual, log_noise=noise)
    assert law_share(drive) == share


def test_the_law_s_share_falls_steadily():
    shares = [
        law_share(Drive(proportional=1.0, integral=1.0, residual=r, log_noise=1.0)) for r in (1.3, 2.0, 4.0, 8.0)
    ]
    assert shares == sorted(shares, reverse=True)
