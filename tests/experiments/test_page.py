"""The page is whole in one file and escapes what it is given."""

import re
from pathlib import Path

from jointscope.experiments.markdown_report import sections_of
from jointscope.experiments.page import Picture, Section, Table, page, table_markup


def test_everything_is_inside_and_escaped(tmp_path: Path) -> None:
    png = tmp_path / "p.png"
    png.write_bytes(b"\x89PNG")
    table = Table(columns=("a<b", "value"), rows=(("x & y", "-1.5"),))
    text = page(
        "T <1>",
        "All & well",
        [Section(heading="H", text=("s",), table=table, pictures=(Picture(path=png, caption="c"),))],
    )
    assert "T &lt;1&gt;" in text and "x &amp; y" in text and "a&lt;b" in text
    assert '<td class="number">-1.5</td>' in text and "<td>x &amp; y</td>" in text
    assert "data:image/png;base64," in text
    assert not re.search(r"(src|href)=.?http", text)
    assert "prefers-color-scheme: dark" in text


def test_a_column_is_one_of_numbers_or_of_words():
    """A sentence that begins with a number wraps, and so its whole column is set as words are."""
    long = "78066.1 N m/rad (-0.003 %); [78053.1, 78079.1] covers 78068.2"
    markup = table_markup(Table(columns=("what", "found", "bound"), rows=(("K", long, "3 %"), ("c", "61.3", ""))))
    assert markup.count('class="number"') == 2  # the bounds, the empty one among them
    assert f"<td>{long}</td>" in markup and "<td>61.3</td>" in markup


def test_a_caption_is_said_once(tmp_path):
    """Markdown repeats it below its picture; the page has it in the figure."""
    (tmp_path / "a.png").write_bytes(b"picture")
    text = "# T\n\n![Two modes.](a.png)\n\nTwo modes.\n\nTwo modes. And more.\n"
    _, sections = sections_of(text, tmp_path, {})
    assert sections[0].markup.count("<p>") == 1 and "<p>Two modes. And more.</p>" in sections[0].markup
