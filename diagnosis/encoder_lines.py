r"""Lines against the turn that an encoder adds to its reading, told from a gear's error and taken off as the recording's own.

Gratings, magnets and the wheels that drive an encoder read e(q) = A cos(o q) + B sin(o q) beside the angle at whatever
speed. A gear's error of the same order is dynamics: with the motor's angle followed,

    q_s - q = -S/(S - w^2 J_l) e,   S = K + i w c,

and above the arm's resonance on the held motor the arm does not follow. So where the difference of two encoders was
recorded, either form is fitted to what the base leaves of it, o over all orders that the runs resolve. A line that every run
shows alike, and that the gear's form explains little of, is the encoder's.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.assembly import BASE_INDEX
from jointscope.diagnosis.noise import Key, block_key
from jointscope.diagnosis.turning import (
    Turned,
    angles_at_outputs,
    best_order,
    fitted_line,
    net_gain,
    projected,
    share_of_signal,
    turned,
)
from jointscope.diagnosis.wind_up import WIND_UP

if TYPE_CHECKING:
    from jointscope.diagnosis.base import Stage
    from jointscope.diagnosis.problem import Output, PreparedRun, Problem

Vector = NDArray[np.float64]
Line = tuple[float, Vector]  # order per turn of the output, and its amplitudes of cos and sin [rad]

LINES = 3  # taken off at most
STANDS = 100.0  # nats, net of the orders tried, that a line must gain
ALIKE = 0.5  # of what a run's own amplitudes explain, that those of all runs must
OF_A_GEAR = 0.5  # of what the encoder's form explains, from which on the gear's may be what it is
LARGEST = 0.2  # of the channel's signal, rms, beyond which it is no blemish of a reading


def without_encoder_lines(problem: Problem, stage: Stage) -> Problem:
    """``problem`` with the lines of its encoders taken off their difference, and a finding for each.

    Args:
        stage: The refitted base, with what it leaves of the runs that are fitted; the others are not asked.
    """
    keys = dict.fromkeys(
        block_key(run, o) for run in stage.objective.prepared for o in run.outputs if o.quantity == WIND_UP
    )
    theta, _ = stage.fit.coordinates.unpack(stage.fit.x)
    found: dict[Key, list[Line]] = {}
    for key in keys:
        runs = turned(stage.objective, stage.predictions, key)
        lines = _lines(stage, theta, runs) if len(runs) > 1 else []
        if lines:
            found[key] = lines
    if not found:
        return problem
    said = [
        f"the encoders' difference holds {1e6 * math.hypot(*step):.3g} urad that repeat {order:.4g} times per turn of the "
        f"joint whatever its speed ({key[0]}): taken off as an encoder's own"
        for key, lines in found.items()
        for order, step in lines
    ]
    without = tuple(replace(run, outputs=_outputs(run, found)) for run in problem.runs)
    return replace(problem, runs=without, findings=(*problem.findings, *said))


def _lines(stage: Stage, theta: Vector, runs: list[Turned]) -> list[Line]:
    found: list[Line] = []
    for _ in range(LINES):
        order, tried = best_order(stage.objective, runs)
        if tried == 0:
            break
        explained, step = fitted_line(runs, order)
        net, _ = net_gain(runs, explained, tried)
        geared, _ = projected([(run.w, _geared(run, theta, order)) for run in runs])
        blemish = share_of_signal(runs, step) < LARGEST and geared < OF_A_GEAR * explained
        if not (net > STANDS and blemish and _shown_alike(runs, order, step)):
            break
        found.append((order, step))
        runs = [replace(run, w=run.w - run.columns(order) @ step) for run in runs]
    return found


def _shown_alike(runs: list[Turned], order: float, step: Vector) -> bool:
    """Whether the amplitudes that the runs have in common explain most of what each run's own would."""
    for run in runs:
        change = run.columns(order) @ step
        common = float(run.w @ change) - 0.5 * float(change @ change)
        if common < ALIKE * 0.5 * fitted_line([run], order)[0]:
            return False
    return True


def _geared(run: Turned, theta: Vector, order: float) -> NDArray[np.float64]:
    """What a gear's error of the order does to the difference of the angles, whitened, shape (n, 2)."""
    stiffness, damping, inertia = (float(theta[BASE_INDEX[n]]) for n in ("stiffness", "damping", "load_inertia"))
    arrays = []
    for output, q in zip(run.objective.prepared[run.index].outputs, run.angles, strict=True):
        error = np.stack([np.cos(order * q), np.sin(order * q)], axis=1)
        n = 2 * len(q)
        omega = 2.0 * math.pi * np.fft.rfftfreq(n, 1.0 / output.rate)[:, None]
        spring = stiffness + 1j * omega * damping
        followed = spring / (spring - omega**2 * inertia)
        mirrored = np.concatenate([error, error[::-1]])  # no step at its ends
        arrays.append(np.fft.irfft(followed * np.fft.rfft(mirrored, axis=0), n, axis=0)[: len(q)])
    return run.whitened(arrays)


def _outputs(run: PreparedRun, lines: Mapping[Key, Sequence[Line]]) -> tuple[Output, ...]:
    found = []
    for output, q in zip(run.outputs, angles_at_outputs(run), strict=False):
        data = output.data
        for order, (cosine, sine) in lines.get(block_key(run, output), ()):
            data = data - cosine * np.cos(order * q) - sine * np.sin(order * q)
        found.append(replace(output, data=data))
    return tuple(found) or run.outputs
