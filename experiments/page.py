"""One self-contained HTML page: a verdict, what to do next, charts, tables; for light, dark and paper, with or without script."""

from __future__ import annotations

import base64
import html
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from itertools import zip_longest
from pathlib import Path

from jointscope.experiments.charts.chart import Chart, Missing
from jointscope.experiments.charts.svg import MOST_POINTS, chart_markup, look_colours, look_rules

_POINTS = 200_000  # of all lines of a page: about 1.6 MB
_LONGEST_NUMBER = 32  # characters of a cell that is a number with its unit and interval
_FEWEST = 400  # of one line: a screen's width shows no more
_LIGHT = (
    "--ink:#1c2430;--quiet-ink:#566070;--quiet-line:#7b8694;--paper:#fdfdfc;--line:#dde2e8;--edge:#97a1ae;--mark:#1f4e79;"
    "--wash:#f1f4f7;--focus:#c2410c;--span:#1f4e7914;--heat:#0b3c6f;--lit:#c2410c;--lit-wash:#f59e0b;"
)
_DARK = (
    "--ink:#e6e9ee;--quiet-ink:#a9b3c0;--quiet-line:#8592a2;--paper:#14181e;--line:#2b333d;--edge:#5b6775;--mark:#8fc1ee;"
    "--wash:#1d242d;--focus:#fb923c;--span:#8fc1ee1c;--heat:#9fd0ff;--lit:#fb923c;--lit-wash:#b45309;"
)


@dataclass(frozen=True, kw_only=True)
class Table:
    """Rows of cells; cells that start with a digit or a sign are set as numbers."""

    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True, kw_only=True)
class Picture:
    """A PNG that is put inside the page, with the sentence that says what to see in it."""

    path: Path
    caption: str


@dataclass(frozen=True, kw_only=True)
class Section:
    """A heading and what stands under it, in this order: sentences, markup, table, charts, tabs, pictures, small print.

    Attributes:
        markup: Put in as it is (an inline SVG); whoever writes it escapes what it quotes.
        charts: One under the other; of a missing one the page says what it would take.
        tabs: Alternatives of which one is shown at a time; on paper all are.
    """

    heading: str
    text: tuple[str, ...] = ()
    markup: str = ""
    table: Table | None = None
    charts: tuple[Chart | Missing, ...] = field(default=())
    tabs: tuple[Chart | Missing, ...] = field(default=())
    pictures: tuple[Picture, ...] = field(default=())
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class FirstScreen:
    """What stands above the evidence.

    Attributes:
        verdict: What is wrong, where and how sure, in a sentence or two.
        next_step: What to do now.
        facts: Names and values of the few figures that matter, units included.
        markup: Drawings side by side, each as inline SVG.
    """

    verdict: str
    next_step: str = ""
    facts: tuple[tuple[str, str], ...] = ()
    markup: tuple[str, ...] = ()


def page(title: str, first: FirstScreen | str, sections: Sequence[Section]) -> str:
    """The page as text; every picture's file is read here.

    Args:
        title: Of the page and its window.
        first: The first screen, or its verdict alone.
        sections: The evidence.
    """
    lines = sum(len(panel.series) for section in sections for c in (*section.charts, *section.tabs)
                if isinstance(c, Chart) for panel in c.panels)  # fmt: skip
    most = min(MOST_POINTS, max(_FEWEST, _POINTS // max(lines, 1)))
    shown = FirstScreen(verdict=first) if isinstance(first, str) else first
    body = [f"<header><h1>{html.escape(title)}</h1></header>", *_first(shown)]
    if len(sections) > 3:
        links = (f'<a href="#{_anchor(s.heading)}">{html.escape(s.heading)}</a>' for s in sections)
        body.append(f'<nav aria-label="Contents">{" ".join(links)}</nav>')
    body.append("<main>")
    body += [_section(section, most) for section in sections]
    body.append("</main>")
    return (
        '<!doctype html>\n<html lang="en">\n<head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{html.escape(title)}</title><style>{_styles()}</style></head>\n<body>\n"
        + "\n".join(body)
        + f"\n<script>{_asset('page_script.js')}</script>\n</body></html>\n"
    )


def _styles() -> str:
    light, dark = _LIGHT + look_colours("light"), _DARK + look_colours("dark")
    return (
        f":root{{color-scheme:light dark;{light}}}\n"
        f"@media screen and (prefers-color-scheme: dark){{:root:not([data-theme=light]){{{dark}}}}}\n"
        f"@media screen{{:root[data-theme=dark]{{{dark}color-scheme:dark}}:root[data-theme=light]{{color-scheme:light}}}}\n"
        f"{_asset('page_style.css')}{look_rules()}\n"
    )


def _asset(name: str) -> str:
    return files("jointscope.experiments").joinpath(name).read_text(encoding="utf-8")


def _first(first: FirstScreen) -> list[str]:
    verdict = pretty(first.verdict).replace(" %", "\u00a0%")  # no line begins with the sign
    parts = [f'<p class="verdict">{html.escape(verdict)}</p>']
    if first.facts:
        facts = (f"<div><dt>{html.escape(a)}</dt><dd>{html.escape(pretty(b))}</dd></div>" for a, b in first.facts)
        parts.append(f'<dl class="facts">{"".join(facts)}</dl>')
    if first.next_step:
        parts.append(f'<p class="next"><b>Next:</b> {html.escape(first.next_step)}</p>')
    drawings = "".join(f"<div>{m}</div>" for m in first.markup if m)
    if drawings:
        parts.append(f'<div class="side">{drawings}</div>')
    return parts


def _anchor(heading: str) -> str:
    return re.sub(r"[^a-z0-9]+", "-", heading.lower()).strip("-")


def _section(section: Section, most: int) -> str:
    parts = [f'<h2 id="{_anchor(section.heading)}">{html.escape(section.heading)}</h2>']
    parts += [f"<p>{html.escape(sentence)}</p>" for sentence in section.text]
    if section.markup:
        parts.append(section.markup)
    if section.table is not None:
        parts.append(table_markup(section.table))
    parts += [_chart(chart, most) for chart in section.charts]
    if section.tabs:
        tabs = (
            f'<section class="tab" id="tab-{_anchor(section.heading)}-{k}" data-label="{html.escape(tab.label)}">'
            f"<h3>{html.escape(tab.label)}</h3>{_chart(tab, most)}</section>"
            for k, tab in enumerate(section.tabs)
        )
        parts.append(f'<div class="tabs">{"".join(tabs)}</div>')
    parts += [picture_markup(picture) for picture in section.pictures]
    parts += [f'<p class="note">{html.escape(note)}</p>' for note in section.notes]
    return "\n".join(parts)


def _chart(chart: Chart | Missing, most: int) -> str:
    if isinstance(chart, Missing):
        return (
            f'<p class="missing">{html.escape(chart.label)}: not drawn. Missing: {html.escape(chart.channel)}.</p>'
        )
    return chart_markup(chart, most)


def table_markup(table: Table) -> str:
    """A table that scrolls sideways where it must."""
    numbers = [all(_is_number(cell) for cell in column) for column in zip_longest(*table.rows, fillvalue="")]
    head = "".join(f'<th scope="col">{html.escape(name)}</th>' for name in table.columns)
    rows = "".join(
        "<tr>" + "".join(_cell(cell, n) for cell, n in zip(row, numbers, strict=False)) + "</tr>\n"
        for row in table.rows
    )
    return f'<div class="wide"><table><thead><tr>{head}</tr></thead><tbody>\n{rows}</tbody></table></div>'


def pretty(text: str) -> str:
    """Units as they are printed: ``m/s^2`` becomes ``m/s²``."""
    return re.sub(r"(?<=[a-zA-Z])\^([23])", lambda power: {"2": "²", "3": "³"}[power[1]], text)


def _is_number(cell: str) -> bool:
    """Whether a cell is a number with what belongs to it, or empty; what is longer is a sentence and wraps."""
    begins = cell[:1].isdigit() or (cell[:1] in ("+", "-", ".", "[") and any(c.isdigit() for c in cell))
    return not cell or cell in ("-", "inf", "nan") or (begins and len(cell) <= _LONGEST_NUMBER)


def _cell(cell: str, number: bool) -> str:
    kind = ' class="number"' if number else ""
    return f"<td{kind}>{html.escape(pretty(cell))}</td>"


def picture_markup(picture: Picture) -> str:
    """The picture's file, inside the page."""
    data = base64.b64encode(picture.path.read_bytes()).decode("ascii")
    caption = html.escape(picture.caption)
    return f'<figure><img alt="{caption}" src="data:image/png;base64,{data}"><figcaption>{caption}</figcaption></figure>'
