"""A run up to some time: what follows a hit's contact, before small differences have grown, or enough of a long run."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from jointscope.diagnosis.problem import PreparedRun

STRUCK = 0.05  # of a hit's peak, where it begins
SETTLING = 50  # steps simulated beyond the end, which the recorder's filter reads


def opening(run: PreparedRun, seconds: float) -> PreparedRun:
    """The run up to ``seconds`` after its external force first was a share of its peak."""
    force = np.abs(run.load_half)
    begins = run.t0 + int(np.argmax(force > STRUCK * force.max())) / (2.0 * run.grid_rate)
    return up_to(run, begins + seconds)


def up_to(run: PreparedRun, ends: float) -> PreparedRun:
    """The run as if it had been recorded up to ``ends`` on its clock [s]."""
    steps = min(run.steps, math.ceil((ends - run.t0) * run.grid_rate) + SETTLING)
    half = 2 * steps + 1
    outputs = tuple(
        replace(o, times=o.times[o.times <= ends], data=o.data[o.times <= ends], mask=o.mask[o.times <= ends])
        for o in run.outputs
    )
    return replace(
        run,
        steps=steps,
        load_half=run.load_half[:half],
        motor_half=run.motor_half[:half],
        command_half=run.command_half[:half],
        observed_half=run.observed_half[:half],
        command_rate_half=run.command_rate_half[:half],
        outputs=outputs,
    )
