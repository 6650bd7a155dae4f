"""Real recordings: every importable public set diagnosed as it is, in disguise, and with what was found taken out.

Each set becomes a campaign by its importer and is diagnosed by the command line in a process of its own, like any
campaign. Sets whose files are not there are reported as absent. Finished answers are kept, so an interrupted run goes on.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

from jointscope import __version__
from jointscope.atomic import write_text
from jointscope.experiments.prove import real_page
from jointscope.experiments.prove.diagnosing import Answer, claim, diagnose_all
from jointscope.experiments.prove.real_copies import COPIES, same_answer, without_friction
from jointscope.experiments.prove.real_sets import SETS, RealSet, checks, figure, named, value
from jointscope.recordings.importers import import_data_set
from jointscope.recordings.importers.importer import importer
from jointscope.recordings.reader import read_campaign
from jointscope.recordings.writer import write_campaign

CAMPAIGNS: Final = "campaigns"
CONTROL: Final = "control"
FORMAT: Final = "jointscope-real/1"


def prove_real(
    data: Path,
    out: Path,
    *,
    workers: int,
    limit: float,
    sets: Sequence[RealSet] = SETS,
    copies: Sequence[str] = tuple(COPIES),
) -> dict[str, Any]:
    """Diagnose the public sets below ``data``; the summary, also written into ``out``.

    Args:
        data: Folder with one folder per set, named as the importer is.
        out: ``real.json``, ``real.md``, ``real.png``, the campaigns and every answer.
        workers: Diagnoses at once.
        limit: Time for one diagnosis [s].
        sets: Which sets.
        copies: Which disguises, of ``COPIES``.

    Raises:
        InputError: ``out`` was begun with other recordings.
    """
    present = [asked for asked in sets if _present(asked, data)]
    claim(out, _fingerprint(present, data))
    folder = out / CAMPAIGNS
    for asked in present:
        _prepare(asked, data, folder, copies)
    names = [name for asked in present for name in (asked.name, *(f"{asked.name}.{c}" for c in copies))]
    answers = {a.case: a for a in diagnose_all(folder, out, names, workers=workers, limit=limit)}
    controls = [asked.name for asked in present if _control(asked, folder, answers[asked.name])]
    again = diagnose_all(folder, out, [f"{name}.{CONTROL}" for name in controls], workers=workers, limit=limit)
    answers.update({a.case: a for a in again})
    rows = [_row(asked, answers, folder, copies) if asked in present else _absent(asked) for asked in sets]
    summary: dict[str, Any] = {"format": FORMAT, "version": __version__, "sets": rows}
    write_text(out / "real.json", json.dumps(_plain(summary), indent=1, sort_keys=True, allow_nan=False) + "\n")
    real_page.picture(summary, out / "real.png")
    write_text(out / "real.md", real_page.page(summary))
    return summary


def _files(asked: RealSet, data: Path) -> list[Path]:
    return [data / asked.data_set / file for file in importer(asked.data_set).files]


def _present(asked: RealSet, data: Path) -> bool:
    return all(path.is_file() for path in _files(asked, data))


def _fingerprint(sets: Sequence[RealSet], data: Path) -> str:
    """SHA-256 over the sets' files: answers belong to these recordings."""
    total = hashlib.sha256()
    for path in sorted({path for asked in sets for path in _files(asked, data)}):
        total.update(hashlib.sha256(path.read_bytes()).digest())
    return total.hexdigest()


def _prepare(asked: RealSet, data: Path, folder: Path, copies: Sequence[str]) -> None:
    """The set's campaign and its disguised copies, those that are not there yet."""
    original = folder / asked.name
    if not original.is_dir():
        folder.mkdir(parents=True, exist_ok=True)
        import_data_set(asked.data_set, [data / asked.data_set], original, axis=asked.axis)
    for copy in copies:
        target = folder / f"{asked.name}.{copy}"
        if not target.is_dir():
            write_campaign(COPIES[copy](read_campaign(original)), target, file_format="npz")


def _control(asked: RealSet, folder: Path, answer: Answer) -> bool:
    """Write the copy without the friction that was named; whether there is one."""
    target = folder / f"{asked.name}.{CONTROL}"
    if target.is_dir():
        return True
    if answer.diagnosis is None:
        return False
    freed = without_friction(read_campaign(folder / asked.name), answer.diagnosis)
    if freed is None:
        return False
    write_campaign(freed, target, file_format="npz")
    return True


def _absent(asked: RealSet) -> dict[str, Any]:
    return {"set": asked.name, "base": asked.base, "status": "absent"}


def _row(asked: RealSet, answers: dict[str, Answer], folder: Path, copies: Sequence[str]) -> dict[str, Any]:
    """Everything that is said of one set."""
    answer = answers[asked.name]
    row: dict[str, Any] = {
        "set": asked.name,
        "base": asked.base,
        "status": answer.status,
        "seconds": answer.seconds,
    }
    if answer.diagnosis is None:
        return {**row, "message": answer.message}
    said = answer.diagnosis
    before, after = figure(said, asked.figure)
    row |= {
        "verdict": said["verdict"],
        "probability": said["verdict_probability"],
        "reason": said["unknown_reason"],
        "where": (said.get("where") or {}).get("location"),
        "effects": said["effects"],
        "parameters": said["parameters"],
        "findings": said.get("findings", []),
        "figure": {"what": asked.figure, "base": before, "answer": after},
        "position_error": (said.get("held_out") or {}).get("position_error"),
        "published": [
            {"what": p.what, "published": p.value, "here": value(said, p.key), "source": p.source}
            for p in asked.published
        ],
        "checks": [asdict(check) for check in checks(asked, said)],
        "copies": [_compared(name, said, answers[f"{asked.name}.{name}"], asked, folder) for name in copies],
        "control": None,
    }
    control = answers.get(f"{asked.name}.{CONTROL}")
    if control is not None:
        row["control"] = _described(control, asked)
        row["control"]["none"] = control.diagnosis is not None and control.diagnosis["verdict"] == "none"
    return row


def _described(answer: Answer, asked: RealSet) -> dict[str, Any]:
    if answer.diagnosis is None:
        return {"status": answer.status, "message": answer.message}
    before, after = figure(answer.diagnosis, asked.figure)
    return {
        "status": answer.status,
        "verdict": answer.diagnosis["verdict"],
        "effects": named(answer.diagnosis),
        "figure": {"base": before, "answer": after},
    }


def _compared(name: str, original: dict[str, Any], answer: Answer, asked: RealSet, folder: Path) -> dict[str, Any]:
    """A disguised copy beside the original."""
    found = {"copy": name, **_described(answer, asked), "same": False, "ratio": math.nan}
    if answer.diagnosis is not None:
        campaign = read_campaign(folder / asked.name)
        calibrated = all(c.calibrated for run in campaign.runs for s in run.streams for c in s.channels)
        found["same"], found["ratio"] = same_answer(original, answer.diagnosis, calibrated=calibrated)
    return found


def _plain(content: Any) -> Any:  # noqa: ANN401 - JSON is any
    """Numbers that are not finite as null, throughout."""
    if isinstance(content, dict):
        return {key: _plain(entry) for key, entry in content.items()}
    if isinstance(content, list | tuple):
        return [_plain(entry) for entry in content]
    if isinstance(content, float) and not math.isfinite(content):
        return None
    return content
