"""Start values from the data themselves, polarity put right on the way.

The nameplate's rough values are starts only, so none of them is trusted: frequency responses give one candidate, the
slow part of the motion another, and the one whose simulation comes nearest to the recordings wins.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.alignment import aligned, inexact
from jointscope.diagnosis.assembly import BASE_INDEX, BASE_NAMES
from jointscope.diagnosis.followers import beside_own_position, followers_polarities
from jointscope.diagnosis.parameters import (
    assumptions,
    base_spec,
    beyond_nameplate,
    bounded,
    known_inertia,
    torque_calibrated,
)
from jointscope.diagnosis.predict import predict_outputs
from jointscope.diagnosis.problem import Problem
from jointscope.diagnosis.responses import (
    WORKED,
    channel_key,
    first_modes,
    fitted,
    passive_polarities,
    polarities,
    responses,
    work_done,
)
from jointscope.diagnosis.rigid import rigid_start
from jointscope.diagnosis.sizes import typical_sizes, unit_scales
from jointscope.diagnosis.unscaled import in_si, quick, unit_missing, unscaled, without_unscaled
from jointscope.diagnosis.wind_up import with_wind_up
from jointscope.identification.drive import ACCOUNTS, identify_drive
from jointscope.models.parameters import Joint, ParameterError
from jointscope.recordings.bandlimited import bandlimited
from jointscope.recordings.campaign import gearing

if TYPE_CHECKING:
    from jointscope.diagnosis.drive_angle import DriveLaw
    from jointscope.diagnosis.problem import BaseSpec, Output, PreparedRun
    from jointscope.diagnosis.responses import Response
    from jointscope.identification.drive_law import Drive
    from jointscope.recordings.campaign import Campaign, Nameplate

Vector = NDArray[np.float64]
Kind = tuple[object, ...]  # of channel


def finished(campaign: Campaign, runs: tuple[PreparedRun, ...], law: DriveLaw | None = None) -> Problem:
    """The problem with start values, polarity, drive law, clocks of unknown start and typical sizes.

    ``law``: of a drive whose motions recorded no angle; without, the law is sought in what was recorded.
    """
    rig = campaign.rig
    if unscaled(runs):
        known = _started(rig, without_unscaled(runs))
        runs = in_si(replace(known, runs=runs), known.base.start, exact=False).runs
    problem = _started(rig, runs)
    if inexact(problem):
        problem = aligned(problem, problem.base.start)
        again = _started(rig, problem.runs, exact=True)
        problem = aligned(replace(again, findings=(*problem.findings, *again.findings)), again.base.start)
    problem = in_si(problem, problem.base.start, exact=True)
    problem = replace(problem, findings=(*problem.findings, *unit_missing(runs)))
    if law is None:
        base = _with_drive(problem.base, problem.runs, _drive(campaign, rig, problem.base), rig)
    else:
        base = _with_law(problem.base, law)
    runs = tuple(with_wind_up(run) for run in problem.runs)
    problem = replace(problem, runs=runs, base=bounded(base, runs, rig))
    findings = (*problem.findings, *assumptions(rig, base, problem.runs))
    return replace(problem, scales=typical_sizes(problem, problem.base.start), findings=findings)


def _started(rig: Nameplate, runs: tuple[PreparedRun, ...], *, exact: bool = False) -> Problem:
    """Start values from whichever candidate comes nearest; ``exact`` says that uncertain clocks are aligned already."""
    base = base_spec(rig, runs)
    following = followers_polarities(runs)
    runs, followers = _righted(runs, following)
    beside = beside_own_position(runs)
    runs, by_position = _righted(runs, {key: sign for key, (_, sign) in beside.items()})
    passive = passive_polarities(responses(runs, exact=exact))
    given_out = [key for key, sign in passive.items() if sign < 0.0 and not _worked(rig, runs, key)]
    runs, findings = _righted(runs, _with_own_acceleration(given_out, beside))
    findings = (*followers, *by_position, *findings)
    measured = responses(runs, exact=exact)
    problem = Problem(
        rig=rig,
        runs=runs,
        base=base,
        scales=unit_scales(),
        torque_calibrated=torque_calibrated(runs),
        findings=findings,
    )
    problem = _nearest(problem, measured)
    signs = polarities(problem.base.start, measured)
    wrong = [key for key, sign in signs.items() if sign < 0.0 and not _worked(rig, problem.runs, key)]
    if not any("motor" in key for key in wrong):  # else it may be the motor that counts the other way
        wrong = [key for key in wrong if key not in following]
    for key in [key for key in wrong if key not in beside]:
        turned, found = _righted(problem.runs, _with_own_acceleration([key], beside))
        other = replace(problem, runs=turned, base=base, findings=(*problem.findings, *found))
        other = _nearest(other, responses(turned, exact=exact))
        if _misfit(other, other.base.start) < _misfit(problem, problem.base.start):
            problem = other
    return problem


def _with_own_acceleration(wrong: Sequence[Kind], beside: dict[Kind, tuple[Kind, float]]) -> dict[Kind, float]:
    """-1 for every kind in ``wrong`` that no position of its own says the sign of, and for what goes by these."""
    own = [key for key in wrong if key not in beside]
    return dict.fromkeys([*own, *(key for key, (position, _) in beside.items() if position in own)], -1.0)


def _worked(rig: Nameplate, runs: tuple[PreparedRun, ...], key: tuple[object, ...]) -> bool:
    """Whether the drive does work along this kind of channel; against a weight it may have to hold back."""
    return rig.plane != "vertical" and work_done(runs, key) > WORKED


def _nearest(problem: Problem, measured: tuple[Response, ...]) -> Problem:
    """The problem with whichever candidate comes nearest to its recordings as start."""
    base, runs, known = problem.base, problem.runs, known_inertia(problem.rig)
    slow = rigid_start(base, runs, base.start, known)
    quick = fitted(base, measured, (base.start,) if slow is None else (base.start, slow))
    low = fitted(base, first_modes(measured), (base.start,))
    candidates = [start for start in (quick, low, slow, base.start) if start is not None]
    if quick is not None:
        rest = rigid_start(base, runs, quick, known)
        if rest is not None:
            candidates.append(_joined(quick, rest))
    near = [start for start in candidates if not beyond_nameplate(start, runs, problem.rig)]
    best = min(near or candidates, key=lambda start: _misfit(problem, start))
    return replace(problem, base=replace(base, start=best))


def _joined(quick: Vector, slow: Vector) -> Vector:
    """Inertias, stiffness and scales of one candidate with weight, offset and slow damping of the other."""
    joined = quick.copy()
    for name in ("gravity_moment", "torque_offset", "motor_damping", "load_damping"):
        joined[BASE_INDEX[name]] = slow[BASE_INDEX[name]]
    return joined


def _misfit(problem: Problem, start: Vector) -> float:
    """How far the base at ``start`` is from the recordings: mean log share of error, whole and above the slow part.

    A torque offset or slow friction hides the resonance in the whole signal; a slow motion has nothing but noise above.
    Each share is bounded: a start is judged, not a fit.
    """
    shares = []
    for run in problem.runs:
        if run.mode == "closed-loop":
            continue
        for output, y in zip(run.outputs, predict_outputs(run, start, (), problem), strict=True):
            error = np.where(output.mask, output.data - y, 0.0)
            for data, rest in (
                (output.data, error),
                (quick(output.data, output.rate), quick(error, output.rate)),
            ):
                size = float(np.std(data[output.mask])) + 1e-6 * float(np.max(np.abs(data))) + 1e-300
                with np.errstate(over="ignore"):  # of a start that flies apart
                    share = float(np.sqrt(np.mean(rest**2))) / size
                shares.append(min(share, 10.0) if math.isfinite(share) else 100.0)
    return float(np.mean(np.log(np.array(shares) + 1e-9))) if shares else 0.0


def _righted(
    runs: tuple[PreparedRun, ...], flips: dict[tuple[object, ...], float]
) -> tuple[tuple[PreparedRun, ...], tuple[str, ...]]:
    """Channels that were found inverted, turned round."""
    findings: list[str] = []
    done: list[PreparedRun] = []
    for run in runs:
        wrong = [o.channel for o in run.outputs if flips.get(channel_key(run, o), 1.0) < 0.0]
        outputs = tuple(inverted(o, run) if o.channel in wrong else o for o in run.outputs)
        declared = tuple(inverted(o, run) if o.channel in wrong else o for o in run.declared)
        for output in outputs:
            if output.channel in wrong:
                line = f"{output.quantity} at the {output.location} (run {run.run.id}): polarity inverted"
                findings.append(line)
        followed = any(o.observed and o.channel in wrong for o in outputs)
        done.append(replace(_mirrored(run) if followed else run, outputs=outputs, declared=declared))
    return tuple(done), tuple(findings)


def inverted(output: Output, run: PreparedRun) -> Output:
    """The channel turned round; an angle about where the run starts."""
    if output.quantity not in ("angle", "position"):
        return replace(output, data=-output.data, polarity=-output.polarity, offset=-output.offset)
    start = run.initial_angle * gearing(output.quantity, output.location, run.ratio)
    offset = -(output.offset + 2.0 * start)
    return replace(output, data=2.0 * start - output.data, polarity=-output.polarity, offset=offset)


def _mirrored(run: PreparedRun) -> PreparedRun:
    """The run with its observed angle counted the other way round."""
    assert run.observed is not None
    start = 0.0 if run.observed.rate_signal else 2.0 * run.initial_angle
    half = start - run.observed_half
    signal = bandlimited(half, 2.0 * run.grid_rate, run.t0)
    return replace(
        run,
        observed_half=half,
        initial_speed=-run.initial_speed,
        observed=replace(run.observed, signal=signal),
    )


def _drive(campaign: Campaign, rig: Nameplate, base: BaseSpec) -> Drive | None:
    """The drive's speed law, where a command and a torque were recorded."""
    if not any(run.select("speed-command") for run in campaign.runs):
        return None
    joint = None
    if rig.motor_inertia is not None:
        b = dict(zip(BASE_NAMES, (float(v) for v in base.start), strict=True))
        try:
            joint = Joint(
                stiffness=b["stiffness"],
                damping=b["damping"],
                load_inertia=b["load_inertia"],
                motor_inertia=rig.motor_inertia,
                reducer_inertia=rig.reducer_inertia or 0.0,
                reduction_ratio=rig.reduction_ratio or 1.0,
                motor_damping=b["motor_damping"],
                load_damping=b["load_damping"],
                efficiency=b["efficiency"],
            )
        except ParameterError:
            joint = None
    try:
        return identify_drive(campaign, joint, gravity_moment=float(b["gravity_moment"]) if joint else 0.0)
    except (ValueError, np.linalg.LinAlgError):
        return None


def _with_law(base: BaseSpec, law: DriveLaw) -> BaseSpec:
    """The law that the accelerometers bear out in the start vector; what a position loop holds, as a stiffer integral."""
    start = base.start.copy()
    start[BASE_INDEX["drive_gain"]] = law.gain
    start[BASE_INDEX["drive_integral"]] = law.integral + law.gain * law.outer
    start[BASE_INDEX["drive_acceleration"]] = law.ahead
    return replace(base, start=start)


def _with_drive(base: BaseSpec, runs: tuple[PreparedRun, ...], drive: Drive | None, rig: Nameplate) -> BaseSpec:
    """The law at the joint output in the start vector; gains are free where no recording gave them."""
    n = rig.reduction_ratio or 1.0
    start, free = base.start.copy(), base.free.copy()
    if drive is None:
        loops = any(run.mode == "closed-loop" for run in runs)
        for name in ("drive_gain", "drive_integral"):
            free[BASE_INDEX[name]] = loops
        total = start[BASE_INDEX["load_inertia"]] + start[BASE_INDEX["motor_inertia"]]
        if not any(run.spring for run in runs):
            total = 0.0  # a rigid axis, which is foretold open loop
        start[BASE_INDEX["drive_gain"]] = 60.0 * total
        start[BASE_INDEX["drive_integral"]] = 360.0 * total
        return replace(base, start=start, free=free)
    law = {
        "drive_gain": drive.proportional * n * n,
        "drive_integral": drive.integral * n * n,
        "drive_acceleration": drive.acceleration_feedforward * n * n,
        "drive_velocity": drive.velocity_feedforward * n * n,
        "drive_limit": 0.0 if drive.torque_limit is None else drive.torque_limit * n,
        "drive_trust": 1.0 if drive.lacking < ACCOUNTS else 0.0,
    }
    for name, value in law.items():
        start[BASE_INDEX[name]] = value
    return replace(base, start=start, free=free)
