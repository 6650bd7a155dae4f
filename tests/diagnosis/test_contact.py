"""Force is kept where there is contact and nowhere else."""

import numpy as np

from jointscope.diagnosis.contact import contact_only


def pulse(n=2048, rate=1024.0):
    t = np.arange(n) / rate - 0.1
    return np.where((t > 0) & (t < 0.006), 400.0 * np.sin(np.pi * np.clip(t / 0.006, 0, 1)), 0.0)


def test_noise_and_offset_outside_the_contact_are_gone_and_the_pulse_is_kept():
    """Zero away from the hit; the impulse within the noise's share."""
    rng = np.random.default_rng(1)
    force = pulse()
    cleaned = contact_only(force + 1.5 + 0.8 * rng.standard_normal(len(force)), 1024.0)
    assert not np.any(cleaned[300:])
    assert not np.any(cleaned[:80])
    assert np.isclose(cleaned.sum(), force.sum(), rtol=0.02)


def test_a_double_hit_stays_double():
    """A second contact of 5 % of the first is a force like any other."""
    force = pulse()
    force[700:706] = 20.0
    cleaned = contact_only(force, 1024.0)
    assert np.array_equal(cleaned[700:706], force[700:706])


def test_a_force_that_acts_all_the_time_is_left_alone():
    """A shaker's force is no impact."""
    force = np.sin(np.arange(2000) / 7.0)
    assert contact_only(force, 1000.0) is force
