"""What a mechanic asks of the held-out runs beside relative errors: the force, the position and the wind-up."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.assembly import observer_corner
from jointscope.diagnosis.errors import rms
from jointscope.diagnosis.noise import ANGULAR
from jointscope.diagnosis.predict import free_prediction, inverse_force, predict_outputs
from jointscope.diagnosis.prescribed_path import INVERSE_CORNER
from jointscope.diagnosis.wind_up import WIND_UP
from jointscope.recordings.campaign import gearing

if TYPE_CHECKING:
    from jointscope.diagnosis.effects import ActiveEffect
    from jointscope.diagnosis.problem import Output, PreparedRun, Problem

Vector = NDArray[np.float64]
NEARER_WIND_UP = (
    0.9  # of the base's error of a wind-up, by which a model shows itself in it whatever moves both ends
)
Model = tuple[Vector, "tuple[ActiveEffect, ...]"]


def held_out_detail(problem: Problem, runs: Sequence[int], base: Model, model: Model) -> dict[str, Any]:
    """Further keys of ``held_out``, those that the rig and its channels admit.

    Args:
        runs: Positions in ``problem.runs``.
        base: Parameters, shape (n_theta,), and effects (none) of the refitted base.
        model: The same of the answer.

    Returns:
        ``inverse_error`` and ``base_inverse_error`` [-] with ``inverse_filter``: RMS(T - T model(q, q', q'')) / RMS(T)
        of a single free inertia; ``position_error``: RMS of recorded minus predicted from inputs alone, per channel of
        angle or position [rad or m]; ``wind_up_error``: RMS of the wind-up's residual over RMS of the wind-up about its
        mean [-], the rigid body following the recording.
    """
    prepared = [problem.runs[i] for i in runs]
    found: dict[str, Any] = {}
    force = [_mean([_inverse(run, m, problem) for run in prepared]) for m in (base, model)]
    if np.isfinite(force).all():
        corner = min(observer_corner(run) for run in prepared)
        found["base_inverse_error"], found["inverse_error"] = force
        found["inverse_filter"] = (
            f"position and force low-passed with zero phase (Butterworth, fourth order, forwards and backwards) at "
            f"{INVERSE_CORNER:g} Hz, central differences, then recorded and modelled force likewise at {corner:g} Hz"
        )
    positions = _positions(prepared, base, model, problem)
    if positions:
        found["position_error"] = positions
    twist = [wind_up_error(problem, runs, m) for m in (base, model)]
    if np.isfinite(twist).all():
        found["wind_up_error"] = {"base": twist[0], "augmented": twist[1]}
    return found


def _mean(values: Sequence[float]) -> float:
    known = [v for v in values if np.isfinite(v)]
    return float(np.mean(known)) if known else float("nan")


def _inverse(run: PreparedRun, model: Model, problem: Problem) -> float:
    pair = inverse_force(run, *model, problem)
    if pair is None:
        return float("nan")
    recorded, modelled = pair
    size = rms(recorded)
    return rms(recorded - modelled) / size if size > 0.0 else float("nan")  # a decay with its drive off


def _recorded(run: PreparedRun, output: Output) -> Vector | None:
    samples = run.run.streams[output.channel[0]].channels[output.channel[1]].samples
    return None if samples is None else np.asarray(samples, dtype=np.float64)


def _positions(runs: Sequence[PreparedRun], base: Model, model: Model, problem: Problem) -> dict[str, Any]:
    pooled: dict[str, list[tuple[float, float, str]]] = {}
    for run in runs:
        predictions = (free_prediction(run, *base, problem), free_prediction(run, *model, problem))
        for k, output in enumerate(run.declared):
            recorded = _recorded(run, output)
            if output.quantity not in ANGULAR or recorded is None or output.mask.size != recorded.size:
                continue
            scored = output.mask & np.isfinite(recorded)
            a, b = (rms((recorded - output.recorded(p[k]))[scored]) for p in predictions)
            unit = "m" if output.quantity == "position" else "rad"
            pooled.setdefault(f"{output.quantity}@{output.location}", []).append((a, b, unit))
    return {
        channel: {
            "base": float(np.sqrt(np.mean([a * a for a, _, _ in rows]))),
            "augmented": float(np.sqrt(np.mean([b * b for _, b, _ in rows]))),
            "unit": rows[0][2],
        }
        for channel, rows in sorted(pooled.items())
    }


def wind_up_error(problem: Problem, runs: Sequence[int], model: Model) -> float:
    """RMS of the wind-up's residual over the wind-up's about its mean [-], mean over ``runs``; ``nan`` without one."""
    return _mean([_wind_up(problem.runs[i], model, problem) for i in runs])


def shown_between_devices(problem: Problem, runs: Sequence[int], base: Model, model: Model) -> bool:
    """Whether encoders of two devices show a wind-up that ``model`` foretells clearly better than ``base`` does.

    Each angle follows whatever moves the joint; their difference does not, and where one device recorded both it is compared
    itself (``wind_up``).
    """
    apart = [i for i in runs if len(_encoders(problem.runs[i]) or ()) > 1]
    of_base = wind_up_error(problem, apart, base)
    return bool(wind_up_error(problem, apart, model) < NEARER_WIND_UP * min(of_base, 1.0))


def _wind_up(run: PreparedRun, model: Model, problem: Problem) -> float:
    told = _encoders(run)
    if told is None:
        return float("nan")
    predicted = predict_outputs(run, *model, problem)
    masks = np.logical_and.reduce([run.outputs[i].mask for i in told])
    recorded, foretold = (
        sum(sign * rows[i] / _turns(run, i) for i, sign in told.items())
        for rows in ([o.data for o in run.outputs], predicted)
    )
    size = float(np.std(np.asarray(recorded)[masks])) if masks.any() else 0.0
    if size == 0.0:
        return float("nan")
    left = np.asarray(recorded - foretold)[masks]
    if len(told) > 1:
        left -= np.mean(left)  # encoders are zeroed each for itself
    return rms(left) / size


def _encoders(run: PreparedRun) -> dict[int, float] | None:
    """Outputs that say the wind-up, with their signs: itself, or the two ends' angles on the same samples of any devices."""
    for i, output in enumerate(run.outputs):
        if output.quantity == WIND_UP:
            return {i: 1.0}
    angles = [(i, o) for i, o in enumerate(run.outputs) if o.quantity in ("angle", "position")]
    for i, motor in angles:
        for j, arm in angles:
            if motor.location == "motor" != arm.location and run.spring and np.array_equal(motor.times, arm.times):
                return {i: 1.0, j: -1.0}
    return None


def _turns(run: PreparedRun, place: int) -> float:
    """Turns of an output's own encoder per turn of the joint [-]."""
    output = run.outputs[place]
    return 1.0 if output.quantity == WIND_UP else gearing(output.quantity, output.location, run.ratio)
