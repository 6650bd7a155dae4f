"""What a take's reality holds beyond the base rig: the one hook through which effects enter a simulation.

Plain runs use :data:`BASE` and pay nothing for it: only a law or an actuation makes the stepping leave compiled code.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import mujoco

from jointscope.sim.chain import Chain
from jointscope.sim.stepping import Actuation, ForceLaw, Trace


def _keep_spec(spec: mujoco.MjSpec) -> None:
    """Leave the model as it is."""
    del spec


def _keep_trace(trace: Trace) -> Trace:
    return trace


def _keep_chain(chain: Chain) -> Chain:
    return chain


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
        chain: Changes the acquisition devices.
    """

    edit: Callable[[mujoco.MjSpec], None] = _keep_spec
    actuation: Callable[[float], Actuation] | None = None
    law: Callable[[mujoco.MjModel], ForceLaw] | None = None
    sensed: Callable[[Trace], Trace] = _keep_trace
    chain: Callable[[Chain], Chain] = _keep_chain


BASE = Physics()
