"""The filter for a noisy input whitens what it should and owes no determinant."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter, lsim, welch

from jointscope.diagnosis.input_noise import Inlet, noise_share, ringing, second_order, shaken
from jointscope.diagnosis.noise import block_noise

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


def test_what_noise_makes_ring_is_white_again():
    """Noise in the log through the true model: nearly all of the residual is ringing before, almost none after."""
    rng = np.random.default_rng(5)
    t = np.arange(20000) / RATE
    w, zeta = 2.0 * np.pi * 40.0, 0.02
    heard = lsim(([w**2], [1.0, 2.0 * zeta * w, w**2]), 0.05 * rng.standard_normal(t.size), t)[1]
    left = heard + 0.05 * rng.standard_normal(t.size)
    quiet = ringing((40.0, zeta), 1.0, RATE)(left)
    assert _lag(left) > 0.5
    assert abs(_lag(quiet)) < 0.1


def test_a_record_that_stands_still_has_no_share_of_an_inputs_noise():
    """A motor held by its friction: no step, no noise, and nothing to divide by."""
    motor = SimpleNamespace(noise=0.1, signal=SimpleNamespace(rate=RATE))
    run = SimpleNamespace(motor=motor, ratio=100.0)
    way = Inlet(inertia=2.0, factor=1.0, poles={})
    still = SimpleNamespace(
        quantity="angle", data=np.full(400, 0.3), mask=np.ones(400, dtype=bool), location="motor", rate=RATE
    )
    assert noise_share(run, still, way, 0.0, 12.0) == 0.0
    assert noise_share(run, still, way, 1e-6, 12.0) > 0.0


def _lag(x):
    return float(np.corrcoef(x[:-1], x[1:])[0, 1])


def shaken_acceleration(rng, seconds, pole, torque):
    """White noise of one, and what a joint with this pole makes of white torque: s^2/(s^2 + 2 zeta w s + w^2)."""
    t = np.arange(round(seconds * RATE)) / RATE
    w, zeta = 2.0 * np.pi * pole[0], pole[1]
    moved = lsim(([1.0, 0.0, 0.0], [1.0, 2.0 * zeta * w, w**2]), torque * rng.standard_normal(t.size), t)[1]
    return moved + rng.standard_normal(t.size)


def test_a_joint_that_is_shaken_is_white_again():
    """A peak of 60 times the sensor's power is gone to less than a third, and hardly anything else is touched."""
    pole = (18.0, 0.012)
    left = shaken_acceleration(np.random.default_rng(8), 200.0, pole, 0.2)
    f, before = welch(left, RATE, nperseg=8192)
    after = welch(shaken(pole, 60.0, RATE)(left), RATE, nperseg=8192)[1]
    at = np.abs(f - pole[0]) < 0.3
    beside = (f > 60.0) & (f < 400.0)
    assert before[at].mean() > 20.0 * before[beside].mean()
    assert after[at].mean() < 3.0 * after[beside].mean()


def record(n):
    data = 50.0 * np.exp(-np.arange(n) / 300.0)
    return SimpleNamespace(quantity="acceleration", rate=RATE, data=data, mask=np.ones(n, bool), step=None)


@pytest.mark.parametrize(("torque", "rings"), [(0.0, False), (0.2, True)])
def test_a_block_rings_where_the_joint_does_and_not_where_its_noise_is_white(torque, rings):
    """Hits of two seconds: a line of any frequency near the pole would explain hundreds of nats of such noise."""
    rng = np.random.default_rng(9)
    left = [shaken_acceleration(rng, 2.0, (18.0, 0.012), torque) for _ in range(12)]
    noise = block_noise([record(r.size) for r in left], left, 12, own_pole=(18.0, 0.012))
    assert (noise.ringing is not None) is rings
