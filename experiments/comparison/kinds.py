"""How each kind of result file is seen as figures and statements, by the ``format`` that it states.

A key that a file lacks, or that holds ``null``, gives no figure: results of older versions can be compared with new
ones as far as both say the same thing.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from jointscope.experiments.comparison.result import Figure, Goal, Listing, Marks, Result, Sample, Statement

Content = Mapping[str, Any]


def _number(value: object) -> float | None:
    """A finite number, or ``None``."""
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        return None
    return float(value)


def _interval(ends: object) -> tuple[float, float] | None:
    if not isinstance(ends, (list, tuple)) or len(ends) != 2:
        return None
    low, high = (_number(end) for end in ends)
    return None if low is None or high is None else (min(low, high), max(low, high))


def _figure(
    name: str, unit: str, value: object, ends: object = None, goal: Goal | None = None
) -> Iterator[Figure]:
    number = _number(value)
    if number is not None:
        yield Figure(name=name, unit=unit, value=number, interval=_interval(ends), goal=goal)


def _estimates(table: Content, prefix: str = "") -> Iterator[Figure]:
    for name, entry in table.items():
        yield from _figure(
            f"{prefix}{name}", str(entry.get("unit", "")), entry.get("value"), entry.get("interval95")
        )


def _said(name: str, value: object) -> Iterator[Statement]:
    if value is not None:
        yield Statement(name=name, said=str(value))


def _findings(content: Content, key: str) -> Listing:
    """Entries of ``quality`` or ``findings``; plain texts stay as they are."""
    entries = []
    for entry in content.get(key) or ():
        if isinstance(entry, Mapping):
            where = " ".join(str(entry[part]) for part in ("run", "channel") if entry.get(part))
            entries.append(f"{entry.get('finding', '')}: {where}")
        else:
            entries.append(str(entry))
    return Listing(name="finding", entries=tuple(sorted(set(entries))))


# --- identification --------------------------------------------------------------------------------------------------


def identification(content: Content, file: Path) -> Result:
    """Parameters, modes, levels; what was refused and found."""
    figures = [*_estimates(content.get("parameters") or {})]
    for number, mode in enumerate(content.get("modes") or (), start=1):
        label = f"mode {number}"
        figures += _figure(f"{label} frequency", "Hz", mode.get("frequency_hz"), mode.get("frequency_interval95"))
        figures += _figure(
            f"{label} damping ratio", "1", mode.get("damping_ratio"), mode.get("damping_ratio_interval95")
        )
    for number, level in enumerate(content.get("levels") or (), start=1):
        label = f"level {number} of {len(content['levels'])}"
        figures += _figure(
            f"{label}, frequency", "Hz", level.get("frequency_hz"), level.get("frequency_interval95")
        )
        figures += _figure(
            f"{label}, damping ratio", "1", level.get("damping_ratio"), level.get("damping_ratio_interval95")
        )
    residual = content.get("residual") or {}
    return Result(
        kind="identification",
        file=file,
        figures=(*figures, *_figure("FRF error, log", "1", content.get("log_frf_error"), goal="less")),
        statements=(*_said("method", content.get("method")), *_said("residual", residual.get("verdict"))),
        listings=(
            _findings(content, "quality"),
            Listing(
                name="refused",
                entries=tuple(f"{row['parameter']}: {row['reason']}" for row in content.get("refused") or ()),
            ),
        ),
    )


# --- prediction ------------------------------------------------------------------------------------------------------


def prediction(content: Content, file: Path) -> Result:
    """Errors per run and channel, paired over the runs that both hold; level bias per band."""
    errors: dict[str, dict[str, float]] = {}
    levels: dict[str, dict[str, float]] = {}
    runs = content.get("runs") or {}
    closed = sum(bool(entry.get("closed_loop")) for entry in runs.values())
    for run, entry in runs.items():
        for column, channel in (entry.get("channels") or {}).items():
            error = _number(channel.get("error"))
            label = f"{channel.get('quantity', '')} {column}, {entry.get('experiment', '')}"
            if error is not None:
                errors.setdefault(f"error of {label}", {})[run] = error
            for band in channel.get("bands") or ():
                median = _number(band.get("median_error_db"))
                if median is not None:
                    name = f"level error of {label}, {band.get('low_hz'):g}-{band.get('high_hz'):g} Hz"
                    levels.setdefault(name, {})[run] = abs(median)
    means = (content.get("mean_error") or {}).items()
    return Result(
        kind="prediction",
        file=file,
        figures=tuple(
            figure
            for experiment, mean in means
            for figure in _figure(f"mean error, {experiment}", "1", mean, goal="less")
        ),
        samples=(
            *(Sample(name=name, unit="1", values=values, goal="less") for name, values in errors.items()),
            *(Sample(name=name, unit="dB", values=values, goal="less") for name, values in levels.items()),
        ),
        statements=tuple(_said("runs", f"{len(runs)}, {closed} of them in closed loop")),
    )


# --- diagnosis -------------------------------------------------------------------------------------------------------


def diagnosis(content: Content, file: Path) -> Result:
    """Verdict, effects with their sizes, base parameters, held-out errors."""
    effects = content.get("effects") or ()
    figures = [*_figure("probability of the verdict", "1", content.get("verdict_probability"))]
    for effect in effects:
        label = f"{effect['effect']}@{effect['location']}"
        figures += _figure(f"{label}, probability", "1", effect.get("probability"))
        figures += _estimates(effect.get("parameters") or {}, f"{label}, ")
    figures += _estimates(content.get("parameters") or {})
    held = content.get("held_out") or {}
    for key, label in (
        ("base_error", "base"),
        ("augmented_error", "with effects"),
        ("noise_floor", "noise floor"),
    ):
        goal: Goal | None = None if key == "noise_floor" else "less"
        figures += _figure(f"held-out error, {label}", "1", held.get(key), goal=goal)
    for model, label in (("base", "base"), ("augmented", "with effects")):
        for experiment, channels in (held.get("by_experiment", {}).get(model) or {}).items():
            for channel, error in channels.items():
                figures += _figure(f"held-out error, {label}, {experiment}, {channel}", "1", error, goal="less")
    where = content.get("where") or {}
    shift = content.get("parameter_shift") or {}
    return Result(
        kind="diagnosis",
        file=file,
        figures=tuple(figures),
        statements=(
            *_said("verdict", content.get("verdict")),
            *_said("why unknown", content.get("unknown_reason")),
            *_said("location", where.get("location")),
            *_said("held-out runs", ", ".join(held["runs"]) if held.get("runs") else content.get("held_out_reason")),
            *_said("next experiment", content.get("next_experiment")),
        ),
        listings=(
            Listing(name="effect", entries=tuple(f"{e['effect']}@{e['location']}" for e in effects)),
            Listing(name="parameter off its nameplate", entries=tuple(sorted(shift))),
            _findings(content, "findings"),
        ),
    )  # fmt: skip


def confirmation(content: Content, file: Path) -> Result:
    """The effect re-run in MuJoCo: errors per held-out run and channel, gain."""
    pairs: dict[str, dict[str, float]] = {}
    for row in content.get("channels") or ():
        for key, label in (("base_error", "base"), ("augmented_error", "with effects")):
            error = _number(row.get(key))
            if error is not None:
                pairs.setdefault(f"MuJoCo error, {label}", {})[f"{row['run']} {row['channel']}"] = error
    figures: list[Figure] = []
    for model, label in (("mujoco", "MuJoCo"), ("reduced_model", "reduced model")):
        figures += _figure(f"gain, {label}", "1", (content.get(model) or {}).get("gain"), goal="more")
    figures += _figure("gain ratio, MuJoCo to reduced model", "1", content.get("gain_ratio"))
    return Result(
        kind="confirmation",
        file=file,
        figures=tuple(figures),
        samples=tuple(Sample(name=name, unit="1", values=values, goal="less") for name, values in pairs.items()),
        statements=tuple(_said("confirmed", "yes" if content.get("confirmed") else "no")),
        listings=(Listing(name="effect", entries=tuple(content.get("effects") or ())),),
    )


# --- studies, proof, gates -------------------------------------------------------------------------------------------


def sensitivity(content: Content, file: Path) -> Result:
    """Indices with their intervals, the outputs' quantiles, and what was studied."""
    study = content.get("study") or {}
    unit = "1" if study.get("method") == "sobol" else "unit of the output"
    figures: list[Figure] = []
    for row in content.get("indices") or ():
        for key, label in (("total", "total"), ("first", "first order")):
            value, half = _number(row.get(key)), _number(row.get(f"{key}_interval"))
            ends = None if value is None or not half else (value - half, value + half)
            figures += _figure(f"{row['output']} by {row['factor']}, {label}", unit, value, ends)
    for output, quantiles in (content.get("quantiles") or {}).items():
        for key, value in quantiles.items():
            figures += _figure(f"{output}, {key.removeprefix('q').lstrip('0')} % quantile", "as studied", value)
    settings = ("method", "samples", "seed", "engine")
    return Result(
        kind="sensitivity study",
        file=file,
        figures=tuple(figures),
        statements=tuple(s for key in settings for s in _said(key, study.get(key))),
        listings=(
            Listing(
                name="range studied",
                entries=tuple(
                    f"{f['name']} {f['lower']:.6g} to {f['upper']:.6g}" for f in study.get("factors") or ()
                ),
            ),
        ),
    )


def proof(content: Content, file: Path) -> Result:
    """Every measure of the table, and right or wrong case by case."""
    figures: list[Figure] = []
    for row in content.get("table") or ():
        value = row.get("value")
        goal: Goal | None = "more" if row.get("upward") else "less"
        if isinstance(value, Mapping):
            ends = (value.get("low"), value.get("high"))
            figures += _figure(row["name"], "1", value.get("share"), ends, goal)
        else:
            figures += _figure(row["name"], str(row.get("unit", "")), value, goal=goal)
    seal = str(content.get("seal"))
    return Result(
        kind="proof",
        file=file,
        figures=tuple(figures),
        marks=(
            Marks(
                name="cases answered right as a whole",
                draw=f"{seal} {content.get('cases')}",
                wrong=frozenset(row["case"] for row in content.get("wrong") or ()),
                cases=int(content.get("cases") or 0),
            ),
        ),
        statements=(
            *_said("draw", f"{content.get('kind')}, seed {content.get('seed')}, seal {seal[:12]}"),
            *_said("cases", content.get("cases")),
        ),
        listings=(
            Listing(
                name="limit missed",
                entries=tuple(row["name"] for row in content.get("table") or () if row.get("reached") is False),
            ),
        ),
    )


def gates(content: Content, file: Path) -> Result:
    """The status of every claim, its figure and its margin."""
    rows = content.get("gates") or ()
    figures: list[Figure] = []
    for row in rows:
        figures += _figure(row["claim"], "of the claim", row.get("figure"))
        figures += _figure(f"{row['claim']}, margin", "share of the bound", row.get("margin"), goal="more")
    return Result(
        kind="gates",
        file=file,
        figures=tuple(figures),
        statements=(
            Statement(name="all gates", said="pass" if content.get("passed") else "do not pass"),
            *(Statement(name=f"gate: {row['claim']}", said=str(row["status"])) for row in rows),
        ),
    )


READERS: Final[Mapping[str, Callable[[Content, Path], Result]]] = {
    "jointscope-identification/1": identification,
    "jointscope-prediction/1": prediction,
    "jointscope-diagnosis/1": diagnosis,
    "jointscope-confirm/1": confirmation,
    "jointscope-sensitivity-result/1": sensitivity,
    "jointscope-proof/1": proof,
    "jointscope-gates-result/1": gates,
}
