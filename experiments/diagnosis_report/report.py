"""The page itself, from the answer, the two models and where they came from."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jointscope.atomic import write_text
from jointscope.experiments.diagnosis_report import figures
from jointscope.experiments.diagnosis_report.balance import balance
from jointscope.experiments.diagnosis_report.bars import error_bars, pairs
from jointscope.experiments.diagnosis_report.drawing import joint_drawing, marks
from jointscope.experiments.diagnosis_report.traces import Models, Trace, gather, telling
from jointscope.experiments.diagnosis_report.wording import (
    CALLED,
    called,
    figure,
    interval,
    next_step,
    trade_unit,
    verdict_sentence,
)
from jointscope.experiments.page import Picture, Section, Table, page

if TYPE_CHECKING:
    from jointscope.diagnosis.errors import Free
    from jointscope.diagnosis.pipeline import Diagnosis

RANKED = 10  # rows of the ranking that are shown; diagnosis.json holds more


@dataclass(frozen=True, kw_only=True)
class Provenance:
    """Where the answer comes from.

    Attributes:
        version: Of this program.
        campaign: Folder with campaign.toml.
        command: What was run, folders by name only.
    """

    version: str
    campaign: Path
    command: str


def models_of(diagnosis: Diagnosis) -> Models:
    """The two models of a diagnosis, with what they were fitted to."""
    base, chosen = diagnosis.judgement.base.fit, diagnosis.decision.chosen.fit
    theta, effects = chosen.coordinates.unpack(chosen.x)
    return Models(
        problem=diagnosis.problem,
        base_theta=base.coordinates.unpack(base.x)[0],
        theta=theta,
        effects=effects,
        noise=diagnosis.judgement.noise,
        held_out=diagnosis.split.held_out,
    )


def write_report(models: Models, answer: dict[str, Any], free: Free, folder: Path, provenance: Provenance) -> Path:
    """Write ``folder``/report.html and the PNG and CSV files of its figures.

    Args:
        models: What was compared.
        answer: ``diagnosis.json`` as plain data.
        free: Inputs-only prediction, as for the held-out errors of ``answer``.
    """
    traces = gather(models, free)
    effects = bool(models.effects)
    sections = (
        _first_screen(models, answer, traces, effects),
        *_evidence(models, traces, effects, folder),
        _ranking(answer, models),
        _parameters(answer),
        _shift(answer),
        _provenance(provenance),
    )
    title = f"Diagnosis of {provenance.campaign.resolve().name}"
    sentence = verdict_sentence(answer, translational=models.problem.rig.motion == "translational")
    path = folder / "report.html"
    write_text(path, page(title, sentence, sections))
    return path


def _named(answer: dict[str, Any]) -> tuple[str, ...]:
    if answer["effects"]:
        return tuple(f"{e['effect']}@{e['location']}" for e in answer["effects"])
    return tuple(dict.fromkeys(name for names in answer.get("candidates") or [] for name in names))


def _first_screen(models: Models, answer: dict[str, Any], traces: Sequence[Trace], effects: bool) -> Section:
    lit = marks(_named(answer), CALLED)
    where = answer["where"]
    if not lit and where and where.get("location"):
        lit = {where["location"]: "the residual's source"}
    rig = models.problem.rig
    drawing = joint_drawing(
        lit,
        topology=rig.topology,
        motion=rig.motion,
        spring=any(run.spring for run in models.problem.runs),
        sure=answer["verdict"] == "effects",
    )
    held = answer["held_out"]
    bars = error_bars(pairs(traces, corrected=effects))
    return Section(
        heading="Where, how sure, and what to do next",
        text=(next_step(answer),),
        markup=f'<div class="side"><div>{drawing}</div><div>{bars}</div></div>',
        notes=(
            "Fit: 100 % less the RMS error as a share of the RMS signal, mean over the output channels of the "
            + (
                f"held-out runs ({len(held['runs'])})"
                if held
                else f"fitted runs, as nothing was held out: {answer.get('held_out_reason')}"
            )
            + ", predicted from the inputs alone. Noise floor: the error of a perfect model"
            + (
                f", here {figure(100.0 * held['noise_floor'])} %."
                if held and held["noise_floor"] is not None
                else "."
            ),
        ),
    )


def _evidence(models: Models, traces: Sequence[Trace], effects: bool, folder: Path) -> list[Section]:
    shown = telling(traces)
    plots = [
        figures.time_and_band(trace, folder / f"residual-{experiment}.png", corrected=effects)
        for experiment, trace in shown.items()
    ]
    first = Section(
        heading="Recorded and predicted",
        pictures=_pictures(plots),
        notes=() if plots else ("No output was recorded.",),
    )
    sections = [first]
    if shown:
        plot = figures.against_frequency(shown, folder / "residual-frequency.png", corrected=effects)
        sections.append(Section(heading="Residual against frequency", pictures=_pictures([plot])))
    found = balance(models)
    heading = "Residual against speed and position"
    if isinstance(found, str):
        sections.append(Section(heading=heading, notes=(f"Not drawn. Missing: {found}.",)))
    else:
        plot = figures.against_motion(found, folder / "residual-motion.png")
        sections.append(Section(heading=heading, pictures=_pictures([plot])))
    heading = "Residual against hit level"
    if any(t.experiment == "hammer" for t in traces):
        plot = figures.against_level(traces, folder / "residual-level.png", corrected=effects)
        sections.append(Section(heading=heading, pictures=_pictures([plot])))
    else:
        sections.append(
            Section(heading=heading, notes=("Not drawn. Missing: hammer hits with a response channel.",))
        )
    return sections


def _pictures(plots: Sequence[figures.Plot]) -> tuple[Picture, ...]:
    return tuple(Picture(path=p.path, caption=p.caption) for p in plots)


def _ranking(answer: dict[str, Any], models: Models) -> Section:
    sliding = models.problem.rig.motion == "translational"
    rows = tuple(
        (
            " with ".join(called(name, translational=sliding) for name in row["effects"]) or "nothing is missing",
            ", ".join(row["effects"]) or "none",
            f"{row['probability']:.3f}",
            f"{row['score']:.1f}",
        )
        for row in answer["ranking"][:RANKED]
    )
    evidence = tuple(dict.fromkeys(e["evidence"] for e in answer["effects"] if e["evidence"]))
    return Section(
        heading="Candidates",
        text=evidence,
        table=Table(columns=("left out", "effect@location", "probability", "score [nats]"), rows=rows),
        notes=(
            "Score: evidence over the base model, held-out runs included; a set that fails a test stands below zero.",
        ),
    )


def _parameters(answer: dict[str, Any]) -> Section:
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
        rows.append((owner, name.replace("_", " "), figure(p["value"], 5), p["unit"], interval(p), also))
    held = answer["held_out"]
    return Section(
        heading="Parameters",
        text=(_residual_verdict(answer, held),),
        table=Table(
            columns=("of", "parameter", "value", "unit", "95 % interval", "in the trade's unit"), rows=tuple(rows)
        ),
        notes=("At the joint output. The intervals hold as far as the model does.",),
    )


def _residual_verdict(answer: dict[str, Any], held: dict[str, Any] | None) -> str:
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


def _shift(answer: dict[str, Any]) -> Section:
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


def _provenance(provenance: Provenance) -> Section:
    folder = provenance.campaign
    files = sorted(p for p in folder.rglob("*") if p.is_file() and not p.name.startswith("."))
    rows = tuple((p.relative_to(folder).as_posix(), _digest(p)) for p in files)
    return Section(
        heading="Provenance",
        text=(f"jointscope {provenance.version}; campaign {folder.resolve().name}; {provenance.command}",),
        table=Table(columns=("file", "SHA-256, first 16 digits"), rows=rows),
    )


def _digest(path: Path) -> str:
    with path.open("rb") as stream:
        return f"sha256:{hashlib.file_digest(stream, 'sha256').hexdigest()[:16]}"
