"""What an arm's further modes add to what its accelerometers read: modal superposition under the torque on the arm."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.signal import cont2discrete, lfilter

from jointscope.diagnosis.acquisition import load_input

if TYPE_CHECKING:
    from jointscope.diagnosis.assembly import Assembly
    from jointscope.diagnosis.problem import Output, PreparedRun

Vector = NDArray[np.float64]


def modal_acceleration(force: Vector, frequency: float, damping: float, rate: float) -> Vector:
    """p'' of p'' + 2 zeta w p' + w^2 p = force from rest, exact for a force that is linear between samples; same shape."""
    w = 2.0 * math.pi * frequency
    b, a, _ = cont2discrete(([1.0, 0.0, 0.0], [1.0, 2.0 * damping * w, w * w]), 1.0 / rate, method="foh")
    return np.asarray(lfilter(b.ravel(), a.ravel(), force), dtype=np.float64)


def reads_the_arm(output: Output) -> bool:
    """Whether this is an accelerometer on the arm, along its motion."""
    return "acceleration" in output.quantity and output.location != "motor" and output.direction == "tangential"


def place(run: PreparedRun, output: Output) -> int:
    """Which of the run's accelerometers on the arm this is, by its channel."""
    among = run.outputs if any(o is output for o in run.outputs) else run.declared
    channels = sorted(o.channel for o in among if reads_the_arm(o))
    return channels.index(output.channel)


def superposed(acceleration: Vector, assembly: Assembly, run: PreparedRun, output: Output) -> Vector:
    """The joint's own acceleration as this sensor's place sees it, with the further modes', shape of ``acceleration``."""
    bends = assembly.bends
    if not reads_the_arm(output):
        return acceleration
    k = place(run, output)
    if k >= len(bends.shapes):
        return acceleration
    force = load_input(assembly)[::2] / assembly.base("load_inertia")
    total = bends.shapes[k] * acceleration
    for frequency, damping, shares in zip(bends.frequencies, bends.dampings, bends.shares, strict=True):
        total += shares[k] * modal_acceleration(force, frequency, damping, run.grid_rate)
    return total
