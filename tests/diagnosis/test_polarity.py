"""A sensor mounted backwards, a clock that starts at will and a steady state change no answer and no error."""

import dataclasses
import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from jointscope.diagnosis.adjudicate import judge
from jointscope.diagnosis.assembly import BASE_INDEX
from jointscope.diagnosis.base import refit_base
from jointscope.diagnosis.errors import channel_errors, without_drift
from jointscope.diagnosis.no_worse import borne
from jointscope.diagnosis.objective import DIVERGED
from jointscope.diagnosis.predict import free_prediction, predict_outputs
from jointscope.diagnosis.prepare import prepare
from jointscope.diagnosis.responses import Response, channel_key, passive_polarities, polarities, work_done
from jointscope.diagnosis.search import Hypothesis
from jointscope.diagnosis.split import split_runs
from jointscope.recordings.campaign import Nameplate, Run, Stream

CARRIAGE = Nameplate(topology="single-dof", motion="translational", plane="horizontal", ground_spring=False)
SPRUNG = dataclasses.replace(CARRIAGE, ground_spring=True)


@pytest.fixture(scope="module")
def turned(edited):
    """The maker of campaigns with the outputs at some places the other way up."""

    def other(campaign, *locations):
        def channel(c):
            wrong = c.role == "output" and c.location in locations
            return dataclasses.replace(c, samples=-c.samples) if wrong else c

        return dataclasses.replace(campaign, runs=tuple(edited(run, channel) for run in campaign.runs))

    return other


def taken(builders, name, t, force, position, initial):
    """One run of a force at a load and its position."""
    stream = Stream(
        file=f"{name}.csv", sampling_rate=1.0 / (t[1] - t[0]), length=t.size,
        channels=(
            builders.channel("F", "force", "N", "load", "input", force),
            builders.channel("x", "position", "m", "load", "output", position),
        ),
    )  # fmt: skip
    return Run(id=name, experiment="torque-sweep", streams=(stream,), initial=initial)


def swung(force, mass, damping, stiffness, t, start):
    def rates(u, x):
        return [x[1], (force(u) - damping * x[1] - stiffness * x[0]) / mass]

    return solve_ivp(
        rates, (t[0], t[-1]), start, method="DOP853", rtol=1e-9, atol=1e-12, max_step=1e-3, t_eval=t
    ).y


@pytest.fixture(scope="module")
def carriage(builders):
    """A mass under a slow force, already on its way at the first sample."""
    t = np.arange(4000) / 500.0
    runs = []
    for k, amplitude in enumerate((40.0, 60.0)):
        force = lambda u, a=amplitude: a * np.sin(2 * np.pi * 0.7 * u)  # noqa: E731
        x = swung(force, 30.0, 20.0, 0.0, t, [0.1, 0.4])
        runs.append(taken(builders, f"take {k}", t, force(t), x[0], "estimate"))
    return builders.campaign_of(runs, CARRIAGE)


def base_of(problem, pool):
    stage = refit_base(problem, predict_outputs, split_runs(problem).estimate, pool)
    return stage, stage.fit.coordinates.unpack(stage.fit.x)[0]


@pytest.fixture(scope="module")
def pool():
    from concurrent.futures import ThreadPoolExecutor

    with ThreadPoolExecutor(1) as threads:
        yield threads


def test_a_carriage_seen_from_the_other_side_is_the_same_carriage(carriage, turned, pool):
    """Its speed at the first sample is turned round too, so that it is foretold as well as before."""
    errors = []
    for campaign in (carriage, turned(carriage, "load")):
        problem = prepare(campaign)
        stage, theta = base_of(problem, pool)
        assert theta[BASE_INDEX["load_inertia"]] == pytest.approx(30.0, rel=0.01)
        errors.append([e.error for e in channel_errors(problem, free_prediction, (0, 1), theta, (), stage.noise)])
    assert len(problem.findings) == 2
    assert errors[1] == pytest.approx(errors[0], rel=1e-6)


def test_an_arm_that_moves_against_its_motor_is_read_backwards(builders, plant, turned):
    def swept(name, amplitude):
        """The builders' sweep with the arm's own angle beside the motor's, slow enough that both go the same way."""
        run = builders.sweep_run(plant, amplitude, name)
        daq, plc = run.streams
        (motor,) = (c for c in plc.channels if c.quantity == "angle")
        arm = builders.channel("q", "angle", "rad", "arm", "output", motor.samples / plant.n)
        return dataclasses.replace(run, streams=(daq, dataclasses.replace(plc, channels=(*plc.channels, arm))))

    campaign = builders.campaign_of([swept("a", 30.0), swept("b", 40.0)])
    straight, backwards = prepare(campaign), prepare(turned(campaign, "arm"))

    def signs(problem):
        return {
            o.polarity
            for run in problem.runs
            for o in run.declared
            if (o.quantity, o.location) == ("angle", "arm")
        }

    assert signs(straight) == {1.0} and signs(backwards) == {-1.0}


def test_a_steady_state_about_an_unknown_zero_is_foretold(builders, pool):
    """The record begins anywhere in the period: its first sample is no rest."""
    mass, stiffness, damping, rate, period = 2.0, 8.0e4, 30.0, 1000.0, 2000
    rng = np.random.default_rng(2)
    f = np.fft.rfftfreq(period, 1.0 / rate)
    runs = []
    for k in range(3):
        spectrum = np.where((f >= 2.0) & (f <= 120.0), np.exp(2j * np.pi * rng.random(f.size)), 0.0)
        response = spectrum / (stiffness - mass * (2 * np.pi * f) ** 2 + 2j * np.pi * f * damping)
        force, x = (np.fft.irfft(s, period) * 5e3 for s in (spectrum, response))
        x = x + 1e-3 * np.std(x) * rng.standard_normal(period) + 2e-3
        runs.append(taken(builders, f"take {k}", np.arange(period) / rate, force, x, "estimate"))
    problem = prepare(builders.campaign_of(runs, SPRUNG))
    stage, theta = base_of(problem, pool)
    assert theta[BASE_INDEX["stiffness"]] == pytest.approx(stiffness, rel=0.01)
    errors = channel_errors(problem, free_prediction, (0, 1, 2), theta, (), stage.noise)
    assert max(e.error for e in errors) < 0.03


def test_where_all_that_was_recorded_drifts_off_the_path_decides(carriage, pool):
    """Nothing is left to foretell a free carriage by: an effect stays if its held-out runs confirm it."""
    problem = prepare(carriage)
    stage, theta = base_of(problem, pool)
    errors = channel_errors(problem, free_prediction, (0, 1), theta, (), stage.noise)
    assert without_drift(problem, errors) == []
    assert borne(3.0, [], [], True) and not borne(3.0, [], [], False)


def test_a_hypothesis_that_diverges_elsewhere_is_not_judged(problem, pool):
    """A resonance beyond the grid's reach can't be simulated: no noise is taken from it."""
    stage, _ = base_of(problem, pool)
    wild = stage.fit.x.copy()
    position = int(np.flatnonzero(stage.fit.coordinates.free == BASE_INDEX["load_inertia"])[0])
    wild[position] *= 1e-7
    hypothesis = Hypothesis((), dataclasses.replace(stage.fit, x=wild, fresh=False), -1e9)
    found = judge(stage, [hypothesis], split_runs(problem).held_out)
    assert len(found.judged) == 1


@pytest.mark.parametrize("height", [1e80, math.inf, math.nan])
def test_a_prediction_without_end_is_as_wrong_as_none_and_finite(problem, pool, height):
    """What runs away may do so in finite numbers, whose squares are not: no sum of squares overflows."""
    stage, _ = base_of(problem, pool)
    run = stage.objective.prepared[0]
    found = stage.objective.whiten_run(0, [np.full(len(o.data), height) for o in run.outputs])
    assert np.all(found == DIVERGED)


def test_what_a_drive_does_work_on_is_not_upside_down(builders, turned):
    """A body that friction holds follows its force like a spring, whose phase is not an inertia's: its work tells."""
    t, lag = np.arange(0.0, 8.0, 1e-3), 0.4
    force, position = 3.0 * np.sin(np.pi * t), 1e-4 * np.sin(np.pi * t - lag)
    runs = [taken(builders, f"take {k}", t, k * force, k * position, "estimate") for k in (1, 2)]
    held = builders.campaign_of(runs, CARRIAGE)
    problem = prepare(held)
    assert not any("polarity" in line for line in problem.findings)
    key = channel_key(problem.runs[0], problem.runs[0].outputs[0])
    net, gross = np.pi * np.sin(lag), 2.0 * np.cos(lag) + 2.0 * lag * np.sin(lag)  # over a period
    assert work_done(problem.runs, key) == pytest.approx(net / gross, rel=0.1)  # the start is not compared
    assert work_done(prepare(turned(held, "load")).runs, key) == pytest.approx(net / gross, rel=0.1)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_what_is_hit_within_a_hinge_is_read_beyond_it_the_right_way_up(sign, problem):
    """The outer part of an arm answers its bend the other way round, and louder: below it the arm moves as a whole."""
    M, K = np.array([[6.6, 0.555], [0.555, 0.35]]), np.diag([183e3, 149e3])  # joint and hinge
    C = np.diag([60.0, 5.7])
    f = np.arange(3.0, 300.0, 1.0)
    s = 2j * np.pi * f[:, None, None]
    moved = np.linalg.solve(s**2 * M + s * C + K, np.array([1.0, 0.0])[:, None])[..., 0]
    H = sign * s[:, 0, 0] ** 2 * (moved[:, 0] + 0.5 / 0.8 * moved[:, 1])
    response = Response(f, H, np.ones(f.size), False, False, False, True, ("acceleration",))
    assert passive_polarities((response,)) == {("acceleration",): sign}
    theta = np.array(problem.base.start)
    for name, value in (("stiffness", 183e3), ("load_inertia", 6.6), ("damping", 60.0)):
        theta[BASE_INDEX[name]] = value
    assert polarities(theta, (response,)) == {("acceleration",): sign}
