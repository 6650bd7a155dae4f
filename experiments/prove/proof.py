"""The proof from one end to the other: seal checked, cases diagnosed, seal opened, answers scored, results written."""

from __future__ import annotations

import json
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

from jointscope import __version__
from jointscope.atomic import write_text
from jointscope.experiments.prove import baselines, diagnosing, leak, measures, page, pictures
from jointscope.experiments.prove.judging import Judged, judge
from jointscope.recordings.reader import read_campaign
from jointscope.sim.concealed import catalogue
from jointscope.sim.concealed.seal import SealError, folder_digest, open_seal, sealed_digest

OPENINGS = "openings.json"


def prove(
    folder: Path, out: Path, *, workers: int, limit: float, first: int | None, scheduler: str | None = None
) -> dict[str, Any]:
    """Diagnose the draw in ``folder``, then open its seal and score; the summary, also written into ``out``.

    Args:
        folder: A finished draw.
        out: Results; an interrupted proof goes on from them.
        workers: Processes.
        limit: Time for one case [s].
        scheduler: Address of a Dask scheduler, instead of local processes.
        first: Only this many cases, in the order of their names (which are random); ``None`` for all.

    Raises:
        SealError: The seal or a campaign was changed.
    """
    seal = sealed_digest(folder)
    diagnosing.claim(out, seal)
    names = diagnosing.cases_of(folder)[:first]
    answers = diagnosing.diagnose_all(folder, out, names, workers=workers, limit=limit, scheduler=scheduler)
    truth = open_seal(folder, seal)
    openings = _count_opening(folder, seal)
    judged = []
    for answer in answers:
        known = truth["cases"].get(answer.case)
        if known is None or folder_digest(folder / answer.case) != known["digest"]:
            raise SealError(folder / answer.case, None, "isn't the campaign that was sealed", fix="draw again")
        judged.append(judge(known, answer))
    summary = summarise(judged, truth["order"], seal, openings)
    summary["leak"] = _leak(folder, judged)
    summary["short"] = measures.as_json(measures.short_table(judged))
    summary["baselines"] = _baselines(folder, [truth["cases"][j.case] for j in judged])
    write_text(out / "summary.json", json.dumps(summary, indent=1, sort_keys=True) + "\n")
    write_text(out / "judged.json", json.dumps(measures.as_json(judged), indent=1) + "\n")
    write_text(out / "proof.md", page.page(summary))
    pictures.draw_all(summary, out)
    return summary


def _count_opening(folder: Path, seal: str) -> int:
    """How often this seal has been opened, this time included; kept beside it."""
    file = folder / OPENINGS
    held = json.loads(file.read_text(encoding="utf-8")) if file.is_file() else []
    held.append({"seal": seal, "version": __version__})
    write_text(file, json.dumps(held) + "\n")
    return sum(entry["seal"] == seal for entry in held)


def _baselines(folder: Path, truths: list[dict[str, Any]]) -> dict[str, Any]:
    """The same measures for simpler ways of answering, on the same cases."""
    labels = {f"{law.effect}@{law.location}" for law in catalogue.LISTED}
    always, regression = [], []
    for known in truths:
        nothing = {"verdict": "none", "effects": []}
        always.append(judge(known, diagnosing.Answer(known["case"], "answered", 0.0, nothing)))
        started = time.monotonic()
        said = baselines.sparse_regression(read_campaign(folder / known["case"]))
        seconds = time.monotonic() - started
        regression.append(judge(known, diagnosing.Answer(known["case"], "answered", seconds, said)))
    return {
        "chance": {"named": baselines.chance(len(labels))},
        "always none": measures.as_json(measures.short_table(always)),
        "sparse regression on the residual": measures.as_json(measures.short_table(regression)),
    }


def _leak(folder: Path, judged: list[Judged]) -> dict[str, Any] | None:
    """Whether the metadata tell nulls from the rest; needs enough of both."""
    concealed = [bool(j.truth) for j in judged]
    if min(sum(concealed), len(judged) - sum(concealed)) < 10:
        return None
    found = leak.probe_draw(folder, [j.case for j in judged], concealed)
    return {**asdict(found), "at_chance": found.at_chance}


def summarise(judged: list[Judged], order: dict[str, Any], seal: str, openings: int) -> dict[str, Any]:
    """Everything the page and the pictures need, as plain JSON."""
    rows = measures.table(judged)
    return {
        "format": "jointscope-proof/1",
        "version": __version__,
        "seal": seal,
        "openings": openings,
        "cases": len(judged),
        "seed": order["seed"],
        "draw": order["draw"],
        "kind": order["kind"],
        "table": [{**measures.as_json(row), "reached": row.reached} for row in rows],
        "law_gap": measures.as_json(measures.law_gap(judged)),
        "by_experiments": measures.as_json(measures.by_experiments(judged)),
        "confusion": {level: measures.confusion(judged, level) for level in ("name", "location", "family")},
        "reliability": measures.as_json(measures.reliability(judged)),
        "power_curve": measures.as_json(measures.power_curve(judged)),
        "wrong": [measures.as_json(j) for j in judged if not j.exact],
    }
