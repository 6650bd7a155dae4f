"""Pictures of a proof, from its saved summary only."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from jointscope.atomic import replaced_file
from jointscope.experiments.plot_style import MEASURED, PREDICTED, QUIET, THIRD, style

Real = NDArray[np.float64]
LEVELS: Final = ("name", "location", "family")
RESOLUTION: Final = 100  # dots per inch: small enough to be kept with the page


def draw_all(summary: Mapping[str, Any], folder: Path) -> None:
    """Every picture of a summary into ``folder``."""
    folder.mkdir(parents=True, exist_ok=True)
    with style():
        reliability_diagram(summary["reliability"], folder / "reliability.png")
        power_curve(summary["power_curve"], folder / "power.png")
        for level in LEVELS:
            confusion_matrix(summary["confusion"][level], folder / f"confusion-{level}.png")


def _save(figure: Figure, path: Path) -> None:
    with replaced_file(path) as temporary:
        figure.savefig(temporary, dpi=RESOLUTION, format="png", pil_kwargs={"optimize": True})


def reliability_diagram(rows: Sequence[Mapping[str, float]], path: Path) -> None:
    """Stated probability against the share that was right."""
    figure = Figure(figsize=(4.4, 4.2), layout="constrained")
    axes = figure.subplots()
    axes.plot([0, 1], [0, 1], color=QUIET, linewidth=1, zorder=1)
    axes.annotate("calibrated", (0.12, 0.14), rotation=45, color=QUIET, fontsize=8, rotation_mode="anchor")
    if rows:
        _with_bars(axes, np.array([row["stated"] for row in rows]), rows, MEASURED, "", line=False)
        for row in rows:
            axes.annotate(f"{row['cases']:.0f}", (row["stated"], row["right"]), xytext=(5, -9),
                          textcoords="offset points", fontsize=7, color=QUIET)  # fmt: skip
    axes.set(
        xlabel="stated probability", ylabel="share right (95 % interval, cases)", xlim=(0, 1.03), ylim=(0, 1.03)
    )
    axes.set_aspect("equal")
    _save(figure, path)


def _with_bars(
    axes: Axes, x: Real, rows: Sequence[Mapping[str, float]], colour: str, label: str, *, line: bool
) -> None:
    y = np.array([row["right"] for row in rows])
    spread = np.array([[row["right"] - row["low"], row["high"] - row["right"]] for row in rows]).T
    axes.errorbar(x, y, yerr=np.maximum(spread, 0.0), fmt="o-" if line else "o", capsize=2.5, markersize=4,
                  color=colour, label=label or None)  # fmt: skip


def confusion_matrix(counts: Mapping[str, Mapping[str, int]], path: Path) -> None:
    """What was said for what was true, as shares of each row with the counts written in."""
    rows = list(counts)
    said = {answer for row in counts.values() for answer in row}
    columns = [name for name in rows if name in said] + sorted(said - set(rows))
    if not rows or not columns:
        return
    matrix = np.array([[counts[row].get(column, 0) for column in columns] for row in rows], dtype=float)
    shares = matrix / np.maximum(matrix.sum(axis=1, keepdims=True), 1.0)
    figure = Figure(figsize=(3.0 + 0.27 * len(columns), 2.2 + 0.24 * len(rows)), layout="constrained")
    axes = figure.subplots()
    axes.imshow(shares, cmap="Blues", vmin=0.0, vmax=1.0, aspect="auto")
    axes.set_xticks(range(len(columns)), columns, rotation=90, fontsize=7)
    axes.set_yticks(range(len(rows)), rows, fontsize=7)
    axes.set(xlabel="said", ylabel="true")
    axes.grid(visible=False)
    for (i, j), count in np.ndenumerate(matrix):
        if count:
            axes.text(j, i, f"{count:.0f}", ha="center", va="center", fontsize=6.5,
                      color="white" if shares[i, j] > 0.6 else "black")  # fmt: skip
        if rows[i] == columns[j]:  # where the right answers are
            axes.add_patch(_frame(i, j))
    _save(figure, path)


def _frame(i: int, j: int) -> Any:  # noqa: ANN401  # a matplotlib patch
    from matplotlib.patches import Rectangle

    return Rectangle((j - 0.5, i - 0.5), 1.0, 1.0, fill=False, edgecolor=PREDICTED, linewidth=0.9)


def power_curve(curves: Mapping[str, Sequence[Mapping[str, float]]], path: Path) -> None:
    """Shares of single effects against discriminability, one curve for each of what is right."""
    figure = Figure(figsize=(5.6, 3.6), layout="constrained")
    axes = figure.subplots()
    for colour, (label, rows) in zip((MEASURED, THIRD, QUIET), curves.items(), strict=False):
        if rows:
            _with_bars(axes, np.array([row["z_d"] for row in rows]), rows, colour, label, line=True)
    axes.set(
        xscale="log", xlabel="discriminability z_d [standard deviations]", ylabel="share right", ylim=(0, 1.03)
    )
    low, high = axes.get_xlim()
    axes.set_xticks([x for x in (1, 2, 4, 10, 30, 100, 300, 1000, 3000) if low < x < high])
    axes.xaxis.set_major_formatter("{x:g}")
    axes.minorticks_off()
    for edge, name in ((4.0, "hard"), (10.0, "medium"), (30.0, "easy"), (100.0, "trivial")):
        if low < edge < high:
            axes.axvline(edge, color=QUIET, linewidth=0.8, linestyle=":", zorder=0)
            axes.annotate(name, (edge, 1.03), xytext=(3, 2), textcoords="offset points", fontsize=7, color=QUIET)
    if any(curves.values()):
        figure.legend(loc="outside lower center", ncols=len(curves))  # the curves fill the axes
    _save(figure, path)
