"""A model's files as text with the places of its elements: edits touch an attribute's own characters and nothing else.

Re-serialising XML loses comments, order and spacing, so nothing here does it. An MJCF file and everything it includes
are read with the byte ranges of every tag; an edit sets an attribute or puts a line in, and the edited texts differ from
the originals there alone. Includes are found as MuJoCo finds them, relative to the main file's directory.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat
from xml.sax.saxutils import quoteattr

from jointscope.errors import InputError

_ATTRIBUTE = re.compile(rb"""([A-Za-z_:][\w:.-]*)\s*=\s*("[^"]*"|'[^']*')""")


@dataclass(frozen=True, eq=False)
class Tag:
    """An element where it stands.

    Attributes:
        file: Position in ``Sources.files``.
        kind: Its name, "joint" for instance.
        start, end: Byte range of its start tag.
        close: Byte at which its end tag begins; ``end`` of a tag that closes itself.
        parent: The element around it, across includes; ``None`` of a root.
        attributes: Value and byte range of the value between its quotes, by name.
    """

    file: int
    kind: str
    start: int
    end: int
    close: int
    parent: Tag | None
    attributes: dict[str, tuple[str, int, int]]

    @property
    def name(self) -> str:
        """Its ``name``, empty where it has none."""
        return self.attributes["name"][0] if "name" in self.attributes else ""

    @property
    def closes_itself(self) -> bool:
        """``<joint ... />``."""
        return self.close == self.end

    def within(self, kind: str) -> bool:
        """Whether an element of ``kind`` is around it."""
        above = self.parent
        while above is not None:
            if above.kind == kind:
                return True
            above = above.parent
        return False


@dataclass(frozen=True, eq=False)
class Sources:
    """A model's text files.

    Attributes:
        root: Directory that holds them all; their paths in a patch count from it.
        files: Their paths, the main one first.
        texts: Their bytes.
        tags: Every element, in document order, files in the order in which they are included.
        assets: Files that the model refers to beside text (meshes, textures).
    """

    root: Path
    files: tuple[Path, ...]
    texts: tuple[bytes, ...]
    tags: tuple[Tag, ...]
    assets: tuple[Path, ...]

    @property
    def urdf(self) -> bool:
        """Whether it is a URDF."""
        return self.tags[0].kind == "robot"

    def relative(self, file: int) -> str:
        """Path of a file inside a patch."""
        return self.files[file].relative_to(self.root).as_posix()

    def line(self, tag: Tag) -> int:
        """Line number of a tag in its file, from 1."""
        return self.texts[tag.file][: tag.start].count(b"\n") + 1

    def select(self, kind: str, name: str | None = None) -> Iterator[Tag]:
        """Elements of a kind, outside ``<default>``."""
        for tag in self.tags:
            if tag.kind == kind and (name is None or tag.name == name) and not tag.within("default"):
                yield tag

    def element(self, kind: str, name: str) -> Tag:
        """The one element of that kind and name.

        Raises:
            InputError: It is not written out in the files (made by ``attach`` or ``replicate``).
        """
        found = next(self.select(kind, name), None)
        if found is None:
            raise InputError(
                self.files[0], kind, "is not written out in the file, so no line of it can be changed", value=name,
                fix="write the part out that <attach> or <replicate> makes",
            )  # fmt: skip
        return found


def read_sources(path: Path) -> Sources:
    """Read a model's text with every file it includes.

    Raises:
        InputError: A file is missing, or not XML.
    """
    main = Path(path).resolve()
    files: list[Path] = []
    texts: list[bytes] = []
    tags: list[Tag] = []

    def read(file: Path, parent: Tag | None) -> None:
        try:
            text = file.read_bytes()
        except OSError:
            raise InputError(main, "include", "no such file", value=os.path.relpath(file, main.parent)) from None
        files.append(file)
        texts.append(text)
        for tag in _tags(file, text, len(files) - 1, parent):
            if tag.kind == "include" and "file" in tag.attributes:
                read((main.parent / tag.attributes["file"][0]).resolve(), tag.parent)
            else:
                tags.append(tag)

    read(main, None)
    assets = tuple(_assets(main, tags))
    root = Path(os.path.commonpath([str(file.parent) for file in files]))
    return Sources(root, tuple(files), tuple(texts), tuple(tags), assets)


def _tags(file: Path, text: bytes, number: int, parent: Tag | None) -> list[Tag]:
    """Tags of one file in the order in which they open; an included file's root stands for its includer's parent."""
    found: list[Tag] = []
    opened: list[Tag | None] = []
    closes: dict[int, int] = {}
    parser = expat.ParserCreate()
    depth = 0

    def start(kind: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        begin = parser.CurrentByteIndex
        end = _end_of_tag(text, begin)
        above = next((t for t in reversed(opened) if t is not None), parent)
        where = {
            match[1].decode(): (
                attributes[match[1].decode()],
                begin + match.start(2) + 1,
                begin + match.end(2) - 1,
            )
            for match in _ATTRIBUTE.finditer(text[begin:end])
        }
        tag = Tag(number, kind, begin, end, end, above, where)
        outermost = parent is not None and not opened
        opened.append(None if outermost else tag)
        if not outermost:
            found.append(tag)
        depth += 1

    def finish(kind: str) -> None:
        del kind
        tag = opened.pop()
        if tag is not None and parser.CurrentByteIndex > tag.start:
            closes[id(tag)] = parser.CurrentByteIndex

    parser.StartElementHandler = start
    parser.EndElementHandler = finish
    try:
        parser.Parse(text, True)
    except expat.ExpatError as problem:
        raise InputError(file, None, f"not XML: {problem}") from None
    for tag in found:
        object.__setattr__(tag, "close", closes.get(id(tag), tag.end))
    return found


def _end_of_tag(text: bytes, begin: int) -> int:
    """Behind the '>' of the start tag at ``begin``; a '>' may stand inside quotes."""
    quote, k = b"", begin
    while True:
        character = text[k : k + 1]
        if quote:
            quote = b"" if character == quote else quote
        elif character in (b'"', b"'"):
            quote = character
        elif character == b">":
            return k + 1
        k += 1


def _assets(main: Path, tags: list[Tag]) -> Iterator[Path]:
    folders = {"."}
    for tag in tags:
        if tag.kind == "compiler":
            folders |= {tag.attributes[k][0] for k in ("meshdir", "texturedir", "assetdir") if k in tag.attributes}
    for tag in tags:
        for key in ("file", "filename", "fileright", "fileleft", "fileup", "filedown", "filefront", "fileback"):
            if key not in tag.attributes:
                continue
            for folder in sorted(folders):
                path = (main.parent / folder / tag.attributes[key][0]).resolve()
                if path.is_file():
                    yield path


@dataclass(frozen=True)
class Line:
    """One line of ``changes.csv``: an attribute and its two values; the old one is empty where there was none."""

    element: str
    attribute: str
    old: str
    new: str
    file: str
    line: int


@dataclass(eq=False)
class Draft:
    """Edits of a model's text, in memory until :meth:`texts`."""

    sources: Sources
    values: dict[tuple[int, str], tuple[Tag, str]] = field(default_factory=dict)
    insertions: list[tuple[int, int, str]] = field(default_factory=list)
    lines: list[Line] = field(default_factory=list)

    def get(self, tag: Tag, attribute: str) -> str | None:
        """The attribute as it stands in this draft; ``None`` where the element doesn't write it."""
        changed = self.values.get((id(tag), attribute))
        if changed is not None:
            return changed[1]
        return tag.attributes[attribute][0] if attribute in tag.attributes else None

    def put(self, tag: Tag, attribute: str, value: str, *, old: str | None = None) -> None:
        """Set an attribute.

        Args:
            tag: Of the element.
            attribute: Its name; it is written where it was not.
            value: Its text.
            old: What held before where the element doesn't write it (a default class's).
        """
        before = self.get(tag, attribute)
        before = (old or "") if before is None else before
        if before == value:
            return
        self.values[(id(tag), attribute)] = (tag, value)
        self._note(tag, f"{tag.kind} {tag.name}".strip(), attribute, before, value)

    def add(self, tag: Tag, text: str, *, element: str, after: bool = False) -> None:
        """Put a new element in: as the last one inside ``tag``, or right behind it.

        Args:
            tag: Where.
            text: The element; it gets a line of its own at its neighbours' indentation.
            element: What ``changes.csv`` calls it.
            after: Behind ``tag`` instead of inside it.
        """
        indent = _indent(self.sources.texts[tag.file], tag.start)
        if after:
            place = tag.end if tag.closes_itself else self.sources.texts[tag.file].index(b">", tag.close) + 1
            body = "\n" + _shifted(text, indent)
        else:
            body = _shifted(text, indent + "  ") + "\n"
            place = _line_start(self.sources.texts[tag.file], tag.close)
            if self.sources.texts[tag.file][place : tag.close].strip():  # something stands before the end tag
                place, body = tag.close, "\n" + body + indent
        if tag.closes_itself and not after:
            raise InputError(self.sources.files[tag.file], tag.kind, "is empty, so nothing can be put into it")
        self.insertions.append((tag.file, place, body))
        self._note(tag, element, "(new element)", "", " ".join(text.split()))

    def withdraw(self, tag: Tag, beginning: str) -> None:
        """Take back what was put into ``tag`` and begins so: another edit writes it anew."""
        for row in [row for row in self.insertions if row[0] == tag.file and row[2].strip().startswith(beginning)]:
            if row[1] in (tag.close, _line_start(self.sources.texts[tag.file], tag.close)):
                self.insertions.remove(row)
        self.lines = [row for row in self.lines if not (row.attribute == "(new element)" and row.new.startswith(beginning)
                      and row.line == self.sources.line(tag))]  # fmt: skip

    def _note(self, tag: Tag, element: str, attribute: str, old: str, new: str) -> None:
        self.lines = [row for row in self.lines if (row.element, row.attribute) != (element, attribute)
                      or attribute == "(new element)"]  # fmt: skip
        first = tag.attributes[attribute][0] if attribute in tag.attributes else old
        self.lines.append(
            Line(element, attribute, first, new, self.sources.relative(tag.file), self.sources.line(tag))
        )

    def texts(self) -> tuple[bytes, ...]:
        """The files as edited."""
        pieces: list[list[tuple[int, int, bytes]]] = [[] for _ in self.sources.files]
        for (_, attribute), (tag, value) in self.values.items():
            if attribute in tag.attributes:
                _, start, end = tag.attributes[attribute]
                quote = self.sources.texts[tag.file][end : end + 1].decode()
                pieces[tag.file].append((start, end, _quoted(value, quote)))
            else:
                place = tag.end - (2 if self.sources.texts[tag.file][tag.end - 2 : tag.end] == b"/>" else 1)
                while self.sources.texts[tag.file][place - 1 : place].isspace():
                    place -= 1
                pieces[tag.file].append((place, place, f" {attribute}={quoteattr(value)}".encode()))
        for number, place, body in self.insertions:
            pieces[number].append((place, place, body.encode()))
        return tuple(_spliced(text, edits) for text, edits in zip(self.sources.texts, pieces, strict=True))


def _quoted(value: str, quote: str) -> bytes:
    escaped = quoteattr(value, {"'": "&apos;"} if quote == "'" else {})
    return escaped[1:-1].encode()


def _spliced(text: bytes, edits: list[tuple[int, int, bytes]]) -> bytes:
    """Edits applied from the end; of those at one place the first comes first."""
    for _, (start, end, body) in sorted(enumerate(edits), key=lambda e: (e[1][0], e[0]), reverse=True):
        text = text[:start] + body + text[end:]
    return text


def _indent(text: bytes, place: int) -> str:
    begin = _line_start(text, place)
    return re.match(rb"[ \t]*", text[begin:place])[0].decode()  # type: ignore[index]


def _line_start(text: bytes, place: int) -> int:
    return text.rfind(b"\n", 0, place) + 1


def _shifted(text: str, indent: str) -> str:
    return "\n".join(indent + line for line in text.splitlines())
