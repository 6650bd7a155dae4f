"""Contact detection: what is a hit, what is a double hit, what is clipped, and what is neither."""

import numpy as np
import pytest

from jointscope.identification.hits import find_contact, is_clipped, is_double_hit

RATE = 1024.0


def pulse(start: int, length: int, peak: float, count: int = 2048) -> np.ndarray:
    force = np.zeros(count)
    force[start : start + length] = peak * np.sin(np.pi * np.arange(1, length + 1) / (length + 1))
    return force


@pytest.mark.parametrize("peak", [200.0, -200.0])
@pytest.mark.parametrize("noise", [0.0, 1.0, 8.0])
def test_the_window_holds_the_whole_contact_and_little_else(peak: float, noise: float) -> None:
    rng = np.random.default_rng(0)
    force = pulse(100, 8, peak) + 3.0 + noise * rng.standard_normal(2048)
    contact = find_contact(force, RATE)
    assert contact is not None
    assert set(range(100, 108)) <= set(contact.window)
    assert contact.window.size < 25
    assert contact.peak == pytest.approx(peak, abs=4 * noise + 8)
    assert contact.offset == pytest.approx(3.0, abs=4 * noise / 45 + 1e-9)
    assert contact.noise == pytest.approx(noise, rel=0.1, abs=1e-9)
    assert not is_double_hit(contact)


def test_noise_alone_is_no_hit() -> None:
    assert find_contact(np.random.default_rng(1).standard_normal(2048), RATE) is None
    assert find_contact(np.zeros(2048), RATE) is None


@pytest.mark.parametrize(("delay", "share", "double"), [(30, 0.2, True), (30, 0.01, False), (400, 0.2, False)])
def test_a_rebound_is_a_double_hit_where_it_is_near_and_strong(delay: int, share: float, double: bool) -> None:
    force = pulse(100, 8, 200.0) + pulse(100 + delay, 8, 200.0 * share)
    contact = find_contact(force + 0.1 * np.random.default_rng(2).standard_normal(2048), RATE)
    assert contact is not None
    assert is_double_hit(contact) is double


def test_clipping_is_a_flat_top_and_a_sharp_peak_is_not() -> None:
    wave = np.sin(np.arange(2000) / 20.0)
    assert is_clipped(np.clip(wave, -0.8, 0.8))
    assert not is_clipped(wave)
    assert is_clipped(wave, full_scale=1.0)
    assert not is_clipped(np.zeros(100))
