"""Effects that act in some runs: a drift takes even steps, in an order that the campaign's own does not change."""

import numpy as np

from jointscope.diagnosis.per_run import drifting

ERRORS = np.full(16, 1e-4)


def test_a_drift_is_found_in_whatever_order_its_runs_come():
    """Ranks follow the stiffness; runs that tell nothing stay in the middle."""
    rng = np.random.default_rng(4)
    steps = 4e-4 * (np.arange(16) - 7.5) + 1e-4 * rng.standard_normal(16)
    ranks = drifting(steps, ERRORS)
    assert ranks is not None
    assert np.array_equal(np.argsort(ranks), np.argsort(steps))
    order = rng.permutation(16)
    assert np.array_equal(drifting(steps[order], ERRORS), ranks[order])
    mute = ERRORS.copy()
    mute[3] = np.inf
    assert drifting(steps, mute)[3] == 0.0


def test_outliers_are_no_drift():
    """The same spread from a few wild hits among steady ones."""
    rng = np.random.default_rng(5)
    steps = 1e-4 * rng.standard_normal(16)
    steps[[2, 9]] = 3e-3, -3e-3
    assert np.std(steps) > 8e-4
    assert drifting(steps, ERRORS) is None
    assert drifting(1e-4 * rng.standard_normal(16), ERRORS) is None
    assert drifting(np.array([0.0, 1.0, 2.0]), ERRORS[:3]) is None
