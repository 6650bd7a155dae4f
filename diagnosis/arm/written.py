"""An arm's diagnosis on disk: ``diagnosis.json`` and ``model.json``, and the answer in a few lines."""

from __future__ import annotations

import json
import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from jointscope.atomic import write_text
from jointscope.diagnosis.arm.answer import arm_answer
from jointscope.diagnosis.arm.law import split_location
from jointscope.diagnosis.arm.pipeline import diagnose_arm
from jointscope.diagnosis.arm.prepare import prepare_arm
from jointscope.diagnosis.errors import held_out_lines
from jointscope.recordings.campaign import Campaign

if TYPE_CHECKING:
    from jointscope.diagnosis.arm.problem import ArmProblem
    from jointscope.diagnosis.pipeline import Diagnosis
    from jointscope.diagnosis.rounds import Report

FORMAT = "jointscope-arm-diagnosed/1"


def write_arm_diagnosis(campaign: Campaign, out: Path, workers: int, report: Report) -> dict[str, Any]:
    """Diagnose an arm's campaign and write the answer into ``out``; the answer.

    Raises:
        RefusedError: The campaign lacks its geometry, or holds no run that an arm's model can predict.
    """
    problem = prepare_arm(campaign)
    with ThreadPoolExecutor(max_workers=workers) as pool:
        diagnosis = diagnose_arm(problem, pool, report=report)
        report("writing")
        answer = arm_answer(diagnosis)
    answer["campaign"] = Path(os.path.relpath(campaign.path, out)).as_posix()
    write_text(out / "model.json", json.dumps(_model(problem, diagnosis), indent=2, allow_nan=False) + "\n")
    write_text(out / "diagnosis.json", json.dumps(answer, indent=2, allow_nan=False) + "\n")
    return answer


def _model(problem: ArmProblem, diagnosis: Diagnosis) -> dict[str, Any]:
    """Base parameters by name and the effects with their joints, as the reduced model takes them."""
    fit = diagnosis.decision.chosen.fit
    theta, effects = fit.coordinates.unpack(fit.x)
    return {
        "format": FORMAT,
        "joints": list(problem.facts.joints),
        "rigid": [j for j, spring in zip(problem.facts.joints, problem.facts.elastic & problem.seen, strict=True) if not spring],
        "base": {name: float(value) for name, value in zip(problem.base.names, theta, strict=True)},
        "effects": [
            {
                "effect": e.spec.name,
                "location": split_location(e.spec.location)[0],
                "joint": split_location(e.spec.location)[1],
                "law": e.spec.variant,
                "parameters": {p.name: v for p, v in zip(e.spec.parameters, e.values, strict=True)},
            }
            for e in effects
        ],
    }  # fmt: skip


def arm_summary(answer: dict[str, Any], out: Path) -> str:
    """The answer in a few lines."""
    lines = [f"verdict: {answer['verdict']} (probability {answer['verdict_probability']:.2f})"]
    if answer["unknown_reason"]:
        lines.append(f"  reason: {answer['unknown_reason']}")
    for names, joints in zip(answer.get("candidates", ()), answer.get("candidate_joints", ()), strict=True):
        lines.append("  candidate: " + " + ".join(f"{n} of {j}" for n, j in zip(names, joints, strict=True)))
    for effect in answer["effects"]:
        of = f" of {effect['joint']}" if effect["joint"] else ""
        lines.append(
            f"  {effect['effect']} at the {effect['location']}{of}, probability {effect['probability']:.2f}"
        )
        lines.extend(f"    {name} = {_value(p)}" for name, p in effect["parameters"].items())
    for joint, found in answer["joints"].items():
        lines.extend(f"  {joint} {name} = {_value(p)}" for name, p in found["parameters"].items())
        if not found["moved_by_these_recordings"]:
            lines.append(f"  {joint}: not moved by these recordings, nothing can be said of it")
    held = answer["held_out"]
    if held:
        lines += held_out_lines(held)
    else:
        lines.append(f"nothing was held out: {answer['held_out_reason']}")
    lines.append(f"written to {out}")
    return "\n".join(lines) + "\n"


def _value(parameter: dict[str, Any]) -> str:
    low, high = cast("tuple[float | None, float | None]", tuple(parameter["interval95"]))
    if low is None or high is None:
        return f"{parameter['value']:.6g} {parameter['unit']} (95 %: not determined)"
    return f"{parameter['value']:.6g} {parameter['unit']} (95 %: {low:.6g} to {high:.6g})"
