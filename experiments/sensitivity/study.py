"""A sensitivity study as data: which parameters vary, how far, which outputs are watched, and how (``study.toml``)."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Literal, get_args

from jointscope.errors import InputError
from jointscope.models.parameters import Joint

FORMAT = "jointscope-sensitivity/1"
Method = Literal["local", "morris", "sobol"]
Engine = Literal["closed-form", "mujoco"]

PARAMETERS = tuple(field.name for field in fields(Joint))
OUTPUTS: dict[str, str] = {
    "antiresonance": "Hz",
    "resonance": "Hz",
    "hammer_peak": "m/s^2",
    "hammer_band_rms": "m/s^2",
    "sweep_peak": "m/s^2",
    "sweep_band_rms": "m/s^2",
    "prediction_error": "dB",
}


@dataclass(frozen=True, kw_only=True)
class Factor:
    """One varied parameter of the joint: uniform between ``lower`` and ``upper`` [SI, as in ``Joint``]."""

    name: str
    lower: float
    upper: float


@dataclass(frozen=True, kw_only=True)
class Study:
    """What to vary and what to watch.

    Attributes:
        samples: Base sample size N: Sobol makes N (k + 2) evaluations, Morris N trajectories of k + 1.
        engine: Closed form, or MuJoCo through the simulator's own stepping.
    """

    nominal: Joint
    factors: tuple[Factor, ...]
    outputs: tuple[str, ...] = tuple(OUTPUTS)
    method: Method = "sobol"
    samples: int = 1024
    seed: int = 0
    engine: Engine = "closed-form"


def _number(path: Path, key: str, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise InputError(path, key, "must be a number", value=value)
    return float(value)


def _factor(path: Path, name: str, table: object, nominal: Joint) -> Factor:
    key = f"parameters.{name}"
    if name not in PARAMETERS:
        raise InputError(path, key, "no such parameter", fix=f"choose among {', '.join(PARAMETERS)}")
    if not isinstance(table, dict):
        raise InputError(path, key, "must be a table", value=table, fix="write { relative = 0.2 }")
    unknown = set(table) - {"relative", "lower", "upper"}
    if unknown:
        raise InputError(path, f"{key}.{min(unknown)}", "unknown key", fix="use relative, or lower and upper")
    centre = float(getattr(nominal, name))
    if "relative" in table:
        share = _number(path, f"{key}.relative", table["relative"])
        if not 0.0 < share < 1.0:
            raise InputError(path, f"{key}.relative", "must lie between 0 and 1", value=share)
        if centre == 0.0:
            raise InputError(
                path, key, "the nominal value is 0, a relative range is empty", fix="give lower and upper"
            )
        return Factor(name=name, lower=centre * (1.0 - share), upper=centre * (1.0 + share))
    if set(table) != {"lower", "upper"}:
        raise InputError(path, key, "needs relative, or lower and upper")
    lower, upper = (_number(path, f"{key}.{end}", table[end]) for end in ("lower", "upper"))
    if not lower < upper:
        raise InputError(path, key, f"lower {lower:g} is not below upper {upper:g}")
    return Factor(name=name, lower=lower, upper=upper)


def read_study(path: Path, default: Joint) -> Study:
    """Read and validate ``study.toml``.

    Args:
        path: The file.
        default: The joint that ``[nominal]`` overrides key by key.

    Raises:
        InputError: Not TOML, an unknown key or value, or an empty range; the message names file, key and value.
    """
    try:
        with path.open("rb") as stream:
            table = tomllib.load(stream)
    except tomllib.TOMLDecodeError as problem:
        raise InputError(path, None, f"not TOML: {problem}") from None
    known = {"format", "method", "samples", "seed", "engine", "outputs", "nominal", "parameters"}
    for key in table:
        if key not in known:
            raise InputError(path, key, "unknown key", fix=f"known keys are {', '.join(sorted(known))}")
    if table.get("format") != FORMAT:
        raise InputError(
            path, "format", "not a sensitivity study", value=table.get("format"), fix=f"write {FORMAT!r}"
        )
    changes: dict[str, float] = {}
    for name, value in table.get("nominal", {}).items():
        if name not in PARAMETERS:
            raise InputError(
                path, f"nominal.{name}", "no such parameter", fix=f"choose among {', '.join(PARAMETERS)}"
            )
        changes[name] = _number(path, f"nominal.{name}", value)
    nominal = Joint(**{name: changes.get(name, float(getattr(default, name))) for name in PARAMETERS})
    factors = tuple(_factor(path, name, entry, nominal) for name, entry in table.get("parameters", {}).items())
    if not factors:
        raise InputError(path, "parameters", "nothing varies", fix="add [parameters.stiffness] relative = 0.2")
    for name in table.get("outputs", ()):
        if name not in OUTPUTS:
            raise InputError(
                path, "outputs", "no such output", value=name, fix=f"choose among {', '.join(OUTPUTS)}"
            )
    for key, choices in (("method", get_args(Method)), ("engine", get_args(Engine))):
        if table.get(key, choices[0]) not in choices:
            raise InputError(
                path, key, "no such choice", value=table[key], fix=f"choose among {', '.join(choices)}"
            )
    for key in ("samples", "seed"):
        value = table.get(key, 1)
        if isinstance(value, bool) or not isinstance(value, int) or value < 0:
            raise InputError(path, key, "must be a whole number, zero or more", value=value)
    if table.get("samples", 1024) < 2:
        raise InputError(path, "samples", "must be at least 2", value=table["samples"])
    return Study(
        nominal=nominal,
        factors=factors,
        outputs=tuple(table.get("outputs", OUTPUTS)),
        method=table.get("method", "sobol"),
        samples=table.get("samples", 1024),
        seed=table.get("seed", 0),
        engine=table.get("engine", "closed-form"),
    )
