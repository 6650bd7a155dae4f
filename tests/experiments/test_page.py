"""The page is whole in one file and escapes what it is given."""

import re
from pathlib import Path

from jointscope.experiments.page import Picture, Section, Table, page


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
