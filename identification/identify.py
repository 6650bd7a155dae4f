"""Campaign -> parameters: which of its recordings say something about the joint, and what they say.

Hammer hits on the braked joint come first, measured FRFs next, then a motor bench (torque or current against the motor's
and the load's motion). Runs kept for validation are never read.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from jointscope.errors import RefusedError
from jointscope.identification.conditioning import gravity_stiffness
from jointscope.identification.drive import identify_drive
from jointscope.identification.hammer import HammerPlan, identify_hammer
from jointscope.identification.hit_spectra import Hit, Rejected, read_hit
from jointscope.identification.measured_frf import frf_hits
from jointscope.identification.model_file import BaseModel
from jointscope.identification.motor_bench import bench_runs, identify_bench
from jointscope.identification.result import Identification, Refused
from jointscope.models.parameters import STANDARD_GRAVITY, Joint
from jointscope.recordings.campaign import Campaign, Nameplate, Run

NAMES = ("stiffness", "inertia", "damping")


def identify(campaign: Campaign, plan: HammerPlan | None = None) -> Identification:
    """Stiffness, inertia, damping and modes with intervals, or why not.

    Args:
        campaign: With samples, as ``recordings.reader.read_campaign`` returns it.
        plan: What to fix beforehand; by default band and number of modes come from the data.

    Returns:
        The identification; where the recordings can't carry it, ``parameters`` is empty and ``refused`` says why.
    """
    found = _identified(campaign, plan or HammerPlan())
    if found.base is None or campaign.rig.motion != "rotational" or campaign.rig.topology != "two-inertia":
        return found
    return replace(found, base=_with_drive(found.base, campaign))


def _with_drive(base: BaseModel, campaign: Campaign) -> BaseModel:
    """The base model with the law of the drive, a nuisance that motions under speed control need to be predicted."""
    gravity = (campaign.rig.arm_mass or 0.0) * (campaign.rig.arm_com_radius or 0.0) * STANDARD_GRAVITY
    try:
        joint: Joint | None = base.as_joint()
    except RefusedError:
        joint = None  # without the motor's inertia the law can be read only where the motor's motion was recorded
    drive = identify_drive(campaign, joint, gravity_moment=gravity if campaign.rig.plane == "vertical" else 0.0)
    return base if drive is None else replace(base, drive=drive.to_json())


def _identified(campaign: Campaign, plan: HammerPlan) -> Identification:
    runs = [run for run in campaign.runs if run.role != "validate"]
    if not runs:
        return refusal("every run has the role validate; identification reads estimate runs only")
    hammer = [run for run in runs if run.experiment == "hammer"]
    held = [run for run in hammer if run.brake or campaign.rig.topology == "single-dof" or _locked(run)]
    rejected: list[Rejected] = []
    hits: list[Hit] = []
    if campaign.rig.topology == "arm":
        held, rejected = _in_one_place(held)
    for run in held:
        answer = read_hit(run, campaign.rig)
        if isinstance(answer, Rejected):
            rejected.append(answer)
        else:
            hits.append(answer)
    try:
        if hits:
            return identify_hammer(
                _alike(hits, rejected), rejected, campaign.rig, _gravity(held, campaign.rig), plan
            )
        measured = frf_hits(runs, campaign.rig)
        if measured:
            return identify_hammer(measured, rejected, campaign.rig, _gravity(runs, campaign.rig), plan)
        bench = bench_runs(runs)
        if bench:
            return identify_bench(bench, campaign.rig)
    except RefusedError as problem:
        return refusal(str(problem), rejected)
    return refusal(_why_nothing(runs, hammer, held, rejected), rejected)


def refusal(reason: str, rejected: Sequence[Rejected] = ()) -> Identification:
    """An identification that refuses all three parameters for one reason."""
    return Identification(
        method="none",
        band=(float("nan"), float("nan")),
        parameters={},
        modes=(),
        refused=tuple(Refused(parameter=name, reason=reason) for name in NAMES),
        rejected=tuple(rejected),
    )


def _locked(run: Run) -> bool:
    return any(state in ("brake", "locked") for state in run.hold.values())


def _in_one_place(runs: Sequence[Run]) -> tuple[list[Run], list[Rejected]]:
    """An arm's hits on the first joint's link in the first posture; another place or posture has other modes."""

    def place(run: Run) -> tuple[object, ...]:
        force = run.select("force", role="input")
        where = (force[0].channel.body, force[0].channel.point, force[0].channel.axis) if force else ()
        return (run.joint, tuple(sorted(run.posture.items())), run.payload_mass, run.payload_com, where)

    kept = [run for run in runs if place(run) == place(runs[0])]
    apart = [
        Rejected(
            run=run.id,
            finding="unlike",
            detail="another posture or point than the first hit's; jointscope arm identify takes them all together",
        )
        for run in runs
        if place(run) != place(runs[0])
    ]
    return kept, apart


def _alike(hits: Sequence[Hit], rejected: list[Rejected]) -> list[Hit]:
    """Hits with the first one's outputs and units; the others are set aside."""
    first = hits[0]
    kept = []
    for hit in hits:
        if hit.spectrum.output.shape[0] == first.spectrum.output.shape[0] and hit.input_unit == first.input_unit:
            kept.append(hit)
        else:
            rejected.append(
                Rejected(run=hit.spectrum.run, finding="unlike", detail="other channels than the first hit's")
            )
    return kept


def _gravity(runs: Sequence[Run], rig: Nameplate) -> float | None:
    shares = [gravity_stiffness(run, rig) for run in runs]
    known = [share for share in shares if share is not None]
    return float(np.mean(known)) if known and len(known) == len(shares) else None


def _why_nothing(
    runs: Sequence[Run], hammer: Sequence[Run], held: Sequence[Run], rejected: Sequence[Rejected]
) -> str:
    if rejected:
        return f"no usable hit among {len(rejected)}: {rejected[0].run}: {rejected[0].detail}"
    if hammer and not held:
        return "the hits were made with the motor free: K and J_L part only with brake = true"
    return (
        f"none of the {len(runs)} runs holds a hit on the braked joint, a measured FRF, or motor torque with the motion "
        "of motor and load"
    )
