"""A gates file as data: what is claimed, which command measures it, and the bound (``gates.toml``)."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Literal

from jointscope.errors import InputError

FORMAT = "jointscope-gates/1"
Measure = Literal["selfcheck", "identify", "predict", "diagnose", "inspect", "result"]

NEEDS: dict[str, tuple[str, ...]] = {
    "selfcheck": (),
    "identify": ("campaign",),
    "inspect": ("campaign",),
    "diagnose": ("campaign",),
    "predict": ("model", "campaign"),
    "result": ("file",),
}
BOUNDS = ("within", "below", "above", "equals", "covers")


@dataclass(frozen=True, kw_only=True)
class Gate:
    """One claim.

    Attributes:
        claim: What is claimed, in words.
        measure: The command whose JSON holds the figure; ``result`` reads a JSON file that exists already.
        figure: Path of the figure in that JSON, keys and list positions joined by dots: ``parameters.stiffness.value``.
        target: With ``within`` (largest relative deviation) or ``covers`` (an interval must hold it).
        below, above, equals: The other bounds; exactly one bound is given.
        optional: A missing campaign, model or file then makes the gate NOT-TESTED instead of FAIL.
    """

    claim: str
    measure: Measure
    figure: str
    campaign: str | None = None
    model: str | None = None
    file: str | None = None
    target: float | None = None
    within: float | None = None
    below: float | None = None
    above: float | None = None
    equals: str | bool | int | float | None = None
    covers: float | None = None
    optional: bool = False

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


def _gate(path: Path, position: int, table: dict[str, Any]) -> Gate:
    where = f"gate[{position}]"
    known = {field.name for field in fields(Gate)}
    for key in table:
        if key not in known:
            raise InputError(
                path, f"{where}.{key}", "unknown key", fix=f"known keys are {', '.join(sorted(known))}"
            )
    for key in ("claim", "measure", "figure"):
        if not isinstance(table.get(key), str):
            raise InputError(path, f"{where}.{key}", "must be a text", value=table.get(key))
    measure = table["measure"]
    if measure not in NEEDS:
        raise InputError(
            path, f"{where}.measure", "no such measure", value=measure, fix=f"choose among {', '.join(NEEDS)}"
        )
    for key in NEEDS[measure]:
        if not isinstance(table.get(key), str):
            raise InputError(path, f"{where}.{key}", f"measure {measure!r} needs it", value=table.get(key))
    given = [key for key in BOUNDS if key in table]
    if len(given) != 1:
        raise InputError(path, where, f"has {len(given)} bounds", fix=f"give exactly one of {', '.join(BOUNDS)}")
    for key in ("target", "within", "below", "above", "covers"):
        if key in table and (isinstance(table[key], bool) or not isinstance(table[key], (int, float))):
            raise InputError(path, f"{where}.{key}", "must be a number", value=table[key])
    if ("within" in table) != ("target" in table):
        raise InputError(path, where, "within and target belong together")
    if table.get("target") == 0:
        raise InputError(
            path, f"{where}.target", "a relative deviation from 0 has no meaning", fix="use below and above"
        )
    return Gate(**table)


def read_gates(path: Path) -> tuple[Gate, ...]:
    """Read and validate ``gates.toml``.

    Raises:
        InputError: The message names file, key and value.
    """
    try:
        with path.open("rb") as stream:
            table = tomllib.load(stream)
    except tomllib.TOMLDecodeError as problem:
        raise InputError(path, None, f"not TOML: {problem}") from None
    for key in table:
        if key not in ("format", "gate"):
            raise InputError(path, key, "unknown key", fix="a gates file holds format and [[gate]] tables")
    if table.get("format") != FORMAT:
        raise InputError(path, "format", "not a gates file", value=table.get("format"), fix=f"write {FORMAT!r}")
    entries = table.get("gate", [])
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise InputError(path, "gate", "must be [[gate]] tables")
    return tuple(_gate(path, position, entry) for position, entry in enumerate(entries, start=1))
