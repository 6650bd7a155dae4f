"""Steps per second of the 12-degree-of-freedom arm, with what a simulation reads out of it and without."""

from __future__ import annotations

import time
from collections.abc import Mapping

import mujoco
import numpy as np

from jointscope.models.arm.build import ElasticArm
from jointscope.models.arm.forward import step_arm
from jointscope.models.arm.holding import HoldKind, equilibrium, hold_arm
from jointscope.sim.arm.plan import BASE, FOREARM, JOINT, UPPER_ARM

_STEPS = 20_000
_ROUNDS = 3


def measure_speed(arm: ElasticArm, posture: Mapping[str, float]) -> dict[str, float]:
    """Best of three rounds each, taken in turns [steps/s]: ``ours``, ``mujoco`` and their ``ratio``."""
    hold: dict[str, HoldKind] = dict.fromkeys(arm.rotors, "drive")
    probes = [UPPER_ARM.probe, FOREARM.probe, BASE.probe]
    held = hold_arm(arm, hold, posture, driven=[JOINT], probes=probes)
    rest = equilibrium(held, posture)
    commands = np.zeros((_STEPS, held.model.nu))
    ours, bare = 0.0, 0.0
    for _ in range(_ROUNDS):
        started = time.perf_counter()
        step_arm(held, rest, commands)
        ours = max(ours, _STEPS / (time.perf_counter() - started))
        data = mujoco.MjData(held.model)
        data.qpos[:] = rest.qpos
        started = time.perf_counter()
        mujoco.mj_step(held.model, data, _STEPS)
        bare = max(bare, _STEPS / (time.perf_counter() - started))
    return {"ours": ours, "mujoco": bare, "ratio": ours / bare}
