r"""What returns with every turn of a driven joint's motor: its torque ripple and the reducer's kinematic error.

    tau + a sin(order n s + phase)                       torque-ripple
    T_S(s - y + e), e = a sin(order n s + phase)         transmission-error; with T_S (1 + de/ds) at the motor where it
                                                         does no work

n s is the motor's own angle, as recorded where an encoder says it; the angle at which a run begins moves the phase only.

Facts used as tests: at constant speed w the line stands at order w; an error that does no work leaves the energy alone.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from jointscope.diagnosis.arm import kernel
from jointscope.diagnosis.arm.law import Put, arm_law
from jointscope.diagnosis.effects.periodic import KINEMATIC, MOTOR_ORDER, PHASE, TURNED, of_the_motor
from jointscope.diagnosis.effects.spec import EffectSpec, ParameterSpec, Values

if TYPE_CHECKING:
    from jointscope.diagnosis.arm.predict import ArmAssembly
    from jointscope.diagnosis.arm.problem import ArmProblem, ArmRun

ORDERS = (1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0)  # per motor turn, tried
SHORTEST = 1.0  # motor turn that a run must make


def lines(problem: ArmProblem, joint: int, reach: float) -> list[EffectSpec]:
    """The laws of a driven joint whose motor turns in some run.

    Args:
        joint: Place of the joint in the arm.
        reach: Torque that its motor is seen to give [N m].
    """
    turns = [float(np.ptp(r.path)) * r.ratio / math.tau for r in problem.arm_runs if r.driven == joint]
    if max(turns, default=0.0) < SHORTEST:
        return []
    name, wind_up = problem.facts.joints[joint], max(float(problem.wind_up[joint]), 1e-9)
    starts = tuple((order, phase) for order in ORDERS for phase in TURNED)

    def at(amplitude_at: int, order_at: int, phase_at: int) -> Put:
        """What puts a line into these columns of the joint's row, in the runs that drive it."""

        def put(assembly: ArmAssembly, values: Values) -> None:
            run, (amplitude, order, phase) = assembly.run, values
            if run.driven == joint:
                row = assembly.P[joint]
                row[amplitude_at], row[order_at] = amplitude, order * run.ratio
                row[phase_at] = phase + order * _begins(run)

        return put

    put_error = at(kernel.ERROR, kernel.ERROR_ORDER, kernel.ERROR_PHASE)

    def put_reacting(assembly: ArmAssembly, values: Values) -> None:
        put_error(assembly, values)
        assembly.P[joint, kernel.ERROR_REACTS] = 1.0

    ripple = arm_law(
        "torque-ripple", "motor", name, "cogging", "periodic",
        (ParameterSpec("amplitude", "N m", 0.0, 2.0 * reach, null=0.0), MOTOR_ORDER, PHASE),
        at(kernel.RIPPLE, kernel.RIPPLE_ORDER, kernel.RIPPLE_PHASE), "tau + a sin(order angle + phase)",
        (0.003 * reach, 0.015 * reach, 0.06 * reach), starts, ("speed-motion",),
        ("transmission-error",),
    )  # fmt: skip
    error = [
        arm_law(
            "transmission-error", "transmission", name, variant, "periodic",
            (ParameterSpec("amplitude", "rad", 0.0, KINEMATIC, null=0.0), MOTOR_ORDER, PHASE), put,
            law, (0.005 * wind_up, 0.03 * wind_up, 0.15 * wind_up), starts, ("speed-motion",), ("torque-ripple",),
        )
        for variant, put, law in (
            ("motor-order", put_error, "s + a sin(order angle + phase)"),
            ("motor-order-reacting", put_reacting, "s + a sin(order angle + phase), with T_S (1 + de/ds) at the motor"),
        )
    ]  # fmt: skip
    return [replace(ripple, sensible=of_the_motor), *error]


def _begins(run: ArmRun) -> float:
    """The motor's angle at the start of a run [rad]: recorded, or the joint's by the posture."""
    recorded = next((o.offset for o in run.outputs if o.observed), None)
    return run.ratio * run.initial_angle if recorded is None else recorded
