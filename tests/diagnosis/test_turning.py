"""What repeats with the turn is found at its order, and in runs that were not fitted; lines in time and noise are not."""

from types import SimpleNamespace

import numpy as np
import pytest

from jointscope.diagnosis.remainder import remainder_json
from jointscope.diagnosis.turning import repeating

RATE, SECONDS, ORDER = 500.0, 8.0, 90.0
NOISE = 1e-3


def run_of(rng, left, speed):
    """A run that swings to and fro from a place and at a pace of its own; ``left(t, q)`` is what a model leaves.

    Args:
        speed: Whether a speed was recorded instead of the angle.
    """
    t = np.arange(round(RATE * SECONDS)) / RATE
    half = np.arange(2 * t.size + 1) / (2.0 * RATE)
    pace, start = rng.uniform(0.5, 1.5), rng.uniform(-0.3, 0.3)

    def angle(times):
        return start + 0.8 * np.sin(pace * times) + 0.1 * np.sin(2.7 * pace * times)

    output = SimpleNamespace(
        quantity="angle", location="arm", direction=None, times=t, rate=RATE, data=angle(t), mask=np.ones(t.size, bool),
        radius=None, followed_to=0.5,
    )  # fmt: skip
    run = SimpleNamespace(
        run=SimpleNamespace(experiment="speed-motion", brake=False), outputs=(output,), t0=0.0, grid_rate=RATE,
        observed_half=np.gradient(angle(half), half) if speed else angle(half), initial_angle=start,
        observed=SimpleNamespace(rate_signal=speed, commanded=False), motor_moves=True, mode="observer",
    )  # fmt: skip
    return run, NOISE * rng.standard_normal(t.size) + left(t, angle(t))


def judged_of(left, seed=1, speed=False):
    """Three fitted and two held-out runs, whitened by their white noise."""
    rng = np.random.default_rng(seed)
    made = [run_of(rng, left, speed) for _ in range(5)]

    def objective(rows):
        return SimpleNamespace(
            prepared=[run for run, _ in rows],
            runs=tuple(range(len(rows))),
            whiteners=[lambda arrays: np.concatenate(arrays) / NOISE for _ in rows],
            whiten_run=lambda i, predicted: rows[i][1] / NOISE,
            map=lambda f, items: [f(item) for item in items],
        )

    judgement = SimpleNamespace(objective=objective(made[:3]), held=objective(made[3:]))
    judged = SimpleNamespace(predictions=[((),)] * 3, predictions_held=[((),)] * 2)
    return repeating(judgement, judged)


@pytest.mark.parametrize("speed", [False, True])
def test_a_grating_is_found_at_its_order_and_in_the_runs_that_were_not_fitted(speed):
    """Wherever each run starts, and from the integral of a speed as well."""
    (found,) = judged_of(lambda t, q: 0.5 * NOISE * np.sin(ORDER * q + 0.4), speed=speed)
    assert found.stands
    assert found.order == pytest.approx(ORDER, abs=0.2)
    assert found.held_gain == pytest.approx(found.foretold, rel=0.3)
    assert f"{found.order:.4g} times per turn" in remainder_json([found])[0]["sentence"]


@pytest.mark.parametrize("seed", range(6))
def test_noise_has_no_order(seed):
    (found,) = judged_of(lambda t, q: 0.0 * t, seed)
    assert not found.stands and found.gain < 0.0


def test_a_line_in_time_has_none_either():
    (found,) = judged_of(lambda t, q: 2.0 * NOISE * np.sin(2.0 * np.pi * 9.0 * t))
    assert not found.stands


def test_what_has_another_phase_in_every_run_is_not_fixed_to_the_joint():
    rng = np.random.default_rng(5)
    (found,) = judged_of(lambda t, q: 0.5 * NOISE * np.sin(ORDER * q + rng.uniform(0.0, 2.0 * np.pi)))
    assert not found.stands
