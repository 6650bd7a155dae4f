"""What a ``campaign.toml`` may hold, as tables: every key with its kind, whether it must be there, and its choices.

Structure only: what keys mean together (units and quantities, radii, model files) is in ``rules``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal, get_args

from jointscope.errors import CampaignError
from jointscope.recordings.campaign import (
    FORMAT,
    Experiment,
    Hold,
    Location,
    Motion,
    Plane,
    Quantity,
    Role,
    Topology,
)

Kind = Literal[
    "text", "flag", "number", "positive", "not-negative", "count", "choice", "pair", "vector", "texts",
    "table", "tables", "numbers-by-name", "holds", "start", "scale", "share",
]  # fmt: skip
Table = Mapping[str, object]
# numbers beyond it, and divisors nearer to 0 than its inverse, are slips of the pen; their squares would overflow
EXTREME: Final = 1e30


@dataclass(frozen=True)
class Key:
    """One key: the kind of its value, the values it may take, and whether it can be left out."""

    kind: Kind
    choices: tuple[str, ...] = ()
    required: bool = False


def _choice(literal: object, *, required: bool = False) -> Key:
    return Key("choice", get_args(literal), required)


_TEXT, _FLAG, _NUMBER, _POSITIVE, _NOT_NEGATIVE = (
    Key("text"), Key("flag"), Key("number"), Key("positive"), Key("not-negative")
)  # fmt: skip

TOP: Final = {
    "format": Key("choice", (FORMAT,), required=True),
    "title": _TEXT,
    "notes": _TEXT,
    "rig": Key("table", required=True),
    "model": Key("table"),
    "run": Key("tables", required=True),
}
MODEL: Final = {"mjcf": _TEXT, "urdf": _TEXT, "joints": Key("texts")}
RIG: Final = {
    "topology": _choice(Topology, required=True),
    "motion": _choice(Motion, required=True),
    "plane": _choice(Plane),
    "reduction_ratio": _POSITIVE,
    "motor_inertia": _NOT_NEGATIVE,
    "reducer_inertia": _NOT_NEGATIVE,
    "motor_damping": _NOT_NEGATIVE,
    "load_damping": _NOT_NEGATIVE,
    "arm_mass": _POSITIVE,
    "arm_com_radius": _NOT_NEGATIVE,
    "efficiency": Key("share"),
    "torque_constant": _POSITIVE,
    "pole_pairs": Key("count"),
    "ground_spring": _FLAG,
    "stiffness_reference": _POSITIVE,
    "inertia_reference": _POSITIVE,
    "damping_reference": _NOT_NEGATIVE,
    "joints": Key("texts"),
}
RUN: Final = {
    "id": Key("text", required=True),
    "experiment": _choice(Experiment, required=True),
    "brake": _FLAG,
    "arm_angle": _NUMBER,
    "repeat_of": _TEXT,
    "role": Key("choice", ("estimate", "validate")),
    "initial": Key("choice", ("rest", "estimate")),
    "hold": Key("holds", get_args(Hold)),
    "joint": _TEXT,
    "posture": Key("numbers-by-name"),
    "payload": Key("table"),
    "stream": Key("tables", required=True),
}
PAYLOAD: Final = {"mass": Key("not-negative", required=True), "com": Key("vector")}
STREAM: Final = {
    "file": Key("text", required=True),
    "sampling_rate": _POSITIVE,
    "start": Key("start"),
    "start_uncertainty": _NOT_NEGATIVE,
    "window": Key("pair"),
    "time": _TEXT,
    "gaps": Key("choice", ("refuse", "mask")),
    "sync": _TEXT,
    "frequency": _TEXT,
    "channels": Key("tables", required=True),
}
CHANNEL: Final = {
    "column": Key("text", required=True),
    "quantity": _choice(Quantity, required=True),
    "unit": Key("text", required=True),
    "location": _choice(Location, required=True),
    "role": _choice(Role, required=True),
    "radius": _POSITIVE,
    "reference_radius": _POSITIVE,
    "direction": Key("choice", ("tangential", "radial")),
    "coupling": Key("choice", ("dc", "ac")),
    "low_cutoff": _POSITIVE,
    "full_scale": _POSITIVE,
    "scale": Key("scale"),
    "sensitivity": Key("scale"),
    "counts_per_turn": _POSITIVE,
    "rated_torque": _POSITIVE,
    "rated_current": _POSITIVE,
    "side": Key("choice", ("motor", "output")),
    "per": Key("choice", ("peak", "rms")),
    "form": Key("choice", ("accelerance", "mobility", "receptance")),
    "averages": Key("count"),
    "coherence": _TEXT,
    "joint": _TEXT,
    "site": _TEXT,
    "body": _TEXT,
    "point": Key("vector"),
    "axis": Key("vector"),
}


def check_structure(document: Table, file: Path) -> None:
    """Check every key, type, range and choice of a parsed ``campaign.toml``.

    Raises:
        CampaignError: The first break, as one line naming ``file``, the key, its value and the way out.
    """
    _check_table(document, TOP, file, "")
    _check_table(_table(document["rig"]), RIG, file, "rig")
    if "model" in document:
        _check_table(_table(document["model"]), MODEL, file, "model")
    for number, run in enumerate(_tables(document["run"])):
        where = run_key(run, number)
        _check_table(run, RUN, file, where)
        if "payload" in run:
            _check_table(_table(run["payload"]), PAYLOAD, file, f"{where}.payload")
        for index, stream in enumerate(_tables(run["stream"])):
            inside = f"{where}.stream[{index}]"
            _check_table(stream, STREAM, file, inside)
            for position, channel in enumerate(_tables(stream["channels"])):
                _check_table(channel, CHANNEL, file, f"{inside}.{channel_key(channel, position)}")


def run_key(run: Table, number: int) -> str:
    """How a message names a run: by its id, or its place where it has none."""
    return f"run[{run['id'] if isinstance(run.get('id'), str) else number}]"


def channel_key(channel: Table, position: int) -> str:
    """How a message names a channel: by its column, or its place where it has none."""
    return f"channels[{channel['column'] if isinstance(channel.get('column'), str) else position}]"


def _table(value: object) -> Table:
    assert isinstance(value, Mapping)
    return value


def _tables(value: object) -> list[Table]:
    assert isinstance(value, list)
    return value


def _check_table(table: Table, keys: Mapping[str, Key], file: Path, where: str) -> None:
    prefix = f"{where}." if where else ""
    for name, value in table.items():
        if name not in keys:
            raise CampaignError(
                file, prefix + name, "unknown key", value=_short(value), fix=_where_known(name, keys)
            )
        problem = _problem(keys[name], value)
        if problem:
            raise CampaignError(file, prefix + name, problem, value=_short(value))
    for name, key in keys.items():
        if key.required and name not in table:
            choices = f" ({' | '.join(key.choices)})" if key.choices else ""
            raise CampaignError(file, prefix + name, "missing", fix=f"it is required{choices}")


def _where_known(name: str, keys: Mapping[str, Key]) -> str:
    """Which table a key that is out of place belongs to; else what is known where it was found."""
    tables = {"[rig]": RIG, "[[run]]": RUN, "[[run.stream]]": STREAM, "a channel": CHANNEL}
    homes = [table for table, known in tables.items() if name in known]
    return f"it belongs to {' or '.join(homes)}" if homes else f"known here: {', '.join(keys)}"


def _short(value: object) -> object:
    if not isinstance(value, (list, dict)):
        return value
    try:
        return f"{len(value)} entries" if len(str(value)) > 80 else value
    except (RecursionError, ValueError):  # too deep, or too many digits, to be shown
        return f"{len(value)} entries"


def _is_number(value: object) -> bool:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return False
    try:
        return math.isfinite(value) and abs(value) <= EXTREME
    except OverflowError:  # a whole number beyond doubles
        return False


def _problem(key: Key, value: object) -> str:
    """What is wrong with ``value``, or an empty text."""
    if key.kind == "choice":
        return "" if value in key.choices else f"must be {_listed(key.choices)}"
    if key.kind == "holds":
        named = list(value.values()) if isinstance(value, dict) else [value]
        return (
            "" if all(v in key.choices for v in named) else f"must be {_listed(key.choices)}, or a table of them"
        )
    test, must = _KINDS[key.kind]
    if test(value):
        return ""
    size = abs(value) if isinstance(value, (int, float)) and not isinstance(value, bool) else 0
    extreme = 0 < size < 1.0 / EXTREME or EXTREME < size < math.inf
    return f"must be {must}{f', between {1.0 / EXTREME:g} and {EXTREME:g} in size' if extreme else ''}"


def _listed(choices: tuple[str, ...]) -> str:
    return " | ".join(repr(choice) for choice in choices)


def _is_vector(value: object, length: int) -> bool:
    return isinstance(value, list) and len(value) == length and all(map(_is_number, value))


_KINDS: Final[dict[str, tuple[Callable[[Any], bool], str]]] = {
    "text": (lambda v: isinstance(v, str), "a text in quotes"),
    "flag": (lambda v: isinstance(v, bool), "true or false"),
    "number": (_is_number, "a finite number"),
    "positive": (lambda v: _is_number(v) and v >= 1.0 / EXTREME, "a positive number"),
    "not-negative": (lambda v: _is_number(v) and v >= 0, "zero or a positive number"),
    "share": (lambda v: _is_number(v) and 1.0 / EXTREME <= v <= 1, "above 0 and at most 1"),
    "scale": (lambda v: _is_number(v) and abs(v) >= 1.0 / EXTREME, "a number other than zero"),
    "count": (lambda v: isinstance(v, int) and not isinstance(v, bool) and v > 0, "a positive whole number"),
    "pair": (lambda v: _is_vector(v, 2) and v[0] < v[1], "[t0, t1] in seconds with t0 < t1"),
    "vector": (lambda v: _is_vector(v, 3), "three numbers [x, y, z]"),
    "texts": (lambda v: isinstance(v, list) and bool(v) and all(isinstance(t, str) for t in v), "a list of names"),
    "table": (lambda v: isinstance(v, dict), "a table"),
    "tables": (
        lambda v: isinstance(v, list) and bool(v) and all(isinstance(t, dict) for t in v),
        "one or more tables",
    ),
    "numbers-by-name": (
        lambda v: isinstance(v, dict) and all(map(_is_number, v.values())),
        "a table of joint name = angle in rad",
    ),
    "start": (lambda v: _is_number(v) or v == "unknown", "seconds, or 'unknown'"),
}
