"""The estimate of a noisy log: the log itself without noise, less noise with it, a transient where it was."""

import numpy as np
import pytest

from jointscope.diagnosis.input_estimate import estimated_input
from jointscope.diagnosis.input_noise import log_noise, white_part

RATE = 800.0
T = np.arange(4000) / RATE
SLOW = 40.0 * np.sin(2.0 * np.pi * 0.5 * T) * np.clip((T - 0.5) * 1.2, 0.0, 1.0)
BURST = 10.0 * np.exp(-(((T - 2.0) / 0.05) ** 2)) * np.cos(2.0 * np.pi * 30.0 * T)


def cleaned(samples):
    return estimated_input(samples, RATE, log_noise(samples, RATE))


def test_a_log_without_noise_is_left_alone():
    np.testing.assert_allclose(cleaned(SLOW + BURST), SLOW + BURST, atol=2e-3)


@pytest.mark.parametrize("noise", [0.1, 0.5])
def test_most_of_the_noise_goes_and_the_transient_stays(noise):
    u = SLOW + BURST
    x = cleaned(u + noise * np.random.default_rng(0).standard_normal(T.size))
    assert np.std(x - u) < 0.35 * noise
    window = slice(1500, 1700)
    assert np.corrcoef((x - SLOW)[window], BURST[window])[0, 1] > 0.99


def test_noise_alone_is_nearly_silenced():
    eta = np.random.default_rng(1).standard_normal(T.size)
    assert np.std(cleaned(eta)) < 0.3


def test_a_steady_torque_keeps_its_mean():
    eta = np.random.default_rng(2).standard_normal(T.size)
    assert np.mean(cleaned(30.0 + eta)) == pytest.approx(30.0, abs=0.1)


def test_a_short_log_is_left_alone():
    short = np.random.default_rng(3).standard_normal(50)
    assert cleaned(short) is short


def test_what_was_taken_off_is_white():
    noise = 0.5
    y = SLOW + noise * np.random.default_rng(4).standard_normal(T.size)
    assert white_part(y - cleaned(y)) == pytest.approx(noise, rel=0.2)


def swept(top: float) -> np.ndarray:
    return 40.0 * np.sin(2.0 * np.pi * (1.0 + 0.5 * top * T / T[-1]) * T)


@pytest.mark.parametrize(
    "signal",
    [np.zeros(T.size), SLOW + BURST, swept(30.0), swept(200.0)],
    ids=["nothing", "burst", "sweep", "fast sweep"],
)
@pytest.mark.parametrize("noise", [0.05, 1.0])
def test_a_logs_noise_is_found_under_any_torque(signal, noise):
    y = signal + noise * np.random.default_rng(5).standard_normal(T.size)
    assert log_noise(y, RATE) == pytest.approx(noise, rel=0.15)


def random_torque(top: float, size: float = 8.0) -> np.ndarray:
    """Gaussian, flat up to ``top`` [Hz] and nothing above, as an exciter makes it."""
    f = np.fft.rfftfreq(T.size, 1.0 / RATE)
    rng = np.random.default_rng(7)
    x = np.fft.irfft(
        (f > 2.0) * (f < top) * (rng.standard_normal(f.size) + 1j * rng.standard_normal(f.size)), T.size
    )
    return size * x / np.std(x)


@pytest.mark.parametrize("top", [90.0, 200.0, 270.0])
def test_a_random_torque_is_no_noise(top):
    """Of half the rate it fills up to 0.68; what is never excited shows the log's noise, and the torque is left as it is."""
    u = random_torque(top)
    y = u + 0.02 * np.random.default_rng(8).standard_normal(T.size)
    assert log_noise(y, RATE) == pytest.approx(0.02, rel=0.3)
    assert np.std(cleaned(y) - u) < 0.005 * np.std(u)


def test_third_differences_take_a_sweep_for_noise():
    y = swept(200.0) + 0.05 * np.random.default_rng(5).standard_normal(T.size)
    assert white_part(y) > 0.5


def test_a_coarse_recorder_is_as_noisy_as_its_step():
    y = np.round(swept(30.0) / 0.5) * 0.5
    assert log_noise(y, RATE) == pytest.approx(0.5 / np.sqrt(12.0), rel=0.3)


def test_what_stands_out_of_the_noise_keeps_its_size():
    """A sweep keeps its size, loud or quiet: 1 - S_eta/S would take as much off the one as off the other."""
    eta = np.random.default_rng(6).standard_normal(T.size)
    for size in (0.1, 0.3, 1.0):
        u = size * swept(30.0)
        x = cleaned(u + 0.5 * eta)
        gain = float(x @ u) / float(u @ u)
        by_chance = 0.5 * float(eta @ u) / float(u @ u)
        assert gain - by_chance == pytest.approx(1.0, abs=0.5e-3 / size)


def test_the_estimate_is_of_the_size_of_its_own_noise():
    assert np.mean(np.square(cleaned(np.random.default_rng(7).standard_normal(T.size)))) < 0.02


def test_several_logs_at_once_are_what_each_is_alone():
    noise = 0.5 * np.random.default_rng(7).standard_normal((3, T.size))
    together = estimated_input(SLOW + BURST + noise, RATE, 0.5)
    alone = np.stack([estimated_input(SLOW + BURST + eta, RATE, 0.5) for eta in noise])
    np.testing.assert_allclose(together, alone, atol=1e-12)
