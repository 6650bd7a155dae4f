r"""Between the logged torque and the shaft: the current loop's lag, and a torque constant or efficiency that is off.

    tau = eta n T_e / (1 + s tau_e)          drive-lag, or two or three such stages of a part of the time
    tau = eta n T_e / (1 + s tau_e + (s tau_e / 2 zeta)^2)     a current loop, tuned to the magnitude optimum: zeta^2 = 1/2
    tau = gain eta n T_e                     torque-gain

Facts used as tests: the lag's gain is 1/sqrt(1 + (w tau_e)^2), a gain scales a linear response exactly.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from jointscope.diagnosis.assembly import BASE_INDEX
from jointscope.diagnosis.effects.spec import (
    Apply,
    EffectSpec,
    ParameterSpec,
    Values,
    beyond_calibration,
    needs_motor_torque,
    one_start,
    outlasts_a_cycle,
)

if TYPE_CHECKING:
    from jointscope.diagnosis.assembly import Assembly
    from jointscope.diagnosis.problem import Problem


def _lag(stages: int) -> Apply:
    def apply(assembly: Assembly, values: Values, weight: float) -> None:
        if values[0] > 0.0:
            assembly.chain.lags += (values[0] / stages,) * stages

    return apply


def _loop(assembly: Assembly, values: Values, weight: float) -> None:
    if values[0] > 0.0:
        assembly.chain.loop = values[0]
    if len(values) > 1:
        assembly.chain.loop_damping = values[1]


def _gain(assembly: Assembly, values: Values, weight: float) -> None:
    assembly.chain.torque_gain *= values[0]


def _lag_possible(problem: Problem) -> str | None:
    return needs_motor_torque(problem)


def _gain_possible(problem: Problem) -> str | None:
    reason = needs_motor_torque(problem)
    if reason is not None:
        return reason
    free = problem.base.free
    if free[BASE_INDEX["torque_scale"]] or free[BASE_INDEX["efficiency"]]:
        return "the torque's scale is not on the nameplate, so it is a parameter"
    if not all(run.motor.calibrated for run in problem.runs if run.motor is not None):
        return "the torque is not calibrated"
    hit = any(run.load is not None and run.load.calibrated for run in problem.runs)
    exact = any(run.motor_moves for run in problem.runs) and not free[BASE_INDEX["motor_inertia"]]
    weighed = problem.rig.plane == "vertical" and not free[BASE_INDEX["gravity_moment"]]
    if not (hit or exact or (weighed and problem.base.start[BASE_INDEX["gravity_moment"]] != 0.0)):
        return "no absolute inertia, force or weight is known beside the torque"
    return None


SPECS: tuple[EffectSpec, ...] = (
    *(
        EffectSpec(
            name="drive-lag",
            location="motor",
            variant=variant,
            family="input",
            parameters=(ParameterSpec("time_constant", "s", 0.0, 0.02, null=0.0), *further),
            law=law,
            revealed_by=("torque-sweep", "speed-motion"),
            look_alikes=("delay", "torque-logging", "sensor-resonance"),
            apply=apply,
            scale=lambda problem: (1e-4, 5e-4, 2e-3),
            starts=starts,
            holds=("torque_age",),
            sensible=outlasts_a_cycle,
            possible=_lag_possible,
        )
        for variant, apply, law, further, starts in (
            ("first-order", _lag(1), "tau = eta n T_e / (1 + s tau_e)", (), one_start),
            ("second-order", _lag(2), "tau = eta n T_e / (1 + s tau_e/2)^2", (), one_start),
            ("third-order", _lag(3), "tau = eta n T_e / (1 + s tau_e/3)^3", (), one_start),
            ("magnitude-optimum", _loop, "tau = eta n T_e / (1 + s tau_e + s^2 tau_e^2/2)", (), one_start),
            (
                "damped-loop",
                _loop,
                "tau = eta n T_e / (1 + s tau_e + (s tau_e / 2 damping)^2)",
                (ParameterSpec("damping", "1", 0.3, 3.0, log=True),),
                lambda problem: ((0.85,),),
            ),
        )
    ),
    EffectSpec(
        name="torque-gain",
        location="motor",
        variant="constant",
        family="input",
        parameters=(ParameterSpec("gain", "1", 0.3, 3.0, null=1.0),),
        law="tau = gain eta n T_e",
        revealed_by=("torque-sweep", "speed-motion"),
        look_alikes=("load-dependent-friction", "sensor-gain", "payload"),
        apply=_gain,
        scale=lambda problem: (1.01, 1.05, 1.15),
        sensible=beyond_calibration,
        starts=one_start,
        possible=_gain_possible,
    ),
)
