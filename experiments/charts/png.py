"""The same chart by matplotlib, for slides and papers."""

from __future__ import annotations

import textwrap
from pathlib import Path
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from jointscope.experiments import plot_style
from jointscope.experiments.charts.chart import Chart, Panel, Series, domain
from jointscope.experiments.charts.looks import LOOKS
from jointscope.experiments.charts.svg import MOST_POINTS, thinned

Corner = Literal["upper right", "upper left", "lower right", "lower left"]

_INCH = 100.0  # px
_WIDTH = 9.4  # inches
# left, right, below, above every panel [inches]; a layout by the extents of texts draws all twice
_MARGINS = (0.95, 0.15, 0.5, 0.3)
_LETTER = 0.068  # inches of a label's letter
_LEGEND = (0.3, 0.3)  # of the axes' width and height, that a legend may take


def write_png(chart: Chart, path: Path) -> Path:
    """Draw ``chart`` to ``path``."""
    rows = -(-len(chart.panels) // chart.columns)
    heights = [
        max(p.height for p in chart.panels[r * chart.columns : (r + 1) * chart.columns]) for r in range(rows)
    ]
    with plot_style.style():
        figure = Figure(figsize=(_WIDTH, sum(heights) / _INCH + 0.3))
        axes = figure.subplots(
            rows, chart.columns, squeeze=False, height_ratios=heights, gridspec_kw=_room(rows, chart, figure)
        )
        for place, ax in enumerate(axes.ravel()):
            if place < len(chart.panels):
                _draw(ax, chart.panels[place])
            else:
                ax.set_visible(False)
        return plot_style.save(figure, path)


def _room(rows: int, chart: Chart, figure: Figure) -> dict[str, float]:
    """Where the panels of a grid stand, as shares of the figure, and the room between them as shares of a mean panel."""
    width, height = figure.get_size_inches()
    left, right, below, above = _MARGINS
    across = (width - chart.columns * (left + right)) / chart.columns
    down = (height - rows * (below + above)) / rows
    return {
        "left": left / width,
        "right": 1.0 - right / width,
        "bottom": below / height,
        "top": 1.0 - above / height,
        "wspace": (left + right) / across,
        "hspace": (below + above) / down,
    }


def _draw(ax: Axes, panel: Panel) -> None:
    if panel.heat is not None:
        heat = panel.heat
        mesh = ax.pcolormesh(heat.x_edges, heat.y_edges, heat.value, cmap="Blues", rasterized=True)
        ax.figure.colorbar(mesh, ax=ax, label=heat.unit)
    for span in panel.spans:
        ax.axvspan(span.low, span.high, color="#dfe8f1", alpha=0.6, lw=0, zorder=-3, label=span.label)
    for s in panel.series:
        _series(ax, s)
    if panel.x_log:
        ax.set_xscale("log")
    if panel.y_log:
        ax.set_yscale("log")
    x, y = domain(panel)
    ax.set_xlim(*(10.0 ** np.array(x) if panel.x_log else x))
    ax.set_ylim(*(10.0 ** np.array(y) if panel.y_log else y))
    letters = int((panel.height / _INCH - _MARGINS[2] - _MARGINS[3]) / _LETTER)
    ax.set(title=panel.title, xlabel=panel.x_label, ylabel=textwrap.fill(panel.y_label, max(letters, 16)))
    if 1 < len(panel.series) <= 8 or panel.spans:
        ax.legend(fontsize=7, loc=emptiest_corner(ax, panel))  # "best" weighs every point against every place


def emptiest_corner(ax: Axes, panel: Panel) -> Corner:
    """Where a legend covers the fewest points, the upper right where that is one of them."""
    points = np.concatenate([np.stack([s.x, s.y], axis=1) for s in panel.series] or [np.empty((0, 2))])
    known = np.all(np.isfinite(points), axis=1)
    if panel.x_log:
        known &= points[:, 0] > 0.0
    if panel.y_log:
        known &= points[:, 1] > 0.0
    x, y = ax.transAxes.inverted().transform(ax.transData.transform(points[known])).T
    right, left = x > 1.0 - _LEGEND[0], x < _LEGEND[0]
    upper, lower = y > 1.0 - _LEGEND[1], y < _LEGEND[1]
    corners: dict[Corner, NDArray[np.bool_]] = {
        "upper right": upper & right,
        "upper left": upper & left,
        "lower right": lower & right,
        "lower left": lower & left,
    }
    return min(corners, key=lambda corner: np.count_nonzero(corners[corner]))


def _series(ax: Axes, s: Series) -> None:
    look = LOOKS[s.look]
    if s.low is not None:
        ax.fill_between(s.x, s.low, s.y, color=look.light, alpha=0.45, lw=0, label=s.name)
    elif s.mark:
        fill = look.light if s.mark == "o" else "none"
        ax.plot(s.x, s.y, s.mark, ms=3.2, mew=0.8, color=look.light, mfc=fill, label=s.name)
    else:
        line = (0, look.dash) if look.dash else "-"
        x, y = thinned(s.x, s.y, MOST_POINTS) if np.all(np.isfinite(s.y)) else (s.x, s.y)
        ax.plot(x, y, ls=line, lw=0.8 * look.width, color=look.light, label=s.name)
