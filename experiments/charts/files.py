"""A chart on disk: picture and numbers under one stem."""

from __future__ import annotations

import itertools
import math
import re
from pathlib import Path

import numpy as np

from jointscope.atomic import write_text
from jointscope.experiments.charts.chart import Chart, Vector
from jointscope.experiments.charts.png import write_png


def write_files(chart: Chart, folder: Path) -> None:
    """``folder``/STEM.png and STEM.csv."""
    folder.mkdir(parents=True, exist_ok=True)
    write_png(chart, folder / f"{chart.stem}.png")
    write_text(folder / f"{chart.stem}.csv", _csv(columns(chart)))


def columns(chart: Chart) -> dict[str, Vector]:
    """Every plotted number, named by series and axis; an abscissa that series share stands once."""
    found: dict[str, Vector] = {}
    several = len(chart.panels) > 1
    for number, panel in enumerate(chart.panels, start=1):
        front = f"{number}_" if several else ""
        seen: list[tuple[Vector, str]] = []
        for s in panel.series:
            if not any(s.x.shape == x.shape and np.array_equal(s.x, x, equal_nan=True) for x, _ in seen):
                name = f"{front}{plain(panel.x_label)}" + (f"_of_{plain(s.name)}" if seen else "")
                seen.append((s.x, name))
                found[_free(name, found)] = s.x
            found[_free(f"{front}{plain(s.name)}_{plain(panel.y_label)}", found)] = s.y
            if s.low is not None:
                found[_free(f"{front}{plain(s.name)}_low", found)] = s.low
        if panel.heat is not None:
            heat = panel.heat
            a = 0.5 * (heat.x_edges[1:] + heat.x_edges[:-1])
            b = 0.5 * (heat.y_edges[1:] + heat.y_edges[:-1])
            found[f"{front}map_{plain(panel.x_label)}"] = np.tile(a, b.size)
            found[f"{front}map_{plain(panel.y_label)}"] = np.repeat(b, a.size)
            found[f"{front}map_{plain(heat.unit)}"] = heat.value.ravel()
    return found


def plain(text: str) -> str:
    """A name for a CSV header: words joined by underscores, units kept."""
    text = (
        text.replace("²", "2")
        .replace("√", "sqrt_")
        .replace("''", "_dd")
        .replace("'", "_d")
        .replace("%", "percent")
    )
    return re.sub(r"[^0-9A-Za-z]+", "_", text).strip("_")


def _free(name: str, taken: dict[str, Vector]) -> str:
    count, found = 2, name
    while found in taken:
        found, count = f"{name}_{count}", count + 1
    return found


def _csv(table: dict[str, Vector]) -> str:
    texts = [[f"{v:.7g}" if math.isfinite(v) else "" for v in column.tolist()] for column in table.values()]
    rows = (",".join(row) for row in itertools.zip_longest(*texts, fillvalue=""))
    return "\n".join([",".join(table), *rows]) + "\n"
