"""What scatters comes off a residual as the formula says, whatever the number of directions."""

from __future__ import annotations

import numpy as np
import pytest

from jointscope.diagnosis.scattered import less_scatter


@pytest.mark.parametrize(("n", "r"), [(50, 1), (5000, 3), (4096, 4), (7000, 27)])
def test_it_is_the_formula_to_single_precision(n, r):
    rng = np.random.default_rng(3)
    directions = np.linalg.qr(rng.standard_normal((n, r)))[0]
    shrink, w = rng.uniform(0.0, 1.0, r), rng.standard_normal(n)
    expected = w - directions @ (shrink * (directions.T @ w))
    rows = np.ascontiguousarray(directions.T, dtype=np.float32)
    found = less_scatter(w, rows, shrink)
    assert np.abs(found - expected).max() < 1e-7 * np.abs(w).max()
    twice = less_scatter(3.0 * w, rows, shrink)
    assert np.allclose(
        twice, 3.0 * found, rtol=1e-12, atol=1e-14
    )  # linear: differences of residuals are not rounded


def test_what_is_taken_off_whole_is_gone():
    rng = np.random.default_rng(4)
    directions = np.linalg.qr(rng.standard_normal((3000, 5)))[0]
    rows = np.ascontiguousarray(directions.T, dtype=np.float32)
    left = less_scatter(1e3 * directions @ rng.standard_normal(5), rows, np.ones(5))
    assert np.abs(left).max() < 1e-4 and np.abs(rows @ left).max() < 1e-3
