"""Laws of the scores."""

import math

import numpy as np
import pytest

from jointscope.prediction.scores import band_score, contract_error, frac
from jointscope.prediction.spectra import Spectrum, spectrum


@pytest.fixture
def noise(rng):
    return rng.standard_normal(4096)


def test_a_perfect_prediction_scores_zero_error_and_frac_one(noise):
    R = spectrum(noise, 1024.0)
    score = band_score(R, R, 10.0, 75.0)
    assert score.median_error == 0.0
    assert score.frac == pytest.approx(1.0)
    assert score.nrmse == 0.0
    assert score.peak_frequency_error == 0.0
    assert score.share == 1.0


@pytest.mark.parametrize("gain", [0.5, 1.1, 2.0])
def test_a_gain_shows_in_decibels_and_leaves_frac_alone(noise, gain):
    score = band_score(spectrum(noise, 1024.0), spectrum(gain * noise, 1024.0), 10.0, 75.0)
    expected = 20 * math.log10(gain)
    assert score.bias == pytest.approx(expected)
    assert score.median_error == pytest.approx(abs(expected))
    assert score.peak_amplitude_error == pytest.approx(expected)
    assert score.frac == pytest.approx(1.0)
    assert score.nrmse == pytest.approx(abs(gain - 1.0))


def test_frac_is_symmetric_bounded_and_blind_to_scale_and_phase(rng):
    a, b = (rng.standard_normal(50) + 1j * rng.standard_normal(50) for _ in range(2))
    assert frac(a, b) == pytest.approx(frac(b, a))
    assert 0.0 <= frac(a, b) <= 1.0
    assert frac(a, 3j * a) == pytest.approx(1.0)
    assert frac(a, np.zeros_like(a)) == 0.0


def test_the_mask_limits_the_bins_and_the_share_says_so(noise):
    R = spectrum(noise, 1024.0)
    mask = R.frequency % 1.0 < 0.5
    score = band_score(R, R, 10.0, 75.0, mask)
    assert score.share == pytest.approx(0.5, abs=0.02)
    with pytest.raises(ValueError, match="no bin"):
        band_score(R, R, 10.0, 75.0, np.zeros_like(mask))


def test_spectra_on_different_axes_are_refused(noise):
    with pytest.raises(ValueError, match="frequency axis"):
        band_score(spectrum(noise, 1024.0), spectrum(noise[:-2], 1024.0), 1.0, 60.0)


def test_the_peak_is_found_between_bins():
    f = np.arange(200) * 0.5
    height = np.exp(-0.5 * ((f - 40.2) / 2.0) ** 2)
    moved = np.exp(-0.5 * ((f - 40.5) / 2.0) ** 2)
    score = band_score(Spectrum(f, height + 0j), Spectrum(f, moved + 0j), 10.0, 75.0)
    assert score.peak_frequency == pytest.approx(40.2, abs=1e-6)
    assert score.peak_frequency_error == pytest.approx(0.3, abs=1e-6)


def test_a_sine_on_a_bin_shows_its_peak_value():
    t = np.arange(2048) / 1024.0
    for window in ("boxcar", "hann"):
        found = spectrum(2.5 * np.sin(2 * np.pi * 64.0 * t), 1024.0, window)
        assert np.abs(found.amplitude[128]) == pytest.approx(2.5, rel=1e-6)


def test_the_contract_counts_angles_from_their_start_and_the_rest_from_zero(rng):
    x = 5.0 + 0.1 * rng.standard_normal(500)
    assert contract_error(x, 0.0 * x, "linear-acceleration") == pytest.approx(1.0)
    still = np.full(500, x[0])
    assert contract_error(x, still, "angle") == pytest.approx(1.0)
    assert contract_error(x, x + 0.1, "position") > contract_error(x, x + 0.1, "angular-velocity")


def test_samples_that_are_missing_do_not_count():
    x = np.linspace(0.0, 1.0, 100)
    holed = x.copy()
    holed[10:20] = np.nan
    assert contract_error(holed, x, "velocity") == 0.0


def test_a_recording_that_never_moves_has_no_scale():
    assert contract_error(np.zeros(10), np.ones(10), "velocity") == math.inf
    assert contract_error(np.zeros(10), np.zeros(10), "velocity") == 0.0
