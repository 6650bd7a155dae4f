"""What a column probably measures, by its unit label and its name, with the reason for each guess."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from jointscope.recordings.files import Column
from jointscope.recordings.quality_units import declared_by_label
from jointscope.recordings.rules import ROTATIONAL_PLACES, TRANSLATIONAL_PLACES
from jointscope.recordings.units import STANDARD_GRAVITY, units_for

_BY_UNIT: Final = {
    "N": "force", "lbf": "force", "N m": "torque", "mN m": "torque", "lbf ft": "torque", "A": "current", "V": "voltage",
    "m/s^2": "acceleration", "g_n": "acceleration", "rad": "angle", "deg": "angle", "arcmin": "angle",
    "arcsec": "angle", "rpm": "velocity", "rad/s": "velocity", "rad/s^2": "angular-acceleration", "m": "position",
    "m/s": "velocity",
}  # fmt: skip
_BY_NAME: Final = (
    (r"force|hammer|impact|kraft|^f\d*$", "force"),
    (r"acc|beschl|^a\d*$|^a_|^m_\d", "acceleration"),
    (r"torque|moment|trq|tau|^tq", "torque"),
    (r"^i_?[uvw]$|^i_?[abc]$|phase", "phase-current"),
    (r"iq|i_q|current|strom|^i$", "current"),
    (r"(speed|vel|omega|rpm|^w).*(cmd|command|ref|set|soll)|(cmd|command|ref|set|soll).*(speed|vel|omega|rpm)", "speed-command"),
    (r"omega|vel|speed|rpm|^w\d*$", "velocity"),
    (r"theta|angle|enc|winkel|pos|^q\d*$|phi", "angle"),
)  # fmt: skip
_INPUTS: Final = ("force", "torque", "phase-current", "current", "voltage", "speed-command")


@dataclass
class Draft:
    """Keys of a table being drafted, and why those that are guesses were guessed.

    Attributes:
        values: Key to value, ready for TOML.
        guessed: Key to reason; keys that a file or an answer states are not in it.
    """

    values: dict[str, Any] = field(default_factory=dict)
    guessed: dict[str, str] = field(default_factory=dict)

    def state(self, key: str, value: object) -> None:
        """Set what is known."""
        self.values[key] = value
        self.guessed.pop(key, None)

    def guess(self, key: str, value: object, why: str) -> None:
        """Set what is assumed, unless it is known."""
        if key not in self.values:
            self.values[key] = value
            self.guessed[key] = why


def guess_channel(column: Column, motion: str, answers: Mapping[str, Any]) -> Draft | None:
    """A channel's keys; ``None`` where nothing says what the column measures, or the answer is to ignore it."""
    draft = Draft({"column": column.name})
    for key, value in answers.items():
        draft.state(key, value)
    if draft.values.pop("ignore", False):
        return None
    for key, (value, why) in column.meaning.items():
        draft.guess(key, _quantity(value, motion) if key == "quantity" else value, why)
    unit = declared_by_label(column.unit)
    if "quantity" not in draft.values:
        kind, why = _kind(column, unit)
        if kind is None:
            return None
        draft.guess("quantity", _quantity(kind, motion), why)
    quantity = draft.values["quantity"]
    _guess_unit(draft, column, unit)
    _guess_location(draft, column, motion, quantity)
    draft.guess("role", "input" if quantity in _INPUTS else "output", f"the usual role of {quantity}")
    if (
        quantity in ("force", "linear-acceleration")
        and motion == "rotational"
        and draft.values["location"] == "arm"
    ):
        draft.guess("radius", 1.0, "nothing says the distance from the joint axis; measure it, in m")
    if quantity == "linear-acceleration":
        _guess_coupling(draft, column)
    if quantity == "frf":
        draft.guess("form", "accelerance", "the usual form of an impact test")
    return draft


def _guess_coupling(draft: Draft, column: Column) -> None:
    """A sensor that reads nothing at all before the take can't feel gravity: an IEPE one."""
    start = np.asarray(column.read(), dtype=np.float64)[:32]
    level = abs(float(np.nanmedian(start))) * (STANDARD_GRAVITY if draft.values["unit"] == "g_n" else 1.0)
    if (
        "coupling" not in draft.values
        and level < 0.03 * STANDARD_GRAVITY
        and draft.values["unit"] in ("m/s^2", "g_n")
    ):
        draft.guess(
            "coupling", "ac", f"it reads {level:.2g} m/s^2 at first, no gravity; unless gravity is across its axis"
        )
        draft.guess("low_cutoff", 0.5, "a usual corner of an IEPE sensor; take it from the data sheet, in Hz")


def _kind(column: Column, unit: str | None) -> tuple[str | None, str]:
    if column.frequency is not None:
        return "frf", "the record has a frequency axis"
    name = re.split(r"[./]", column.name)[-1].lower()
    by_name = next((kind for pattern, kind in _BY_NAME if re.search(pattern, name)), None)
    by_unit = _BY_UNIT.get(unit or "")
    if by_name == "speed-command" and by_unit in (None, "velocity"):
        return by_name, f"the name {column.name!r}"
    if by_unit is not None and (by_name in (None, by_unit) or unit != "g_n"):
        return by_unit, f"the file's unit {column.unit!r}"
    if by_name is not None:
        return by_name, f"the name {column.name!r}"
    return None, ""


def _quantity(kind: str, motion: str) -> str:
    rotational = {"acceleration": "linear-acceleration", "velocity": "angular-velocity", "position": "angle"}
    translational = {"angle": "position"}
    return (rotational if motion == "rotational" else translational).get(kind, kind)


def _guess_unit(draft: Draft, column: Column, unit: str | None) -> None:
    if "unit" in draft.values:
        return
    quantity = draft.values["quantity"]
    allowed = units_for(quantity, draft.values.get("form", "accelerance") if quantity == "frf" else None)
    if unit in allowed and unit != "g_n":
        draft.state("unit", unit)
    elif unit in allowed:
        draft.guess("unit", unit, f"the file says {column.unit!r}, which may be gravity or gram")
    elif column.unit:
        draft.guess("unit", "1", f"the file's {column.unit!r} is no unit of {quantity}, so the scale is unknown")
    else:
        draft.guess("unit", allowed[0], "the file names no unit; the SI one")


def _guess_location(draft: Draft, column: Column, motion: str, quantity: str) -> None:
    places = (ROTATIONAL_PLACES if motion == "rotational" else TRANSLATIONAL_PLACES).get(quantity, ("arm",))
    if len(places) == 1:
        draft.guess("location", places[0], f"the only place of a {quantity}")
        draft.guessed.pop("location", None)
        return
    name = column.name.lower()
    motor = re.search(r"mot|_m(x|$|_)|mx$|^m_|rotor", name) and "motor" in places
    far = re.search(r"arm|load|link|_l($|_)|my$|out|_se", name)
    if motor and not far:
        draft.guess("location", "motor", f"the name {column.name!r}")
    elif far and not motor:
        draft.guess("location", "load" if "load" in places else "arm", f"the name {column.name!r}")
    else:
        usual = "motor" if quantity == "torque" else places[0] if quantity != "angle" else "arm"
        draft.guess("location", usual if usual in places else places[0], "its usual place")
