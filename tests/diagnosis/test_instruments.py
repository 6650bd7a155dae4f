"""Closed forms of the instruments: lags, logs, mounts and the recorder."""

import numpy as np
import pytest

from jointscope.diagnosis.acquisition import lagged, looped, relogged
from jointscope.diagnosis.channels import _commensurate, _read, _table, mount_resonance, recorded


def test_lag_has_the_gain_and_phase_of_a_first_order_law():
    rate, tau, f = 8192.0, 1e-3, 60.0
    t = np.arange(8192) / rate
    y = lagged(np.sin(2 * np.pi * f * t), tau, rate)[4096:]
    H = 1.0 / (1.0 + 2j * np.pi * f * tau)
    np.testing.assert_allclose(y, np.imag(H * np.exp(2j * np.pi * f * t[4096:])), atol=2e-4)


def test_a_tuned_current_loop_is_flat_and_late_as_a_delay_is():
    """1/(1 + s t + s^2 t^2/2): |H| falls with the fourth power of the frequency only, the phase is that of a delay t."""
    rate, tau = 8192.0, 1e-3
    t = np.arange(8192) / rate
    for f in (20.0, 60.0, 150.0):
        s = 2j * np.pi * f * tau
        H = 1.0 / (1.0 + s + s**2 / 2.0)
        y = looped(np.sin(2 * np.pi * f * t), tau, rate)[4096:]
        np.testing.assert_allclose(y, np.imag(H * np.exp(2j * np.pi * f * t[4096:])), atol=2e-3)
    assert abs(1.0 / (1.0 + 0.2j + 0.2j**2 / 2.0)) == pytest.approx(1.0 - 0.2**4 / 8.0, abs=1e-5)


@pytest.mark.parametrize(("kind", "log_rate"), [("averaged", 500.0), ("averaged", 250.0), ("held", 250.0)])
def test_a_slow_log_is_undone_below_half_its_rate(kind, log_rate):
    """Averaging or holding a known torque and undoing it gives the torque back; ignoring it does not."""
    rate = 500.0
    fine = np.arange(0, 4.0, 1e-4)
    torque = lambda t: np.sin(2 * np.pi * (4 * t + 7 * t * t)) * np.clip(t * 5, 0, 1) * np.clip((4 - t) * 5, 0, 1)  # noqa: E731
    t = np.arange(2000) / rate
    if kind == "averaged":
        total = np.concatenate([[0.0], np.cumsum(torque(fine)) * 1e-4])
        edge = np.concatenate([fine, [4.0]])
        area = lambda u: np.interp(np.maximum(u, 0.0), edge, total)  # noqa: E731
        log = (area(t) - area(t - 1 / log_rate)) * log_rate
    else:
        log = torque(np.floor(t * log_rate + 1e-9) / log_rate)
    back = relogged(log, rate, rate, log_rate, kind)
    middle = slice(200, 1500)  # up to 46 Hz
    naive = np.std((log - torque(t))[middle])
    assert np.std((back - torque(t))[middle]) < 0.2 * naive


def test_mount_resonance_lifts_low_frequencies_by_the_square():
    rate, f0, f = 8192.0, 600.0, 60.0
    t = np.arange(8192) / rate
    y = mount_resonance(np.sin(2 * np.pi * f * t), f0, 0.05, rate)[4096:]
    assert np.ptp(y) / 2 == pytest.approx(1.0 / (1.0 - (f / f0) ** 2), rel=2e-3)


def test_the_recorder_passes_its_band_and_nothing_above():
    """What lies below 0.4 of the rate is recorded to 2e-5; what lies above 0.6 is gone (to 1e-4)."""
    grid, rate = 4096.0, 1024.0
    t = np.arange(8192) / grid
    times = np.arange(2048) / rate
    inner = slice(100, -100)
    for f, tolerance in ((40.0, 2e-5), (400.0, 2e-3)):
        y = recorded(np.sin(2 * np.pi * f * t), grid, 0.0, times, rate)
        np.testing.assert_allclose(y[inner], np.sin(2 * np.pi * f * times)[inner], atol=tolerance)
    y = recorded(np.sin(2 * np.pi * 640.0 * t), grid, 0.0, times, rate)
    assert np.abs(y[inner]).max() < 1e-4
    shifted = recorded(np.sin(2 * np.pi * 40.0 * t), grid, 0.0, times[:-1] + 0.37 / rate, rate)
    np.testing.assert_allclose(
        shifted[inner], np.sin(2 * np.pi * 40.0 * (times[:-1] + 0.37 / rate))[inner], atol=3e-5
    )


@pytest.mark.parametrize("ratio", [0.8, 1.0, 1.5, 2.0, 2.4, 3.0, 1.37])
@pytest.mark.parametrize("late", [0.0, 0.37, -12.3])
def test_taps_of_each_place_between_nodes_say_what_the_table_says_sample_by_sample(ratio, late):
    """Where a grid meets every few samples alike, ends included; one that never does is read from the table itself."""
    rate, count = 1280.0, 500
    x = np.random.default_rng(3).standard_normal(int(count * ratio) + 20)
    times = (5.0 + late) / (rate * ratio) + np.arange(count) / rate
    expected = np.empty(count)
    _read(x, rate * ratio, 0.0, times, min(rate, rate * ratio), _table(), expected)
    np.testing.assert_allclose(recorded(x, rate * ratio, 0.0, times, rate), expected, atol=1e-10)
    assert (_commensurate(ratio) == 0) == (ratio == 1.37)
