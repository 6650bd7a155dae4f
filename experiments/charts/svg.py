"""A chart as markup: one inline SVG per panel, legend and readout around them; the page's script lets it zoom.

Everything is drawn here, so the page needs no script to be read or printed. Lines live in a nested ``svg`` whose view
box is the data's square, FULL units wide; to zoom is to move that view box. Marks keep their size and are placed in
pixels. Series are told apart by dash and mark as well as by colour.
"""

from __future__ import annotations

import html

import numpy as np
from numpy.typing import NDArray

from jointscope.experiments.charts.chart import Chart, Heat, Panel, Series, Vector, coordinates, domain
from jointscope.experiments.charts.looks import LOOKS
from jointscope.experiments.charts.ticks import ticks

FULL = 50000  # units across the data's square: a fortieth of a pixel at 1200 px
LEFT, RIGHT, TOP, BOTTOM = 62, 14, 40, 42  # margins [px]
WIDE = 940  # [px] of a chart on a wide page
MOST_POINTS = 4000  # of one line; beyond, the extremes per stretch are kept
SHADES = 10  # steps of a map
_GAP = 14  # [px] between columns


def chart_markup(chart: Chart, most: int = MOST_POINTS) -> str:
    """The figure with legend, caption and the names of its files; ``most`` points of any one line."""
    width = (WIDE - _GAP * (chart.columns - 1)) // chart.columns
    names = list(dict.fromkeys(s.name for panel in chart.panels for s in panel.series))
    looks = {s.name: s for panel in reversed(chart.panels) for s in reversed(panel.series)}
    panels = "".join(_panel(panel, width, names, chart.label, most) for panel in chart.panels)
    legend = "".join(_key(name, names.index(name), looks[name]) for name in names) if len(names) > 1 else ""
    files = (
        f' <span class="files">Numbers: <a href="{chart.stem}.csv">{chart.stem}.csv</a>, '
        f'picture: <a href="{chart.stem}.png">{chart.stem}.png</a>.</span>'
    )
    return (
        f'<figure class="chart" id="{html.escape(chart.stem)}"><div class="legend">{legend}</div>'
        f'<div class="panels c{chart.columns}">{panels}</div><output class="read"></output>'
        f"<figcaption>{html.escape(chart.shows)} <b>How to read it:</b> {html.escape(chart.reading)}{files}</figcaption>"
        "</figure>"
    )


def _key(name: str, index: int, series: Series) -> str:
    kind = " fill" if series.low is not None else ""
    shape = {
        "o": "M14 5h0",
        "x": "M10.5 1.5l7 7m0-7l-7 7",
        "": "M1 1H27V9H1z" if series.low is not None else "M1 5H27",
    }[series.mark]
    mark = f" m{series.mark}" if series.mark else ""
    return (
        f'<button type="button" aria-pressed="true" data-s="{index}"><svg viewBox="0 0 28 10" width="28" height="10" '
        f'aria-hidden="true"><path class="s {series.look}{mark}{kind}" d="{shape}"/></svg>{html.escape(name)}</button>'
    )


def _panel(panel: Panel, width: int, names: list[str], label: str, most: int) -> str:
    x, y = domain(panel)
    w, h = width - LEFT - RIGHT, panel.height - TOP - BOTTOM
    lines, marks = [], []
    for span in panel.spans:
        lines.append(_span(span.low, span.high, span.label, x, panel.x_log))
    if panel.heat is not None:
        lines.append(_heat(panel.heat, x, y, panel))
    for s in panel.series:
        u = _unit(coordinates(s.x, panel.x_log), x)
        v = 1.0 - _unit(coordinates(s.y, panel.y_log), y)
        tag = f'data-s="{names.index(s.name)}"'
        if s.mark:
            marks.append(f'<path {tag} class="s {s.look} m{s.mark}" d="{_marks(u * w, v * h, s.mark)}"/>')
        elif s.low is not None:
            floor = 1.0 - _unit(coordinates(s.low, panel.y_log), y)
            lines.append(f'<path {tag} class="s {s.look} fill" d="{_area(u, v, floor, most)}"/>')
        else:
            lines.append(f'<path {tag} class="s {s.look}" d="{_line(u, v, most)}"/>')
    told = html.escape(f"{label}: {panel.title}; {panel.y_label} against {panel.x_label}")
    return (
        f'<svg class="panel" viewBox="0 0 {width} {panel.height}" width="{width}" height="{panel.height}" tabindex="0" '
        f'role="img" aria-label="{told}" data-x="{x[0]:.9g} {x[1]:.9g}" data-y="{y[0]:.9g} {y[1]:.9g}" '
        f'data-log="{int(panel.x_log)} {int(panel.y_log)}" data-link="{html.escape(panel.link)}" '
        f'data-xl="{html.escape(panel.x_label)}"><title>{html.escape(panel.title)}</title>'
        f'<text class="t" x="4" y="14">{html.escape(panel.title)}</text>'
        f'<text class="u" x="4" y="30">{html.escape(panel.y_label)}</text>'
        f'<g class="axes">{_axes(panel, x, y, width)}</g>'
        f'<svg class="box" x="{LEFT}" y="{TOP}" width="{w}" height="{h}" viewBox="0 0 {FULL} {FULL}" '
        f'preserveAspectRatio="none">{"".join(lines)}</svg>'
        f'<svg class="dots" x="{LEFT}" y="{TOP}" width="{w}" height="{h}">{"".join(marks)}</svg></svg>'
    )


def _axes(panel: Panel, x: tuple[float, float], y: tuple[float, float], width: int) -> str:
    w, h = width - LEFT - RIGHT, panel.height - TOP - BOTTOM
    parts = []
    for at, label in ticks(*x, log=panel.x_log, most=max(3, w // 70)):
        px = LEFT + w * (at - x[0]) / (x[1] - x[0])
        parts.append(f'<path class="grid" d="M{px:.1f} {TOP}v{h}"/>')
        parts.append(f'<text x="{px:.1f}" y="{TOP + h + 15}" text-anchor="middle">{label}</text>')
    for at, label in ticks(*y, log=panel.y_log, most=max(2, h // 32)):
        py = TOP + h * (1.0 - (at - y[0]) / (y[1] - y[0]))
        parts.append(f'<path class="grid" d="M{LEFT} {py:.1f}h{w}"/>')
        parts.append(f'<text x="{LEFT - 6}" y="{py + 4:.1f}" text-anchor="end">{label}</text>')
    parts.append(f'<path class="frame" d="M{LEFT} {TOP}v{h}h{w}"/>')
    told = html.escape(panel.x_label)
    parts.append(f'<text x="{LEFT + w / 2:.1f}" y="{TOP + h + 33}" text-anchor="middle">{told}</text>')
    return "".join(parts)


def _unit(values: Vector, ends: tuple[float, float]) -> Vector:
    return (values - ends[0]) / (ends[1] - ends[0])


def _whole(u: Vector) -> NDArray[np.int64]:
    """In units of the data's square; what lies far outside is brought near, so that it stays a number of few digits."""
    return np.asarray(np.rint(FULL * np.clip(u, -3.0, 4.0)), dtype=np.int64)


def _line(u: Vector, v: Vector, most: int) -> str:
    """Runs of finite points as relative moves."""
    good = np.isfinite(u) & np.isfinite(v)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], good.astype(np.int8), [0]])))
    pieces = []
    share = most / max(int(np.count_nonzero(good)), most)
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        a, b = thinned(u[first:last], v[first:last], max(4, int(share * (last - first))))
        pieces.append(_moves(_whole(a), _whole(b)))
    return "".join(pieces)


def _moves(a: NDArray[np.int64], b: NDArray[np.int64]) -> str:
    steps = " ".join(f"{dx} {dy}" for dx, dy in zip(np.diff(a), np.diff(b), strict=True))
    return f"M{a[0]} {b[0]}" + (f"l{steps}" if steps else "h0")


def thinned(u: Vector, v: Vector, most: int) -> tuple[Vector, Vector]:
    """At most about ``most`` points: lowest and highest of every stretch along the line, in their order."""
    if u.size <= most:
        return u, v
    size = -(-2 * u.size // most)
    keep = {0, u.size - 1}
    for begin in range(0, u.size, size):
        part = v[begin : begin + size]
        keep.update((begin + int(np.argmin(part)), begin + int(np.argmax(part))))
    index = np.array(sorted(keep))
    return u[index], v[index]


def _area(u: Vector, top: Vector, floor: Vector, most: int) -> str:
    """Between two edges; an edge off a logarithmic axis runs along the bottom."""
    good = np.isfinite(u) & np.isfinite(top)
    u, top, floor = u[good], top[good], np.where(np.isfinite(floor[good]), floor[good], 1.0)
    step = max(1, -(-u.size // (most // 2)))
    u, top, floor = u[::step], top[::step], floor[::step]
    if not u.size:
        return ""
    return (
        _moves(np.concatenate([_whole(u), _whole(u[::-1])]), np.concatenate([_whole(top), _whole(floor[::-1])]))
        + "z"
    )


def _marks(px: Vector, py: Vector, mark: str) -> str:
    shape = "h0" if mark == "o" else "m-3-3l6 6m0-6l-6 6"
    return "".join(
        f"M{a:.1f} {b:.1f}{shape}" for a, b in zip(px, py, strict=True) if np.isfinite(a) and np.isfinite(b)
    )


def _span(low: float, high: float, label: str, x: tuple[float, float], log: bool) -> str:
    ends = _whole(_unit(coordinates(np.array([low, high]), log), x))
    return (
        f'<path class="span" d="M{ends[0]} {-FULL}H{ends[1]}V{2 * FULL}H{ends[0]}z">'
        f"<title>{html.escape(label)}</title></path>"
    )


def _heat(heat: Heat, x: tuple[float, float], y: tuple[float, float], panel: Panel) -> str:
    a = _whole(_unit(coordinates(heat.x_edges, panel.x_log), x))
    b = _whole(1.0 - _unit(coordinates(heat.y_edges, panel.y_log), y))
    low, high = np.nanmin(heat.value), np.nanmax(heat.value)
    shade = np.floor(SHADES * (heat.value - low) / max(high - low, 1e-300))
    shade = np.where(np.isfinite(shade), np.clip(shade, 0, SHADES - 1), -1).astype(int)
    parts = []
    for level in range(SHADES):
        cells = []
        for row in range(shade.shape[0]):
            same = np.flatnonzero(np.diff(np.concatenate([[0], (shade[row] == level).astype(np.int8), [0]])))
            for first, last in zip(same[::2], same[1::2], strict=True):
                cells.append(f"M{a[first]} {b[row]}H{a[last]}V{b[row + 1]}H{a[first]}z")
        if cells:
            parts.append(f'<path class="heat" fill-opacity="{(level + 0.5) / SHADES:.2f}" d="{"".join(cells)}"/>')
    return "".join(parts)


def look_rules() -> str:
    """Style rules of the looks: variables per theme are set by the page."""
    rules = []
    for name, look in LOOKS.items():
        dash = f";stroke-dasharray:{' '.join(f'{d:g}' for d in look.dash)}" if look.dash else ""
        rules.append(f".s.{name}{{stroke:var(--{name});stroke-width:{look.width:g}{dash}}}")
        rules.append(f".s.{name}.fill{{fill:var(--{name});stroke:none}}")
        rules.append(f".s.{name}.mo,.s.{name}.mx{{stroke-dasharray:none}}")
    return "".join(rules)


def look_colours(theme: str) -> str:
    """The variables of one theme, ``light`` or ``dark``."""
    return "".join(f"--{name}:{getattr(look, theme)};" for name, look in LOOKS.items())
