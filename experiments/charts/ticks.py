"""Where an axis is labelled: round steps, decades on a logarithmic axis. The page's script follows the same rule."""

from __future__ import annotations

import math

_ROUND = (1.0, 2.0, 5.0, 10.0)


def ticks(low: float, high: float, *, log: bool, most: int) -> list[tuple[float, str]]:
    """Positions along the axis (see ``chart.coordinates``) and labels, at most about ``most`` of them."""
    if not log:
        return [(v, label(v, high - low)) for v in linear(low, high, most)]
    if high - low < 0.7:
        values = [v for v in linear(10.0**low, 10.0**high, most) if v > 0.0]
        return [(math.log10(v), label(v, 10.0**high - 10.0**low)) for v in values]
    decades = range(math.ceil(low - 1e-9), math.floor(high + 1e-9) + 1)
    every = max(1, math.ceil(len(decades) / most))
    found = [(float(d), label(10.0**d, 10.0**d)) for d in decades if d % every == 0]
    if len(decades) < 3:
        found += [
            (d + math.log10(m), label(m * 10.0**d, 10.0**d))
            for d in range(math.floor(low), math.ceil(high) + 1)
            for m in (2.0, 5.0)
            if low <= d + math.log10(m) <= high
        ]
    return sorted(found)


def linear(low: float, high: float, most: int) -> list[float]:
    """Multiples of 1, 2 or 5 times a power of ten between the ends."""
    step = round_step((high - low) / max(most, 1))
    first = math.ceil(low / step - 1e-9)
    count = math.floor(high / step + 1e-9) - first + 1
    return [(first + k) * step for k in range(count)]


def round_step(at_least: float) -> float:
    """The smallest 1, 2 or 5 times a power of ten that is not below ``at_least``."""
    power = 10.0 ** math.floor(math.log10(at_least))
    return next(m * power for m in _ROUND if m * power >= at_least * (1.0 - 1e-9))


def label(value: float, span: float) -> str:
    """A number as short as its neighbours along an axis of width ``span`` allow."""
    if abs(value) < 1e-9 * span:
        return "0"
    if not 1e-3 <= abs(value) < 1e5:
        mantissa, _, exponent = f"{value:.3e}".partition("e")
        return f"{mantissa.rstrip('0').rstrip('.')}e{int(exponent)}"
    digits = min(6, max(0, 2 - math.floor(math.log10(abs(span)))))
    text = f"{value:.{digits}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text
