"""A record between its samples in compiled steps: the same spline as SciPy's, at its ends and between."""

import numpy as np
import pytest

from jointscope.diagnosis.kernel.between import SHORTEST, quintic
from jointscope.recordings.bandlimited import OVERSAMPLING, bandlimited


@pytest.mark.parametrize("size", [2, 3, 40, 900])
def test_it_is_the_same_spline(size):
    record = bandlimited(np.random.default_rng(size).standard_normal(size), 500.0, 0.1)
    times = np.linspace(record.start, record.end, 4001)
    coefficients, lead = record.quintic
    assert coefficients.size >= SHORTEST
    out = np.empty_like(times)
    quintic(coefficients, (times - record.start) * (record.rate * OVERSAMPLING) + lead, out)
    np.testing.assert_allclose(out, record(times), atol=1e-11)


def test_a_straight_line_is_kept_within_a_record():
    record = bandlimited(3.0 + 2.0 * np.arange(400), 100.0)
    times = np.linspace(1.5, 2.5, 333)
    coefficients, lead = record.quintic
    out = np.empty_like(times)
    quintic(coefficients, times * (100.0 * OVERSAMPLING) + lead, out)
    np.testing.assert_allclose(out, 3.0 + 200.0 * times, atol=1e-8)
