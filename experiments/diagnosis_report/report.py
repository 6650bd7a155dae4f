"""The page itself, from the answer, the two models and where they came from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jointscope.atomic import write_text
from jointscope.experiments.diagnosis_report import tables
from jointscope.experiments.diagnosis_report.bars import error_bars, pairs, worst_sentence
from jointscope.experiments.diagnosis_report.drawing import joint_drawing, marks
from jointscope.experiments.diagnosis_report.evidence import evidence
from jointscope.experiments.diagnosis_report.traces import Models, Trace, gather
from jointscope.experiments.diagnosis_report.wording import (
    CALLED,
    figure,
    next_step,
    percent_fit,
    trade_unit,
    verdict_sentence,
)
from jointscope.experiments.own_model.sections import simulation_sections
from jointscope.experiments.page import FirstScreen, page
from jointscope.experiments.provenance import provenance_section

if TYPE_CHECKING:
    from jointscope.diagnosis.errors import Free
    from jointscope.diagnosis.pipeline import Diagnosis


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
    sliding = models.problem.rig.motion == "translational"
    sections = (
        *simulation_sections(answer),
        *evidence(models, traces, answer, folder),
        *tables.errors(answer),
        tables.ranking(answer, sliding=sliding),
        tables.parameters(answer),
        tables.shift(answer),
        *tables.findings(answer),
        *tables.menu(answer),
        *tables.not_seen(answer),
        provenance_section(provenance.campaign, provenance.command),
    )
    title = f"Diagnosis of {provenance.campaign.resolve().name}"
    path = folder / "report.html"
    write_text(path, page(title, first_screen(models, answer, traces), sections))
    return path


def first_screen(models: Models, answer: dict[str, Any], traces: Sequence[Trace]) -> FirstScreen:
    """What is wrong, where, how sure, what to do next; drawing and errors before and after beside each other."""
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
        silent="the place is not known" if answer["verdict"] == "unknown" else "",
    )
    sliding = rig.motion == "translational"
    compared = pairs(traces, corrected=bool(models.effects))
    verdict = verdict_sentence(answer, translational=sliding)
    if answer["unknown_reason"] == "outside-catalogue":
        verdict += worst_sentence(compared)
    return FirstScreen(
        verdict=verdict,
        facts=_facts(answer),
        next_step=next_step(answer, translational=sliding),
        markup=(drawing, error_bars(compared)),
    )


def _named(answer: dict[str, Any]) -> tuple[str, ...]:
    if answer["effects"]:
        return tuple(f"{e['effect']}@{e['location']}" for e in answer["effects"])
    return tuple(dict.fromkeys(name for names in answer.get("candidates") or [] for name in names))


def _facts(answer: dict[str, Any]) -> tuple[tuple[str, str], ...]:
    facts = [("probability of the verdict", f"{100.0 * answer['verdict_probability']:.0f} %")]
    stated = (answer.get("calibration") or {}).get("stated_probability")
    if stated is not None and abs(stated - answer["verdict_probability"]) > 0.1:
        facts.append(("before calibration", f"{100.0 * stated:.0f} %"))
    held = answer["held_out"]
    if held and held["base_error"] is not None:
        count = len(held["runs"])
        facts.append(
            (f"fit on {count} held-out run{'s' if count > 1 else ''}, base", percent_fit(held["base_error"]))
        )
        if answer["verdict"] != "none" and held["augmented_error"] not in (None, held["base_error"]):
            facts.append(("corrected", percent_fit(held["augmented_error"])))
        if held["noise_floor"] is not None:
            facts.append(("best possible (noise floor)", percent_fit(held["noise_floor"])))
    elif not held:
        facts.append(("held-out runs", f"none: {answer.get('held_out_reason')}"))
    stiffness = answer["parameters"].get("stiffness")
    if stiffness and stiffness["value"] is not None:
        other = trade_unit(stiffness["unit"])
        also = f" = {figure(stiffness['value'] * other[1], 4)} {other[0]}" if other else ""
        facts.append(("stiffness K", f"{figure(stiffness['value'], 5)} {stiffness['unit']}{also}"))
    return tuple(facts)
