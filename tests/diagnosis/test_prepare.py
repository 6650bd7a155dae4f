"""A campaign becomes the same problem whatever its names and order, from any subset of channels, from rough values."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import replace

import numpy as np
import pytest

from jointscope.diagnosis.channels import high_pass
from jointscope.diagnosis.effects import ActiveEffect, catalogue
from jointscope.diagnosis.noise import quantum
from jointscope.diagnosis.parameters import AGE
from jointscope.diagnosis.predict import free_prediction, inverse_force, predict_outputs
from jointscope.diagnosis.prepare import prepare, prepare_inputs
from jointscope.diagnosis.resolution import resolved, thinned
from jointscope.errors import RefusedError
from jointscope.recordings.campaign import Campaign, Nameplate, Run, Stream


def start(problem, name):
    return float(problem.base.start[problem.base.names.index(name)])


def free(problem):
    return {n for n, f in zip(problem.base.names, problem.base.free, strict=True) if f}


def errors(problem, theta, effects=()):
    found = {}
    for run in problem.runs:
        for output, y in zip(run.outputs, predict_outputs(run, theta, effects, problem), strict=True):
            d = output.data[output.mask]
            key = (run.run.id, output.quantity, output.location)
            found[key] = float(np.sqrt(np.mean((d - y[output.mask]) ** 2)) / d.std())
    return found


def test_the_compiled_model_is_the_recorded_one(problem, truth):
    """At the true parameters hits, sweep and innovation agree with SciPy's integration to 2e-3 of the signal."""
    for key, error in errors(problem, truth).items():
        assert error < 2e-3, (key, error)


def test_starts_are_near_the_truth_though_the_nameplate_is_not(problem, plant):
    assert start(problem, "stiffness") == pytest.approx(plant.K, rel=0.05)
    assert start(problem, "load_inertia") == pytest.approx(plant.J_L, rel=0.05)
    assert start(problem, "damping") == pytest.approx(plant.c, rel=0.3)
    assert free(problem) == {
        "stiffness", "damping", "load_inertia", "motor_damping", "load_damping", "torque_offset", "torque_age",
    }  # fmt: skip


@pytest.mark.parametrize("factor", [0.3, 3.0])
def test_starts_survive_references_off_by_a_factor_of_three(bench, builders, plant, factor):
    rig = dataclasses.replace(
        builders.NAMEPLATE, stiffness_reference=plant.K * factor, inertia_reference=plant.J_L / factor
    )
    problem = prepare(dataclasses.replace(bench, rig=rig))
    assert start(problem, "stiffness") == pytest.approx(plant.K, rel=0.1)


def test_names_and_order_do_not_matter(bench, problem, edited):
    def renamed(run, number):
        run = edited(run, lambda c: dataclasses.replace(c, column=f"x-{c.column[::-1]}"))
        streams = tuple(dataclasses.replace(s, file=f"{i}.dat") for i, s in enumerate(run.streams[::-1]))
        return dataclasses.replace(run, id=f"r{number}", streams=streams)

    shuffled = tuple(renamed(run, i) for i, run in enumerate(bench.runs[::-1]))
    other = prepare(dataclasses.replace(bench, runs=shuffled, title="t", notes="n"))
    np.testing.assert_allclose(other.base.start, problem.base.start, rtol=1e-5)
    assert np.array_equal(other.base.free, problem.base.free)
    assert other.scales.torque == pytest.approx(problem.scales.torque, rel=1e-4)
    a = predict_outputs(problem.runs[2], problem.base.start, (), problem)
    b = predict_outputs(other.runs[0], problem.base.start, (), other)
    for x, y in zip(a, b[::-1] if len(a[0]) != len(b[0]) else b, strict=True):
        np.testing.assert_allclose(x, y, rtol=1e-9, atol=1e-12)


def test_an_inverted_channel_is_turned_round_and_reported(bench, problem, edited):
    def flip(channel):
        if channel.quantity == "linear-acceleration":
            return dataclasses.replace(channel, samples=-channel.samples)
        return channel

    flipped = prepare(dataclasses.replace(bench, runs=tuple(edited(run, flip) for run in bench.runs)))
    assert len(flipped.findings) == 3 and not problem.findings
    np.testing.assert_allclose(flipped.runs[0].outputs[0].data, problem.runs[0].outputs[0].data)
    for run in flipped.runs:
        for output in run.outputs:
            recorded = run.run.streams[output.channel[0]].channels[output.channel[1]].samples
            np.testing.assert_allclose(output.polarity * (output.data + output.offset), recorded, atol=1e-9)


def test_hits_alone_merge_the_dampings(builders, plant):
    problem = prepare(builders.campaign_of([builders.hammer_run(plant, 100.0, "a")]))
    assert free(problem) == {"stiffness", "damping", "load_inertia"}
    assert problem.base.merged == {"damping": "damping_total"}
    assert start(problem, "damping") == pytest.approx(plant.c + plant.b_l, rel=0.2)
    assert start(problem, "load_damping") == 0.0


def test_a_sweep_without_encoder_is_compared_above_the_drift(builders, plant):
    run = builders.sweep_run(plant, 30.0, "s", encoder=False)
    problem = prepare(builders.campaign_of([run]))
    assert problem.runs[0].mode == "torque-driven"
    assert problem.runs[0].outputs[0].high_pass == 2.0
    theta = problem.theta(
        stiffness=plant.K, damping=plant.c, load_inertia=plant.J_L, motor_damping=2.0, load_damping=2.0
    )
    assert max(errors(problem, theta).values()) < 3e-3


def test_unknown_motor_inertia_is_a_parameter(bench, builders, plant):
    rig = dataclasses.replace(builders.NAMEPLATE, motor_inertia=None)
    problem = prepare(dataclasses.replace(bench, rig=rig))
    assert "motor_inertia" in free(problem)
    assert start(problem, "motor_inertia") == pytest.approx(plant.J_m * plant.n**2, rel=0.1)


def test_an_uncalibrated_current_is_scaled_by_the_hammer(bench, builders, plant, edited):
    """Torque in unknown units beside a calibrated hammer: the scale is a nuisance parameter and is found."""

    def current(channel):
        if channel.quantity != "torque":
            return channel
        return dataclasses.replace(channel, quantity="current", unit="A", samples=channel.samples / 0.458)

    problem = prepare(dataclasses.replace(bench, runs=tuple(edited(run, current) for run in bench.runs)))
    assert "torque_scale" in free(problem)
    assert problem.base.nuisance[problem.base.names.index("torque_scale")]
    assert start(problem, "torque_scale") == pytest.approx(0.458, rel=0.05)
    assert start(problem, "stiffness") == pytest.approx(plant.K, rel=0.05)


def test_an_uncalibrated_rig_alone_is_identified_per_unit(builders, plant, edited):
    """Without any absolute torque the ratios K/J come out, in units of the input."""

    def unknown(channel):
        if channel.quantity != "torque":
            return channel
        return dataclasses.replace(channel, quantity="current", unit="A", samples=channel.samples / 0.458)

    rig = dataclasses.replace(
        builders.NAMEPLATE, motor_inertia=None, reducer_inertia=None, plane="horizontal", efficiency=None
    )
    flat = dataclasses.replace(plant, weight=0.0)
    run = edited(builders.sweep_run(flat, 30.0, "s"), unknown)
    problem = prepare(builders.campaign_of([run], rig))
    assert not problem.torque_calibrated and "torque_scale" not in free(problem)
    assert start(problem, "stiffness") / start(problem, "load_inertia") == pytest.approx(
        plant.K / plant.J_L, rel=0.05
    )


def carriage(builders, friction=20.0, mass=95.0, viscous=200.0, rate=500.0, duration=5.0):
    """A carriage with dry friction by Euler at 20 kHz with exact stiction: position out, force in."""
    fine = 40
    n = int(duration * rate)
    dt = 1 / (rate * fine)
    t = np.arange(n * fine) * dt
    force = 60.0 * np.sin(2 * np.pi * 0.4 * t) + 40.0 * np.sin(2 * np.pi * 1.7 * t)
    q, v, path = 0.0, 0.0, np.empty(n * fine)
    for i, f in enumerate(force):
        path[i] = q
        free_v = v + dt * (f - viscous * v) / mass
        v = math.copysign(max(abs(free_v) - dt * friction / mass, 0.0), free_v)
        q += dt * v
    stream = Stream(
        file="c.csv",
        sampling_rate=rate,
        length=n,
        channels=(
            builders.channel("F", "force", "N", "load", "input", force[::fine]),
            builders.channel("q", "position", "m", "load", "output", path[::fine]),
        ),
    )
    run = Run(id="c", experiment="speed-motion", streams=(stream,))
    return Campaign(
        path=builders.campaign_of([]).path,
        rig=Nameplate(topology="single-dof", motion="translational", plane="horizontal"),
        runs=(run,),
    )


def test_a_free_carriage_is_observed_and_its_friction_fits(builders):
    """Position out, force in: no spring, no gravity; the true friction leaves a hundredth of the base's innovation."""
    problem = prepare(carriage(builders))
    assert problem.runs[0].mode == "observer" and free(problem) == {
        "load_inertia",
        "load_damping",
        "torque_offset",
    }
    assert start(problem, "load_inertia") == pytest.approx(95.0, rel=0.05)
    theta = problem.theta(load_inertia=95.0, load_damping=200.0)
    coulomb = next(
        s for s in catalogue(problem) if (s.name, s.location, s.variant) == ("coulomb-friction", "load", "plain")
    )
    assert coulomb.parameters[0].unit == "N"
    active = (ActiveEffect(coulomb, (20.0,)),)
    (bare,), (right,) = errors(problem, theta).values(), errors(problem, theta, active).values()
    assert right < 0.02 * bare
    recorded, model = inverse_force(problem.runs[0], theta, active, problem)
    assert np.sqrt(np.mean((recorded - model) ** 2) / np.mean(recorded**2)) < 0.08


def test_free_prediction_reads_inputs_only(bench, problem, truth, edited):
    """Blanking every output column changes no prediction beyond the encoder's zero."""
    blank = tuple(
        edited(run, lambda c: c if c.role == "input" else dataclasses.replace(c, samples=None))
        for run in bench.runs
    )
    empty = prepare_inputs(dataclasses.replace(bench, runs=blank))
    full = prepare_inputs(bench)
    for a, b, c in zip(empty.runs, full.runs, problem.runs, strict=True):
        for x, y, z in zip(
            free_prediction(a, truth, (), empty), free_prediction(b, truth, (), full), free_prediction(c, truth, (), problem),
            strict=True,
        ):  # fmt: skip
            np.testing.assert_array_equal(x, y)
            np.testing.assert_allclose(x, z, rtol=1e-6, atol=1e-9)


def test_free_prediction_of_a_sweep_matches_the_recording(problem, truth):
    run = problem.runs[2]
    for output, y in zip(run.declared, free_prediction(run, truth, (), problem), strict=True):
        d = output.data[output.mask]
        assert np.sqrt(np.mean((d - y[output.mask]) ** 2)) < 0.01 * d.std()


def test_a_fast_record_is_thinned_where_nothing_is_lost_and_left_where_it_clips(bench, problem):
    """A tone below 400 Hz survives, one above does not; the recorder's step is remembered."""
    output = next(o for o in problem.runs[-1].outputs if "acceleration" in o.quantity)
    times = np.arange(8192) / 4096.0
    tones = np.sin(2 * np.pi * 70.0 * times) + 0.5 * np.sin(2 * np.pi * 900.0 * times)
    fast = replace(output, rate=4096.0, times=times, data=tones, mask=np.ones(8192, dtype=bool), step=None)
    slow = thinned(fast, hits=False)
    assert slow.rate == 1024.0 and slow.times.size == 2048
    inner = slice(64, -64)
    np.testing.assert_allclose(slow.data[inner], np.sin(2 * np.pi * 70.0 * slow.times)[inner], atol=2e-3)
    assert thinned(replace(fast, data=np.clip(tones, -1.0, 1.0)), hits=False).rate == 4096.0
    assert thinned(slow, hits=False) is slow
    steps = thinned(replace(fast, data=np.round(tones, 1)), hits=False)
    assert quantum(steps) == pytest.approx(0.1)


@pytest.mark.parametrize("corner", [None, 2.0])
def test_what_thinning_takes_off_is_what_lies_above_its_band(problem, corner):
    """A tone of 900 Hz, 0.5 high: 0.125. What a high-pass takes off an open-loop record is not lost to thinning."""
    output = next(o for o in problem.runs[-1].outputs if "acceleration" in o.quantity)
    times = np.arange(8192) / 4096.0
    tones = 5.0 * np.sin(2 * np.pi * 0.5 * times) + 0.5 * np.sin(2 * np.pi * 900.0 * times)
    whole = replace(output, rate=4096.0, times=times, data=tones, mask=np.ones(8192, dtype=bool), step=None)
    kept = whole if corner is None else replace(whole, data=high_pass(tones, corner, 4096.0), high_pass=corner)
    assert thinned(kept, hits=False).taken_off == pytest.approx(0.125, rel=0.03)


def test_a_decay_below_the_encoders_step_is_not_scored():
    """In steps, the tail of a ring-down stands still, which dry friction would explain; unstepped it is all there."""
    t = np.arange(4096) / 1024.0
    decay = 1e-3 * np.exp(-3.0 * t) * np.sin(2 * np.pi * 30.0 * t)
    step = 4e-5
    coarse = resolved(step * np.round(decay / step), 1024.0)
    gone = np.log(1e-3 / (1.25 * step)) / 3.0  # the swing is two steps and a half wide there
    assert coarse[t < gone - 0.2].all() and not coarse[t > gone + 0.2].any()
    assert resolved(decay, 1024.0).all()


def test_refuses_what_it_cannot_use(bench, builders, edited):
    with pytest.raises(RefusedError, match="topology"):
        prepare(dataclasses.replace(bench, rig=dataclasses.replace(builders.NAMEPLATE, topology="arm")))
    silent = tuple(edited(run, lambda c: c if c.role == "output" else None) for run in bench.runs)
    with pytest.raises(RefusedError, match="no run holds"):
        prepare(dataclasses.replace(bench, runs=silent))


def test_an_unknown_start_is_found_and_is_no_effect(builders, plant):
    """The PLC's clock stated 37 ms wrong with start_uncertainty: the offset comes out, and delay is no candidate."""
    run = builders.sweep_run(plant, 30.0, "s")
    daq, plc = run.streams
    run = dataclasses.replace(run, streams=(daq, dataclasses.replace(plc, start=0.037, start_uncertainty=0.02)))
    problem = prepare(builders.campaign_of([builders.hammer_run(plant, 100.0, "h", duration=0.6), run]))
    motor = problem.runs[1].motor
    assert motor is not None and motor.signal.start == pytest.approx(0.0, abs=1e-4)
    delay = next(s for s in catalogue(problem) if s.name == "delay")
    assert "exact" in (delay.possible(problem) or "")
    k = problem.base.names.index(
        "torque_age"
    )  # a start is found to a part of a sample, and the torque may act as late
    assert problem.base.upper[k] == -problem.base.lower[k] == 0.5 / motor.signal.rate
    alone = dataclasses.replace(
        run, streams=(dataclasses.replace(plc, start_uncertainty=0.02, channels=(*plc.channels, *daq.channels)),)
    )
    one_clock = prepare(builders.campaign_of([alone]))
    assert one_clock.base.upper[k] == AGE  # no other clock, and nothing to find


@pytest.mark.parametrize(
    "keep",
    [
        [("angle", "motor")],
        [("angular-velocity", "motor")],
        [("angular-acceleration", "arm"), ("angular-velocity", "arm")],
        [("angle", "arm"), ("angular-acceleration", "motor")],
    ],
    ids=str,
)
def test_any_subset_of_channels_gives_a_start(problem, truth, plant, builders, keep):
    """A sweep seen by other sensors, made by the model itself: every subset starts near K/J."""
    from jointscope.diagnosis import kernel as k
    from jointscope.diagnosis.predict import build, integrate

    prepared = problem.runs[2]
    states = integrate(build(prepared, truth, (), problem, free=True))[:: int(prepared.grid_rate / 1024)]
    columns = {
        ("angle", "motor"): k.X_QS, ("angle", "arm"): k.X_Q, ("angular-velocity", "motor"): k.X_VS,
        ("angular-velocity", "arm"): k.X_V, ("angular-acceleration", "motor"): k.X_AS, ("angular-acceleration", "arm"): k.X_A,
    }  # fmt: skip
    units = {"angle": "rad", "angular-velocity": "rad/s", "angular-acceleration": "rad/s^2"}
    channels = tuple(
        builders.channel(
            f"{q}{at}", q, units[q], at, "output", states[:, columns[q, at]] * (plant.n if at == "motor" else 1.0)
        )
        for q, at in keep
    )
    daq, plc = prepared.run.streams
    daq = dataclasses.replace(daq, channels=channels, length=len(states), start=prepared.t0)
    plc = dataclasses.replace(plc, channels=plc.channels[:1])
    other = prepare(builders.campaign_of([dataclasses.replace(prepared.run, streams=(daq, plc))]))
    ratio = start(other, "stiffness") / start(other, "load_inertia")
    assert ratio == pytest.approx(plant.K / plant.J_L, rel=0.05)
    assert max(errors(other, truth).values()) < 0.01


def test_a_log_is_no_noisier_than_its_device_is_elsewhere(bench, builders, plant, edited):
    """What a drive works into its torque at one experiment is torque: the sweep says what the log's noise is."""
    rng = np.random.default_rng(21)

    def noisy(level, experiment):
        def change(channel):
            if channel.quantity != "torque":
                return channel
            return dataclasses.replace(
                channel, samples=channel.samples + level * rng.standard_normal(len(channel.samples))
            )

        run = edited(builders.sweep_run(plant, 30.0, f"level-{level}"), change)
        return dataclasses.replace(run, experiment=experiment)

    runs = (noisy(0.01, "torque-sweep"), noisy(0.1, "speed-motion"))
    problem = prepare(dataclasses.replace(bench, runs=runs))
    quiet, loud = (run.motor.noise / plant.n for run in problem.runs)
    assert quiet == pytest.approx(0.01, rel=0.25)
    assert loud == pytest.approx(1.5 * quiet, rel=1e-9)
    assert prepare(dataclasses.replace(bench, runs=runs[1:])).runs[0].motor.noise == pytest.approx(
        0.1 * plant.n, rel=0.25
    )


def test_what_a_prediction_takes_for_noise_is_read_off_inputs_alone(bench, builders, plant, edited):
    """A clean torque that is an output of another run says nothing of the log that is an input."""
    rng = np.random.default_rng(22)

    def noisy(channel):
        if channel.quantity != "torque":
            return channel
        return dataclasses.replace(
            channel, samples=channel.samples + 0.1 * rng.standard_normal(len(channel.samples))
        )

    sweep = builders.sweep_run(plant, 30.0, "sweep")
    clean = tuple(dataclasses.replace(c, role="output") for c in sweep.streams[1].channels)
    hit = dataclasses.replace(
        bench.runs[0], streams=(*bench.runs[0].streams, dataclasses.replace(sweep.streams[1], channels=clean))
    )
    foretold = prepare_inputs(dataclasses.replace(bench, runs=(edited(sweep, noisy), hit)))
    assert foretold.runs[0].motor.noise == pytest.approx(0.1 * plant.n, rel=0.25)


def test_an_angle_is_thinned_and_stays_unscored_below_its_encoders_step(bench, builders):
    """A ring-down at 4096 Hz, in steps that it soon falls below: compared at half that rate, and only while it moves."""
    rate, t = 4096.0, np.arange(8192) / 4096.0
    ring = np.where(t > 0.1, 1e-3 * np.exp(-6.0 * (t - 0.1)) * np.sin(2 * np.pi * 30.0 * (t - 0.1)), 0.0)
    angle = builders.channel("q", "angle", "rad", "arm", "output", 4e-5 * np.round(ring / 4e-5))
    force = builders.channel(
        "f", "force", "N", "arm", "input", np.where((t > 0.1) & (t < 0.105), 100.0, 0.0), radius=0.9
    )
    stream = Stream(file="hit.csv", sampling_rate=rate, length=t.size, channels=(force, angle))
    hit = Run(id="hit", experiment="hammer", brake=True, streams=(stream,))
    (output,) = prepare(dataclasses.replace(bench, runs=(hit,))).runs[0].outputs
    assert output.rate == 2048.0 and output.mask.size == t.size // 2
    gone = 0.1 + np.log(1e-3 / (1.25 * 4e-5)) / 6.0  # the swing is two steps and a half wide there
    assert output.mask[(output.times > 0.2) & (output.times < gone - 0.2)].all()
    assert not output.mask[output.times > gone + 0.2].any()
