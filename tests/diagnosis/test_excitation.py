"""What lies below the excitation is cut, what it asks for is kept."""

from types import SimpleNamespace

import numpy as np

from jointscope.diagnosis.excitation import asked_only, below_excitation
from jointscope.recordings.drift import lower_edge

RATE = 1000.0
T = np.arange(20_000) / RATE


def driven(torque, mode="observer"):
    motor = SimpleNamespace(samples=torque, signal=SimpleNamespace(rate=RATE))
    return SimpleNamespace(mode=mode, motor=motor, load=None, command=None)


def test_the_lower_edge_of_a_multisine_is_its_first_line():
    """Lines at 11, 12 ... 60 Hz begin at 11 Hz."""
    rng = np.random.default_rng(1)
    x = sum(np.sin(2 * np.pi * f * T + rng.uniform(0, 6)) for f in range(11, 61))
    assert abs(lower_edge(x, RATE) - 11.0) < 0.5


def test_a_drift_below_the_excitation_is_cut_and_a_line_within_is_kept():
    """0.5 Hz keeps its tenth; 20 Hz keeps its amplitude within 10 %."""
    x = sum(np.sin(2 * np.pi * f * T) for f in range(11, 61))
    sections = below_excitation(driven(x), SimpleNamespace(rate=RATE))
    slow = asked_only(np.sin(2 * np.pi * 0.5 * T), sections)[5000:]
    line = asked_only(np.sin(2 * np.pi * 20.0 * T), sections)[5000:]
    assert np.isclose(np.std(slow), 0.1 * np.sqrt(0.5), rtol=0.1)
    assert np.isclose(np.std(line), np.sqrt(0.5), rtol=0.1)


def test_excitations_from_near_nothing_and_held_motors_are_left_alone():
    """A sweep from 4 Hz, and any braked run, keep everything."""
    sweep = np.sin(2 * np.pi * (4.0 * T + 38.0 / 20.0 * T**2))
    assert below_excitation(driven(sweep), SimpleNamespace(rate=RATE)) is None
    high = np.sin(2 * np.pi * 40.0 * T)
    assert below_excitation(driven(high, mode="braked"), SimpleNamespace(rate=RATE)) is None
