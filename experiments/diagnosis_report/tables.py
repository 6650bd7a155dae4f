"""Tables of the answer: shares of the error, candidates, parameters, what could not be seen, what to record next."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from jointscope.experiments.diagnosis_report.wording import (
    called,
    field_name,
    figure,
    interval,
    trade_unit,
)
from jointscope.experiments.page import Section, Table

RANKED = 10  # rows of the ranking that are shown; diagnosis.json holds more


def ranking(answer: Mapping[str, Any], *, sliding: bool) -> Section:
    """Candidates with their probabilities."""
    rows = tuple(
        (
            " with ".join(called(name, translational=sliding) for name in row["effects"]) or "nothing is missing",
            ", ".join(row["effects"]) or "none",
            f"{row['probability']:.3f}",
            f"{row['score']:.1f}",
            "" if row.get("held_out_error") is None else f"{row['held_out_error']:.4f}",
        )
        for row in answer["ranking"][:RANKED]
    )
    calibration = answer.get("calibration") or {}
    inside = calibration.get("in_domain") if isinstance(calibration, Mapping) else None
    notes = [
        "Score: evidence over the base model, held-out runs included; a set that fails a test stands below zero."
    ]
    if calibration:
        notes.insert(
            0, "Probabilities among the candidates, before calibration; that of the verdict is calibrated."
        )
    if inside is False:
        notes.insert(
            0,
            "These recordings lie outside the range in which the probabilities were calibrated"
            f"{_because(calibration)}: read the order, not them.",
        )
    elif inside:
        notes.insert(0, "These recordings lie inside the range in which the probabilities were calibrated.")
    return Section(
        heading="Candidates",
        text=tuple(dict.fromkeys(e["evidence"] for e in answer["effects"] if e["evidence"])),
        table=Table(
            columns=("left out", "effect@location", "probability [-]", "score [nats]", "held-out error [-]"),
            rows=rows,
        ),
        notes=tuple(notes),
    )


def _because(calibration: Mapping[str, Any]) -> str:
    return f" ({calibration['reason']})" if calibration.get("reason") else ""


def parameters(answer: Mapping[str, Any]) -> Section:
    """Every parameter with unit, interval, the field's name and the trade's unit."""
    entries = [("joint", name, p) for name, p in answer["parameters"].items()]
    entries += [
        (f"{e['effect']}@{e['location']}", n, p) for e in answer["effects"] for n, p in e["parameters"].items()
    ]
    rows = []
    for owner, name, p in entries:
        other = trade_unit(p["unit"])
        also = ""
        if other and p["value"] is not None:
            also = f"{figure(p['value'] * other[1], 4)} {other[0]} ({interval(p, other[1])})"
        unit = "-" if p["unit"] == "1" else p["unit"]
        rows.append(
            (
                owner,
                name.replace("_", " "),
                field_name(owner, name),
                figure(p["value"], 5),
                unit,
                interval(p),
                also,
            )
        )
    return Section(
        heading="Parameters",
        text=(residual_verdict(answer),),
        table=Table(
            columns=("of", "parameter", "in the field", "value", "unit", "95 % interval", "in the trade's unit"),
            rows=tuple(rows),
        ),
        notes=("At the joint output. The intervals hold as far as the model does.",),
    )


def residual_verdict(answer: Mapping[str, Any]) -> str:
    """Whether the model describes what was held out to within its noise."""
    held = answer["held_out"]
    if not held or held["noise_floor"] in (None, 0.0) or held["augmented_error"] is None:
        return (
            "Residual: its noise floor is not known here, so whether the model is complete can't be told from it."
        )
    ratio = held["augmented_error"] / held["noise_floor"]
    if ratio < 1.5:
        return f"Residual: {figure(ratio)} times the noise floor; the model is complete to within the noise."
    return (
        f"Residual: {figure(ratio)} times the noise floor; something remains that this model does not describe, so trust "
        "the intervals below less than their width suggests."
    )


def shift(answer: Mapping[str, Any]) -> Section:
    """Nameplate values that the recordings contradict."""
    rows = tuple(
        (
            name.replace("_", " "),
            figure(s["nameplate"], 5),
            figure(s["fitted"], 5),
            figure(s["sigma"], 2),
            f"{100.0 * (s['fitted'] / s['nameplate'] - 1.0):+.1f} %" if s["nameplate"] else "",
        )
        for name, s in answer["parameter_shift"].items()
    )
    heading = "Nameplate against fit"
    if not rows:
        return Section(
            heading=heading, notes=("No rough value of the campaign is contradicted by more than three sigma.",)
        )
    return Section(
        heading=heading,
        text=("These values were off; the base model was refitted before anything was said to be missing.",),
        table=Table(columns=("parameter", "nameplate", "fitted", "sigma", "change"), rows=rows),
        notes=("In the units of the table above.",),
    )


def errors(answer: Mapping[str, Any]) -> list[Section]:
    """Held-out error per experiment and channel, before and after."""
    held = answer["held_out"]
    split = held.get("by_experiment") if held else None
    if not split:
        return []
    rows = []
    for experiment, channels in split["base"].items():
        for channel, before in channels.items():
            after = split["augmented"].get(experiment, {}).get(channel)
            rows.append((experiment, channel, *(_percent(v) for v in (before, after)), _fit(before), _fit(after)))
    return [
        Section(
            heading="Errors on the held-out runs",
            table=Table(
                columns=(
                    "experiment",
                    "channel",
                    "error, base",
                    "error, corrected",
                    "fit, base",
                    "fit, corrected",
                ),
                rows=tuple(rows),
            ),
            notes=("Error: RMS of the difference over RMS of the signal; fit: 100 % less the error.",),
        )
    ]


def _percent(value: float | None) -> str:
    return "silent" if value is None else f"{100.0 * value:.3g} %"


def _fit(value: float | None) -> str:
    return "silent" if value is None else f"{100.0 * (1.0 - value):.4g} %"


def findings(answer: Mapping[str, Any]) -> list[Section]:
    """What was found in the recordings on the way and put right, or taken for granted."""
    found = tuple(f"{finding[:1].upper()}{finding[1:]}." for finding in answer.get("findings", ()))
    return [Section(heading="What was found on the way", text=found)] if found else []


def not_seen(answer: Mapping[str, Any]) -> list[Section]:
    """The sizes that these recordings would have shown, of every effect that was not found."""
    found = answer.get("not_seen")
    if not found:
        return []
    rows = tuple(
        (
            called(f"{row['effect']}@{row['location']}"),
            field_name(f"{row['effect']}@{row['location']}", row["parameter"])
            or str(row["parameter"]).replace("_", " "),
            _size(row["size"], row["unit"]),
            str(row["sentence"] or row["reason"] or ""),
        )
        for row in found
    )
    return [
        Section(
            heading="What could not be seen",
            text=("Effects below these sizes would have gone unnoticed in these recordings; that none is named says nothing "
                  "about them.",),
            table=Table(columns=("effect", "in the field", "would show from", ""), rows=rows),
        )
    ]  # fmt: skip


def _size(size: float | None, unit: str) -> str:
    if size is None:
        return "at no size"
    other = trade_unit(unit)
    text = figure(size) + ("" if unit == "1" else f" {unit}")
    return text if other is None else f"{figure(size * other[1])} {other[0]} ({text})"


def menu(answer: Mapping[str, Any]) -> list[Section]:
    """Every recording that was considered as the next one, and what it would bring."""
    detail = answer.get("next_experiment_detail")
    if not detail:
        return []
    listed = detail.get("menu") if isinstance(detail, Mapping) else detail
    pair = detail.get("pair") if isinstance(detail, Mapping) else None
    between = " and ".join(" with ".join(names) or "nothing missing" for names in pair) if pair else ""
    return [
        Section(
            heading="What to record next",
            text=(f"To tell apart: {between}.",) if between else (),
            table=plain_table(listed),
            notes=("Each recording was simulated under either answer, with this campaign's own noise. expected gain: in the "
                   "probability of naming the right one; distance: between the two predicted recordings, in sigma.",),
        )
    ]  # fmt: skip


def plain_table(value: object) -> Table | None:
    """A table of plain data: a list of records, records by name, or figures by name."""
    if isinstance(value, Mapping):
        if value and all(isinstance(v, Mapping) and "value" not in v for v in value.values()):
            value = [{"": name, **entry} for name, entry in value.items()]
        else:
            rows = tuple((str(k).replace("_", " "), plain_text(v)) for k, v in value.items())
            return Table(columns=("", "value"), rows=rows) if rows else None
    if not isinstance(value, Sequence) or isinstance(value, str) or not value:
        return None
    if not all(isinstance(row, Mapping) for row in value):
        return Table(columns=("",), rows=tuple((plain_text(row),) for row in value))
    keys = list(dict.fromkeys(key for row in value for key in row))
    return Table(
        columns=tuple(str(key).replace("_", " ") for key in keys),
        rows=tuple(tuple(plain_text(row.get(key)) for key in keys) for row in value),
    )


def plain_text(value: object) -> str:
    """One cell."""
    if value is None:
        return "not known"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return figure(value, 4)
    if isinstance(value, Mapping):
        if "value" in value:
            unit = "" if value.get("unit") in (None, "1") else f" {value['unit']}"
            return f"{plain_text(value['value'])}{unit}"
        return "; ".join(f"{k} {plain_text(v)}" for k, v in value.items())
    if isinstance(value, Sequence) and not isinstance(value, str):
        return ", ".join(plain_text(v) for v in value)
    return str(value)
