"""The proof of a draw of arms: an effect is named right only with its place and its joint.

The same seal, the same processes and the same rule of opening once everything is answered as for one joint; the table is
the arm's own, since what single joints are compared with there (other ways of answering, rivals' strength) has no joints.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median
from typing import Any

from jointscope.atomic import write_text
from jointscope.experiments.prove import diagnosing
from jointscope.experiments.prove.diagnosing import Answer
from jointscope.experiments.prove.measures import wilson
from jointscope.sim.concealed.seal import SealError, folder_digest, open_seal, sealed_digest

MAIN = {
    "coulomb-friction": "torque", "stribeck-friction": "torque", "backlash": "gap", "torque-gain": "gain",
    "neighbour-flexibility": "frequency", "stiffness-nonlinearity": "cubic",
}  # fmt: skip
FAINT = 0.01  # relative change of what is read below which an effect is counted apart


@dataclass(frozen=True)
class JudgedArm:
    """One case: what was true, what was said.

    Attributes:
        truth, said: ``name@location:joint``, sorted; empty for nulls, and where no effect was named.
        faint: Whether the effect hardly changes what is read.
        error: Relative error of the main parameter where the effect was named right, else ``None``.
    """

    case: str
    verdict: str
    truth: tuple[str, ...]
    said: tuple[str, ...]
    faint: bool
    error: float | None
    seconds: float

    @property
    def exact(self) -> bool:
        """Name, place and joint right; of a null, that it was answered ``none``."""
        return self.verdict == "none" if not self.truth else self.said == self.truth

    @property
    def joint(self) -> bool:
        """The joint right, whatever the name."""
        return bool(self.said) and {s.rpartition(":")[2] for s in self.said} == {
            s.rpartition(":")[2] for s in self.truth
        }


def is_arm_draw(folder: Path) -> bool:
    """Whether ``folder`` is a draw of arms."""
    file = folder / "draw.json"
    return file.is_file() and json.loads(file.read_text(encoding="utf-8")).get("rig") == "six-axis"


def label(effect: Mapping[str, Any]) -> str:
    """``name@location:joint``."""
    return f"{effect['effect']}@{effect['location']}:{effect.get('joint') or ''}"


def judge_arm(truth: Mapping[str, Any], answer: Answer) -> JudgedArm:
    """Score one case."""
    said = answer.diagnosis or {}
    verdict = str(said.get("verdict", answer.status))
    named = list(said.get("effects", ())) if verdict == "effects" else []
    known = tuple(sorted(label(e) for e in truth["effects"]))
    error = None
    if len(named) == 1 and tuple(label(e) for e in named) == known:
        error = _error(truth["effects"][0], named[0]["parameters"])
    strength = truth["strength"] or {}
    return JudgedArm(
        case=truth["case"], verdict=verdict, truth=known, said=tuple(sorted(label(e) for e in named)),
        faint=bool(known) and strength.get("share", 1.0) < FAINT, error=error, seconds=answer.seconds,
    )  # fmt: skip


def _error(known: Mapping[str, Any], parameters: Mapping[str, Any]) -> float | None:
    name = MAIN.get(known["effect"], "")
    if name not in parameters or name not in known["values"]:
        return None
    true = float(known["values"][name])
    return abs(float(parameters[name]["value"]) / true - 1.0)


def prove_arms(folder: Path, out: Path, *, workers: int, limit: float, first: int | None) -> dict[str, Any]:
    """Diagnose the draw of arms in ``folder``, then open its seal and score; the summary, also written into ``out``.

    Args:
        folder: A finished draw.
        out: Results; an interrupted proof goes on from them.
        workers: Processes.
        limit: Time for one case [s].
        first: Only this many cases; ``None`` for all.

    Raises:
        SealError: The seal or a campaign was changed.
    """
    seal = sealed_digest(folder)
    diagnosing.claim(out, seal)
    names = diagnosing.cases_of(folder)[:first]
    answers = diagnosing.diagnose_all(folder, out, names, workers=workers, limit=limit)
    truths = open_seal(folder, seal)["cases"]
    judged = []
    for answer in answers:
        known = truths.get(answer.case)
        if known is None or folder_digest(folder / answer.case) != known["digest"]:
            raise SealError(folder / answer.case, None, "isn't the campaign that was sealed", fix="draw again")
        judged.append(judge_arm(known, answer))
    summary = {"seal": seal, "cases": len(judged), "table": arm_table(judged), "confusion": confusion(judged)}
    write_text(out / "summary.json", json.dumps(summary, indent=1, sort_keys=True) + "\n")
    write_text(out / "judged.json", json.dumps([asdict(j) for j in judged], indent=1) + "\n")
    write_text(out / "proof.md", page(summary, judged))
    return summary


def arm_table(judged: Sequence[JudgedArm]) -> list[dict[str, Any]]:
    """The measures, shares with their 95 % Wilson intervals."""
    nulls = [j for j in judged if not j.truth]
    plain = [j for j in judged if j.truth and not j.faint]
    faint = [j for j in judged if j.faint]

    def row(name: str, cases: Sequence[JudgedArm], right: Callable[[JudgedArm], bool]) -> dict[str, Any]:
        return {"name": name, **asdict(wilson(sum(map(right, cases)), len(cases)))}

    rows = [
        row("nulls answered none", nulls, lambda j: j.exact),
        row("nulls in which an effect was named", nulls, lambda j: bool(j.said)),
        row("effects named with place and joint", plain, lambda j: j.exact),
        row("joint right", plain, lambda j: j.joint),
        row("something else named", plain, lambda j: bool(j.said) and not j.exact),
        row("faint effects named with place and joint", faint, lambda j: j.exact),
        row("faint effects: something else named", faint, lambda j: bool(j.said) and not j.exact),
    ]
    errors = [j.error for j in judged if j.error is not None]
    seconds = [j.seconds for j in judged]
    rows.append({"name": "main parameter, median relative error", "value": median(errors) if errors else None})
    rows.append({"name": "wall time, median [s]", "value": median(seconds) if seconds else None})
    rows.append({"name": "wall time, worst [s]", "value": max(seconds, default=None)})
    return rows


def confusion(judged: Sequence[JudgedArm]) -> dict[str, dict[str, int]]:
    """How often what was true was answered by what; joints left out where they agree."""
    found: dict[str, Counter[str]] = {}
    for j in judged:
        true = " + ".join(t.rpartition(":")[0] for t in j.truth) or "nothing"
        said = " + ".join(s.rpartition(":")[0] for s in j.said) or j.verdict
        if j.said and j.truth and not j.joint:
            said += " at another joint"
        found.setdefault(true, Counter())[said] += 1
    return {true: dict(counts) for true, counts in sorted(found.items())}


def shown(row: Mapping[str, Any]) -> str:
    """A row's figure as text."""
    if "cases" in row:
        return f"{row['hits']} of {row['cases']} ({100 * row['low']:.0f} to {100 * row['high']:.0f} %)"
    return "none" if row["value"] is None else f"{row['value']:.3g}"


def page(summary: Mapping[str, Any], judged: Sequence[JudgedArm]) -> str:
    """``proof.md``."""
    lines = ["# Concealed effects of a six-axis arm", "", f"{summary['cases']} cases, seal {summary['seal']}.", ""]
    lines += ["| measure | found (95 % interval) |", "|---|---|"]
    lines += [f"| {row['name']} | {shown(row)} |" for row in summary["table"]]
    lines += ["", "| true | answered, number of cases |", "|---|---|"]
    for true, counts in summary["confusion"].items():
        lines.append(f"| {true} | " + ", ".join(f"{said}: {count}" for said, count in counts.items()) + " |")
    lines += ["", "| case | true | answered | time [s] |", "|---|---|---|---|"]
    for j in judged:
        said = ", ".join(j.said) or j.verdict
        lines.append(f"| {j.case} | {', '.join(j.truth) or 'nothing'} | {said} | {j.seconds:.0f} |")
    return "\n".join(lines) + "\n"
