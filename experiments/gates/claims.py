"""A gates file as data: what is made first, what is claimed, which command measures it, and the bound (``gates.toml``)."""

from __future__ import annotations

import os
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Literal, get_args

from jointscope.errors import InputError

FORMAT = "jointscope-gates/1"
Measure = Literal["selfcheck", "identify", "predict", "diagnose", "inspect", "confirm", "command", "result"]

NEEDS: dict[str, tuple[str, ...]] = {
    "selfcheck": (),
    "identify": ("campaign",),
    "inspect": ("campaign",),
    "diagnose": ("campaign",),
    "predict": ("model", "campaign"),
    "confirm": ("diagnosis",),
    "command": ("command",),
    "result": ("file",),
}
PATHS = ("campaign", "model", "map", "diagnosis", "file")
BOUNDS = ("within", "below", "above", "equals", "covers")
MADE = re.compile(r"\{made\}/([\w.-]+)")
_PLACE = re.compile(r"\{(\w+)\}")


@dataclass(frozen=True, kw_only=True)
class Make:
    """Recordings, models or results that claims need and that are made anew at every call.

    Attributes:
        name: Its folder, ``{made}/NAME``.
        command: Words of a command of this tool that writes that folder.
        needs: A path without which it is left out (a data set that is not everywhere); its claims are then NOT-TESTED
            where they are optional, FAIL where not.
    """

    name: str
    command: tuple[str, ...]
    needs: str | None = None


@dataclass(frozen=True, kw_only=True)
class Gate:
    """One claim.

    Attributes:
        claim: What is claimed, in words.
        measure: The command whose JSON holds the figure; ``result`` reads a JSON file that exists already, ``command``
            any other command's JSON.
        figure: Path of the figure in that JSON (see ``judge.select``): ``parameters.stiffness.value``; as a list of its
            parts where a name holds a dot. Where it selects several figures, each must keep the bound.
        band: Of ``predict``: frequencies [Hz] in which accelerations are scored, beside the paper's bands.
        group: For ``--group``.
        target: With ``within``: the largest relative deviation from it.
        below, above, equals: The other bounds; ``covers``: the figure is an interval and must hold this. Exactly one
            bound is given.
        optional: A missing campaign, model or file then makes the gate NOT-TESTED instead of FAIL.
    """

    claim: str
    measure: Measure
    figure: str | tuple[str, ...]
    campaign: str | None = None
    model: str | None = None
    map: str | None = None
    diagnosis: str | None = None
    file: str | None = None
    command: tuple[str, ...] | None = None
    band: tuple[float, float] | None = None
    group: str = ""
    target: float | None = None
    within: float | None = None
    below: float | None = None
    above: float | None = None
    equals: str | bool | int | float | None = None
    covers: float | None = None
    optional: bool = False

    @property
    def parts(self) -> tuple[str, ...]:
        """The figure's path, part by part."""
        return tuple(_split(self.figure)) if isinstance(self.figure, str) else self.figure

    @property
    def bound(self) -> str:
        """The bound in words."""
        if self.within is not None:
            return f"within {100 * self.within:g} % of {self.target:g}"
        if self.covers is not None:
            return f"interval holds {self.covers:g}"
        if self.below is not None:
            return f"<= {self.below:g}"
        if self.above is not None:
            return f">= {self.above:g}"
        return f"is {self.equals!r}"


@dataclass(frozen=True, kw_only=True)
class GatesFile:
    """A gates file, its paths still with their places.

    Attributes:
        folder: Where it lies; relative paths start there.
        places: Named folders, for ``{name}`` in a path.
    """

    folder: Path
    places: Mapping[str, Path]
    makes: tuple[Make, ...]
    gates: tuple[Gate, ...]

    def resolve(self, text: str, made: Path) -> str:
        """``text`` with ``{made}`` and every place filled in."""
        known = {"made": made, **self.places}
        return _PLACE.sub(lambda found: str(known[found[1]]), text)

    def path(self, text: str, made: Path) -> Path:
        """The path that ``text`` names, relative ones from the file's folder."""
        return self.folder / self.resolve(text, made)

    def needed(self, gates: tuple[Gate, ...]) -> tuple[Make, ...]:
        """What must be made for ``gates``, in the file's order, with what that needs in turn."""
        by_name = {make.name: make for make in self.makes}
        wanted: set[str] = set()
        waiting = {name for gate in gates for name in made_names(gate)}
        while waiting:
            name = waiting.pop()
            if name in by_name and name not in wanted:
                wanted.add(name)
                waiting |= set(MADE.findall(" ".join(by_name[name].command)))
        return tuple(make for make in self.makes if make.name in wanted)


def made_names(gate: Gate) -> tuple[str, ...]:
    """Names of what is made that a gate's paths lead into."""
    texts = [value for key in PATHS if (value := getattr(gate, key)) is not None]
    return tuple(MADE.findall(" ".join([*texts, *(gate.command or ())])))


def _split(path: str) -> list[str]:
    """Parts of a dotted path; dots inside ``[...]`` belong to the part."""
    return re.findall(r"\[[^\]]*\]|[^.\[\]]+", path)


def read_gates(path: Path) -> GatesFile:
    """Read and validate ``gates.toml``.

    Raises:
        InputError: The message names file, key and value.
    """
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as problem:
        raise InputError(path, None, f"not TOML: {problem}") from None
    for key in table:
        if key not in ("format", "places", "make", "gate"):
            raise InputError(path, key, "unknown key", fix="a gates file holds format, places, make and gate")
    if table.get("format") != FORMAT:
        raise InputError(path, "format", "not a gates file", value=table.get("format"), fix=f"write {FORMAT!r}")
    folder = path.parent
    places = _places(path, table.get("places", {}))
    makes = tuple(_make(path, at, entry) for at, entry in enumerate(_entries(path, table, "make"), start=1))
    names = [make.name for make in makes]
    for at, name in enumerate(names):
        if name in names[:at]:
            raise InputError(path, f"make[{at + 1}].name", "used twice", value=name)
    gates = tuple(_gate(path, at, entry) for at, entry in enumerate(_entries(path, table, "gate"), start=1))
    for at, gate in enumerate(gates, start=1):
        _check_places(path, f"gate[{at}]", (*(getattr(gate, key) for key in PATHS), *(gate.command or ())), places)
        for name in made_names(gate):
            if name not in names:
                raise InputError(
                    path, f"gate[{at}]", "nothing makes it", value=name, fix="add a [[make]] of that name"
                )
    for at, make in enumerate(makes, start=1):
        _check_places(path, f"make[{at}]", (*make.command, make.needs), places)
        later = [name for name in MADE.findall(" ".join(make.command)) if name not in names[:at]]
        if later:
            raise InputError(path, f"make[{at}].command", "nothing makes it before", value=later[0], fix="reorder")
    return GatesFile(folder=folder, places=places, makes=makes, gates=gates)


def _entries(path: Path, table: dict[str, Any], key: str) -> list[dict[str, Any]]:
    entries = table.get(key, [])
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise InputError(path, key, f"must be [[{key}]] tables")
    return entries


def _places(path: Path, table: object) -> dict[str, Path]:
    """Folders by name: the environment's where it has one, else the one given, from the file's own folder."""
    if not isinstance(table, dict):
        raise InputError(path, "places", "must be a table", value=table)
    places = {}
    for name, entry in table.items():
        where = f"places.{name}"
        if name == "made" or not isinstance(entry, dict) or set(entry) - {"environment", "folder"}:
            raise InputError(path, where, "must be { folder = '...', environment = '...' }", value=entry)
        if not isinstance(entry.get("folder"), str):
            raise InputError(path, f"{where}.folder", "must be a text", value=entry.get("folder"))
        variable = entry.get("environment", "")
        if not isinstance(variable, str):
            raise InputError(path, f"{where}.environment", "must be a text", value=variable)
        own = os.environ.get(variable) if variable else None
        places[name] = Path(own).resolve() if own else (path.parent / entry["folder"]).resolve()
    return places


def _check_places(path: Path, where: str, texts: tuple[str | None, ...], places: Mapping[str, Path]) -> None:
    for text in texts:
        for name in _PLACE.findall(text or ""):
            if name != "made" and name not in places:
                raise InputError(path, where, "no such place", value=f"{{{name}}}", fix=f"add [places.{name}]")


def _words(path: Path, key: str, value: object) -> tuple[str, ...]:
    words = value.split() if isinstance(value, str) else value
    if not isinstance(words, list) or not words or not all(isinstance(word, str) for word in words):
        raise InputError(path, key, "must be a command of this tool, or a list of its words", value=value)
    return tuple(words[1:] if words[0] == "jointscope" else words)


def _make(path: Path, position: int, table: dict[str, Any]) -> Make:
    where = f"make[{position}]"
    for key in table:
        if key not in ("name", "command", "needs"):
            raise InputError(path, f"{where}.{key}", "unknown key", fix="known keys are name, command, needs")
    name = table.get("name")
    if not isinstance(name, str) or not re.fullmatch(r"\w[\w.-]*", name):
        raise InputError(path, f"{where}.name", "must be a folder's name", value=name)
    if not isinstance(table.get("needs", ""), str):
        raise InputError(path, f"{where}.needs", "must be a path", value=table["needs"])
    command = _words(path, f"{where}.command", table.get("command"))
    if f"{{made}}/{name}" not in " ".join(command):
        raise InputError(path, f"{where}.command", f"does not write {{made}}/{name}", value=" ".join(command))
    return Make(name=name, command=command, needs=table.get("needs"))


def _gate(path: Path, position: int, table: dict[str, Any]) -> Gate:
    where = f"gate[{position}]"
    known = {field.name for field in fields(Gate)}
    for key in table:
        if key not in known:
            raise InputError(
                path, f"{where}.{key}", "unknown key", fix=f"known keys are {', '.join(sorted(known))}"
            )
    given = dict(table)
    if isinstance(given.get("figure"), list) and all(isinstance(part, str) for part in given["figure"]):
        given["figure"] = tuple(given["figure"])
    if "command" in given:
        given["command"] = _words(path, f"{where}.command", given["command"])
    for key in ("claim", "measure", "group", *PATHS, *(("figure",) if "figure" not in given else ())):
        if not isinstance(given.get(key, "" if key in ("group", *PATHS) else None), str):
            raise InputError(path, f"{where}.{key}", "must be a text", value=given.get(key))
    if not isinstance(given["figure"], (str, tuple)):
        raise InputError(path, f"{where}.figure", "must be a text or a list of texts", value=given["figure"])
    measure = given["measure"]
    if measure not in get_args(Measure):
        raise InputError(
            path, f"{where}.measure", "no such measure", value=measure, fix=f"choose among {', '.join(NEEDS)}"
        )
    for key in NEEDS[measure]:
        if key not in given:
            raise InputError(path, f"{where}.{key}", f"measure {measure!r} needs it")
    if not isinstance(given.get("optional", False), bool):
        raise InputError(path, f"{where}.optional", "must be true or false", value=given["optional"])
    if "band" in given:
        given["band"] = _band(path, where, measure, given["band"])
    _check_bounds(path, where, given)
    return Gate(**given)


def _band(path: Path, where: str, measure: str, band: object) -> tuple[float, float]:
    numbers = isinstance(band, list) and len(band) == 2 and all(type(end) in (int, float) for end in band)
    if measure != "predict" or not numbers or not 0 <= band[0] < band[1]:  # type: ignore[index]
        raise InputError(path, f"{where}.band", "must be two rising frequencies in Hz, of a 'predict'", value=band)
    return float(band[0]), float(band[1])  # type: ignore[index]


def _check_bounds(path: Path, where: str, table: dict[str, Any]) -> None:
    given = [key for key in BOUNDS if key in table]
    if len(given) != 1:
        raise InputError(path, where, f"has {len(given)} bounds", fix=f"give exactly one of {', '.join(BOUNDS)}")
    for key in ("target", "within", "below", "above", "covers"):
        if key in table and (isinstance(table[key], bool) or not isinstance(table[key], (int, float))):
            raise InputError(path, f"{where}.{key}", "must be a number", value=table[key])
    if isinstance(table.get("equals"), (list, dict)):
        raise InputError(path, f"{where}.equals", "must be a text, a number, true or false", value=table["equals"])
    if ("within" in table) != ("target" in table):
        raise InputError(path, where, "within and target belong together")
    if table.get("target") == 0:
        raise InputError(
            path, f"{where}.target", "a relative deviation from 0 has no meaning", fix="use below and above"
        )
