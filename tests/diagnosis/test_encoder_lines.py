"""An encoder's line is taken off, a gear's error of the same order, a line in time, and noise are left."""

import math
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from jointscope.diagnosis.assembly import BASE_INDEX
from jointscope.diagnosis.encoder_lines import without_encoder_lines
from jointscope.diagnosis.wind_up import WIND_UP

RATE, SECONDS, NOISE = 250.0, 10.0, 1e-5
K, C, J_L = 2.0e6, 3000.0, 600.0  # 9 Hz on the held motor
ORDER, SIZE = 800.0, 7e-5


@dataclass(frozen=True)
class Channel:
    times: np.ndarray
    data: np.ndarray
    mask: np.ndarray
    quantity: str = WIND_UP
    location: str = "transmission"
    direction: str = "tangential"
    rate: float = RATE
    radius: None = None
    followed_to: float = 0.5


@dataclass(frozen=True)
class Take:
    outputs: tuple[Channel, ...]
    observed_half: np.ndarray
    run: object
    observed: object
    t0: float = 0.0
    grid_rate: float = RATE
    initial_angle: float = 0.0
    motor_moves: bool = True
    mode: str = "observer"


@dataclass(frozen=True)
class Case:
    runs: tuple[Take, ...]
    findings: tuple[str, ...] = ()


def angle(t, pace, start):
    """A motion at varying speed, its line between 0 and 60 Hz."""
    return start + 0.25 * np.sin(0.9 * pace * t) + 0.03 * np.sin(2.3 * pace * t)


def of_a_gear(t, pace, start):
    """q_s - q of an arm behind a gear whose error is sin(o q), the motor's angle given: J q'' = K (e - q) + c (e' - q')."""
    fine = np.arange(0.0, SECONDS, 1.0 / (8.0 * RATE))
    e = SIZE * np.sin(ORDER * angle(fine, pace, start) + 0.7)
    rate = np.gradient(e, fine)

    def rates(now, x):
        pull = K * (np.interp(now, fine, e) - x[0]) + C * (np.interp(now, fine, rate) - x[1])
        return [x[1], pull / J_L]

    path = solve_ivp(rates, (0.0, SECONDS), [e[0], 0.0], t_eval=t, max_step=1.0 / (4.0 * RATE), rtol=1e-6)
    return -path.y[0]


LEFT = {
    "encoder": lambda t, pace, start: SIZE * np.sin(ORDER * angle(t, pace, start) + 0.7),
    "gear": of_a_gear,
    "time": lambda t, pace, start: SIZE * np.sin(2.0 * math.pi * 21.0 * t),
    "nothing": lambda t, pace, start: 0.0 * t,
}


def staged(kind, signal=1e-3, experiments=("speed-motion",) * 3):
    rng = np.random.default_rng(4)
    takes, left = [], []
    ways = ((1.0, 0.0), (0.8, -0.2), (1.1, 0.1), (0.9, 0.0))
    for experiment, (pace, start) in zip(experiments, ways, strict=False):
        t = np.arange(round(RATE * SECONDS)) / RATE
        half = np.arange(2 * t.size + 1) / (2.0 * RATE)
        r = LEFT[kind](t, pace, start) + NOISE * rng.standard_normal(t.size)
        wind_up = signal * np.sin(0.9 * pace * t)
        takes.append(
            Take(
                (Channel(t, wind_up + r, np.ones(t.size, bool)),),
                angle(half, pace, start),
                SimpleNamespace(experiment=experiment, brake=False),
                SimpleNamespace(rate_signal=False, commanded=False),
            )
        )
        left.append((wind_up, r))
    theta = np.zeros(max(BASE_INDEX.values()) + 1)
    for name, value in (("stiffness", K), ("damping", C), ("load_inertia", J_L)):
        theta[BASE_INDEX[name]] = value
    objective = SimpleNamespace(
        prepared=takes,
        runs=tuple(range(len(takes))),
        whiteners=[lambda arrays: np.concatenate(arrays) / NOISE] * len(takes),
        whiten_run=lambda i, predicted: left[i][1] / NOISE,
        map=lambda f, items: [f(item) for item in items],
    )
    fit = SimpleNamespace(x=None, coordinates=SimpleNamespace(unpack=lambda x: (theta, ())))
    stage = SimpleNamespace(objective=objective, fit=fit, predictions=[((),)] * len(takes))
    return Case(tuple(takes)), stage, left


def test_a_line_of_an_encoder_is_taken_off():
    case, stage, left = staged("encoder")
    found = without_encoder_lines(case, stage)
    (said,) = found.findings
    assert "800" in said and "70" in said
    for run, (wind_up, _) in zip(found.runs, left, strict=True):
        assert np.std(run.outputs[0].data - wind_up) < 1.1 * NOISE


def test_a_line_that_two_experiments_show_is_taken_off_each_once():
    case, stage, left = staged(
        "encoder", experiments=("speed-motion", "speed-motion", "torque-sweep", "torque-sweep")
    )
    found = without_encoder_lines(case, stage)
    assert len(found.findings) == 2
    for run, (wind_up, _) in zip(found.runs, left, strict=True):
        assert np.std(run.outputs[0].data - wind_up) < 1.1 * NOISE


@pytest.mark.parametrize("kind", ["gear", "time", "nothing"])
def test_what_is_no_encoder_s_is_left(kind):
    case, stage, _ = staged(kind)
    assert without_encoder_lines(case, stage) is case


def test_what_is_a_good_part_of_the_signal_is_no_blemish():
    case, stage, _ = staged("encoder", signal=2e-4)
    assert without_encoder_lines(case, stage) is case


def test_of_one_run_it_is_not_told():
    case, stage, _ = staged("encoder")
    stage.objective.prepared, stage.predictions = stage.objective.prepared[:1], stage.predictions[:1]
    assert without_encoder_lines(case, stage) is case
