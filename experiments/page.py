"""One self-contained HTML page: a verdict, tables, pictures inside the file; readable in light and dark, and on paper."""

from __future__ import annotations

import base64
import html
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

_CSS = """
:root { color-scheme: light dark; --ink: #1c2430; --quiet: #5b6675; --paper: #fdfdfc; --line: #d9dee5; --mark: #1f4e79;
        --wash: #f1f4f7; }
@media (prefers-color-scheme: dark) { :root { --ink: #e6e9ee; --quiet: #a3adba; --paper: #14181e; --line: #303844;
        --mark: #8fc1ee; --wash: #1c222b; } img { background: #fff; } }
body { font: 16px/1.5 system-ui, sans-serif; color: var(--ink); background: var(--paper); margin: 0 auto;
       max-width: 62rem; padding: 2rem 1.2rem 4rem; }
h1 { font-size: 1.5rem; margin: 0 0 .4rem; } h2 { font-size: 1.1rem; margin: 2.2rem 0 .5rem; color: var(--mark); }
p.verdict { font-size: 1.12rem; border-left: 4px solid var(--mark); padding: .3rem 0 .3rem .9rem; }
p.note, figcaption { color: var(--quiet); font-size: .9rem; }
div.wide { overflow-x: auto; } table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
th, td { padding: .28rem .8rem .28rem 0; border-bottom: 1px solid var(--line); text-align: left; vertical-align: top; }
th { color: var(--quiet); font-weight: 600; font-size: .85rem; } td.number { text-align: right; white-space: nowrap; }
figure { margin: 1rem 0; } img { max-width: 100%; border-radius: 4px; } svg { max-width: 100%; height: auto; }
div.side { display: flex; flex-wrap: wrap; gap: 1rem; } div.side > div { flex: 1 1 26rem; }
@media print { body { max-width: none; } figure { break-inside: avoid; } }
"""


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
    """A heading and what stands under it, in this order: sentences, markup, table, pictures, small print.

    ``markup`` is put in as it is (an inline SVG); whoever writes it escapes what it quotes.
    """

    heading: str
    text: tuple[str, ...] = ()
    markup: str = ""
    table: Table | None = None
    pictures: tuple[Picture, ...] = field(default=())
    notes: tuple[str, ...] = ()


def page(title: str, verdict: str, sections: Sequence[Section]) -> str:
    """The page as text; every picture's file is read here."""
    body = [f"<h1>{html.escape(title)}</h1>", f'<p class="verdict">{html.escape(verdict)}</p>']
    body += [_section(section) for section in sections]
    return (
        '<!doctype html>\n<html lang="en">\n<head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{html.escape(title)}</title><style>{_CSS}</style></head>\n<body>\n"
        + "\n".join(body)
        + "\n</body></html>\n"
    )


def _section(section: Section) -> str:
    parts = [f"<h2>{html.escape(section.heading)}</h2>"]
    parts += [f"<p>{html.escape(sentence)}</p>" for sentence in section.text]
    if section.markup:
        parts.append(section.markup)
    if section.table is not None:
        parts.append(_table(section.table))
    parts += [_picture(picture) for picture in section.pictures]
    parts += [f'<p class="note">{html.escape(note)}</p>' for note in section.notes]
    return "\n".join(parts)


def _table(table: Table) -> str:
    head = "".join(f"<th>{html.escape(name)}</th>" for name in table.columns)
    rows = "".join("<tr>" + "".join(_cell(cell) for cell in row) + "</tr>\n" for row in table.rows)
    return f'<div class="wide"><table><thead><tr>{head}</tr></thead><tbody>\n{rows}</tbody></table></div>'


def _cell(cell: str) -> str:
    number = bool(cell) and (cell[0].isdigit() or (cell[0] in "+-.[" and any(c.isdigit() for c in cell)))
    kind = ' class="number"' if number else ""
    return f"<td{kind}>{html.escape(cell)}</td>"


def _picture(picture: Picture) -> str:
    data = base64.b64encode(picture.path.read_bytes()).decode("ascii")
    caption = html.escape(picture.caption)
    return f'<figure><img alt="{caption}" src="data:image/png;base64,{data}"><figcaption>{caption}</figcaption></figure>'
