"""A model that rings with its log's noise where the recording is quiet is not explained by what quiets the model."""

from __future__ import annotations

import numpy as np
import pytest

from jointscope.diagnosis.silent_bands import unrecorded

RATE = 1000.0
T = np.arange(6000) / RATE


@pytest.fixture
def noise():
    return np.random.default_rng(7).standard_normal(T.size)


def ringing(seed, frequency=90.0):
    """Noise through a resonance, of twice the noise's size."""
    from scipy import signal

    b, a = signal.iirpeak(frequency, 15.0, fs=RATE)
    y = signal.lfilter(b, a, np.random.default_rng(seed).standard_normal(T.size))
    return 2.0 * y / np.std(y)


def test_ringing_of_the_model_alone_is_not_in_the_recording(noise):
    motion = 40.0 * np.sin(2.0 * np.pi * 1.5 * T)
    assert unrecorded(motion + noise, noise + ringing(1), noise)


def test_what_the_recording_holds_is(noise):
    """The same ringing, of the joint: the base lacked it."""
    motion = 40.0 * np.sin(2.0 * np.pi * 1.5 * T)
    assert not unrecorded(motion + noise + ringing(1), noise + ringing(1), noise)


def test_slow_errors_of_a_slow_motion_are_recorded(noise):
    motion = 40.0 * np.sin(2.0 * np.pi * 1.5 * T)
    assert not unrecorded(motion + noise, noise + 3.0 * np.sign(np.cos(2.0 * np.pi * 1.5 * T)), noise)


def test_where_nothing_is_explained_nothing_is_silent(noise):
    assert not unrecorded(noise, noise, noise + ringing(1))
