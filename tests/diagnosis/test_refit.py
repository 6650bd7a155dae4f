"""The optimiser: exact on linear problems, convergent on curved ones, obedient to bounds, never worse than its start."""

from types import SimpleNamespace

import numpy as np
import pytest

from jointscope.diagnosis.coordinates import Coordinates
from jointscope.diagnosis.refit import _step, covariance, least_squares, tangent_share


def plain(n, lower=-np.inf, upper=np.inf):
    """Coordinates that are the parameters themselves."""
    return Coordinates(
        start=np.zeros(n), free=np.arange(n), effects=(), scale=np.ones(n), logarithm=np.zeros(n, bool),
        lower=np.full(n, lower), upper=np.full(n, upper), step=np.full(n, 1e-6), amplitudes=np.zeros(n, bool),
    )  # fmt: skip


def objective(function):
    """The two methods that the optimiser uses, for w = function(x)."""

    def columns(x, where, w, which):
        result = np.zeros((len(w), len(which)))
        for k, j in enumerate(which):
            shifted = x.copy()
            shifted[j] += where.step[j]
            result[:, k] = (function(shifted) - w) / where.step[j]
        return result

    return SimpleNamespace(residual=lambda x, where: function(x), columns=columns)


def test_a_linear_problem_is_solved_to_the_normal_equations():
    """The optimum is lstsq's, and P_B w vanishes there."""
    rng = np.random.default_rng(1)
    a, b = rng.standard_normal((50, 4)), rng.standard_normal(50)
    fit = least_squares(objective(lambda x: a @ x - b), plain(4), np.zeros(4), iterations=30)
    assert fit.converged
    assert np.allclose(fit.x, np.linalg.lstsq(a, b, rcond=None)[0], atol=1e-5)
    assert tangent_share(a, fit.w, fit.x, plain(4)) < 1e-4
    assert np.allclose(covariance(fit), np.linalg.inv(a.T @ a), rtol=1e-4)


def test_a_curved_valley_is_followed_to_its_end():
    """Rosenbrock's valley as residuals (10 (y - x^2), 1 - x)."""
    fit = least_squares(
        objective(lambda x: np.array([10 * (x[1] - x[0] ** 2), 1 - x[0], 1e-3])),
        plain(2),
        np.array([-1.2, 1.0]),
        iterations=80,
    )
    assert np.allclose(fit.x, 1.0, atol=1e-3)


def test_what_will_not_come_within_reach_is_left_and_what_will_is_followed_as_ever():
    """Rosenbrock's valley above a floor of w'w = 9: nobody gets to 8, and to 9.5 the whole way leads through the bend."""

    def followed(behind):
        function = objective(lambda x: np.array([10 * (x[1] - x[0] ** 2), 1 - x[0], 3.0]))
        return least_squares(function, plain(2), np.array([-1.2, 1.0]), iterations=80, behind=behind)

    whole, within, beyond = (followed(b) for b in (None, lambda w: w @ w - 9.5, lambda w: w @ w - 8.0))
    assert np.array_equal(within.x, whole.x)
    assert within.simulations == whole.simulations
    assert beyond.simulations < whole.simulations / 2
    assert not beyond.converged


def test_bounds_hold_and_the_free_coordinates_still_converge():
    """With x <= 0.5 active the other coordinate reaches its own optimum."""
    fit = least_squares(
        objective(lambda x: np.array([x[0] - 1.0, x[1] + 2.0 * x[0]])),
        plain(2, upper=0.5),
        np.zeros(2),
        iterations=40,
    )
    assert fit.x[0] <= 0.5
    assert np.isclose(fit.x[1] + 2 * fit.x[0], 0.0, atol=1e-4)


@pytest.mark.parametrize("seed", range(5))
def test_the_cost_never_rises(seed):
    """Even from a misleading Jacobian the best point is at least as good as the start."""
    rng = np.random.default_rng(seed)

    def rough(x):
        return np.array([np.sin(3 * x[0]) + x[1], x[0] * x[1] - 1.0, np.cos(x[1])])

    start = rng.uniform(-2, 2, 2)
    fit = least_squares(objective(rough), plain(2), start, jacobian=rng.standard_normal((3, 2)), iterations=10)
    assert fit.chi2 <= np.sum(rough(start) ** 2) + 1e-12


def test_along_a_column_that_no_number_holds_there_is_no_step():
    """Nothing, too much, and what is no number: the other coordinates step as if these were not there."""
    J = np.random.default_rng(1).standard_normal((30, 4))
    w = np.random.default_rng(2).standard_normal(30)
    plain = _step(J.T @ J, J.T @ w, 0.0)
    for column in (0.0, 1e150, np.nan):
        normal, gradient = np.zeros((5, 5)), np.zeros(5)
        normal[:4, :4], gradient[:4] = J.T @ J, J.T @ w
        with np.errstate(over="ignore"):
            normal[4, 4], gradient[4] = column * column, column
        normal[4, :4] = normal[:4, 4] = column
        step = _step(normal, gradient, 0.0)
        assert step[4] == 0.0
        np.testing.assert_allclose(step[:4], plain, rtol=1e-9)
    np.testing.assert_allclose(plain, -np.linalg.lstsq(J, w, rcond=None)[0], rtol=1e-6)
