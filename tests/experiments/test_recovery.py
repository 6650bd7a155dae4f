"""The proof's own parts: the closed form, the bound, and that the numbers do not depend on how they were computed."""

from pathlib import Path

import numpy as np
import pytest
from scipy import integrate

from jointscope.experiments.recovery import run_chunk
from jointscope.experiments.recovery_bound import fisher_matrix
from jointscope.experiments.recovery_cases import CASES
from jointscope.experiments.recovery_report import figures
from jointscope.experiments.recovery_truth import Bench, Pulse, acceleration, record

BENCH, PULSE = Bench(), Pulse(peak=200.0, contact=7e-3, start=0.02)


def test_the_closed_form_solves_the_equation_of_motion() -> None:
    def motion(t: float, state: np.ndarray) -> list[float]:
        inside = 0.0 <= t - PULSE.start <= PULSE.contact
        torque = (
            PULSE.peak * BENCH.hammer_radius * np.sin(np.pi * (t - PULSE.start) / PULSE.contact) if inside else 0.0
        )
        return [state[1], (torque - BENCH.damping * state[1] - BENCH.stiffness * state[0]) / BENCH.inertia]

    times = np.linspace(0.0, 0.1, 400)
    solved = integrate.solve_ivp(
        motion, (0.0, 0.1), [0.0, 0.0], t_eval=times, rtol=1e-9, atol=1e-13, max_step=1e-4
    )
    expected = np.array([motion(t, s)[1] for t, s in zip(times, solved.y.T, strict=True)])
    np.testing.assert_allclose(acceleration(BENCH, PULSE, times), expected, atol=2e-5 * np.abs(expected).max())


def test_force_and_acceleration_pass_the_same_filter() -> None:
    """So their ratio is the joint's own response, up to the fine grid's sampling."""
    force, response = record(BENCH, PULSE)
    frequency = np.fft.rfftfreq(force.size, 1 / BENCH.rate)
    keep = (frequency >= 5) & (frequency <= 60)
    s = 2j * np.pi * frequency[keep]
    truth = s**2 / (BENCH.inertia * s**2 + BENCH.damping * s + BENCH.stiffness)
    ratio = (
        (np.fft.rfft(response) / np.fft.rfft(force))[keep] * BENCH.hammer_radius**-1 / BENCH.accelerometer_radius
    )
    np.testing.assert_allclose(ratio, truth, rtol=2e-4, atol=2e-5)


def test_more_hits_and_less_noise_lower_the_bound_as_they_must() -> None:
    one = fisher_matrix(BENCH, [PULSE], [0.5], [1.0], (2.0, 50.0))
    np.testing.assert_allclose(fisher_matrix(BENCH, [PULSE] * 4, [0.5] * 4, [1.0] * 4, (2.0, 50.0)), 4 * one)
    np.testing.assert_allclose(fisher_matrix(BENCH, [PULSE], [0.25], [0.5], (2.0, 50.0)), 4 * one, rtol=1e-9)
    wider = fisher_matrix(BENCH, [PULSE], [0.5], [1.0], (2.0, 100.0))
    assert np.all(np.linalg.eigvalsh(wider - one) > -1e-9 * np.abs(wider).max())


def test_rows_do_not_depend_on_how_seeds_are_grouped(tmp_path: Path) -> None:
    run_chunk(CASES[0], (3, 4), tmp_path / "both.npz")
    run_chunk(CASES[0], (4,), tmp_path / "one.npz")
    with np.load(tmp_path / "both.npz") as both, np.load(tmp_path / "one.npz") as one:
        np.testing.assert_array_equal(both["rows"][1], one["rows"][0])
        found = figures(both["rows"])
    assert np.all(np.abs(found.bias[0]) < 0.5)


@pytest.mark.slow
def test_the_claims_hold_over_a_hundred_seeds(tmp_path: Path) -> None:
    from jointscope.experiments.recovery import run_recovery

    run_recovery(tmp_path / "recovery", seeds=100)
    assert "FAILS: |mean error|" not in (tmp_path / "recovery" / "README.md").read_text()
