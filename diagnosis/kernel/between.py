"""A record read between its samples, at many times and often: the quintic B-spline of a ``Bandlimited`` in compiled steps."""

from __future__ import annotations

from jointscope.diagnosis.kernel.compiled import Real, compiled

SHORTEST = 8  # coefficients, below which no six stand about every place


@compiled
def quintic(c: Real, places: Real, out: Real) -> None:
    """sum_k c_k B(x - k) at every x of ``places``, B the cardinal quintic B-spline; ``places`` and ``out`` shape (n,)."""
    last = c.size - 4
    for j in range(places.size):
        i = min(max(int(places[j]), 2), last)
        u = places[j] - i
        v, u2 = 1.0 - u, u * u
        v2 = v * v
        out[j] = (
            v2 * v2 * v * c[i - 2]
            + (26.0 + u * (-50.0 + u * (20.0 + u * (20.0 + u * (-20.0 + 5.0 * u))))) * c[i - 1]
            + (66.0 + u2 * (-60.0 + u2 * (30.0 - 10.0 * u))) * c[i]
            + (26.0 + u * (50.0 + u * (20.0 + u * (-20.0 + u * (-20.0 + 10.0 * u))))) * c[i + 1]
            + (1.0 + u * (5.0 + u * (10.0 + u * (10.0 + u * (5.0 - 5.0 * u))))) * c[i + 2]
            + u2 * u2 * u * c[i + 3]
        ) / 120.0
