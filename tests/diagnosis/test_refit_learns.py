"""What a step that failed teaches: only the columns that were not differenced where the search stands."""

from types import SimpleNamespace

import numpy as np
import pytest

from jointscope.diagnosis.refit import _bounded_step, _Search


class Where:
    n, n_base = 4, 2


def search(base_fresh, effects_fresh):
    rng = np.random.default_rng(5)
    jacobian = rng.standard_normal((50, Where.n))
    return _Search(None, Where(), np.zeros(4), rng.standard_normal(50), jacobian, 0, base_fresh, effects_fresh)


@pytest.mark.parametrize(("base", "effects"), [(True, False), (False, True)])
def test_columns_differenced_here_are_kept_when_a_step_fails(base, effects):
    state = search(base, effects)
    before = state.jacobian.copy()
    moved, missed = np.array([0.3, -0.2, 0.1, 0.4]), np.linspace(-1.0, 1.0, 50)
    state.learn(moved, missed, stays=True)
    fresh, stale = (slice(0, 2), slice(2, 4)) if base else (slice(2, 4), slice(0, 2))
    np.testing.assert_array_equal(state.jacobian[:, fresh], before[:, fresh])
    np.testing.assert_allclose((state.jacobian - before)[:, stale] @ moved[stale], missed, atol=1e-12)


def test_a_step_that_is_taken_is_foretold_afterwards():
    state = search(True, True)
    before = state.jacobian.copy()
    moved, missed = np.array([0.3, -0.2, 0.1, 0.4]), np.linspace(-1.0, 1.0, 50)
    state.learn(moved, missed, stays=False)
    np.testing.assert_allclose((state.jacobian - before) @ moved, missed, atol=1e-12)


def test_nothing_is_learnt_where_all_is_known():
    state = search(True, True)
    before = state.jacobian.copy()
    state.learn(np.ones(4), np.ones(50), stays=True)
    np.testing.assert_array_equal(state.jacobian, before)


def test_the_normal_equations_follow_what_is_learnt():
    state = search(False, False)
    first, _ = state.normal
    state.learn(np.ones(4), np.ones(50), stays=False)
    second, _ = state.normal
    assert not np.allclose(first, second)
    np.testing.assert_allclose(second, state.jacobian.T @ state.jacobian)


def test_where_a_step_meets_a_bound_the_others_make_up_for_it():
    """Of a quadratic cost the bounded step ends at the bounded optimum, and the plainly clipped one does not."""
    rng = np.random.default_rng(2)
    jacobian = rng.standard_normal((40, 3)) + np.array([[1.0], [1.0]] * 20)  # coordinates that pull together
    w = jacobian @ np.array([0.4, 0.1, -0.2])
    where = SimpleNamespace(
        lower=np.array([-0.1, -2.0, -2.0]), upper=np.full(3, 2.0), logarithm=np.zeros(3, dtype=bool), n=3
    )
    normal, gradient = jacobian.T @ jacobian, jacobian.T @ w
    step = _bounded_step(np.zeros(3), normal, gradient, np.arange(3), where, 0.0)
    assert step[0] == -0.1
    rest = np.linalg.lstsq(jacobian[:, 1:], -(w - 0.1 * jacobian[:, 0]), rcond=None)[0]
    np.testing.assert_allclose(step[1:], rest, rtol=1e-6)
    clipped = np.clip(-np.linalg.solve(normal, gradient), where.lower, where.upper)
    assert np.linalg.norm(w + jacobian @ step) < 0.99 * np.linalg.norm(w + jacobian @ clipped)
