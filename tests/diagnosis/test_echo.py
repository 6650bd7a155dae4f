"""What the noise of a torque log makes a model do, and that an effect must explain more than that."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import butter, lfilter, sosfiltfilt, sosfreqz

from jointscope.diagnosis.echo import Echo, echoes, from_noise_alone, relogs
from jointscope.diagnosis.energies import by_experiment, drowned, heard, improvement
from jointscope.diagnosis.inputs import Drive
from jointscope.diagnosis.objective import Objective
from jointscope.diagnosis.relog import relogged
from jointscope.recordings.bandlimited import bandlimited

RATE, COUNT = 1000.0, 8192
BAND = 0.3  # of half the rate, that the torque fills
KEY = ("torque-sweep", "linear-acceleration", "arm", "tangential")


@dataclass(frozen=True)
class Take:
    """As much of a prepared run as an echo needs."""

    motor: Drive | None
    motor_half: np.ndarray
    outputs: tuple
    run: SimpleNamespace = field(default_factory=lambda: SimpleNamespace(experiment=KEY[0]))
    observed: None = None
    mode: str = "braked"
    t0: float = 0.0
    grid_rate: float = RATE
    steps: int = COUNT - 1
    index: int = 0

    @property
    def relogged(self):
        return relogged(self)


def take(noise):
    """A torque that fills its band, 1 N m rms, and a log of it with white noise [N m]."""
    rng = np.random.default_rng(4)
    torque = sosfiltfilt(butter(8, BAND, output="sos"), rng.standard_normal(COUNT))
    torque /= np.std(torque)
    half = np.repeat(torque, 2)[:-1]
    output = SimpleNamespace(
        quantity=KEY[1], location=KEY[2], direction=KEY[3], rate=RATE, mask=np.ones(COUNT, bool)
    )
    drive = Drive(bandlimited(torque, RATE, 0.0), 0, 1.0, True, torque, noise)
    return Take(drive, half, (output,))


def echo_of(run, gain=1.0):
    """Of a model whose output is ``gain`` times the torque."""
    with ThreadPoolExecutor(1) as pool:
        objective = Objective(SimpleNamespace(runs=(run,)), lambda r, *_: (gain * r.motor_half[::2],), (0,), pool)
        return echoes(objective, relogs(objective), np.zeros(0), ()).energies


def test_where_the_log_holds_a_signal_its_noise_is_left_in_it():
    """White noise of 0.01 N m keeps the share of its power that lies where the torque is stronger than it."""
    power = np.abs(sosfreqz(butter(8, BAND, output="sos"))[1]) ** 4
    share = np.mean(power / np.mean(power) > 0.01**2)
    assert 0.3 < share < 0.45
    assert echo_of(take(0.01))[KEY] == pytest.approx(share * 0.01**2 * COUNT, rel=0.1)


def test_an_echo_is_as_strong_as_the_noise_and_the_model():
    """Twice the noise, or twice the gain: four times the energy."""
    one = echo_of(take(0.01))[KEY]
    assert echo_of(take(0.02))[KEY] == pytest.approx(4.0 * one, rel=0.1)
    assert echo_of(take(0.01), gain=2.0)[KEY] == pytest.approx(4.0 * one, rel=1e-9)


def test_a_clean_log_has_no_echo():
    assert echo_of(take(0.0)) == {}


@pytest.mark.parametrize(("echo", "material"), [(0.0, 0.1), (0.75, 0.05), (1.0, 0.0), (3.0, 0.0)])
def test_what_an_echo_could_explain_does_not_count(echo, material):
    """1 of 100 is explained: 10 % in rms; less the echo's energy, 5 %, and nothing."""
    before, after = {KEY: (5.0, 100.0)}, {KEY: (4.0, 100.0)}
    assert improvement(before, before, after, {KEY: echo})[0] == pytest.approx(material)


@pytest.mark.parametrize(
    ("echo", "nats", "counted"),
    [
        (0.5, 20.0, [7.0, -2.0, 9.0]),
        (2.0, 20.0, [0.0, -2.0, 9.0]),
        (2.0, 4.0, [7.0, -2.0, 9.0]),  # little of the energy, in a band where the echo is weak
    ],
)
def test_gains_of_runs_that_only_follow_an_echo_do_not_count(echo, nats, counted):
    """Losses do, and so do the gains of hits, which no log drives."""
    runs = tuple(SimpleNamespace(run=SimpleNamespace(experiment=e)) for e in (KEY[0], KEY[0], "hammer"))
    gains = np.array([7.0, -2.0, 9.0])
    heard_of = Echo({KEY: echo}, {KEY[0]: nats})
    silent = drowned(heard_of, {KEY: (5.0, 100.0)}, {KEY: (4.0, 100.0)}, by_experiment(gains, runs), {}, dict)
    np.testing.assert_array_equal(heard(gains, runs, silent), counted)


def test_an_effect_follows_only_the_echo_that_lies_along_it():
    """A large echo in one direction is nothing to an effect that changes another one."""
    runs = tuple(SimpleNamespace(run=SimpleNamespace(experiment=KEY[0])) for _ in range(2))
    rng = np.random.default_rng(8)
    echo = np.zeros((8, 50))
    echo[:, 0], echo[:, 1] = 30.0 * rng.standard_normal(8), 0.5 * rng.standard_normal(8)
    heard_of = Echo({KEY: 2.0}, {KEY[0]: 900.0}, (echo, echo[::-1]))
    with_it, across = np.eye(50)[0], np.eye(50)[1]
    assert heard_of.along(runs, [7.0 * with_it, with_it])[KEY[0]] > 900.0
    most = heard_of.along(runs, [7.0 * across, across])
    assert most[KEY[0]] < 12.5 * 4.0 * 0.25
    gains = {KEY[0]: 60.0, "hammer": 30.0}
    before, after = {KEY: (5.0, 100.0)}, {KEY: (4.0, 100.0)}
    assert drowned(heard_of, before, after, gains, most, dict) == set()
    assert drowned(heard_of, before, after, gains, {KEY[0]: 2000.0}, dict) == {KEY[0]}
    alone = {**gains, "hammer": 2.0}  # hits say nothing of it
    assert drowned(heard_of, before, after, alone, most, lambda: {KEY[0]: 70.0}) == {KEY[0]}
    assert drowned(heard_of, before, after, alone, most, lambda: {KEY[0]: -300.0}) == set()
    assert heard_of.along(runs, [np.zeros(50), np.zeros(50)]) == {}


def ringing_of(noises, zeta):
    """A mode driven by white noise, shape of ``noises``."""
    w = 2.0 * np.pi * 0.05
    a = [1.0, -2.0 * np.exp(-zeta * w) * np.cos(w), np.exp(-2.0 * zeta * w)]
    return lfilter([1.0], a, noises, axis=1)


def test_a_model_that_damps_the_noise_gains_from_it_and_one_that_adds_a_line_loses():
    """Nothing is left out: half of |r|^2 less that of the child's r, on average, with five standard deviations."""
    rng = np.random.default_rng(12)
    noises = np.concatenate([np.zeros((1, 3000)), 0.1 * rng.standard_normal((8, 3000))])
    runs = (SimpleNamespace(run=SimpleNamespace(experiment=KEY[0])),)
    parent = {0: ringing_of(noises, 0.02)}
    damped, line = {0: ringing_of(noises, 0.04)}, {0: parent[0] + np.sin(0.9 * np.arange(3000))}
    assert from_noise_alone(runs, parent, damped)[KEY[0]] > 0.3 * 0.5 * np.sum(parent[0][1:] ** 2) / 8
    assert from_noise_alone(runs, parent, line)[KEY[0]] < -0.4 * 1500
    assert from_noise_alone(runs, parent, parent)[KEY[0]] == 0.0
