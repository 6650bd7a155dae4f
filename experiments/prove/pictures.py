"""Pictures of a proof, from its saved summary only."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np


def reliability_diagram(rows: Sequence[Mapping[str, float]], path: Path) -> None:
    """Stated probability against the share that was right."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(4.6, 4.4), layout="constrained")
    axes = figure.subplots()
    axes.plot([0, 1], [0, 1], color="0.6", linewidth=1)
    if rows:
        x = np.array([row["stated"] for row in rows])
        y = np.array([row["right"] for row in rows])
        spread = np.array([[row["right"] - row["low"], row["high"] - row["right"]] for row in rows]).T
        axes.errorbar(x, y, yerr=np.maximum(spread, 0.0), fmt="o", capsize=3, color="C0")
    axes.set(xlabel="stated probability", ylabel="share right (95 % interval)", xlim=(0, 1.02), ylim=(0, 1.02))
    figure.savefig(path, dpi=150)


def confusion_matrix(counts: Mapping[str, Mapping[str, int]], path: Path) -> None:
    """What was said for what was true, as shares of each row with the counts written in."""
    from matplotlib.figure import Figure

    rows = list(counts)
    said = {answer for row in counts.values() for answer in row}
    columns = [name for name in rows if name in said] + sorted(said - set(rows))
    if not rows or not columns:
        return
    matrix = np.array([[counts[row].get(column, 0) for column in columns] for row in rows], dtype=float)
    shares = matrix / np.maximum(matrix.sum(axis=1, keepdims=True), 1.0)
    size = (2.8 + 0.33 * len(columns), 2.4 + 0.3 * len(rows))
    figure = Figure(figsize=size, layout="constrained")
    axes = figure.subplots()
    axes.imshow(shares, cmap="Blues", vmin=0.0, vmax=1.0, aspect="auto")
    axes.set_xticks(range(len(columns)), columns, rotation=90, fontsize=7)
    axes.set_yticks(range(len(rows)), rows, fontsize=7)
    axes.set(xlabel="said", ylabel="true")
    for (i, j), count in np.ndenumerate(matrix):
        if count:
            axes.text(j, i, f"{count:.0f}", ha="center", va="center", fontsize=6,
                      color="white" if shares[i, j] > 0.6 else "black")  # fmt: skip
    figure.savefig(path, dpi=150)


def power_curve(rows: Sequence[Mapping[str, float]], path: Path) -> None:
    """Share named exactly against discriminability."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(5.0, 3.6), layout="constrained")
    axes = figure.subplots()
    if rows:
        x = np.array([row["z_d"] for row in rows])
        y = np.array([row["right"] for row in rows])
        spread = np.array([[row["right"] - row["low"], row["high"] - row["right"]] for row in rows]).T
        axes.errorbar(x, y, yerr=np.maximum(spread, 0.0), fmt="o-", capsize=3, color="C0")
    axes.set(
        xscale="log", xlabel="discriminability z_d [standard deviations]", ylabel="named exactly", ylim=(0, 1.02)
    )
    for edge in (4.0, 10.0, 30.0, 100.0):
        axes.axvline(edge, color="0.85", linewidth=0.8, zorder=0)
    figure.savefig(path, dpi=150)


def draw_all(summary: Mapping[str, Any], folder: Path) -> None:
    """Every picture of a summary into ``folder``."""
    reliability_diagram(summary["reliability"], folder / "reliability.png")
    power_curve(summary["power_curve"], folder / "power.png")
    for level in ("name", "location", "family"):
        confusion_matrix(summary["confusion"][level], folder / f"confusion-{level}.png")
