r"""An accelerometer on the mount or on a neighbour tells which of the two moves: what stands still carries no mode.

The arm's own accelerometers see a moving mount and a moving neighbour alike. A sensor on either is no output of this
joint's model, but a witness: after a hit it moves with rms a_w above its own before the hit, and beside the arm's a by the
part a_w / a of what the reaction moves.

Fact used as a test: a witness of noise alone has stood still at any level of the noise; a scaled copy of the arm's
acceleration has moved.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np

if TYPE_CHECKING:
    from jointscope.diagnosis.problem import Problem
    from jointscope.recordings.campaign import Run, Signal

Place = Literal["base", "neighbour"]

_RINGS = 0.3  # s after the hit, in which whatever moves is heard
_QUIET = 0.02  # s before the hit that its rise may begin in
_ABOVE_REST = 2.0  # times the rms before the hit
_PART = 0.005  # of the arm's acceleration: a mount that moves less carries nothing that could be told
_OTHER: dict[Place, Place] = {"base": "neighbour", "neighbour": "base"}


def contradicted(problem: Problem, place: Place) -> str | None:
    """Why an accelerometer says that this place stands still, or that the other one is what moves; else ``None``."""
    here, there = _moves(problem, place), _moves(problem, _OTHER[place])
    if here is False:
        return f"the accelerometer on the {place} stands still when the arm is hit"
    if here is None and there:
        return f"the accelerometer on the {_OTHER[place]} moves when the arm is hit"
    return None


def _moves(problem: Problem, place: Place) -> bool | None:
    """Whether an accelerometer at this place moves in most of the hits that it saw; ``None`` where there is none."""
    seen = [
        answer
        for run in problem.runs
        if run.run.experiment == "hammer"
        for answer in [moved(run.run, place)]
        if answer is not None
    ]
    return 2 * sum(seen) > len(seen) if seen else None


def moved(run: Run, place: Place) -> bool | None:
    """Whether any accelerometer at this place answers the hit of this run; ``None`` where none was recorded."""
    hammer = [
        *run.select("force", location="arm", role="input"),
        *run.select("torque", location="arm", role="input"),
    ]
    witnesses = run.select("linear-acceleration", location=place, role="output")
    arm = run.select("linear-acceleration", location="arm", role="output")
    if not (hammer and witnesses and arm):
        return None
    force = hammer[0]
    struck = force.stream.start + int(np.argmax(np.nan_to_num(np.abs(force.samples)))) / force.sampling_rate
    loudest = max(_rung(signal, struck)[1] for signal in arm)
    heard = [_rung(signal, struck) for signal in witnesses]
    return any(after > max(_ABOVE_REST * before, _PART * loudest) for before, after in heard)


def _rung(signal: Signal, struck: float) -> tuple[float, float]:
    """Rms before and after the hit [m/s^2], about the level at rest."""
    samples = np.asarray(signal.samples, dtype=np.float64)
    times = signal.stream.start + np.arange(samples.size) / signal.sampling_rate
    good = np.isfinite(samples)
    before = samples[good & (times < struck - _QUIET)]
    after = samples[good & (times >= struck - _QUIET) & (times < struck + _RINGS)]
    level = float(np.median(before)) if before.size else 0.0
    rest = float(np.std(before)) if before.size > 8 else 0.0
    return rest, float(np.sqrt(np.mean(np.square(after - level)))) if after.size else 0.0
