"""A log that repeats its values tells the rate of its updates by itself; no other log is taken for one."""

import numpy as np
import pytest

from jointscope.recordings.held_log import common_hold, hold_of

RATE = 800.0
TIME = np.arange(6400) / RATE


def torque(seed: int) -> np.ndarray:
    """A sweep with a drive's unrest in it."""
    rng = np.random.default_rng(seed)
    unrest = np.cumsum(rng.standard_normal(TIME.size * 10)) * 0.02
    fine = np.arange(TIME.size * 10) / (10 * RATE)
    return 50.0 * np.sin(2.0 * np.pi * (2.0 + 3.0 * fine) * fine) + unrest


def held(fine: np.ndarray, update: float, late: float = 0.0) -> np.ndarray:
    """Samples at ``RATE`` of the value at the last update."""
    at = np.floor((TIME + late) * update + 1e-9) / update - late
    return np.interp(at, np.arange(fine.size) / (10 * RATE), fine)


@pytest.mark.parametrize("update", [400.0, 266.7, 250.0, 160.0, 100.0, 80.0])
@pytest.mark.parametrize("late", [0.0, 1e-3])
def test_the_rate_of_its_updates_is_read_off_the_log(update, late):
    rng = np.random.default_rng(3)
    logged = held(torque(1), update, late) + 0.2 * rng.standard_normal(TIME.size)
    found = hold_of(logged, RATE)
    assert found is not None
    assert found.rate == pytest.approx(update, rel=2e-3)
    assert found.noise == pytest.approx(0.2, rel=0.1)


def test_values_that_repeat_exactly_have_no_noise_added():
    found = hold_of(held(torque(2), 200.0), RATE)
    assert found is not None
    assert found.noise == 0.0


def _logs() -> dict[str, np.ndarray]:
    rng = np.random.default_rng(7)
    plain = np.interp(TIME, np.arange(TIME.size * 10) / (10 * RATE), torque(4))
    return {
        "smooth": plain,
        "noisy": plain + rng.standard_normal(TIME.size),
        "noise alone": rng.standard_normal(TIME.size),
        "coarse": np.round(plain / 4.0) * 4.0,
        "coarse and slow": np.round(3.0 * np.sin(2.0 * np.pi * 1.7 * TIME)) * 1.0,
        "a motor's ripple": plain + 5.0 * np.sin(2.0 * np.pi * 200.0 * TIME),
        "steps now and then": np.where(TIME > 3.0, 30.0, 0.0) + 0.3 * rng.standard_normal(TIME.size),
        "at rest": np.zeros(TIME.size),
    }


@pytest.mark.parametrize("name", list(_logs()))
def test_no_other_log_is_taken_for_one(name):
    assert hold_of(_logs()[name], RATE) is None


def test_logs_of_one_device_must_agree():
    rng = np.random.default_rng(5)
    noisy = [held(torque(k), 200.0) + 0.1 * rng.standard_normal(TIME.size) for k in range(3)]
    free = [_logs()["noisy"]] * 8
    found = common_hold([*noisy, *free[:3]], RATE)
    assert found is not None
    assert found.rate == pytest.approx(200.0, rel=2e-3)
    assert common_hold([*noisy, *free], RATE) is None
    assert common_hold([*noisy, held(torque(9), 100.0)], RATE) is None
    assert common_hold([], RATE) is None
