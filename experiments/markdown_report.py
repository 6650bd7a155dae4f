"""A page that a command wrote in Markdown as one HTML file: the same words, pictures inside, a first screen above them.

Only the Markdown that this project writes is read: headings, paragraphs, lists, pipe tables, pictures, bold and code.
"""

from __future__ import annotations

import html
import re
from collections.abc import Iterator, Mapping
from pathlib import Path

from jointscope.atomic import write_text
from jointscope.experiments.charts.chart import Chart
from jointscope.experiments.page import (
    FirstScreen,
    Picture,
    Section,
    Table,
    page,
    picture_markup,
    table_markup,
)

_IMAGE = re.compile(r"!\[([^\]]*)\]\(([^)]+)\)")


def write_markdown_report(
    source: Path, first: FirstScreen, provenance: Section, charts: Mapping[str, Chart] | None = None
) -> Path:
    """Write ``report.html`` beside ``source``.

    Args:
        source: The Markdown page; its pictures are read from its folder.
        first: Verdict, next step, drawing.
        provenance: The last section.
        charts: By the picture's file name: drawn in its place, so that they can be zoomed.
    """
    title, sections = sections_of(source.read_text(encoding="utf-8"), source.parent, charts or {})
    path = source.parent / "report.html"
    write_text(path, page(title or source.stem, first, [*sections, provenance]))
    return path


def sections_of(text: str, folder: Path, charts: Mapping[str, Chart]) -> tuple[str, list[Section]]:
    """Title and sections of a page."""
    title, heading = "", "Result"
    parts: list[str] = []
    drawn: list[Chart] = []
    found: list[Section] = []
    caption = ""
    for kind, lines in _blocks(text):
        if kind == "heading":
            level, _, said = lines[0].partition(" ")
            if level == "#":
                title = _plain(said)
                continue
            if level == "##":
                if parts or drawn:
                    found.append(Section(heading=heading, markup="\n".join(parts), charts=tuple(drawn)))
                heading, parts, drawn = _plain(said), [], []
            else:
                parts.append(f"<h3>{_inline(said)}</h3>")
        elif kind == "table":
            parts.append(_table(lines))
        elif kind == "list":
            parts.append("<ul>" + "".join(f"<li>{_inline(line[2:])}</li>" for line in lines) + "</ul>")
        else:
            rest = _IMAGE.sub("", " ".join(lines)).strip()
            if rest == caption:  # Markdown shows no caption of its own: there it is repeated below the picture
                rest = ""
            for alt, name in _IMAGE.findall(" ".join(lines)):
                caption = alt
                if name in charts:
                    drawn.append(charts[name])
                elif (folder / name).is_file():
                    parts.append(picture_markup(Picture(path=folder / name, caption=alt)))
            if rest:
                parts.append(f"<p>{_inline(rest)}</p>")
    if parts or drawn:
        found.append(Section(heading=heading, markup="\n".join(parts), charts=tuple(drawn)))
    return title, found


def _blocks(text: str) -> Iterator[tuple[str, list[str]]]:
    """(kind, lines) of each block: heading, table, list or paragraph."""
    held: list[str] = []
    kind = ""
    for line in [*text.splitlines(), ""]:
        now = (
            "" if not line.strip() else "heading" if line.startswith("#") else "table" if line.startswith("|")
            else "list" if line.startswith(("- ", "* ")) else "text"
        )  # fmt: skip
        if held and (now != kind or now == "heading"):
            yield kind, held
            held = []
        if now:
            held.append(line)
        kind = now


def _table(lines: list[str]) -> str:
    rows = [
        tuple(_plain(cell.strip()) for cell in re.split(r"(?<!\\)\|", line.strip().strip("|"))) for line in lines
    ]
    body = [row for row in rows if not all(re.fullmatch(r":?-+:?", cell) for cell in row)]
    width = len(body[0])
    full = tuple((row + ("",) * width)[:width] for row in body[1:])
    return table_markup(Table(columns=body[0], rows=full))


def _plain(text: str) -> str:
    return re.sub(r"\*\*|`", "", text).replace("\\|", "|")


def _inline(text: str) -> str:
    text = html.escape(text, quote=False)
    text = re.sub(r"\*\*(.+?)\*\*", r"<b>\1</b>", text)
    return re.sub(r"`(.+?)`", r"<code>\1</code>", text)
