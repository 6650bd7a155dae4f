"""The filter for a noisy input whitens what it should, follows the model's own resonance, and owes no determinant."""

import numpy as np
import pytest
from scipy.signal import lfilter, lsim

from jointscope.diagnosis.input_noise import ringing, second_order

RATE = 1000.0


def test_the_polynomial_has_the_sampled_poles():
    """z = exp(s/rate) for both roots of s^2 + 2 zeta w s + w^2, under and over critical damping."""
    for zeta in (0.02, 0.5, 1.7):
        w = 2.0 * np.pi * 40.0 / RATE
        wanted = np.real(np.poly(np.exp(np.roots([1.0, 2.0 * zeta * w, w * w]))))
        assert np.allclose(second_order(40.0, zeta, RATE), wanted, atol=1e-12)


@pytest.mark.parametrize("share", [0.1, 1.0, 10.0])
def test_noise_through_a_resonance_becomes_white(share):
    """White noise plus white noise through w^2/(s^2 + 2 zeta w s + w^2), filtered by A/B, is flat within a few percent."""
    pole = (40.0, 0.02)
    f = np.linspace(1.0, 300.0, 600)
    z = np.exp(-2j * np.pi * f / RATE)
    filtered = ringing(pole, share, RATE)
    gain = np.abs(np.polyval(filtered.numerator[::-1], z) / np.polyval(filtered.denominator[::-1], z)) ** 2
    s, w = 2j * np.pi * f, 2.0 * np.pi * 40.0
    spectrum = 1.0 + share * np.abs(w**2 / (s**2 + 2 * 0.02 * w * s + w**2)) ** 2
    white = gain * spectrum
    assert white.max() / white.min() < 1.6
    assert spectrum.max() / spectrum.min() > 50.0


def test_filter_is_monic_so_that_no_determinant_is_owed():
    """The impulse response of A/B begins with one."""
    assert lfilter(*_coefficients(ringing((35.0, 0.03), 2.0, RATE)), np.eye(8)[0])[0] == 1.0


def _coefficients(filtered):
    return filtered.numerator, filtered.denominator


def test_least_squares_of_the_filtered_residual_is_unbiased_where_the_plain_one_is_not():
    """A resonance driven by a noisily logged input: the damping that fits best is the true one only after A/B."""
    rng = np.random.default_rng(5)
    t = np.arange(20000) / RATE
    u = np.cumsum(rng.standard_normal(t.size)) * 0.004  # little excitation at the resonance
    u -= np.linspace(u[0], u[-1], u.size)
    w, zeta = 2.0 * np.pi * 40.0, 0.02
    logged = u + 0.05 * rng.standard_normal(t.size)

    def response(x, damping):
        return lsim(([w**2], [1.0, 2.0 * damping * w, w**2]), x, t)[1]

    data = response(u, zeta) + 0.05 * rng.standard_normal(t.size)
    grid = np.geomspace(0.008, 0.4, 25)
    plain, filtered = [], []
    for damping in grid:
        left = data - response(logged, damping)
        plain.append(left @ left)
        whitened = ringing((40.0, zeta), 1.0, RATE).at((40.0, damping))(left)
        filtered.append(whitened @ whitened)
    assert grid[int(np.argmin(plain))] > 2.5 * zeta
    assert 0.6 * zeta < grid[int(np.argmin(filtered))] < 1.7 * zeta
