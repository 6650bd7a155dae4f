r"""Faults of an arm's recording that a joint would else be blamed for.

sensor-gain         accelerometers times gain, all or those of one seat
sensor-resonance    behind w^2/(s^2 + 2 zeta w s + w^2) of their own mounts, likewise
sensor-saturation   clipped at a level, likewise
delay               a late log of the drive
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from jointscope.diagnosis.arm.law import Put, arm_law
from jointscope.diagnosis.arm.problem import ArmProblem
from jointscope.diagnosis.effects.lines import Residuals, response_peaks
from jointscope.diagnosis.effects.spec import EffectSpec, ParameterSpec, Values

if TYPE_CHECKING:
    from jointscope.diagnosis.arm.predict import ArmAssembly
    from jointscope.diagnosis.problem import Problem

MOST_SEATS = 4  # of accelerometers, beyond which no one's fault is looked for
SLOWEST_SEAT = 60.0  # Hz of an accelerometer's own mount: nobody sticks it on more softly than what it is to show


def recorder_faults(problem: ArmProblem) -> list[EffectSpec]:
    """Faults of the recording that a joint would else be blamed for."""
    found = []
    if any(r.late_motor or any(o.device != 0 for o in r.outputs) for r in problem.arm_runs):

        def put_delay(assembly: ArmAssembly, values: Values) -> None:
            assembly.late = values[0]

        found.append(
            arm_law(
                "delay", "acquisition", None, "constant", "sensor-time",
                (ParameterSpec("delay", "s", -0.02, 0.02, null=0.0),), put_delay, "the drive's log stamps late",
                (2e-4, 1e-3, 4e-3), ((),), ("torque-sweep",), ("drive-lag",),
            )
        )  # fmt: skip

    def gain(put: Put, law: str, variant: str) -> EffectSpec:
        return arm_law(
            "sensor-gain", "acquisition", None, variant, "sensor-gain",
            (ParameterSpec("gain", "1", 0.5, 1.8, null=1.0),), put, law, (1.01, 1.05, 1.2), ((),),
            ("hammer", "torque-sweep"), ("torque-gain",),
        )  # fmt: skip

    def put_all(assembly: ArmAssembly, values: Values) -> None:
        assembly.readings = values[0]

    def put_one(seat: str) -> Put:
        def put(assembly: ArmAssembly, values: Values) -> None:
            assembly.one_of[seat] = values[0]

        return put

    seats = sorted({seat for r in problem.arm_runs for seat in r.sensors})
    if seats:
        found.append(gain(put_all, "accelerations times gain", "factor"))
        found.extend([_ringing(problem, ""), _clipping(problem, "")])
    if 1 < len(seats) <= MOST_SEATS:
        found.extend(gain(put_one(s), f"times gain, of the accelerometer on {s}", f"factor, {s}") for s in seats)
        found.extend(_ringing(problem, s) for s in seats)
        found.extend(_clipping(problem, s) for s in seats)
    return found


def _ringing(problem: ArmProblem, seat: str) -> EffectSpec:
    rate = max(o.rate for r in problem.arm_runs for o, p in zip(r.outputs, r.probes, strict=True) if p >= 0)

    def put(assembly: ArmAssembly, values: Values) -> None:
        if math.isfinite(values[0]):
            assembly.ringing[seat] = values[0], values[1]

    def peaks(problem: Problem, residuals: Residuals) -> tuple[Values, ...]:
        found = response_peaks(problem, residuals, SLOWEST_SEAT, 0.45 * rate, 3)
        return tuple((f, damping) for f in found for damping in (0.02, 0.1))

    spec = arm_law(
        "sensor-resonance", "acquisition", None, "mount" + (f", {seat}" if seat else ""), "sensor-gain",
        (
            ParameterSpec("frequency", "Hz", SLOWEST_SEAT, 20.0 * rate, log=True, null=math.inf),
            ParameterSpec("damping", "1", 0.003, 1.5, log=True),
        ), put, "w^2/(s^2 + 2 zeta w s + w^2)" + (f", of the accelerometer on {seat}" if seat else ""),
        (rate, 0.45 * rate, 0.2 * rate), ((0.05,), (0.3,)), ("hammer", "torque-sweep"), ("delay", "neighbour-flexibility"),
    )  # fmt: skip
    return replace(spec, residual_starts=peaks)


def _clipping(problem: ArmProblem, seat: str) -> EffectSpec:
    peak = max(
        float(np.max(np.abs(o.data)))
        for r in problem.arm_runs
        for o, p in zip(r.outputs, r.probes, strict=True)
        if p >= 0 and o.data.size and seat in ("", r.sensors[p])
    )

    def put(assembly: ArmAssembly, values: Values) -> None:
        if math.isfinite(values[0]):
            assembly.levels[seat] = values[0]

    variant, of_one = ("clip, " + seat, f", of the accelerometer on {seat}") if seat else ("clip", "")
    return arm_law(
        "sensor-saturation", "acquisition", None, variant, "sensor-gain",
        (ParameterSpec("level", "m/s^2", 0.01 * peak, 1.5 * peak, log=True, null=math.inf),), put,
        "clip(y, +-level)" + of_one, (0.97 * peak, 0.75 * peak, 0.45 * peak), ((),), ("hammer", "torque-sweep"),
        ("stiffness-nonlinearity",),
    )  # fmt: skip
