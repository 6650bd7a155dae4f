"""The same outputs from MuJoCo, through the simulator's own stepping: slower, for checking the closed form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from jointscope.experiments.sensitivity import outputs
from jointscope.models.paper import paper_rig
from jointscope.models.parameters import Joint
from jointscope.models.rig import brake, rig_spec
from jointscope.sim.stepping import Machine, machine, stack_inputs, step

Array = NDArray[np.float64]

RATE = 16384.0  # [Hz], of the stepping; both sampling rates divide it, so nothing is interpolated


def _arm_acceleration(model: Machine, actuator: str, drive: Array, rate: float) -> Array:
    trace = step(model, np.zeros(model.model.nq), stack_inputs(model, {actuator: drive}, len(drive)))
    return outputs.ACCELEROMETER_RADIUS * trace.signals["arm acceleration"][:: int(RATE / rate)]


def evaluate_mujoco(nominal: Joint, names: tuple[str, ...], values: Array) -> dict[str, Array]:
    """As ``outputs.evaluate``, with the accelerations stepped by MuJoCo (no gravity, as in the closed form)."""
    table = outputs.evaluate(nominal, names, values)
    force = outputs.hammer_force(np.arange(int(outputs.HAMMER_RECORD * RATE)) / RATE)
    torque = outputs.sweep_torque(np.arange(int(outputs.SWEEP_RECORD * RATE)) / RATE)
    hits, sweeps = [], []
    for row in values:
        joint = replace(nominal, **dict(zip(names, (float(value) for value in row), strict=True)))
        rig = replace(
            paper_rig(), joint=joint, gravity=0.0, arm_com_radius=0.0, hammer_radius=outputs.HAMMER_RADIUS
        )
        spec = rig_spec(rig)
        hits.append(_arm_acceleration(machine(brake(spec, 0.0), 1 / RATE), "hammer", force, outputs.HAMMER_RATE))
        sweeps.append(_arm_acceleration(machine(spec, 1 / RATE), "motor", torque, outputs.SWEEP_RATE))
    hit, swept = np.array(hits), np.array(sweeps)
    return table | {
        "hammer_peak": np.max(np.abs(hit), axis=-1),
        "hammer_band_rms": outputs.band_rms(hit, outputs.HAMMER_RATE, outputs.HAMMER_BAND),
        "sweep_peak": np.max(np.abs(swept), axis=-1),
        "sweep_band_rms": outputs.band_rms(swept, outputs.SWEEP_RATE, outputs.SWEEP_BAND),
    }
