"""Say what physics a model of the joint left out: where, what it is, how large, how sure; or that it can't be told.

  jointscope diagnose bench-a --out out/diagnosis

The base model (two inertias, a linear elastic joint, viscous damping) is refitted to a part of the runs. What remains
is compared with every effect of the catalogue at every place where it can sit: friction, play, stiffness, hysteresis,
kinematic error, extra modes, gravity, outside disturbances, and faults of the recording itself such as delays, gains and
clipping. A candidate is named only where it is real, shows again on runs that were kept back, and matters.

The verdict is one of
  none      no mismatch beyond noise; parameters that were merely off are reported as such
  effects   up to three effects, each with parameters, intervals and a probability
  unknown   a mismatch that nothing in the catalogue explains, or that these recordings can't tell apart

DIR holds
  report.html      the answer on one page: what, where, how sure, what to do next, and the evidence plot by plot
                   (each figure also as PNG, its numbers as CSV)
  diagnosis.json   the answer, in full
  model.json       the model with the effects in it; jointscope predict runs it on new inputs
  augmented.xml    the same model in MJCF, effects.json what MJCF has no element for, base.xml the base alone;
                   jointscope confirm DIR runs the held-out experiments through them

Which runs are kept back: those with role = "validate"; without any, every third run of each experiment by level.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import Any


def configure(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument("campaign", type=Path, help="folder with campaign.toml")
    parser.add_argument("--out", type=Path, required=True, help="folder to write")
    parser.add_argument("--workers", type=int, default=None, help="threads (default: one per processor)")
    parser.add_argument("--json", action="store_true", help="print diagnosis.json instead of the summary")


def run(options: argparse.Namespace) -> int:
    """Diagnose; the exit code is 0 whatever the verdict."""
    import json
    import os
    from concurrent.futures import ThreadPoolExecutor

    from jointscope import __version__
    from jointscope.atomic import write_text
    from jointscope.diagnosis.answer import diagnosis_json, finite_or_none
    from jointscope.diagnosis.effects import catalogue
    from jointscope.diagnosis.model_file import model_json
    from jointscope.diagnosis.pipeline import diagnose
    from jointscope.diagnosis.predict import free_prediction, predict_outputs
    from jointscope.diagnosis.prepare import prepare
    from jointscope.experiments.diagnosis_report.report import Provenance, models_of, write_report
    from jointscope.models.effects import write_augmented
    from jointscope.recordings.reader import read_campaign

    started = time.monotonic()

    def report(stage: str) -> None:
        print(f"{time.monotonic() - started:6.1f} s  {stage}", file=sys.stderr, flush=True)

    report("reading and preparing")
    problem = prepare(read_campaign(options.campaign))
    with ThreadPoolExecutor(max_workers=options.workers or os.cpu_count() or 1) as pool:
        diagnosis = diagnose(problem, predict_outputs, catalogue(problem), pool, report=report)
        report("writing")
        answer = finite_or_none(diagnosis_json(diagnosis, free_prediction))
    theta, effects = diagnosis.decision.chosen.fit.coordinates.unpack(diagnosis.decision.chosen.fit.x)
    model = model_json(problem, theta, effects)
    alone = diagnosis.judgement.base.fit
    model["base_alone"] = model_json(problem, alone.coordinates.unpack(alone.x)[0], ())["base"]
    answer["campaign"] = Path(os.path.relpath(options.campaign, options.out)).as_posix()
    text = json.dumps(answer, indent=2, allow_nan=False) + "\n"
    write_text(options.out / "model.json", json.dumps(model, indent=2, allow_nan=False) + "\n")
    write_text(options.out / "diagnosis.json", text)
    report("drawing the report")
    came_from = Provenance(
        version=__version__,
        campaign=options.campaign,
        command=f"jointscope diagnose {options.campaign.resolve().name} --out {options.out.resolve().name}",
    )
    write_report(models_of(diagnosis), answer, free_prediction, options.out, came_from)
    write_augmented(model, options.out)
    print(text if options.json else summary(answer, options.out), end="")
    return 0


def summary(answer: dict[str, Any], out: Path) -> str:
    """The answer in a few lines."""
    lines = [f"verdict: {answer['verdict']} (probability {answer['verdict_probability']:.2f})"]
    if answer["unknown_reason"]:
        lines.append(f"  reason: {answer['unknown_reason']}")
        lines.extend("  candidate: " + " + ".join(names) for names in answer.get("candidates", []))
    for effect in answer["effects"]:
        lines.append(f"  {effect['effect']} at {effect['location']}, probability {effect['probability']:.2f}")
        lines.extend(f"    {name} = {_value(p)}" for name, p in effect["parameters"].items())
    lines.append("parameters:")
    lines.extend(f"  {name} = {_value(p)}" for name, p in answer["parameters"].items())
    for name, shift in answer["parameter_shift"].items():
        lines.append(
            f"  {name}: nameplate {shift['nameplate']:.6g}, fitted {shift['fitted']:.6g} +- {shift['sigma']:.2g}"
        )
    held = answer["held_out"]
    if held:
        lines.append(
            f"held-out runs ({len(held['runs'])}): relative error {held['base_error']:.4f} with the base model, "
            f"{held['augmented_error']:.4f} with the effects, noise floor {held['noise_floor']:.4f}"
        )
    else:
        lines.append(f"nothing was held out: {answer['held_out_reason']}")
    if answer["next_experiment"]:
        lines.append(f"record next: {answer['next_experiment']}")
    lines.append(f"written to {out}")
    return "\n".join(lines) + "\n"


def _value(parameter: dict[str, Any]) -> str:
    low, high = parameter["interval95"]
    if low is None or high is None:
        return f"{parameter['value']:.6g} {parameter['unit']} (95 %: not determined)"
    return f"{parameter['value']:.6g} {parameter['unit']} (95 %: {low:.6g} to {high:.6g})"
