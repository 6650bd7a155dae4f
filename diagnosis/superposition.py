"""What an arm's further modes add to what its accelerometers read: modal superposition under the torque on the arm."""

from __future__ import annotations

import math
from collections.abc import Iterable
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


def accelerometers(outputs: Iterable[Output]) -> list[Output]:
    """Those on the arm along its motion, in the order of their channels."""
    found = (o for o in outputs if "acceleration" in o.quantity and o.location != "motor")
    return sorted((o for o in found if o.direction == "tangential"), key=lambda o: o.channel)


def superposed(acceleration: Vector, assembly: Assembly, run: PreparedRun, output: Output) -> Vector:
    """The joint's own acceleration as this sensor's place sees it, with the further modes', shape of ``acceleration``."""
    bends = assembly.bends
    among = run.outputs if any(o is output for o in run.outputs) else run.declared
    places = [o.channel for o in accelerometers(among)]
    k = places.index(output.channel) if output.channel in places else len(bends.shapes)
    if k >= len(bends.shapes):
        return acceleration
    force = load_input(assembly)[::2] / assembly.base("load_inertia")
    total = bends.shapes[k] * acceleration
    for frequency, damping, shares in zip(bends.frequencies, bends.dampings, bends.shares, strict=True):
        total += shares[k] * modal_acceleration(force, frequency, damping, run.grid_rate)
    return total
