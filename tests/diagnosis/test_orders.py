"""Lines against the turn are found where they are, at any phase, also where they sweep over the resonance."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from jointscope.diagnosis.assembly import BASE_INDEX
from jointscope.diagnosis.effects.orders import _response, order_lines
from jointscope.diagnosis.wind_up import WIND_UP

RATE, RATIO = 1000.0, 100.0
K, C, J_M, J_L = 1.5e5, 30.0, 6.0, 3.0


def bench(order, phase, source, noise, seed=1, reverse=False, quantity="linear-acceleration"):
    """A motion from rest to speed and back: the line passes the resonance twice."""
    t = np.arange(0.0, 6.0, 1.0 / RATE)
    angle = 1.3 * 0.5 * (1.0 - np.cos(2.0 * math.pi * t / 6.0)) * (-1.0 if reverse else 1.0)
    start = np.zeros(max(BASE_INDEX.values()) + 1)
    for name, value in (("stiffness", K), ("damping", C), ("motor_inertia", J_M), ("load_inertia", J_L)):
        start[BASE_INDEX[name]] = value
    output = SimpleNamespace(
        times=t, rate=RATE, mask=np.ones(t.size, dtype=bool), quantity=quantity, data=np.zeros(t.size)
    )
    observed = SimpleNamespace(rate_signal=False)
    run = SimpleNamespace(
        observed=observed, observed_half=np.repeat(angle, 2), time=t, ratio=RATIO, outputs=(output,),
        mode="observer", spring=True,
    )  # fmt: skip
    rig = SimpleNamespace(reduction_ratio=RATIO, motion="rotational")
    problem = SimpleNamespace(runs=(run,), base=SimpleNamespace(start=start), rig=rig)
    law = np.sin(order * RATIO * angle + phase)
    f = np.fft.rfftfreq(2 * t.size, 1.0 / RATE)
    shown = np.fft.irfft(_response(problem, 2.0 * math.pi * f, source, quantity) * np.fft.rfft(law, 2 * t.size))[
        : t.size
    ]
    rng = np.random.default_rng(seed)
    return problem, [[shown + noise * np.std(shown) * rng.standard_normal(t.size)]]


@pytest.mark.parametrize("quantity", ["linear-acceleration", WIND_UP])
@pytest.mark.parametrize("source", ["ripple", "error"])
@pytest.mark.parametrize(("order", "phase"), [(1.0, 0.4), (2.37, -2.0), (6.0, 3.0), (11.93, 1.5)])
def test_a_line_is_found_with_its_phase(order, phase, source, quantity):
    problem, residuals = bench(order, phase, source, noise=2.0, quantity=quantity)
    found = order_lines(problem, residuals, 3, per_output=False, source=source)
    turns = 1.3 * RATIO / (2.0 * math.pi)
    best = min(found, key=lambda line: abs(line[0] - order))
    assert best in found[:3]  # itself or one of its fringes
    assert abs(best[0] - order) < 0.5 / turns
    assert abs(math.remainder(best[1] + (best[0] - order) * RATIO * 0.65 - phase, math.tau)) < 0.6


def test_what_hardly_turns_has_no_lines():
    problem, residuals = bench(2.0, 0.0, "ripple", noise=1.0)
    problem.runs[0].observed_half = 0.01 * problem.runs[0].observed_half
    assert order_lines(problem, residuals, 3, per_output=False, source="ripple") == ()


@pytest.mark.parametrize("order", [39.0, 78.0])
def test_the_pins_of_a_reducer_show_in_a_fifth_of_an_output_turn(order):
    """Many periods of a high order pass in a travel that is a small part of the output's turn."""
    problem, residuals = bench(order / RATIO, 1.0, "error", noise=1.0)
    found = order_lines(problem, residuals, 3, per_output=True, source="error")
    assert min(abs(line[0] - order) for line in found) < 2.0 * math.pi / 1.3  # one period more or less


def test_lines_of_the_output_need_three_periods():
    problem, residuals = bench(8.0 / RATIO, 1.0, "error", noise=1.0)
    found = order_lines(problem, residuals, 3, per_output=True, source="error")
    assert all(line[0] >= 3.0 * 2.0 * math.pi / 1.3 for line in found)
