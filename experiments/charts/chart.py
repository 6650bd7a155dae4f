"""What is drawn: series on panels, panels in a chart, with the sentence that says how to read it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
Mark = Literal["", "o", "x"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Series:
    """Points joined by a line, or marks; NaN breaks the line.

    Attributes:
        name: For the legend and the CSV; the same name on several panels is switched together.
        x, y: Shape (n,).
        look: A key of ``looks.LOOKS``.
        mark: Empty for a line; ``o`` or ``x`` for marks alone.
        low: Lower edge of a filled band whose upper edge is ``y``, shape (n,).
    """

    name: str
    x: Vector
    y: Vector
    look: str
    mark: Mark = ""
    low: Vector | None = None


@dataclass(frozen=True, eq=False)
class Heat:
    """A map of values over two quantities, darker for more.

    Attributes:
        x_edges, y_edges: Shapes (m + 1,), (n + 1,), rising.
        value: Shape (n, m); NaN where there is none.
        unit: Of the value.
    """

    x_edges: Vector
    y_edges: Vector
    value: Vector
    unit: str


@dataclass(frozen=True)
class Span:
    """A shaded stretch of the x axis, such as a usable band."""

    low: float
    high: float
    label: str


@dataclass(frozen=True, kw_only=True, eq=False)
class Panel:
    """One pair of axes.

    Attributes:
        x_log, y_log: Logarithmic axes; values that are not positive are not drawn there.
        x_range, y_range: Ends of the axes; from the data where None.
        link: Panels of one chart with the same word zoom together along x.
        height: [px].
    """

    title: str
    x_label: str
    y_label: str
    series: tuple[Series, ...]
    x_log: bool = False
    y_log: bool = False
    x_range: tuple[float, float] | None = None
    y_range: tuple[float, float] | None = None
    spans: tuple[Span, ...] = ()
    heat: Heat | None = None
    link: str = ""
    height: int = 230


@dataclass(frozen=True, kw_only=True, eq=False)
class Chart:
    """A figure of one or more panels.

    Attributes:
        stem: File name without ending, for PNG and CSV.
        label: A few words: the tab that shows it.
        shows: What is drawn.
        reading: How to read it, after "How to read it:".
        columns: Panels beside each other on a wide page.
    """

    stem: str
    label: str
    shows: str
    reading: str
    panels: tuple[Panel, ...]
    columns: int = 1


@dataclass(frozen=True)
class Missing:
    """Stands where a chart can't be drawn: the channel (or run) that it would take."""

    label: str
    channel: str


def coordinates(values: Vector, log: bool) -> Vector:
    """Where values lie along an axis: themselves, or their decadic logarithm (NaN where there is none)."""
    x = np.asarray(values, dtype=np.float64)
    if not log:
        return np.where(np.isfinite(x), x, np.nan)
    return np.log10(np.where(np.isfinite(x) & (x > 0.0), x, np.nan))


def domain(panel: Panel) -> tuple[tuple[float, float], tuple[float, float]]:
    """Ends of both axes along ``coordinates``; never of zero width."""
    x = [coordinates(s.x, panel.x_log) for s in panel.series]
    y = [coordinates(v, panel.y_log) for s in panel.series for v in (s.y, s.low) if v is not None]
    marks = any(s.mark for s in panel.series)
    if panel.heat is not None:
        x.append(coordinates(panel.heat.x_edges, panel.x_log))
        y.append(coordinates(panel.heat.y_edges, panel.y_log))
    return (
        _ends(x, panel.x_range, panel.x_log, 0.03 if marks else 0.0),
        _ends(y, panel.y_range, panel.y_log, 0.0 if panel.heat is not None else 0.05),
    )


def _ends(parts: list[Vector], fixed: tuple[float, float] | None, log: bool, margin: float) -> tuple[float, float]:
    if fixed is not None:
        low, high = coordinates(np.asarray(fixed), log)
    else:
        values = np.concatenate([p[np.isfinite(p)] for p in parts]) if parts else np.zeros(0)
        low, high = (np.min(values), np.max(values)) if values.size else (0.0, 1.0)
        pad = margin * (high - low)
        low, high = low - pad, high + pad
    if not high > low:
        half = 0.5 * abs(low) or 0.5
        low, high = low - half, high + half
    return float(low), float(high)
