"""What a take's reality holds beyond the base rig: the one hook through which effects enter a simulation.

Plain runs use :data:`BASE` and pay nothing for it: only a law or an actuation makes the stepping leave compiled code.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import mujoco
import numpy as np
from numpy.typing import NDArray

from jointscope.recordings.campaign import Signal
from jointscope.sim.chain import Chain
from jointscope.sim.measurement import Clock
from jointscope.sim.stepping import Actuation, ForceLaw, Trace

Real = NDArray[np.float64]


class Record(Protocol):
    """A recorded input as a function of time."""

    def __call__(self, times: Real, derivative: int = 0) -> Real:
        """Value in SI, or its time derivative, at ``times`` [s] on the run's clock, same shape."""


def _keep_spec(spec: mujoco.MjSpec) -> None:
    """Leave the model as it is."""
    del spec


def _keep_trace(trace: Trace) -> Trace:
    return trace


def _keep_chain(chain: Chain) -> Chain:
    return chain


def _as_recorded(signal: Signal, record: Record) -> Record:
    del signal
    return record


def _right_clock(signal: Signal) -> Clock:
    del signal
    return Clock()


def _as_it_is(signal: Signal, values: Real, trace: Trace) -> Real:
    del signal, trace
    return values


def _all_kept(signal: Signal, samples: Real) -> Real:
    del signal
    return samples


@dataclass(frozen=True, kw_only=True)
class Acquisition:
    """How a run's instruments stand between the machine and the recording, when a recording is replayed.

    Attributes:
        acted: What a recorded input stands for: from the record to what acted on the machine.
        clock: Of the device that records an output.
        seen: What the sensor of an output makes of ``values`` on the stepping grid, shape (n,), before its coupling.
        kept: What the device makes of its samples.
        moved: By how much a point of the arm at a radius [m] moves with the mode in which the arm bends.
    """

    acted: Callable[[Signal, Record], Record] = _as_recorded
    clock: Callable[[Signal], Clock] = _right_clock
    seen: Callable[[Signal, Real, Trace], Real] = _as_it_is
    kept: Callable[[Signal, Real], Real] = _all_kept
    moved: Callable[[float], float] = float


@dataclass(frozen=True, kw_only=True)
class Physics:
    """Additions to the base rig for one take, in the order in which they act.

    Attributes:
        edit: Changes the model in place (bodies, stiffnesses, friction) before it is braked and compiled.
        actuation: Makes, for a step h [s], what stands between the commanded torque and the one that acts.
        law: Makes, for the compiled model, generalized forces as a function of time, angles, speeds and states of its
            own. Look coordinates up by joint name: a braked model has no joint ``motor``.
        sensed: Changes what the sensors see (``signals``) and what is recorded as input (``inputs``) on the stepping
            grid, before any device samples it.
        chain: Changes the acquisition devices of a simulated bench.
        acquisition: Changes what a replay takes from and gives to a recording.
    """

    edit: Callable[[mujoco.MjSpec], None] = _keep_spec
    actuation: Callable[[float], Actuation] | None = None
    law: Callable[[mujoco.MjModel], ForceLaw] | None = None
    sensed: Callable[[Trace], Trace] = _keep_trace
    chain: Callable[[Chain], Chain] = _keep_chain
    acquisition: Acquisition = Acquisition()


BASE = Physics()
