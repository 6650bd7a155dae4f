"""A campaign made ready for fitting: what is driven, what is compared, which parameters are free, and where they start.

Nothing is read from titles, notes, ids, file or column names, or from the order of runs.
"""

from __future__ import annotations

from dataclasses import replace

from jointscope.diagnosis.drive_angle import DriveLaw, drive_law
from jointscope.diagnosis.inputs import torque_logs
from jointscope.diagnosis.parameters import base_spec
from jointscope.diagnosis.prescribed_path import INVERSE_CORNER
from jointscope.diagnosis.problem import BaseSpec, Observed, Output, PreparedRun, Problem, Scales
from jointscope.diagnosis.run_preparation import DRIFT_CORNER, prepare_run, without_outputs
from jointscope.diagnosis.sizes import unit_scales
from jointscope.diagnosis.starts import finished
from jointscope.errors import RefusedError
from jointscope.recordings.campaign import Campaign
from jointscope.recordings.wild import tamed
from jointscope.recordings.zeroed import zeroed

__all__ = [
    "DRIFT_CORNER",
    "INVERSE_CORNER",
    "BaseSpec",
    "Observed",
    "Output",
    "PreparedRun",
    "Problem",
    "Scales",
    "prepare",
    "prepare_inputs",
]


def prepare(campaign: Campaign) -> Problem:
    """Read a campaign as a problem of estimation.

    Raises:
        RefusedError: The rig has several joints, or no run holds both an input and an output in time.
    """
    if campaign.rig.topology == "arm":
        raise RefusedError(
            f"{campaign.path}: topology = 'arm': diagnosis needs one joint's runs; export them as a two-inertia campaign"
        )
    campaign, wild = tamed(campaign)
    campaign, offsets = zeroed(campaign)
    runs = _prepared(campaign, None)
    if not runs:
        raise RefusedError(
            f"{campaign.path}: no run holds an input and an output in time; record a force, torque or speed command "
            "together with an acceleration, speed or angle"
        )
    problem = finished(campaign, runs)
    law = drive_law(problem)
    drive = () if law is None else (law.finding(),)
    if law is not None and law.credible:
        problem = finished(campaign, _prepared(campaign, law), law)
    return replace(problem, findings=(*wild, *offsets, *problem.findings, *drive, *_repeating(problem)))


def _repeating(problem: Problem) -> tuple[str, ...]:
    """What is said of torque logs that repeat their values."""
    rates = {
        (run.motor.held, run.motor.signal.rate) for run in problem.runs if run.motor is not None and run.motor.held
    }
    return tuple(
        f"the torque log repeats its values: refreshed at {held:.4g} Hz, written at {rate:.4g} Hz"
        for held, rate in sorted(rates)
    )


def _prepared(campaign: Campaign, law: DriveLaw | None) -> tuple[PreparedRun, ...]:
    """Every run in which something drives the joint and something was compared; ``law``: of a drive without encoder."""
    runs: list[PreparedRun] = []
    for run, log in zip(campaign.runs, torque_logs(campaign.runs, campaign.rig), strict=True):
        prepared = prepare_run(run, campaign.rig, len(runs), log=log, law=law)
        if prepared is not None:
            runs.append(prepared)
    return tuple(runs)


def prepare_inputs(campaign: Campaign) -> Problem:
    """A campaign of which only the inputs are read, for :func:`free_prediction`; every declared output is foretold.

    The base parameters come from a diagnosed model; those of the result are placeholders.

    Raises:
        RefusedError: The rig has several joints, or a run holds no input.
    """
    if campaign.rig.topology == "arm":
        raise RefusedError(f"{campaign.path}: topology = 'arm': a diagnosed model is of one joint")
    blind, _ = zeroed(replace(campaign, runs=tuple(without_outputs(run) for run in campaign.runs)))
    runs: list[PreparedRun] = []
    for run, log in zip(blind.runs, torque_logs(blind.runs, campaign.rig), strict=True):
        prepared = prepare_run(run, campaign.rig, len(runs), inputs_only=True, log=log)
        if prepared is None:
            raise RefusedError(
                f"{campaign.path}: run {run.id}: no force, torque or speed command to predict from; record one"
            )
        runs.append(prepared)
    return Problem(
        rig=campaign.rig, runs=tuple(runs), base=base_spec(campaign.rig, tuple(runs)), scales=unit_scales()
    )
