"""Where no encoder was recorded the drive's own law gives the motor's angle, whatever the joint's model lacks."""

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from jointscope.diagnosis.assembly import COMMAND_HZ, LAW_HZ, observer_corner
from jointscope.diagnosis.drive_angle import UNTOLD, DriveLaw, Log, drive_law, followed_angle
from jointscope.diagnosis.prepare import DRIFT_CORNER, prepare
from jointscope.diagnosis.relog import LOGS, driven_by, relogged
from jointscope.recordings.campaign import Stream

RATE, SLOW = 1024.0, 500.0  # Hz, of the accelerometer's device and of the drive's log
REST, DURATION = 0.2, 3.2  # s


@dataclass(frozen=True)
class Loop:
    """A drive at the joint output: T = sat(K_p e + K_i E + ahead w_c'), e = w_c - w_m + outer E."""

    gain: float = 900.0
    integral: float = 5000.0
    ahead: float = 0.0
    outer: float = 0.0
    limit: float = math.inf


def command(t, swing, period):
    """Speed at the joint output [rad/s] and its rate: there and back, after a rest."""
    w = 2.0 * math.pi / period
    u = np.maximum(np.asarray(t) - REST, 0.0)
    ramp = 1.0 - np.exp(-((u / 0.3) ** 2))
    slope = 2.0 * u / 0.09 * np.exp(-((u / 0.3) ** 2))
    return swing * w * np.sin(w * u) * ramp, swing * w * (w * np.cos(w * u) * ramp + np.sin(w * u) * slope)


def motion(builders, plant, loop, name, *, swing=0.25, period=1.3, q0=-1.047, angle=False):
    """A motion under ``loop`` by SciPy, recorded as torque, command and accelerometer; and the motor's angle at the log."""
    hold = plant.weight * math.cos(q0)

    def torque(t, x):
        w_c, rate = command(t, swing, period)
        asked = loop.gain * (w_c - x[1] + loop.outer * x[4]) + loop.integral * x[5] + loop.ahead * rate
        return hold + min(max(asked, -loop.limit), loop.limit)

    def f(t, x):
        T = torque(t, x)
        free = plant.rates(lambda u: 0.0, lambda u: T, False)(t, x[:4])
        e = float(command(t, swing, period)[0]) - x[1]
        return [*free, e, 0.0 if abs(T - hold) >= loop.limit else e + loop.outer * x[4]]

    start = [q0 + hold / plant.K, 0.0, q0, 0.0, 0.0, 0.0]
    path = solve_ivp(f, (0.0, DURATION), start, rtol=1e-7, atol=1e-10, max_step=2e-3, dense_output=True).sol
    t, tl = np.arange(int(DURATION * RATE)) / RATE, np.arange(int(DURATION * SLOW)) / SLOW
    x, slow = path(t), path(tl)
    arm = np.array([f(u, s)[3] for u, s in zip(t, x.T, strict=True)])
    logged = np.array([torque(u, s) for u, s in zip(tl, slow.T, strict=True)]) / plant.n / plant.eta
    channel = builders.channel
    plc = [
        channel("T", "torque", "N m", "motor", "input", logged),
        channel("w", "speed-command", "rad/s", "motor", "input", command(tl, swing, period)[0] * plant.n),
    ]
    if angle:
        plc.append(channel("th", "angle", "rad", "motor", "output", slow[0] * plant.n))
    y = 0.95 * arm + 9.80665 * np.cos(x[2])
    daq = (channel("a", "linear-acceleration", "m/s^2", "arm", "output", y, radius=0.95),)
    streams = (
        Stream(file=f"{name}-daq.csv", sampling_rate=RATE, length=t.size, channels=daq),
        Stream(file=f"{name}-plc.csv", sampling_rate=SLOW, length=tl.size, channels=tuple(plc)),
    )
    run = replace(builders.sweep_run(plant, 1.0, name, duration=0.2), experiment="speed-motion", streams=streams)
    return run, slow[0]


def noisy(run, edited, rng, share=2e-3):
    """The run with white noise of a share of the rms in what was measured."""

    def with_noise(channel):
        if channel.quantity not in ("torque", "linear-acceleration"):
            return channel
        noise = share * np.std(channel.samples) * rng.standard_normal(channel.samples.size)
        return replace(channel, samples=channel.samples + noise)

    return edited(run, with_noise)


@pytest.fixture(scope="module")
def rough(builders):
    """A joint with dry friction at its motor, which no model here knows of."""
    return builders.Plant(extra=lambda t, x: (-25.0 * np.tanh(x[1] / 2e-3), 0.0))


@pytest.fixture(scope="module")
def hit(builders):
    return builders.hammer_run(builders.Plant(), 100.0, "hit")


@pytest.fixture(scope="module")
def of(builders, rough, edited):
    """The maker of two noisy motions under a loop, and of the motor's true angle in each; those of one loop only once."""
    made = {}

    def motions(loop, seed=1):
        if loop not in made:
            made[loop] = [
                motion(builders, rough, loop, name, swing=swing, period=period)
                for name, swing, period in (("far", 0.25, 1.3), ("near", 0.1, 0.7))
            ]
        rng = np.random.default_rng(seed)
        return [noisy(run, edited, rng) for run, _ in made[loop]], [angle for _, angle in made[loop]]

    return motions


@pytest.fixture(scope="module")
def plain(builders, hit, of):
    """Two motions under a drive's law of two gains, prepared."""
    return prepare(builders.campaign_of([hit, *of(Loop())[0]]))


def followed(problem):
    return [run for run in problem.runs if run.run.experiment == "speed-motion"]


def errors(problem, angles):
    """RMS error of the angle that each motion follows [rad at the motor]."""
    t = np.arange(int(DURATION * SLOW)) / SLOW
    return [
        run.ratio * float(np.std(run.observed.signal(t) - angle))
        for run, angle in zip(followed(problem), angles, strict=True)
    ]


@pytest.mark.parametrize("outer", [0.0, 3.0])
def test_a_growing_torque_makes_the_lag_that_the_law_says(outer):
    """E of a torque of 10 N m/s t, by its partial fractions, to the second order of the step."""
    law, p = DriveLaw(gain=50.0, integral=400.0, outer=outer), 8.0
    worst = []
    for rate in (250.0, 500.0):
        t = np.arange(int(rate)) / rate
        zero = np.zeros(t.size)
        if outer:
            slow, quick = np.exp(-outer * t) / (outer * (outer - p)), np.exp(-p * t) / (p * (p - outer))
            exact = 10.0 / 50.0 * (1.0 / (outer * p) + slow + quick)
        else:
            exact = 10.0 / 400.0 * (t - (1.0 - np.exp(-p * t)) / p)
        worst.append(float(np.max(np.abs(Log(rate, t, 10.0 * t, zero, zero, 0.0).lag(law) - exact))))
    assert worst[0] < 1e-3 * 10.0 / 400.0
    assert worst[1] < 0.3 * worst[0]


def test_the_angle_is_found_whatever_friction_the_model_lacks(plain, of):
    """0.03 rad of a motor that lags behind its command by a radian; the gains are at the output, before its losses."""
    _, angles = of(Loop())
    problem = plain
    law = followed(problem)[0].observed.law
    assert max(errors(problem, angles)) < 0.05
    assert law.gain * 0.7 == pytest.approx(Loop().gain, rel=0.03)
    assert law.integral * 0.7 == pytest.approx(Loop().integral, rel=0.06)
    assert (law.ahead, law.outer) == (0.0, 0.0)
    assert law.lag == pytest.approx(1.0, abs=0.2)
    assert "taken from the drive's law" in problem.findings[-1]
    for run in followed(problem):
        assert not run.observed.rate_signal and observer_corner(run) == LAW_HZ
        assert all(o.high_pass is None for o in run.outputs)


@pytest.mark.parametrize("loop", [Loop(ahead=4.0), Loop(ahead=10.0), Loop(outer=6.0)])
def test_feed_forward_and_a_position_loop_are_found(builders, hit, of, loop):
    runs, angles = of(loop)
    problem = prepare(builders.campaign_of([hit, *runs]))
    law = followed(problem)[0].observed.law
    assert max(errors(problem, angles)) < 0.05
    assert law.ahead * 0.7 == pytest.approx(loop.ahead, rel=0.05)
    assert law.outer == pytest.approx(loop.outer, rel=0.1)


def test_a_drive_at_its_limit_is_refused_and_its_command_followed(builders, hit, of):
    runs, _ = of(Loop(limit=45.0))
    problem = prepare(builders.campaign_of([hit, *runs]))
    assert "the speed command is followed" in problem.findings[-1]
    for run in followed(problem):
        assert run.observed.rate_signal and run.observed.law is None and observer_corner(run) == COMMAND_HZ
        assert {o.high_pass for o in run.outputs} == {DRIFT_CORNER}


def test_no_law_is_sought_where_the_angle_was_recorded(builders, hit, rough):
    run, _ = motion(builders, rough, Loop(), "seen", angle=True)
    problem = prepare(builders.campaign_of([hit, run]))
    assert drive_law(problem) is None
    assert not followed(problem)[0].observed.commanded


def test_where_nothing_can_be_heard_of_the_drive_no_law_is_sought(plain):
    """A joint too soft for the band, a record shorter than the loop, an accelerometer without a unit."""
    problem = plain
    commanded = [
        replace(r, observed=replace(r.observed, law=None)) for r in problem.runs if r.observed is not None
    ]
    at = problem.base.names.index("stiffness")
    soft = problem.base.start.copy()
    soft[at] = 1.0
    assert drive_law(replace(problem, runs=tuple(commanded))) is not None
    assert drive_law(replace(problem, runs=tuple(commanded), base=replace(problem.base, start=soft))) is None
    for change in ({"calibrated": False}, {"times": commanded[0].outputs[0].times[:500]}):
        deaf = tuple(replace(r, outputs=tuple(replace(o, **change) for o in r.outputs)) for r in commanded)
        assert drive_law(replace(problem, runs=deaf)) is None


def test_a_held_out_motion_has_no_say_in_the_law(builders, hit, of, edited):
    runs, _ = of(Loop())
    held = replace(runs[1], role="validate")
    louder = edited(held, lambda c: replace(c, samples=2.0 * c.samples) if c.location == "arm" else c)
    laws = [
        followed(prepare(builders.campaign_of([hit, runs[0], last])))[0].observed.law for last in (held, louder)
    ]
    assert laws[0].gain == pytest.approx(laws[1].gain, rel=0.01)  # what is left comes by way of the joint's start


def test_a_motion_that_shows_no_rest_or_has_two_clocks_gives_no_angle(plain):
    run = followed(plain)[0]
    law = run.observed.law
    assert followed_angle(run.motor, run.command, 0.0, law) is not None
    signal = run.command.signal
    moving = replace(run.command, signal=replace(signal, start=signal.start - 0.5, end=signal.end - 0.5))
    assert followed_angle(run.motor, moving, 0.0, law) is None
    assert followed_angle(run.motor, replace(run.command, device=7), 0.0, law) is None


def test_the_stated_errors_are_those_of_noise(builders, hit, of, plain):
    """ln K_p of further recordings scatters by what is stated, within a factor of three either way."""
    further = (prepare(builders.campaign_of([hit, *of(Loop(), seed)[0]])) for seed in range(2, 7))
    laws = [followed(problem)[0].observed.law for problem in (plain, *further)]
    found = [(math.log(law.gain), math.sqrt(law.covariance[0, 0])) for law in laws]
    gains, stated = np.array(found).T
    assert np.std(gains, ddof=1) < 3.0 * np.mean(stated)


def test_likely_laws_scatter_by_their_covariance():
    covariance = np.zeros((4, 4))
    covariance[:2, :2] = [[4e-4, 3e-4], [3e-4, 9e-4]]
    law = DriveLaw(gain=50.0, integral=400.0, covariance=covariance)
    rng = np.random.default_rng(5)
    drawn = [law.drawn(rng) for _ in range(4000)]
    logs = np.array([(math.log(d.gain / 50.0), math.log(d.integral / 400.0)) for d in drawn])
    assert np.cov(logs.T) == pytest.approx(covariance[:2, :2], rel=0.1)
    assert {(d.ahead, d.outer) for d in drawn} == {(0.0, 0.0)}


def test_what_the_laws_error_does_is_had_again_with_the_logs_noise(plain):
    run = followed(plain)[0]
    relog = relogged(run)
    paths = np.stack([driven_by(run, relog, turn).observed_half for turn in range(LOGS)])
    spread = run.ratio * float(np.sqrt(np.mean(np.var(paths, axis=0))))
    assert spread == pytest.approx(run.observed.law.angle_error, rel=0.8)
    known = replace(run, observed=replace(run.observed, law=None))
    assert relogged(known).observed == ()


def test_a_gain_that_no_motion_tells_is_drawn_within_bounds():
    """An integral gain known to a factor of e^4500: every draw is a law, and what is known scatters as it should."""
    law = DriveLaw(gain=123.0, integral=1.8e-4, covariance=np.diag([0.094**2, 4500.0**2, 0.0, 0.0]))
    drawn = [law.drawn(np.random.default_rng(k)) for k in range(200)]
    assert all(law.integral / UNTOLD <= one.integral <= law.integral * UNTOLD for one in drawn)
    assert np.std(np.log([one.gain / law.gain for one in drawn])) == pytest.approx(0.094, rel=0.15)
