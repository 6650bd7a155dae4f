r"""Physics that the diagnosis contract's table does not hold, and that one of its effects would be named for.

    T_S = K (1 + s sin(order angle + phase)) Delta       teeth or rollers that share the load by turns
    T_S = K Delta + (c + d |Delta|) Delta'                contacts that rub the more the further they are wound up
    motor held by a brake that slips above a torque       hits only
    tau = eta n T_e (1 - s h), t h' = (T_e/T_0)^2 - h     a torque constant that falls as the motor warms within a run
    tau - c exp(-E/t) q_s', E' = (q_s'/v_0)^2             grease that thins as it is worked, cold where a run begins
    -k d (1 - a + a d^2/w^2) on the arm, d = q - q_0              hoses and cables beside the joint, straight between nine nodes
    -k d - r k (d - z), t z' = d - z                      the same where they creep, z = d where a run begins

They compete as single effects only; where one of them leads, the answer is ``unknown``, and says what it resembles. They
have no counterpart in the MuJoCo model.

Fact used as test: a brake that never slips is a held motor.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from jointscope.diagnosis import kernel
from jointscope.diagnosis.assembly import BASE_INDEX
from jointscope.diagnosis.effects.latent import node_range
from jointscope.diagnosis.effects.periodic import MOTOR_ORDER, OUTPUT_ORDER, PHASE, TURNED, possible_line
from jointscope.diagnosis.effects.postures import APART
from jointscope.diagnosis.effects.spec import (
    Apply,
    EffectSpec,
    ParameterSpec,
    Possible,
    Values,
    needs_motor,
    needs_motor_torque,
    needs_spring,
    needs_travel,
    one_start,
)

if TYPE_CHECKING:
    from jointscope.diagnosis.assembly import Assembly
    from jointscope.diagnosis.problem import Problem

WARMING = (1.0, 4.0)  # s, time constants that are tried
THINS = (0.5, 3.0)  # s at half the largest speed, after which a third is left of what cold grease drags more
_HITS = ("hammer", "torque-sweep")
CREEPS = (0.2, 1.0)  # s in which hoses and cables let go of what they pull when turned
POSTURES = 4  # of the arm, in which a stiffness that varies with its angle is told from two of its numbers
TURNS = (1.0, 2.0, 3.0, 4.0)  # periods in a turn, where no leading effect says how many


def _turning(per_output: bool) -> Apply:
    def apply(assembly: Assembly, values: Values, weight: float) -> None:
        P, (share, order, phase) = assembly.P, values
        P[kernel.PAR_SHARE], P[kernel.PAR_PHASE] = share, phase
        P[kernel.PAR_MOTOR] = 0.0 if per_output else order * assembly.ratio
        P[kernel.PAR_LOAD] = order if per_output else 0.0

    return apply


def _rubbing(assembly: Assembly, values: Values, weight: float) -> None:
    assembly.P[kernel.RUB] = values[0]


def _slipping(assembly: Assembly, values: Values, weight: float) -> None:
    P, S = assembly.P, assembly.S
    if S[kernel.MOTOR] != kernel.MOTOR_HELD or not assembly.run.spring:
        return
    S[kernel.MOTOR], S[kernel.FRICTION_M] = kernel.MOTOR_FREE, 1
    P[kernel.FM_PLUS] = P[kernel.FM_MINUS] = values[0]


def _warming(assembly: Assembly, values: Values, weight: float) -> None:
    assembly.chain.heat = values[0], values[1]


def _thinning(assembly: Assembly, values: Values, weight: float) -> None:
    assembly.chain.thinning = values[0], values[1]


def _turned_through(*, per_output: bool) -> Possible:
    """Whether motions turn far enough, or hits and sweeps were made in enough postures of the output."""
    in_motion = possible_line(spring=True, per_output=per_output)

    def possible(problem: Problem) -> str | None:
        angles = sorted(r.initial_angle for r in problem.runs if r.spring and r.run.experiment != "speed-motion")
        apart = [b for a, b in pairwise(angles) if b - a > APART]
        met = problem.rig.motion == "rotational" and len(apart) + 1 >= POSTURES
        return needs_spring(problem) if per_output and met else in_motion(problem)

    return possible


def _dressed(assembly: Assembly, values: Values, weight: float) -> None:
    low, high = node_range(assembly.problem, "load", "angle")
    P, S, (stiffness, taut, rest) = assembly.P, assembly.S, values
    P[kernel.TABLE_LOW], P[kernel.TABLE_STEP] = low, (high - low) / (kernel.N_NODES - 1)
    turned = np.linspace(low, high, kernel.N_NODES) - rest
    growing = 1.0 - taut + taut * (turned / _half_travel(assembly.problem)) ** 2
    P[kernel.TABLE_0 : kernel.TABLE_0 + kernel.N_NODES] = -stiffness * turned * growing
    S[kernel.TABLE_SITE], S[kernel.TABLE_OF] = kernel.AT_LOAD, kernel.OF_ANGLE


def _creeping(assembly: Assembly, values: Values, weight: float) -> None:
    stiffness, ratio, time_constant, rest = values
    _dressed(assembly, (stiffness, 0.0, rest), weight)
    assembly.chain.relaxing = ratio * stiffness, time_constant


def _half_travel(problem: Problem) -> float:
    return max(0.5 * (problem.scales.angle_high - problem.scales.angle_low), 1e-9)


def _dress_sizes(problem: Problem) -> tuple[float, float, float]:
    unit = problem.scales.motor_torque / _half_travel(problem)
    return 0.005 * unit, 0.03 * unit, 0.15 * unit


def _at_rest(problem: Problem) -> tuple[tuple[float, float], ...]:
    starts = sorted({round(run.initial_angle, 3) for run in problem.runs})
    return tuple((taut, angle) for angle in (starts[0], starts[-1])[: len(starts)] for taut in (0.0, 0.8))


def _creeps_from(problem: Problem) -> tuple[tuple[float, float, float], ...]:
    angles = sorted({angle for _, angle in _at_rest(problem)})
    return tuple((1.0, time_constant, angle) for angle in angles for time_constant in CREEPS)


def _needs_driven_travel(problem: Problem) -> str | None:
    return needs_travel(problem) or needs_motor_torque(problem)


def _needs_crept_travel(problem: Problem) -> str | None:
    return _needs_driven_travel(problem) or _needs_followed_motions(problem)


def _needs_runs_of_torque(problem: Problem) -> str | None:
    reason = needs_motor(problem) or needs_motor_torque(problem)
    if reason is None and problem.scales.duration < WARMING[0]:
        return "no run is long enough for a motor to warm"
    return reason


def _needs_followed_motions(problem: Problem) -> str | None:
    if any(run.motor_moves and run.observed is not None and not run.observed.commanded for run in problem.runs):
        return needs_motor_torque(problem)
    return "no run follows what it drives by its log"


def _cold_sizes(problem: Problem) -> tuple[float, float, float]:
    unit = problem.scales.motor_torque / max(problem.scales.motor_speed, 1e-12)
    return 0.005 * unit, 0.03 * unit, 0.15 * unit


def _rubbing_sizes(problem: Problem) -> tuple[float, float, float]:
    unit = float(problem.base.start[BASE_INDEX["damping"]]) / max(problem.scales.wind_up, 1e-12)
    return 0.1 * unit, 0.6 * unit, 3.0 * unit


def _slip_sizes(problem: Problem) -> tuple[float, float, float]:
    t = problem.scales.torque
    return 0.9 * t, 0.6 * t, 0.3 * t


def _hit_on_the_brake(problem: Problem) -> str | None:
    reason = needs_spring(problem)
    if reason is None and not any(run.mode == "braked" for run in problem.runs):
        return "no run was made on the brake"
    return reason


SPECS: tuple[EffectSpec, ...] = (
    *(
        EffectSpec(
            name="stiffness-by-turn",
            location="transmission",
            variant=variant,
            family="periodic",
            parameters=(ParameterSpec("share", "1", 0.0, 0.9, null=0.0), order, PHASE),
            law="a stiffness that varies with every turn, K (1 + share sin(order angle + phase))",
            revealed_by=("speed-motion",),
            look_alikes=("transmission-error", "torque-ripple"),
            apply=_turning(per_output),
            scale=lambda problem: (0.003, 0.02, 0.1),
            starts=lambda problem: tuple((turns, phase) for turns in TURNS for phase in TURNED),
            possible=_turned_through(per_output=per_output),
        )
        for variant, order, per_output in (
            ("motor-order", MOTOR_ORDER, False),
            ("output-order", OUTPUT_ORDER, True),
        )
    ),
    EffectSpec(
        name="rubbing",
        location="transmission",
        variant="by-wind-up",
        family="stiffness",
        parameters=(ParameterSpec("coefficient", "N m s/rad^2", 0.0, 1e15, null=0.0),),
        law="a damping that grows with the wind-up, (c + d |Delta|) Delta'",
        revealed_by=_HITS,
        look_alikes=("hysteresis", "structural-damping", "quadratic-damping"),
        apply=_rubbing,
        scale=_rubbing_sizes,
        starts=one_start,
        possible=needs_spring,
    ),
    EffectSpec(
        name="warming",
        location="motor",
        variant="by-torque-squared",
        family="input",
        parameters=(
            ParameterSpec("share", "1", 0.0, 0.9, null=0.0),
            ParameterSpec("time_constant", "s", 0.1, 1e3, log=True),
        ),
        law="a torque constant that falls as the motor warms, eta n T_e (1 - share h)",
        revealed_by=("torque-sweep", "speed-motion"),
        look_alikes=("torque-gain", "payload", "load-dependent-friction"),
        apply=_warming,
        scale=lambda problem: (0.01, 0.05, 0.2),
        starts=lambda problem: tuple((time,) for time in WARMING),
        possible=_needs_runs_of_torque,
    ),
    EffectSpec(
        name="thinning",
        location="motor",
        variant="as-worked",
        family="dissipative",
        parameters=(
            ParameterSpec("coefficient", "N m s/rad", 0.0, 1e12, null=0.0),
            ParameterSpec("time_constant", "s", 0.05, 1e3, log=True),
        ),
        law="a viscous friction that falls as the grease is worked, cold where a run begins",
        revealed_by=("speed-motion",),
        look_alikes=("coulomb-friction", "stribeck-friction", "torque-gain"),
        apply=_thinning,
        scale=_cold_sizes,
        starts=lambda problem: tuple((time,) for time in THINS),
        possible=_needs_followed_motions,
    ),
    EffectSpec(
        name="dress-pack",
        location="load",
        variant="to-ground",
        family="external",
        parameters=(
            ParameterSpec("stiffness", "N m/rad", -1e12, 1e12, null=0.0),
            ParameterSpec("taut", "1", -1.0, 1.5),
            ParameterSpec("rest", "rad", -20.0, 20.0),
        ),
        law="hoses or cables that pull the arm to where they hang free, k d (1 - taut + taut (d/w)^2), w the half travel",
        revealed_by=("speed-motion",),
        look_alikes=("gravity", "end-stop"),
        apply=_dressed,
        scale=_dress_sizes,
        starts=_at_rest,
        possible=_needs_driven_travel,
    ),
    EffectSpec(
        name="dress-pack",
        location="load",
        variant="creeping",
        family="external",
        parameters=(
            ParameterSpec("stiffness", "N m/rad", -1e12, 1e12, null=0.0),
            ParameterSpec("relaxing", "1", 0.0, 20.0),
            ParameterSpec("time_constant", "s", 0.02, 50.0, log=True),
            ParameterSpec("rest", "rad", -20.0, 20.0),
        ),
        law="hoses or cables that pull the arm to where they hang free and creep, k d + r k (d - z), t z' = d - z",
        revealed_by=("speed-motion",),
        look_alikes=("gravity", "end-stop", "hysteresis", "stribeck-friction"),
        apply=_creeping,
        scale=_dress_sizes,
        starts=_creeps_from,
        possible=_needs_crept_travel,
    ),
    EffectSpec(
        name="brake-slip",
        location="motor",
        variant="dry",
        family="dissipative",
        parameters=(ParameterSpec("torque", "N m", 1e-9, 1e12, log=True, null=math.inf),),
        law="a brake that slips above a torque",
        revealed_by=("hammer",),
        look_alikes=("hysteresis", "quadratic-damping", "stiffness-nonlinearity"),
        apply=_slipping,
        scale=_slip_sizes,
        starts=one_start,
        possible=_hit_on_the_brake,
    ),
)
