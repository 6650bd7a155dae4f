"""Recordings of joints integrated by SciPy, so that the compiled model is tested against another integrator."""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import lfilter

from jointscope.diagnosis.base import whitened
from jointscope.diagnosis.coordinates import coordinates
from jointscope.diagnosis.noise import white
from jointscope.diagnosis.objective import Objective
from jointscope.diagnosis.predict import predict_outputs
from jointscope.diagnosis.refit import Fit
from jointscope.recordings.campaign import Campaign, Channel, Nameplate, Run, Stream

G = 9.80665


@dataclass(frozen=True)
class Plant:
    """A two-inertia joint; ``extra`` adds (motor, load) torques from (t, q_s, v_s, q, v)."""

    K: float = 1.9e5
    c: float = 60.0
    J_L: float = 3.0
    J_m: float = 4.58e-4
    n: float = 141.0
    b_m: float = 2.0
    b_l: float = 2.0
    eta: float = 0.7
    weight: float = 6.0 * G * 0.5
    extra: Callable[[float, np.ndarray], tuple[float, float]] | None = None

    def rates(self, load, motor, braked: bool):
        J_M, K, c, J_L, weight = self.J_m * self.n**2, self.K, self.c, self.J_L, self.weight
        b_m, b_l, extra, cos = (
            self.b_m,
            self.b_l,
            self.extra,
            math.cos,
        )  # looked up once: f is called a million times

        def f(t, x):
            q_s, v_s, q, v = x.tolist()
            T = K * (q_s - q) + c * (v_s - v)
            m, arm = (0.0, 0.0) if extra is None else extra(t, (q_s, v_s, q, v))
            a = (T + load(t) - weight * cos(q) - b_l * v + arm) / J_L
            if braked:
                return 0.0, 0.0, v, a
            return v_s, (motor(t) - T - b_m * v_s + m) / J_M, v, a

        return f

    def motion(self, load, motor, braked: bool, q0: float, duration: float):
        start = [q0 + self.weight * math.cos(q0) / self.K, 0.0, q0, 0.0]
        f = self.rates(load, motor, braked)
        solution = solve_ivp(
            f, (0.0, duration), start, method="DOP853", rtol=1e-8, atol=1e-11, max_step=2e-3, dense_output=True
        ).sol
        return solution, f


def channel(column, quantity, unit, location, role, samples, **more) -> Channel:
    return Channel(
        column=column, quantity=quantity, unit=unit, location=location, role=role,
        samples=np.asarray(samples, dtype=float), **more,
    )  # fmt: skip


def _settled_high_pass(x, corner, rate):
    k = math.tan(math.pi * corner / rate)
    return lfilter(np.array([1.0, -1.0]) / (1.0 + k), [1.0, (k - 1.0) / (1.0 + k)], x - x[0])


def hammer_run(plant: Plant, peak: float, name: str, *, q0=0.0, duration=1.5, rate=1024.0, **more) -> Run:
    """One hit at 0.8 m, an ac-coupled accelerometer at 0.95 m."""
    t = np.arange(int(duration * rate)) / rate
    load = lambda u: 0.8 * peak * math.exp(-(((u - 0.1) / 0.002) ** 2))  # noqa: E731
    motion, f = plant.motion(load, lambda u: 0.0, True, q0, duration)
    x = motion(t)
    a = np.array([f(u, s)[3] for u, s in zip(t, x.T, strict=True)])
    y = _settled_high_pass(0.95 * a + G * np.cos(x[2]) * (plant.weight > 0), 0.5, rate)
    force = np.array([load(u) for u in t]) / 0.8
    stream = Stream(
        file=f"{name}.csv",
        sampling_rate=rate,
        length=t.size,
        channels=(
            channel("f", "force", "N", "arm", "input", force, radius=0.8),
            channel(
                "a", "linear-acceleration", "m/s^2", "arm", "output", y, radius=0.95, coupling="ac", low_cutoff=0.5
            ),
        ),
    )
    return Run(id=name, experiment="hammer", streams=(stream,), brake=True, arm_angle=q0, **more)


def sweep_run(plant: Plant, amplitude: float, name: str, *, q0=-1.047, duration=2.0, encoder=True, **more) -> Run:
    """Torque swept over 4-80 Hz, logged at 500 Hz with the motor's angle by a second device."""
    rate, slow = 1024.0, 500.0
    t, tl = np.arange(int(duration * rate)) / rate, np.arange(int(duration * slow)) / slow
    hold = plant.weight * math.cos(q0)

    def motor(u):
        chirp = math.sin(2 * math.pi * (4.0 * u + 76.0 / (2 * duration) * u * u))
        return hold + amplitude * min(max(u / 0.1, 0.0), 1.0) * chirp

    motion, f = plant.motion(lambda u: 0.0, motor, False, q0, duration)
    x = motion(t)
    a = np.array([f(u, s)[3] for u, s in zip(t, x.T, strict=True)])
    y = _settled_high_pass(0.95 * a + G * np.cos(x[2]) * (plant.weight > 0), 0.5, rate)
    torque = np.array([motor(u) for u in tl]) / plant.n / plant.eta
    logged = [channel("T", "torque", "N m", "motor", "input", torque)]
    if encoder:
        logged.append(channel("th", "angle", "rad", "motor", "output", motion(tl)[0] * plant.n))
    streams = (
        Stream(
            file=f"{name}-daq.csv",
            sampling_rate=rate,
            length=t.size,
            channels=(
                channel("a", "linear-acceleration", "m/s^2", "arm", "output", y, radius=0.95, coupling="ac",
                        low_cutoff=0.5),
            ),
        ),
        Stream(file=f"{name}-plc.csv", sampling_rate=slow, length=tl.size, channels=tuple(logged)),
    )  # fmt: skip
    return Run(id=name, experiment="torque-sweep", streams=streams, arm_angle=q0, **more)


def edited_run(run: Run, change) -> Run:
    """The run with every channel passed through ``change`` (None drops it)."""
    streams = []
    for stream in run.streams:
        channels = tuple(c for c in (change(c) for c in stream.channels) if c is not None)
        if channels:
            streams.append(replace(stream, channels=channels))
    return replace(run, streams=tuple(streams))


NAMEPLATE = Nameplate(
    topology="two-inertia",
    motion="rotational",
    plane="vertical",
    reduction_ratio=141.0,
    motor_inertia=2.1e-4,
    reducer_inertia=2.48e-4,
    arm_mass=6.0,
    arm_com_radius=0.5,
    efficiency=0.7,
    motor_damping=1.0,
    load_damping=4.0,
    stiffness_reference=1.5e5,
    inertia_reference=3.6,
)


def campaign_of(runs, rig: Nameplate = NAMEPLATE) -> Campaign:
    return Campaign(path=Path("bench"), rig=rig, runs=tuple(runs))


@pytest.fixture(scope="session")
def one_effect():
    """The effort that says which single effect leads, with no pairs tried."""
    from jointscope.diagnosis.search import Effort

    return Effort(beam=0, children=0, pairs=0, size=1)


@pytest.fixture(scope="session")
def plant() -> Plant:
    return Plant()


@pytest.fixture(scope="session")
def bench(plant) -> Campaign:
    """Two hits and a sweep of the same joint, without noise."""
    runs = (hammer_run(plant, 100.0, "a"), hammer_run(plant, 300.0, "b"), sweep_run(plant, 30.0, "c"))
    return campaign_of(runs)


@pytest.fixture(scope="session")
def problem(bench):
    from jointscope.diagnosis.prepare import prepare

    return prepare(bench)


@pytest.fixture(scope="session")
def truth(problem, plant):
    return problem.theta(
        stiffness=plant.K, damping=plant.c, load_inertia=plant.J_L, motor_damping=2.0, load_damping=2.0, torque_offset=0.0,
    )  # fmt: skip


def recorded_of(problem, share, pickup=0.0, seed=1, effects=()):
    """The problem's own predictions at its start, ``effects`` in it, as data, with white noise of a share of each channel's rms.

    Accelerations also pick up what drives the run, ``pickup`` times their own rms.
    """
    from jointscope.diagnosis.noise import ANGULAR
    from jointscope.diagnosis.predict import predict_outputs

    rng = np.random.default_rng(seed)
    runs = []
    for run in problem.runs:
        outputs = []
        for o, y in zip(run.outputs, predict_outputs(run, problem.base.start, effects, problem), strict=True):
            drive = run.motor if run.motor_moves else run.load
            if not o.observed:
                y = y + share * np.std(y) * rng.standard_normal(y.size)
            if pickup and o.quantity not in ANGULAR and drive is not None:
                u = drive.signal(o.times)
                y = y + pickup * np.std(y) / max(np.std(u), 1e-12) * u
            outputs.append(replace(o, data=y))
        runs.append(replace(run, outputs=tuple(outputs)))
    return replace(problem, runs=tuple(runs))


@pytest.fixture(scope="session")
def recorded():
    """The maker of recordings of which the base at its start is the truth."""
    return recorded_of


@pytest.fixture(scope="session")
def edited():
    """The editor of a run's channels."""
    return edited_run


@pytest.fixture
def deciding():
    """The maker of a decision that names effects at given sizes on top of the base, the best scored first."""
    from jointscope.diagnosis.adjudicate import evidence
    from jointscope.diagnosis.coordinates import coordinates
    from jointscope.diagnosis.search import Hypothesis
    from jointscope.diagnosis.verdict import Decision, Ranked, adequacy_of

    def named(judgement, active):
        base = judgement.base.fit
        where = coordinates(judgement.objective.problem, (active.spec,))
        x = where.pack(base.coordinates.unpack(base.x)[0], (active,))
        fit = replace(base, coordinates=where, x=x, fresh=False)
        return evidence(Hypothesis((active.spec,), fit, 0.0), judgement.objective, judgement.held)

    def decide(judgement, *actives):
        judged = [named(judgement, active) for active in actives]
        ranking = tuple(Ranked(j.names, 0.5, 100.0 - k, j, None) for k, j in enumerate(judged))
        return Decision("effects", judged[0], 0.9, ranking, None, (), adequacy_of(judgement, judged[0]))

    return decide


@pytest.fixture(scope="session")
def builders():
    """The makers of runs, for tests that need others."""

    class Builders:
        Plant, hammer_run, sweep_run, campaign_of, channel, NAMEPLATE = (
            Plant, staticmethod(hammer_run), staticmethod(sweep_run), staticmethod(campaign_of),
            staticmethod(channel), NAMEPLATE,
        )  # fmt: skip
        replace = staticmethod(replace)

    return Builders


@pytest.fixture
def fitted():
    """The objective of a problem under white noise, and the maker of fits as they stand at given values."""
    pools = []

    def made(problem, *truth):
        pools.append(ThreadPoolExecutor(2))
        objective = Objective(problem, predict_outputs, tuple(range(len(problem.runs))), pools[-1])
        objective = whitened(objective, white(problem.runs), objective.predictions(problem.base.start, truth))

        def at(theta, *active):
            where = coordinates(problem, tuple(e.spec for e in active))
            x = where.pack(theta, active)
            w = objective.residual(x, where)
            return Fit(where, x, w, objective.columns(x, where, w, range(where.n)), math.nan, False, True, 1)

        return objective, at

    yield made
    for pool in pools:
        pool.shutdown()


@pytest.fixture
def base_and_trials(fitted):
    """The maker of a base fitted to recordings that hold effects: the objective, the fit, what it leaves, trials of modes."""
    from jointscope.diagnosis.candidates import candidates_for, residuals_of
    from jointscope.diagnosis.effects import catalogue
    from jointscope.diagnosis.refit import least_squares

    def made(problem, effects):
        objective, at = fitted(problem, *effects)
        start = at(problem.base.start)
        base = least_squares(objective, start.coordinates, start.x, iterations=8, tolerance=1e-3)
        theta, _ = base.coordinates.unpack(base.x)
        left = residuals_of(objective, objective.predictions(theta, ()))
        laws = tuple(s for s in catalogue(problem) if s.family == "mode" and s.possible(problem) is None)
        return objective, base, left, candidates_for(problem, laws, left)

    return made


@pytest.fixture(scope="session")
def two(bench):
    """The bench with a second accelerometer nearer to the joint, at 0.55 m."""
    runs, near = [], 0.55
    for run in bench.runs:
        streams = []
        for stream in run.streams:
            further = tuple(
                replace(c, column="a2", radius=near, samples=c.samples * near / c.radius)
                for c in stream.channels
                if c.quantity == "linear-acceleration"
            )
            streams.append(replace(stream, channels=(*stream.channels, *further)))
        runs.append(replace(run, streams=tuple(streams)))
    from jointscope.diagnosis.prepare import prepare

    return prepare(replace(bench, runs=tuple(runs)))
