"""Channels whose unit nobody knows: their scale is what the base says of them, beside channels whose units are known.

The scale is a nuisance and never an effect. While clocks are unknown too it is the ratio of the sizes above the slow part,
s = |d| / |y|; once they are found it is least squares', s = y'd / y'y. One instrument has one scale in all runs. Where no other
channel has a unit only ratios can be had, and the channel is taken as it is.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.channels import high_pass
from jointscope.diagnosis.parameters import torque_calibrated
from jointscope.diagnosis.predict import predict_outputs

if TYPE_CHECKING:
    from jointscope.diagnosis.problem import Output, PreparedRun, Problem

Vector = NDArray[np.float64]
Instrument = tuple[object, ...]

SLOW = 6.0  # Hz; drives and friction move the rigid body below it, the joint's resonance lies above


def _instrument(output: Output) -> Instrument:
    return output.quantity, output.location, output.direction, output.radius


def unscaled(runs: tuple[PreparedRun, ...]) -> bool:
    """Whether any channel's scale is unknown, and can be told: an input and another output have units."""
    outputs = [o for run in runs for o in run.outputs]
    return torque_calibrated(runs) and any(_to_scale(o) for o in outputs) and any(o.calibrated for o in outputs)


def _to_scale(output: Output) -> bool:
    return not output.calibrated and not output.observed


def without_unscaled(runs: tuple[PreparedRun, ...]) -> tuple[PreparedRun, ...]:
    """The runs as the channels with units tell them."""
    return tuple(replace(run, outputs=tuple(o for o in run.outputs if not _to_scale(o))) for run in runs)


def in_si(problem: Problem, theta: Vector, *, exact: bool) -> Problem:
    """``problem`` with every channel of unknown scale in SI, by the base at ``theta``, shape (n_theta,).

    Args:
        exact: Whether the clocks of the streams are known, or found.
    """
    if not unscaled(problem.runs):
        return problem
    sums: dict[Instrument, Vector] = {}
    for run in problem.runs:
        predicted = predict_outputs(run, theta, (), problem)
        for output, y in zip(run.outputs, predicted, strict=True):
            if _to_scale(output) and np.all(np.isfinite(y)) and output.mask.any():
                sums[_instrument(output)] = sums.get(_instrument(output), np.zeros(3)) + _products(output, y)
    scales = {instrument: _scale(*found, exact=exact) for instrument, found in sums.items()}

    def scaled(output: Output) -> Output:
        s = scales.get(_instrument(output), 1.0) if _to_scale(output) else 1.0
        return output if s == 1.0 else rescaled(output, s)

    runs = tuple(
        replace(run, outputs=tuple(map(scaled, run.outputs)), declared=tuple(map(scaled, run.declared)))
        for run in problem.runs
    )
    said = _in_words(problem.runs)
    others = (line for line in problem.findings if line not in said)
    return replace(problem, runs=runs, findings=(*others, *_in_words(runs)))


def unit_missing(runs: tuple[PreparedRun, ...]) -> tuple[str, ...]:
    """What no channel tells the scale of, in words; nothing where inputs have no units either: then all is per unit of them."""
    if not torque_calibrated(runs) or unscaled(runs):
        return ()
    found = {_instrument(o): o for run in runs for o in run.outputs if _to_scale(o)}
    return tuple(
        f"{o.quantity} at the {o.location}: its unit is unknown and no other channel tells it; it is taken for SI, "
        "and stiffness, damping and inertia are as far off as it is (give its scale)"
        for o in found.values()
    )


def _in_words(runs: tuple[PreparedRun, ...]) -> tuple[str, ...]:
    """What one recorded unit of every channel that was brought to SI comes to, in words."""
    found = {_instrument(o): o for run in runs for o in run.outputs if o.scale != 1.0}
    return tuple(
        f"{o.quantity} at the {o.location}: its unit is unknown; one of it is {1.0 / o.scale:.4g} in SI by the base model"
        for o in found.values()
    )


def _products(output: Output, y: Vector) -> Vector:
    """(d'd, d'y, y'y) above the slow part, shape (3,)."""
    d, y = (quick(x, output.rate)[output.mask] for x in (output.data, y))
    return np.array([d @ d, d @ y, y @ y])


def quick(x: Vector, rate: float) -> Vector:
    """What lies above the slow part, by two first-order high-passes."""
    corner = min(SLOW, 0.1 * rate)
    return high_pass(high_pass(x, corner, rate), corner, rate)


def _scale(dd: float, dy: float, yy: float, *, exact: bool) -> float:
    if not (dd > 0.0 and yy > 0.0):
        return 1.0
    return float(dy / yy if exact and dy > 0.0 else math.sqrt(dd / yy))


def rescaled(output: Output, scale: float) -> Output:
    """The channel in a unit ``scale`` times as large."""
    return replace(
        output,
        data=output.data / scale,
        offset=output.offset / scale,
        scale=output.scale * scale,
        step=None if output.step is None else output.step / scale,
        taken_off=output.taken_off / scale**2,
    )
