"""The concealed cases' measurement chain: exact where it should be, faulty in the way it says."""

from __future__ import annotations

import numpy as np
import pytest

from jointscope.sim.concealed import measurement
from jointscope.sim.concealed.measurement import Acquisition, Devices, Noise

H = 1e-4
T = np.arange(20000) * H
DEVICES = Devices(
    daq_rate=1024.0, log_rate=500.0, low_cutoff=0.0, full_scale=200.0, motor_counts=2.0**17, arm_counts=2.0**20,
    motor_encoder=True, arm_encoder=True,
)  # fmt: skip
NOISE = Noise(
    acceleration=0.05, colour=0.5, pole=0.95, level=0.002, force=0.2, torque=0.005, arm=1e-6, outliers=0.0,
    hit_gain=0.01, hit_timing=2e-5,
)  # fmt: skip


@pytest.mark.parametrize("frequency", [0.0, 5.0, 80.0, 190.0])
def test_a_sample_is_the_value_of_the_band_limited_signal(frequency):
    """Below 0.4 of the rate nothing changes, neither size nor phase."""
    x = np.cos(2 * np.pi * frequency * T + 0.3)
    times = np.arange(0.2, 1.8, 1 / 500.0)
    found = measurement.resample(x[:, None], H, times, 500.0)[:, 0]
    assert np.max(np.abs(found - np.cos(2 * np.pi * frequency * times + 0.3))) < 2e-3


def test_what_lies_above_half_the_rate_is_gone():
    """No alias above 0.6 of the rate."""
    x = np.cos(2 * np.pi * 330.0 * T)
    times = np.arange(0.2, 1.8, 1 / 500.0)
    assert np.max(np.abs(measurement.resample(x[:, None], H, times, 500.0))) < 2e-3


def test_a_late_stamp_shows_an_earlier_value():
    """delay > 0: the log stamps late, so what it stamps t was so at t - delay; ppm > 0: its clock runs fast."""
    stamps = np.array([1.0, 10.0])
    assert np.allclose(measurement.log_times(stamps, Acquisition(delay=2e-3)), stamps - 2e-3)
    fast = measurement.log_times(stamps, Acquisition(ppm=100.0))
    assert np.allclose(stamps - fast, stamps * 1e-4, rtol=1e-3)


def test_a_held_log_lags_by_half_its_period():
    """A hold delays by half a period on average, the mean of the last frame by a whole one."""
    x = np.sin(2 * np.pi * 4.0 * T)
    times = np.arange(0.0, 1.9, 1e-3)
    for averaged, late in ((0.0, 0.5), (1.0, 1.0)):
        fault = Acquisition(refresh=100.0, averaged=averaged)
        y = measurement.logged_torque(x, H, times, 1000.0, fault)
        keep = (times > 0.25) & (times < 1.75)
        z = np.exp(-2j * np.pi * 4.0 * times[keep])
        phase = np.angle(np.sum(y[keep] * z) / np.sum(np.sin(2 * np.pi * 4.0 * times[keep]) * z))
        assert -phase / (2 * np.pi * 4.0) == pytest.approx(late / 100.0, abs=6e-4)


def test_a_tilted_accelerometer_reads_the_radial_part():
    """cos(angle) tangential + sin(angle) radial, before everything else."""
    proper = np.column_stack([np.full(500, 3.0), np.full(500, 5.0)])
    y = measurement.accelerometer(proper, H, DEVICES, Acquisition(tilt=0.1))
    assert np.allclose(y, 5.0 * np.cos(0.1) + 3.0 * np.sin(0.1))


def test_a_resonant_mount_amplifies_below_its_frequency():
    """Gain 1/(1 - (f/fa)^2) well below the mount's resonance."""
    proper = np.column_stack([np.zeros(T.size), np.sin(2 * np.pi * 100.0 * T)])
    y = measurement.accelerometer(proper, H, DEVICES, Acquisition(resonance=400.0, resonance_damping=0.05))
    assert np.max(np.abs(y[10000:])) == pytest.approx(1.0 / (1.0 - (100.0 / 400.0) ** 2), rel=5e-3)


def test_noise_has_the_spectrum_that_hardness_is_computed_with():
    """The variance per bin of what is added agrees with the model over the band, on average."""
    rng = np.random.default_rng(0)
    rate, n = DEVICES.daq_rate, 2048
    clean = 4.0 * np.sin(2 * np.pi * 40.0 * np.arange(n) / rate)
    power = np.zeros(n // 2 + 1)
    for _ in range(60):
        y = measurement.noisy({"acceleration": clean}, DEVICES, NOISE, rng)["acceleration"]
        power += np.abs(np.fft.rfft(y - clean)) ** 2 / n / 60
    model = measurement.noise_spectrum("acceleration", float(np.std(clean)), n, rate, DEVICES, NOISE)
    for low, high in ((5, 60), (60, 400), (400, 800)):
        assert np.mean(power[low:high]) == pytest.approx(np.mean(model[low:high]), rel=0.15)
