"""The measurement chain does to a signal what its data sheet says, and nothing else."""

import math

import numpy as np
import pytest

from jointscope.sim.measurement import AntiAlias, Clock, Converter, Device, MeasurementError, interpolate_grid
from jointscope.sim.measurement_log import TorqueLog
from jointscope.sim.measurement_sensors import Encoder, iepe, phase_currents
from jointscope.sim.stepping import grid

H = 5e-5


def tone(frequency, duration=2.0, start=0.3, stop=1.7):
    """A tone with smooth ends, so that nothing of it lies outside the record."""
    times = grid(duration, H)
    return times, exact(frequency, times, start, stop)


def exact(frequency, stamps, start=0.3, stop=1.7):
    edge = np.clip(np.minimum(stamps - start, stop - stamps) / 0.2, 0.0, 1.0)
    smooth = edge**4 * (
        35.0 - 84.0 * edge + 70.0 * edge**2 - 20.0 * edge**3
    )  # three derivatives vanish at its ends
    return np.sin(2.0 * np.pi * frequency * stamps) * smooth


@pytest.mark.parametrize("rate", [500.0, 1024.0, 10_000.0])
@pytest.mark.parametrize("share", [0.01, 0.2, 0.4])
def test_samples_are_the_signals_values(rate, share):
    """In the pass band a sample is the instantaneous value, within 1e-4 and without delay."""
    device = Device(sampling_rate=rate)
    _, values = tone(share * rate)
    stamps = device.stamps(2.0)
    np.testing.assert_allclose(device.sample(values, H, stamps), exact(share * rate, stamps), atol=2e-4)


@pytest.mark.parametrize("share", [0.55, 0.8, 1.1, 2.3])
def test_nothing_aliases(share):
    """Above half the rate 80 dB or more are gone."""
    device = Device(sampling_rate=500.0)
    _, values = tone(share * 500.0)
    assert np.abs(device.sample(values, H, device.stamps(2.0))).max() < 1e-4


def test_a_constant_passes_exactly():
    """A resting signal is the same value before, in and after the record."""
    device = Device(sampling_rate=1024.0)
    sampled = device.sample(np.full(5000, 3.7), H, device.stamps(0.3))
    np.testing.assert_allclose(sampled, 3.7, rtol=1e-14)


def test_a_late_clock_shows_the_past():
    """delay > 0 stamps late: the sample stamped t was taken at t - delay; ppm > 0 runs fast."""
    _, values = tone(20.0)
    late = Device(sampling_rate=500.0, clock=Clock(delay=0.004))
    stamps = late.stamps(2.0)
    np.testing.assert_allclose(late.sample(values, H, stamps), exact(20.0, stamps - 0.004), atol=2e-4)
    fast = Device(sampling_rate=500.0, clock=Clock(ppm=200.0))
    np.testing.assert_allclose(fast.sample(values, H, stamps), exact(20.0, stamps / 1.0002), atol=2e-4)


def test_interpolation_is_exact_for_quintics():
    """Six points carry a polynomial of degree five."""
    h, at = 0.1, np.linspace(0.0, 4.9, 37)
    values = (np.arange(50) * h - 2.0) ** 5
    np.testing.assert_allclose(interpolate_grid(values, h, at), (at - 2.0) ** 5, atol=1e-9)


def test_converter_clips_and_rounds():
    """Nothing exceeds full scale, and every sample is a multiple of the step."""
    converter = Converter(full_scale=1.0, bits=8)
    out = converter.convert(np.linspace(-3.0, 3.0, 101), np.random.default_rng(0))
    assert np.abs(out).max() == 1.0
    np.testing.assert_allclose(out * 128.0, np.rint(out * 128.0))


def test_noise_has_its_stated_size():
    """rms as stated, mean zero."""
    out = Converter(full_scale=1.0, noise_rms=0.01).convert(np.zeros(20_000), np.random.default_rng(1))
    assert out.std() == pytest.approx(0.01, rel=0.03)
    assert abs(out.mean()) < 3e-4


def test_iepe_settled_before_the_record():
    """A constant (gravity) is not seen; a step decays with 1/(2 pi f_c); the band is left alone."""
    times = grid(2.0, H)
    assert np.all(iepe(np.full(1000, 9.81), H, 0.5) == 0.0)
    step = iepe(np.where(times > 0.1, 1.0, 0.0), H, 0.5)
    late = np.searchsorted(times, 0.1 + 1.0 / (2.0 * math.pi * 0.5))
    assert step[late] == pytest.approx(math.exp(-1.0), rel=1e-2)


def test_encoder_is_right_to_half_a_count():
    """Rounded to counts."""
    encoder = Encoder(counts_per_turn=4096.0)
    angle = np.linspace(-10.0, 10.0, 999)
    assert np.abs(encoder.read(angle) - angle).max() <= math.pi / 4096.0 + 1e-12


def test_three_phases_carry_the_signed_torque():
    """Clarke and Park give i_q = T_e/K_t back, sign included, and the three add to nothing."""
    angle = np.linspace(0.0, 20.0, 500)
    torque = 2.0 * np.sin(0.3 * angle)
    i = np.array(phase_currents(torque, angle, 0.458, 5))
    assert np.abs(i.sum(axis=0)).max() < 1e-12
    phases = 5.0 * angle - 2.0 * np.pi / 3.0 * np.arange(3)[:, np.newaxis]
    i_q = -2.0 / 3.0 * np.sum(i * np.sin(phases), axis=0)
    np.testing.assert_allclose(0.458 * i_q, torque, atol=1e-12)


def test_distorted_logs_are_what_their_names_say():
    """Held: steps of the slow rate. Average: sinc in amplitude and half a period late. Alias: folded, not removed."""
    device = Device(sampling_rate=500.0)
    _, values = tone(30.0)
    stamps = device.stamps(2.0)
    held = TorqueLog(kind="hold", rate=125.0).sample(device, values, H, stamps)
    assert np.all(held.reshape(-1, 4) == held.reshape(-1, 4)[:, :1])
    average = TorqueLog(kind="average").sample(device, values, H, stamps)
    middle = (stamps > 0.6) & (stamps < 1.4)
    expected = exact(30.0, stamps - 0.001) * np.sinc(30.0 / 500.0)
    np.testing.assert_allclose(average[middle], expected[middle], atol=2e-3)
    _, fast = tone(480.0)
    aliased = TorqueLog(kind="alias").sample(device, fast, H, stamps)
    assert np.abs(aliased[middle]).max() > 0.9
    assert np.abs(TorqueLog().sample(device, fast, H, stamps)[middle]).max() < 1e-4


@pytest.mark.parametrize(
    "make",
    [
        lambda: Device(sampling_rate=0.0),
        lambda: AntiAlias(passband=0.6),
        lambda: Converter(full_scale=-1.0),
        lambda: TorqueLog(rate=0.0),
    ],
)
def test_impossible_devices_are_refused(make):
    """One line with the value."""
    with pytest.raises(MeasurementError):
        make()
