"""The proof from one end to the other: seal checked, cases diagnosed, seal opened, answers scored, results written."""

from __future__ import annotations

import hashlib
import json
import subprocess
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

from jointscope import __version__
from jointscope.atomic import write_text
from jointscope.experiments.prove import baselines, diagnosing, draws, leak, measures, page, pictures
from jointscope.experiments.prove.diagnosing import Answer
from jointscope.experiments.prove.failures import failures
from jointscope.experiments.prove.judging import Judged, judge
from jointscope.experiments.prove.table import table
from jointscope.recordings.reader import read_campaign
from jointscope.sim.concealed import catalogue
from jointscope.sim.concealed.seal import SealError, folder_digest, open_seal, sealed_digest

OPENINGS: Final = "openings.json"
SUMMARY: Final = "summary.json"


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
    openings = _count_opening(folder, seal, answers)
    truths = truth["cases"]
    judged = []
    for answer in answers:
        known = truths.get(answer.case)
        if known is None or folder_digest(folder / answer.case) != known["digest"]:
            raise SealError(folder / answer.case, None, "isn't the campaign that was sealed", fix="draw again")
        judged.append(judge(known, answer))
    summary = summarise(judged, truth["order"], seal, openings)
    summary["failures"] = measures.as_json(failures(judged, {a.case: a.diagnosis for a in answers}, truths))
    summary["leak"] = _leak(folder, judged)
    summary["baselines"], others = _baselines(folder, [truths[j.case] for j in judged])
    summary["power_curve"]["sparse regression: name and location"] = measures.as_json(measures.power_curve(others))
    write_text(out / SUMMARY, json.dumps(summary, indent=1, sort_keys=True) + "\n")
    write_text(out / "judged.json", json.dumps(measures.as_json(judged), indent=1) + "\n")
    write_text(out / "proof.md", page.page(summary))
    pictures.draw_all(summary, out)
    return summary


def saved(folder: Path, out: Path) -> dict[str, Any] | None:
    """The summary in ``out``, if it is of the draw in ``folder``: reading it opens nothing."""
    if not (out / SUMMARY).is_file():
        return None
    summary: dict[str, Any] = json.loads((out / SUMMARY).read_text(encoding="utf-8"))
    return summary if summary["seal"] == sealed_digest(folder) else None


def publish(summary: Mapping[str, Any], file: Path) -> None:
    """Write the page ``file`` with its pictures, its summary and its counts in a folder of the same name beside it."""
    beside = file.with_suffix("")
    pictures.draw_all(summary, beside)
    write_text(beside / SUMMARY, json.dumps(summary, indent=1, sort_keys=True) + "\n")
    draws.record(summary, beside)
    write_text(file, page.page(summary, f"{beside.name}/"))


def _count_opening(folder: Path, seal: str, answers: Sequence[Answer]) -> dict[str, int]:
    """How often this seal has been opened, and on how many sets of answers, this time included; kept beside it."""
    file = folder / OPENINGS
    held = json.loads(file.read_text(encoding="utf-8")) if file.is_file() else []
    kept = json.dumps([[a.case, a.status, a.diagnosis] for a in answers], sort_keys=True)
    digest = hashlib.sha256(kept.encode()).hexdigest()
    held.append({"seal": seal, "version": __version__, "commit": commit(), "answers": digest})
    write_text(file, json.dumps(held, indent=1) + "\n")
    mine = [entry for entry in held if entry["seal"] == seal]
    return {"times": len(mine), "answers": len({entry.get("answers") for entry in mine})}


def commit() -> str:
    """The source's commit, marked where it was changed since; ``unknown`` outside a repository."""
    root = Path(__file__).resolve().parents[2]
    try:
        words = ["git", "-C", str(root), "describe", "--always", "--abbrev=40", "--dirty=-changed", "--exclude=*"]
        done = subprocess.run(words, capture_output=True, text=True, timeout=20.0, check=True)
    except (OSError, subprocess.SubprocessError):
        return "unknown"
    return done.stdout.strip()


def _baselines(folder: Path, truths: Sequence[Mapping[str, Any]]) -> tuple[dict[str, Any], list[Judged]]:
    """The same measures for simpler ways of answering, on the same cases; and sparse regression case by case."""
    labels = {f"{law.effect}@{law.location}" for law in catalogue.LISTED}
    by_way: dict[str, list[Judged]] = {"always none": [], **{way: [] for way in baselines.WAYS}}
    for known in truths:
        started = time.monotonic()
        said = {
            "always none": {"verdict": "none", "effects": []},
            **baselines.answers(read_campaign(folder / known["case"])),
        }
        seconds = time.monotonic() - started
        for way, answer in said.items():
            by_way[way].append(judge(known, Answer(known["case"], "answered", seconds, answer)))
    found: dict[str, Any] = {way: measures.as_json(measures.short_table(judged)) for way, judged in by_way.items()}
    return {"chance": {"named": baselines.chance(len(labels))}, **found}, by_way[baselines.SPARSE]


def _leak(folder: Path, judged: Sequence[Judged]) -> dict[str, Any] | None:
    """Whether the metadata tell nulls from the rest; needs enough of both."""
    concealed = [bool(j.truth) for j in judged]
    if min(sum(concealed), len(judged) - sum(concealed)) < 10:
        return None
    found = leak.probe_draw(folder, [j.case for j in judged], concealed)
    return {name: {**asdict(one), "at_chance": one.at_chance} for name, one in found.items()}


def summarise(
    judged: Sequence[Judged], order: Mapping[str, Any], seal: str, openings: Mapping[str, int]
) -> dict[str, Any]:
    """Everything the page and the pictures need of the answers, as plain JSON."""
    curves = {
        "name and location": measures.power_curve(judged),
        "location": measures.power_curve(judged, lambda j: bool(j.location)),
    }
    summary = {
        "format": "jointscope-proof/2",
        "version": __version__,
        "commit": commit(),
        "seal": seal,
        "openings": dict(openings),
        "cases": len(judged),
        "kinds": Counter(j.kind for j in judged),
        "bands": Counter(j.band for j in judged if j.band != "null"),
        "seed": order["seed"],
        "draw": order["draw"],
        "engine": order.get("engine", "mujoco"),
        "kind": order["kind"],
        "table": [{**asdict(row), "reached": row.reached} for row in table(judged)],
        "law_gap": measures.law_gap(judged),
        "by_experiments": measures.by_experiments(judged),
        "confusion": {level: measures.confusion(judged, level) for level in pictures.LEVELS},
        "reliability": measures.reliability(judged),
        "power_curve": curves,
        "short": measures.short_table(judged),
    }
    plain: dict[str, Any] = measures.as_json(summary)
    return plain
