"""TOML as people write it: 1.0, and besides an inline table may run over several lines (as TOML 1.1 has it)."""

from __future__ import annotations

import re
import tomllib
from typing import Any

_TOKEN = re.compile(
    r'"""(?:\\.|[^\\])*?"""' r"|'''.*?'''" r'|"(?:\\.|[^"\\\n])*"' r"|'[^'\n]*'" r"|\#[^\n]*" r"|[{}\n]", re.DOTALL
)


def parse_toml(text: str) -> dict[str, Any]:
    """The document.

    Raises:
        tomllib.TOMLDecodeError: As TOML 1.0 sees the text, where joining inline tables doesn't mend it.
    """
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as problem:
        try:
            return tomllib.loads(joined_inline_tables(text))
        except tomllib.TOMLDecodeError:
            raise problem from None


def joined_inline_tables(text: str) -> str:
    """``text`` with every inline table on one line, its comments and a trailing comma dropped."""
    pieces: list[str] = []
    depth = position = 0
    for found in _TOKEN.finditer(text):
        pieces.append(text[position : found.start()])
        token, position = found.group(), found.end()
        if token == "}" and depth:
            pieces = ["".join(pieces).rstrip().removesuffix(",").rstrip() + " "]
        depth = max(0, depth + (token == "{") - (token == "}"))
        inside = depth > 0 and (token == "\n" or token.startswith("#"))
        pieces.append(" " if inside else token)
    return "".join([*pieces, text[position:]])
