"""Say what physics a model of the joint left out: where, what it is, how large, how sure; or that it can't be told.

  jointscope diagnose bench-a --out out/diagnosis
  jointscope diagnose bench-a --model robot.xml --map map.toml --out out/diagnosis
  jointscope diagnose bench-a --simulated my-simulator-runs --out out/diagnosis

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

With --model your own MJCF or URDF is stepped unchanged on the runs' inputs and scored; its error is split into its own
numerics, its parameter values, physics it leaves out, and physics it holds that the recording contradicts (the report's
first table, and simulation in diagnosis.json). The map says which joint is which: jointscope model map --help writes it.
  patch/           a unified diff of your own files (patch -p1), and changes.csv with what each line is worth

With --simulated the outputs of any other simulator are scored, run by run: a campaign with the same runs, channels and
rates. What it behaves like is read from its outputs as from a recording; what its code does can't be told from them.

Which runs are kept back: those with role = "validate"; without any, every third run of each experiment by level.
"""

from __future__ import annotations

import argparse
import sys
import time
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from concurrent.futures import ThreadPoolExecutor

    from jointscope.diagnosis.pipeline import Diagnosis
    from jointscope.diagnosis.prepare import Problem
    from jointscope.recordings.campaign import Campaign

    Report = Callable[[str], None]
    Simulate = Callable[[Problem, dict[str, Any], dict[str, Any], ThreadPoolExecutor], dict[str, Any]]


def configure(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument("campaign", type=Path, help="folder with campaign.toml")
    parser.add_argument("--out", type=Path, required=True, help="folder to write")
    simulation = parser.add_mutually_exclusive_group()
    simulation.add_argument("--model", type=Path, metavar="XML", help="your own MJCF or URDF, scored and patched")
    simulation.add_argument(
        "--simulated", type=Path, metavar="SIM_CAMPAIGN", help="campaign of the same runs by any other simulator"
    )
    parser.add_argument("--map", type=Path, help="map.toml of --model (guessed without it)")
    parser.add_argument("--workers", type=int, default=None, help="threads (default: one per processor)")
    parser.add_argument("--json", action="store_true", help="print diagnosis.json instead of the summary")


@contextmanager
def _threads(count: int) -> Iterator[ThreadPoolExecutor]:
    """A pool that on an error or Ctrl-C drops what waits in it, instead of working it off first."""
    from concurrent.futures import ThreadPoolExecutor

    pool = ThreadPoolExecutor(max_workers=count)
    try:
        yield pool
    except BaseException:
        pool.shutdown(wait=False, cancel_futures=True)
        raise
    pool.shutdown()


def run(options: argparse.Namespace) -> int:
    """Diagnose; the exit code is 0 whatever the verdict."""
    import json
    import os

    from jointscope import __version__
    from jointscope.atomic import write_text
    from jointscope.diagnosis.answer import finite_or_none
    from jointscope.diagnosis.predict import free_prediction
    from jointscope.diagnosis.prepare import prepare
    from jointscope.errors import InputError
    from jointscope.experiments.diagnosis_report.report import Provenance, models_of, write_report
    from jointscope.models.effects import write_augmented
    from jointscope.recordings.reader import read_campaign

    started = time.monotonic()

    def report(stage: str) -> None:
        print(f"{time.monotonic() - started:6.1f} s  {stage}", file=sys.stderr, flush=True)

    report("reading and preparing")
    campaign = read_campaign(options.campaign)
    if options.map is not None and options.model is None:
        raise InputError(
            options.map, None, "a map belongs to a model", fix="give the model too: --model robot.xml"
        )
    if campaign.rig.topology == "arm":
        return _arm(options, campaign, report)
    simulate = _simulation(options, campaign, report)
    problem = prepare(campaign)
    workers = options.workers or os.cpu_count() or 1
    with _threads(workers) as pool:
        diagnosis, answer, model = _diagnosed(problem, pool, report)
        answer["campaign"] = Path(os.path.relpath(options.campaign, options.out)).as_posix()
        if simulate is not None:
            answer["simulation"] = finite_or_none(simulate(problem, answer, model, pool))
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


def _arm(options: argparse.Namespace, campaign: Campaign, report: Report) -> int:
    """Several joints: effects are named with theirs."""
    import json
    import os

    from jointscope.diagnosis.arm.written import arm_summary, write_arm_diagnosis
    from jointscope.errors import RefusedError

    if options.model is not None or options.simulated is not None:
        raise RefusedError("--model and --simulated take one joint's campaign; an arm's holds its model already")
    answer = write_arm_diagnosis(campaign, options.out, options.workers or os.cpu_count() or 1, report)
    print(json.dumps(answer, indent=2) + "\n" if options.json else arm_summary(answer, options.out), end="")
    return 0


def _diagnosed(
    problem: Problem, pool: ThreadPoolExecutor, report: Report
) -> tuple[Diagnosis, dict[str, Any], dict[str, Any]]:
    """A diagnosis, its ``diagnosis.json`` and its ``model.json``."""
    from jointscope.diagnosis.answer import diagnosis_json, finite_or_none
    from jointscope.diagnosis.effects import catalogue
    from jointscope.diagnosis.model_file import model_json
    from jointscope.diagnosis.pipeline import diagnose
    from jointscope.diagnosis.predict import free_prediction, predict_outputs

    diagnosis = diagnose(problem, predict_outputs, catalogue(problem), pool, report=report)
    report("writing")
    answer = finite_or_none(diagnosis_json(diagnosis, free_prediction))
    theta, effects = diagnosis.decision.chosen.fit.coordinates.unpack(diagnosis.decision.chosen.fit.x)
    model = model_json(problem, theta, effects)
    alone = diagnosis.judgement.base.fit
    model["base_alone"] = model_json(problem, alone.coordinates.unpack(alone.x)[0], ())["base"]
    return diagnosis, answer, model


def _simulation(options: argparse.Namespace, campaign: Campaign, report: Report) -> Simulate | None:
    """What compares the user's simulation with the diagnosis; its files are checked before anything is fitted."""
    if options.model is not None:
        from jointscope.experiments.own_model.files import write_patch
        from jointscope.experiments.own_model.mapping import own_joint
        from jointscope.experiments.own_model.study import simulation_json, study_own_model

        joint = own_joint(options.model, options.map, campaign)

        def with_model(
            problem: Problem, answer: dict[str, Any], model: dict[str, Any], pool: ThreadPoolExecutor
        ) -> dict[str, Any]:
            del problem, pool
            study = study_own_model(
                campaign, answer, model, options.model, joint, workers=options.workers or 2, report=report
            )
            write_patch(study, options.out)
            return simulation_json(study)

        return with_model
    if options.simulated is not None:
        import numpy as np

        from jointscope.diagnosis.prepare import prepare
        from jointscope.experiments.own_model.behaviour import (
            behaviour_json,
            compare_behaviour,
            read_simulated,
            score_outputs,
            with_noise_of,
        )

        simulated = read_simulated(options.simulated, campaign)

        def with_outputs(
            problem: Problem, answer: dict[str, Any], model: dict[str, Any], pool: ThreadPoolExecutor
        ) -> dict[str, Any]:
            scores = score_outputs(campaign, simulated, answer)
            report("reading what your simulation behaves like")
            _, other_answer, other_model = _diagnosed(
                prepare(with_noise_of(simulated, campaign, np.random.default_rng(0))), pool, report
            )
            del problem
            found = compare_behaviour(campaign, scores, (answer, model), (other_answer, other_model))
            return behaviour_json(found)

        return with_outputs
    return None


def summary(answer: dict[str, Any], out: Path) -> str:
    """The answer in a few lines."""
    from jointscope.diagnosis.errors import held_out_lines

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
        lines += held_out_lines(held)
    else:
        lines.append(f"nothing was held out: {answer['held_out_reason']}")
    lines.extend(f"found on the way: {finding}" for finding in answer.get("findings", []))
    lines += _simulation_lines(answer.get("simulation"))
    if answer["next_experiment"]:
        lines.append(f"record next: {answer['next_experiment']}")
    lines.append(f"written to {out}")
    return "\n".join(lines) + "\n"


def _simulation_lines(simulation: dict[str, Any] | None) -> list[str]:
    """The user's simulation in a few lines."""
    if simulation is None:
        return []
    which = "held-out" if simulation["held_out"] else "fitted"
    lines = [
        f"your simulation: relative error {simulation['error']:.4f} on {len(simulation['runs'])} {which} runs, of it"
    ]
    shown = {"numerics": "its own numerics", "parameters": "parameter values", "left_out": "physics left out",
             "contradicted": "physics it holds and the recording contradicts"}  # fmt: skip
    for key, name in shown.items():
        share = simulation["shares"].get(key)
        lines.append(f"  {name}: " + ("can't be told" if share is None else f"{share:.4f}"))
    if simulation.get("unsplit") is not None:
        lines.append(f"  not told apart: {simulation['unsplit']:.4f}")
    lines.append(f"  what remains: {simulation['remaining']:.4f}")
    changes = simulation.get("changes")
    if changes is not None:
        lines.append(
            f"  {len(changes)} changes in patch/" if changes else "  nothing to change: the patch is empty"
        )
        lines += [f"    {change['reason']} (alone: {change['gain_alone']:+.4f})" for change in changes]
    lines += [f"  note: {note}" for note in simulation["notes"]]
    return lines


def _value(parameter: dict[str, Any]) -> str:
    low, high = parameter["interval95"]
    if low is None or high is None:
        return f"{parameter['value']:.6g} {parameter['unit']} (95 %: not determined)"
    return f"{parameter['value']:.6g} {parameter['unit']} (95 %: {low:.6g} to {high:.6g})"
