"""The compiled filter is the product of its parts: weights, a second order, a finite response, the samples wanted."""

import numpy as np
import pytest
from scipy.signal import lfilter

from jointscope.diagnosis.input_noise import ringing
from jointscope.diagnosis.prediction_error import prediction_errors


@pytest.mark.parametrize(
    ("n", "lags", "columns"), [(5000, 24, 1), (300, 7, 3), (300, 0, 2), (10, 24, 1), (1, 0, 1)]
)
@pytest.mark.parametrize("rings", [False, True])
def test_it_is_the_filters_one_after_the_other(n, lags, columns, rings):
    rng = np.random.default_rng(7)
    r, weight = rng.standard_normal((n, columns)), rng.random(n)
    ar = np.concatenate([[1.0], 0.1 * rng.standard_normal(lags)])
    keep = np.flatnonzero(rng.random(n) > 0.2)
    way = ringing((20.0, 0.1), 3.0, 1000.0)
    above, below = (way.numerator, way.denominator) if rings else (np.empty(0), np.empty(0))
    scaled = r * weight[:, None]
    expected = lfilter(ar, [1.0], way(scaled) if rings else scaled, axis=0)[keep] / 0.3
    found = prediction_errors(r, weight, above, below, ar, keep, 0.3)
    np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-12)
