"""FRF estimators: which noise biases which, and that windows are taken off exactly."""

import numpy as np
import pytest

from jointscope.identification.comparison import circle_fit, half_power, least_squares_h1
from jointscope.identification.frf import estimate_frf, from_spectra, without_window

RATE, COUNT = 512.0, 4096
A1, A2, B1 = 4.0, (2 * np.pi * 30.0) ** 2, 0.5


def response(s: np.ndarray) -> np.ndarray:
    return B1 * s**2 / (s**2 + A1 * s + A2)


def records(hits: int = 6) -> tuple[np.ndarray, np.ndarray]:
    """A pulse per hit and its exact band-limited response."""
    rng = np.random.default_rng(1)
    line = np.fft.rfftfreq(4 * COUNT, 1 / RATE)
    u = np.zeros((hits, 4 * COUNT))
    for row in u:
        row[20:26] = rng.uniform(1, 3) * np.sin(np.pi * np.arange(1, 7) / 7)
    y = np.fft.irfft(np.fft.rfft(u) * response(2j * np.pi * line))
    return u[:, :COUNT], y[:, :COUNT]


def test_without_noise_all_estimators_agree_with_the_truth_and_coherence_is_one() -> None:
    u, y = records()
    frf = estimate_frf(u, y, RATE)
    inside = (frf.frequency > 5) & (frf.frequency < 60)
    truth = response(frf.s[inside])
    for estimate in (frf.h1, frf.h2, frf.hv):
        np.testing.assert_allclose(estimate[inside], truth, rtol=2e-3)
    assert frf.coherence[inside].min() > 1 - 1e-6


def test_h1_is_unbiased_by_output_noise_and_h2_by_input_noise() -> None:
    rng = np.random.default_rng(2)
    frequency = np.array([10.0])
    hits = 20000
    u = np.ones((hits, 1), dtype=complex)
    y = 2.0 * u

    def noise() -> np.ndarray:
        return 0.3 * (rng.standard_normal((hits, 1)) + 1j * rng.standard_normal((hits, 1)))

    on_output = from_spectra(frequency, u, y + noise())
    on_input = from_spectra(frequency, u + noise(), y)
    assert abs(on_output.h1[0] - 2.0) < 0.01 < abs(on_output.h2[0] - 2.0)
    assert abs(on_input.h2[0] - 2.0) < 0.02 < abs(on_input.h1[0] - 2.0)
    assert abs(on_output.h1[0]) < abs(on_output.hv[0]) < abs(on_output.h2[0])


def test_the_variance_of_h1_is_what_repeats_show() -> None:
    rng = np.random.default_rng(3)
    estimates, variances = [], []
    for _ in range(400):
        u = rng.uniform(0.5, 2.0, (10, 1)) + 0j
        y = 3.0 * u + 0.1 * (rng.standard_normal((10, 1)) + 1j * rng.standard_normal((10, 1)))
        frf = from_spectra(np.array([1.0]), u, y)
        estimates.append(frf.h1[0])
        variances.append(frf.variance[0])
    spread = np.mean(np.abs(np.array(estimates) - 3.0) ** 2)
    assert np.mean(variances) == pytest.approx(spread, rel=0.15)


@pytest.mark.parametrize("sigma", [1.0, 5.0, 20.0])
def test_the_damping_that_an_exponential_window_adds_is_taken_off_exactly(sigma: float) -> None:
    u, y = records()
    frf = estimate_frf(u, y, RATE, exponential=sigma)
    inside = (frf.frequency > 5) & (frf.frequency < 60)
    np.testing.assert_allclose(frf.h1[inside], response(frf.s[inside]), rtol=3e-3)
    moved = np.poly1d([1.0, A1 + 2 * sigma, A2 + A1 * sigma + sigma**2])
    assert without_window(moved.c[1], moved.c[2], sigma) == pytest.approx((A1, A2))


def test_a_force_window_keeps_the_pulse_and_drops_the_rest() -> None:
    u, y = records()
    noisy = u + 0.02 * np.random.default_rng(4).standard_normal(u.shape)
    plain = estimate_frf(noisy, y, RATE)
    windowed = estimate_frf(noisy, y, RATE, force_window=0.06)
    inside = (plain.frequency > 20) & (plain.frequency < 40)
    truth = response(plain.s[inside])
    assert np.abs(windowed.h1[inside] - truth).mean() < 0.5 * np.abs(plain.h1[inside] - truth).mean()


def test_textbook_methods_find_a_clean_mode() -> None:
    u, y = records()
    frf = estimate_frf(u, y, RATE)
    found = [
        half_power(frf.frequency, frf.h1, 30.0),
        circle_fit(frf.frequency, frf.h1, 30.0, A1 / 2 / A2**0.5),
        least_squares_h1(frf, (5.0, 60.0), 30.0, 0.01),
    ]
    for row, digits in zip(found, (0.05, 0.05, 1e-3), strict=True):
        assert row is not None
        assert row.frequency == pytest.approx(30.0, rel=digits)
        assert row.damping_ratio == pytest.approx(A1 / 2 / A2**0.5, rel=2 * digits)
        assert row.b1 == pytest.approx(B1, rel=2 * digits)


def test_half_power_says_nothing_of_a_peak_that_does_not_fall() -> None:
    frequency = np.linspace(1.0, 50.0, 200)
    assert half_power(frequency, np.ones(200, dtype=complex), 25.0) is None


def test_a_single_hit_has_no_coherence() -> None:
    u, y = records(1)
    assert np.isnan(estimate_frf(u, y, RATE).coherence).all()
