"""Laws of reading between samples."""

import numpy as np
import pytest

from jointscope.recordings.bandlimited import bandlimited


@pytest.mark.parametrize("frequency", [3.0, 80.0, 150.0, 225.0])
def test_a_sine_below_09_of_half_the_rate_is_read_back_to_1e_5(frequency):
    rate = 500.0
    n = 1500

    def window(t):
        return 0.5 - 0.5 * np.cos(2 * np.pi * t * rate / (n - 1))

    t = np.arange(n) / rate
    curve = bandlimited(window(t) * np.sin(2 * np.pi * frequency * t), rate)
    fine = np.linspace(0.2, 2.8, 7001)
    truth = window(fine) * np.sin(2 * np.pi * frequency * fine)
    assert np.max(np.abs(curve(fine) - truth)) < 1e-5


def test_the_samples_themselves_come_back_unchanged(rng):
    x = rng.standard_normal(300)
    curve = bandlimited(x, 100.0, start=2.0)
    assert curve(2.0 + np.arange(300) / 100.0) == pytest.approx(x, abs=1e-9)


def test_the_derivative_of_a_sine_is_its_cosine():
    rate, w = 500.0, 2 * np.pi * 40.0
    t = np.arange(1000) / rate
    inner = np.linspace(0.3, 1.6, 1777)
    assert bandlimited(np.sin(w * t), rate)(inner, 1) == pytest.approx(w * np.cos(w * inner), abs=2e-3 * w)


def test_a_constant_stays_constant_inside_and_outside_the_record():
    curve = bandlimited(np.full(80, 3.5), 200.0, start=-1.0)
    t = np.linspace(-5.0, 5.0, 500)
    assert curve(t) == pytest.approx(3.5)
    assert curve(t, 1) == pytest.approx(0.0, abs=1e-8)


def test_a_gap_is_bridged():
    x = np.linspace(0.0, 1.0, 200)
    x[90:95] = np.nan
    curve = bandlimited(x, 100.0)
    assert curve(np.array([0.92])) == pytest.approx(92 / 199, abs=1e-6)
