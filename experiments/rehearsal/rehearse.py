"""Every effect in turn concealed in a laboratory's own rehearsal, diagnosed blind: "on your recordings, would we see it?"

The campaign is diagnosed once for its parameters, its noise and the sizes that could not have been seen. Then, for every
effect, the same runs are simulated in MuJoCo by the concealed engine, whose laws share nothing with the explainer's, with
that effect at a few times the smallest visible size; and without any. Each is diagnosed in a process of its own.
"""

from __future__ import annotations

import json
import os
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from jointscope.atomic import write_text
from jointscope.errors import InputError
from jointscope.experiments.rehearsal.likeness import Likeness, likeness, rehearsed
from jointscope.progress import track
from jointscope.recordings.reader import read_campaign
from jointscope.recordings.writer import write_campaign

PLAN: Final = "plan.json"
CASES: Final = "cases"
NOTHING: Final = "nothing"
SIZE = 4.0  # times the smallest visible size


@dataclass(frozen=True)
class Case:
    """One rehearsal.

    Attributes:
        concealed: ``effect@location``, or ``nothing``.
        parameters: Of the concealed effect under the contract's names.
        said: The answer's names, or its verdict.
    """

    name: str
    concealed: str
    parameters: dict[str, float]
    said: tuple[str, ...]
    verdict: str
    probability: float | None
    status: str

    @property
    def right(self) -> bool:
        """Named exactly; or, where nothing was concealed, nothing was named."""
        if self.concealed == NOTHING:
            return self.verdict == "none"
        return self.said == (self.concealed,)

    @property
    def answer(self) -> str:
        """In one word for the table."""
        if self.status != "answered":
            return "failed"
        return " + ".join(self.said) if self.verdict == "effects" else self.verdict


def rehearse(
    campaign: Path, out: Path, *, effects: Sequence[str] | None, repeats: int, seed: int, workers: int, limit: float,
    size: float = SIZE,
) -> dict[str, Any]:  # fmt: skip
    """Rehearse and diagnose; the summary, also written into ``out``. Finished cases are kept when it is run again.

    Args:
        campaign: Folder with campaign.toml.
        effects: Names, or ``effect@location``, to conceal; ``None`` for all that these recordings can hold.
        repeats: Rehearsals of each, with noise of their own.
        workers: Processes.
        limit: Time for one diagnosis [s].
        size: Concealed size over the smallest visible one.

    Raises:
        InputError: No effect of ``effects`` fits, or ``out`` was begun with other words.
    """
    from jointscope.experiments.prove.diagnosing import diagnose_all

    out.mkdir(parents=True, exist_ok=True)
    asked = {"effects": sorted(effects) if effects else None, "repeats": repeats, "seed": seed, "size": size}
    plan = _plan(campaign, out, asked)
    names = list(plan["cases"])
    answers = diagnose_all(out / CASES, out, names, workers=workers, limit=limit)
    found = []
    for answer in answers:
        said = answer.diagnosis or {}
        named = tuple(sorted(f"{e['effect']}@{e['location']}" for e in said.get("effects", ())))
        known = plan["cases"][answer.case]
        probability = said.get("verdict_probability")
        found.append(
            Case(
                answer.case, known["concealed"], known["parameters"], named, str(said.get("verdict", answer.status)),
                None if probability is None else float(probability), answer.status,
            )
        )  # fmt: skip
    summary = summarise(found, plan)
    write_text(out / "rehearsal.json", json.dumps(summary, indent=1) + "\n")
    return summary


def _plan(campaign: Path, out: Path, asked: dict[str, Any]) -> dict[str, Any]:
    """The cases, simulated and written; kept in ``out`` so that an interruption costs nothing twice."""
    file = out / PLAN
    if file.is_file():
        held: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
        if held["asked"] != asked:
            raise InputError(file, "asked", "this folder was begun with other words", value=held["asked"],
                             fix="choose another --out")  # fmt: skip
        return held
    like, concealed = _chosen(campaign, asked)
    todo = [(label, effect, k) for label, effect in concealed for k in range(asked["repeats"])]
    rng = np.random.default_rng([asked["seed"], 7])
    codes = [f"{int(v) >> 24:010x}" for v in rng.integers(0, 2**63, size=len(todo), dtype=np.uint64)]
    cases: dict[str, Any] = {}
    failed: list[str] = []
    for (label, effect, k), code in track(list(zip(todo, codes, strict=True)), "rehearsing", len(todo)):
        folder = out / CASES / code
        try:
            taken = rehearsed(like, () if effect is None else (effect,), asked["seed"] * 1000 + k + len(cases))
        except FloatingPointError:
            failed.append(f"{label}: the simulation diverged at this size")
            continue
        if not folder.is_dir():
            folder.parent.mkdir(parents=True, exist_ok=True)
            write_campaign(taken, folder, file_format="npz")
        cases[code] = {
            "concealed": label,
            "parameters": {} if effect is None else effect.reported(like.setting),
        }
    plan = {"asked": asked, "cases": cases, "left_out": [*like.left_out, *failed]}
    write_text(file, json.dumps(plan, indent=1) + "\n")
    return plan


def _chosen(campaign: Path, asked: dict[str, Any]) -> tuple[Likeness, list[tuple[str, Any]]]:
    """The likeness, and each effect to conceal with its label (``None`` for nothing), at the asked size."""
    from jointscope.diagnosis.effects import catalogue
    from jointscope.diagnosis.pipeline import diagnose
    from jointscope.diagnosis.power import unseen
    from jointscope.diagnosis.predict import predict_outputs
    from jointscope.diagnosis.prepare import prepare
    from jointscope.experiments.rehearsal.sizing import sized
    from jointscope.sim.concealed import catalogue as concealed
    from jointscope.sim.concealed.law import Effect, log_between

    recorded = read_campaign(campaign)
    problem = prepare(recorded)
    specs = catalogue(problem)
    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        diagnosis = diagnose(problem, predict_outputs, specs, pool)
        base = diagnosis.judgement.base
        stated = unseen(problem, diagnosis.judgement, base, specs, pool)
    chosen = diagnosis.decision.chosen.fit
    theta, _ = chosen.coordinates.unpack(chosen.x)
    like = likeness(recorded, problem, theta, diagnosis.judgement.noise, asked["seed"])
    sizes = {(u.effect, u.location): u for u in stated}
    wanted = asked["effects"]
    found: list[tuple[str, Effect | None]] = [(NOTHING, None)]
    labels: set[str] = set()
    for law in concealed.laws("development"):
        label = f"{law.effect}@{law.location}"
        if law.departs or label in labels or not law.applies(like.setting):
            continue
        if wanted and not {label, law.effect} & set(wanted):
            continue
        said = sizes.get((law.effect, law.location))
        if said is None or said.reason is not None:
            continue
        labels.add(label)
        rng = np.random.default_rng([asked["seed"], len(labels)])
        effect = sized(law, like.setting, said, asked["size"], rng) if said.size is not None else None
        if effect is None:
            low, high = law.span(like.setting)
            effect = Effect(law, law.shape(like.setting, rng)).scaled(log_between(low, high, 0.5))
        found.append((label, effect))
    if wanted and len(found) == 1:
        raise InputError(
            campaign, None, f"none of {', '.join(wanted)} can be concealed in these recordings",
            fix="leave --effects out to see which can",
        )  # fmt: skip
    return like, found


def summarise(found: Sequence[Case], plan: dict[str, Any]) -> dict[str, Any]:
    """The confusion table, shares right with Wilson intervals, and every case."""
    from jointscope.experiments.prove.measures import wilson

    table: dict[str, Counter[str]] = {}
    for case in found:
        table.setdefault(case.concealed, Counter())[case.answer] += 1
    listed = [c for c in found if c.concealed != NOTHING]
    nothing = [c for c in found if c.concealed == NOTHING]
    return {
        "asked": plan["asked"],
        "confusion": {true: dict(sorted(row.items())) for true, row in table.items()},
        "named": asdict(wilson(sum(c.right for c in listed), len(listed))),
        "noticed": asdict(wilson(sum(c.verdict in ("effects", "unknown") for c in listed), len(listed))),
        "false_alarms": asdict(wilson(sum(c.verdict == "effects" for c in nothing), len(nothing))),
        "left_out": plan["left_out"],
        "cases": [{**asdict(c), "right": c.right} for c in found],
    }
