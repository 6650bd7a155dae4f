"""Errors before and after as horizontal bars with the noise floor as a line, inline SVG."""

from __future__ import annotations

import html
import math
from collections.abc import Sequence
from dataclasses import dataclass

from jointscope.experiments.diagnosis_report.traces import Trace


@dataclass(frozen=True)
class Pair:
    """Relative error of one group of channels with the base model and with the effects, and its floor [-]."""

    label: str
    base: float
    corrected: float | None
    floor: float


def pairs(traces: Sequence[Trace], *, corrected: bool) -> tuple[Pair, ...]:
    """One pair per experiment and channel of the held-out runs; of all runs where none was kept back."""
    kept = [t for t in traces if t.held_out] or list(traces)
    groups: dict[tuple[str, str], list[Trace]] = {}
    for t in kept:
        groups.setdefault((t.experiment, t.channel), []).append(t)
    return tuple(
        Pair(
            f"{experiment}, {channel.replace('@', ' at ').replace('-', ' ')}",
            _mean([t.base_error for t in members]),
            _mean([t.corrected_error for t in members]) if corrected else None,
            _mean([t.floor for t in members]),
        )
        for (experiment, channel), members in sorted(groups.items())
    )


def worst_sentence(found: Sequence[Pair]) -> str:
    """Where the model is farthest above the noise, with both figures; empty where no floor is known."""
    known = [p for p in found if math.isfinite(p.base) and math.isfinite(p.floor) and p.floor > 0.0]
    if not known:
        return ""
    worst = max(known, key=lambda p: p.base / p.floor)
    return (
        f" They differ most in {worst.label}: an error of {_percent(worst.base)} of the signal, where noise alone makes "
        f"{_percent(worst.floor)}."
    )


def _percent(share: float) -> str:
    return f"{100.0 * share:.2g} %" if share < 0.1 else f"{100.0 * share:.0f} %"


def _mean(values: Sequence[float]) -> float:
    known = [min(v, 100.0) for v in values if math.isfinite(v)]
    return sum(known) / len(known) if known else float("nan")


def error_bars(found: Sequence[Pair], name: str = "base") -> str:
    """The drawing; the axis is logarithmic, as errors and floors are often decades apart.

    Args:
        found: One group of bars each.
        name: Written at the first bar.
    """
    shown = [p for p in found if math.isfinite(p.base) and p.base > 0.0]
    if not shown:
        return ""
    values = [v for p in shown for v in (p.base, p.corrected, p.floor) if v and math.isfinite(v) and v > 0.0]
    low, high = math.floor(math.log10(min(values)) - 0.1), math.ceil(math.log10(max(values)) + 0.05)
    left, width, row = 24.0, 350.0, 56.0

    def x(value: float) -> float:
        return left + width * (math.log10(max(value, 10.0**low)) - low) / (high - low)

    bottom = row * len(shown) + 6.0
    floors = "; dashed: noise floor" if any(math.isfinite(p.floor) for p in shown) else ""
    parts = [
        "<style>.eb text{font:12px system-ui,sans-serif;fill:var(--ink);paint-order:stroke;stroke:var(--paper);"
        "stroke-width:3px}.eb .grid{stroke:var(--line)}.eb .b{fill:var(--base)}.eb .c{fill:var(--corrected)}"
        ".eb .f{stroke:var(--ink);stroke-width:2;stroke-dasharray:5 3}</style>"
    ]
    every = max(1, math.ceil((high - low) / 6))
    for decade in range(low, high + 1, every):
        at = x(10.0**decade)
        parts.append(f'<line class="grid" x1="{at:.1f}" x2="{at:.1f}" y1="4" y2="{bottom}"/>')
        parts.append(
            f'<text x="{at:.1f}" y="{bottom + 15}" text-anchor="middle">{100.0 * 10.0**decade:g} %</text>'
        )
    for index, pair in enumerate(shown):
        top = row * index + 4.0
        parts.append(f'<text x="{left}" y="{top + 12}" font-weight="600">{html.escape(pair.label)}</text>')
        bars = [("b", pair.base, name)]
        if pair.corrected is not None and math.isfinite(pair.corrected):
            bars.append(("c", pair.corrected, "corrected"))
        labels = []
        for line, (kind, value, told) in enumerate(bars):
            y = top + 16.0 + 16.0 * line
            parts.append(
                f'<rect class="{kind}" x="{left}" y="{y}" width="{max(x(value) - left, 1.0):.1f}" height="13"/>'
            )
            labels.append(f'<text x="{x(value) + 6:.1f}" y="{y + 11}">{told} {100.0 * value:.3g} %</text>')
        if math.isfinite(pair.floor) and pair.floor > 0.0:
            at = x(pair.floor)
            parts.append(f'<line class="f" x1="{at:.1f}" x2="{at:.1f}" y1="{top + 14}" y2="{top + 48}"/>')
        parts += labels
    parts.append(f'<text x="{left}" y="{bottom + 32}">RMS error over RMS signal{floors}</text>')
    return (
        f'<svg class="eb" viewBox="0 0 520 {bottom + 38}" width="520" role="img">'
        f"<title>Prediction error per experiment and channel</title>{''.join(parts)}</svg>"
    )
