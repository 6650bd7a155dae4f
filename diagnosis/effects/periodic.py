r"""Periodic in position: the gear's kinematic error and the motor's torque ripple.

    Delta = q_s + a sin(order angle + phase) - q          transmission-error; with dDelta/dq_s T_S at the motor and
                                                          -dDelta/dq T_S at the arm where the error does no work
    tau + a sin(order angle + phase)                      torque-ripple (cogging), or a share of tau
    a sin x + h_s sin 2x + h_c cos 2x + g_s sin 3x + g_c cos 3x for a sin x    either with two harmonics

Facts used as tests: at constant speed w the line stands at order w; the error cancels in the momentum balance of both
inertias, the ripple does not.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Literal

from jointscope.diagnosis import kernel
from jointscope.diagnosis.effects.lines import Residuals
from jointscope.diagnosis.effects.orders import PITCH, TRAVEL, order_lines
from jointscope.diagnosis.effects.spec import (
    ActiveEffect,
    Apply,
    EffectSpec,
    ParameterSpec,
    Possible,
    ResidualStarts,
    Starts,
    Values,
    always,
    needs_drive,
    needs_motor,
    needs_spring,
)

if TYPE_CHECKING:
    from jointscope.diagnosis.assembly import Assembly
    from jointscope.diagnosis.problem import Problem

_MOTOR_ORDERS = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 12.0)
_SLIDE_ORDERS = tuple(math.tau / pitch for pitch in (0.06, 0.03, 0.024, 0.016, 0.01))
_OUTPUT_ORDERS = (1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 39.0, 40.0)
TURNED = (0.0, math.tau / 3.0, -math.tau / 3.0)  # one of them is within 60 degrees of any phase


def harmonics(values: Values) -> tuple[tuple[float, float, float], ...]:
    """(amplitude, order, phase) of every line of ``amplitude, order, phase[, h_s, h_c, g_s, g_c]``."""
    amplitude, order, phase = values[:3]
    further = enumerate(zip(values[3::2], values[4::2], strict=True), start=2)
    return (
        (amplitude, order, phase),
        *(
            (math.hypot(sine, cosine), k * order, k * phase + math.atan2(cosine, sine))
            for k, (sine, cosine) in further
        ),
    )


def slower_lines(values: Values, k: int) -> tuple[Values, ...]:
    """Lines of which ``values`` is the ``k``-th harmonic and as strong, where they make whole periods in a turn.

    Whichever harmonic meets the joint's resonance is the loudest; fitted alone, its order leans towards what it stands in for.
    """
    amplitude, order, phase = values[:3]
    if round(order / k) < 1 or abs(order - k * round(order / k)) > max(WHOLE, FOUND_TO * order):
        return ()
    found = []
    for turn in PHASES:
        slower = [amplitude, order / k, turn, *[0.0] * len(HARMONICS)]
        ahead = phase - k * turn
        slower[2 * k - 1 : 2 * k + 1] = amplitude * math.cos(ahead), amplitude * math.sin(ahead)
        found.append(tuple(slower))
    return tuple(found)


def _error(per_output: bool) -> Apply:
    def apply(assembly: Assembly, values: Values, weight: float) -> None:
        for amplitude, order, phase in harmonics(values):
            per_motor, per_load = (0.0, order) if per_output else (order * assembly.ratio, 0.0)
            assembly.line(kernel.TE_0, kernel.N_TE, (amplitude, per_motor, per_load, phase))

    return apply


def _reacting(per_output: bool) -> Apply:
    def apply(assembly: Assembly, values: Values, weight: float) -> None:
        _error(per_output)(assembly, values, weight)
        assembly.P[kernel.TE_REACTS] = 1.0

    return apply


def _ripple(loaded: bool) -> Apply:
    def apply(assembly: Assembly, values: Values, weight: float) -> None:
        for amplitude, order, phase in harmonics(values):
            per_motor = order * assembly.ratio
            line = (0.0, amplitude, per_motor, phase) if loaded else (amplitude, 0.0, per_motor, phase)
            assembly.line(kernel.RIPPLE_0, kernel.N_RIPPLE, line)

    return apply


def _starts(orders: tuple[float, ...]) -> Starts:
    return lambda problem: tuple((order, phase) for order in orders for phase in TURNED)


def _found(per_output: bool, source: Literal["ripple", "error"]) -> ResidualStarts:
    def starts(problem: Problem, residuals: Residuals) -> tuple[Values, ...]:
        found = order_lines(problem, residuals, 3, per_output=per_output, source=source)
        return tuple((order, math.remainder(phase + turn, math.tau)) for order, phase in found for turn in TURNED)

    return starts


def of_the_motor(values: Values) -> bool:
    """Whether a line's order is whole: the motor's own field returns with every turn."""
    return round(values[1]) >= 1 and abs(values[1] - round(values[1])) < WHOLE


def _seen_whole(problem: Problem, values: Values) -> bool:
    """Whether the travel holds a period: less of one is a torque that is constant, or grows, and anyone's."""
    turn = problem.scales.travel * (problem.rig.reduction_ratio or 1.0)
    return values[1] * turn >= math.tau


def possible_line(*, spring: bool, per_output: bool) -> Possible:
    """Whether the travel shows what returns with every turn of the motor or of the output."""

    def possible(problem: Problem) -> str | None:
        reason = needs_motor(problem) if spring else needs_drive(problem)
        if reason is None and spring:
            reason = needs_spring(problem)
        turn = problem.scales.travel * (1.0 if per_output else problem.rig.reduction_ratio or 1.0)
        if reason is None and turn < 1.0:
            reason = f"the travel of {problem.scales.travel:.2g} rad is a small part of a turn"
        return reason

    return possible


def _of_a_slide(problem: Problem) -> str | None:
    """Whether a motor without turns moves far enough for its pitch to return."""
    if problem.rig.motion != "translational":
        return "the motor turns"
    if problem.scales.travel < TRAVEL:
        return f"the travel of {problem.scales.travel:.2g} m is a small part of a motor's pitch"
    return needs_drive(problem)


def _error_sizes(problem: Problem) -> tuple[float, float, float]:
    a = problem.scales.wind_up
    return 0.003 * a, 0.02 * a, 0.1 * a


def _ripple_sizes(problem: Problem) -> tuple[float, float, float]:
    t = problem.scales.motor_torque or problem.scales.torque
    return 0.003 * t, 0.015 * t, 0.06 * t


def _error_limits(problem: Problem) -> dict[str, tuple[float, float]]:
    top = max(
        2.0 * problem.scales.wind_up,
        KINEMATIC * (1.0 if problem.rig.motion == "rotational" else problem.scales.travel),
    )
    return {"amplitude": (0.0, top), **dict.fromkeys(HARMONICS, (-top, top))}


def _ripple_limits(problem: Problem) -> dict[str, tuple[float, float]]:
    top = 2.0 * (problem.scales.motor_torque or problem.scales.torque)
    return {"amplitude": (0.0, top), **dict.fromkeys(HARMONICS, (-top, top))}


PHASE = ParameterSpec("phase", "rad", -math.pi, math.pi)
SLIDE_ORDER = ParameterSpec("order", "per motor turn", 0.05, 2.0 * math.pi / PITCH, log=True, fineness=0.03)
MOTOR_ORDER = ParameterSpec("order", "per motor turn", 0.05, 200.0, log=True, fineness=0.03)
OUTPUT_ORDER = ParameterSpec("order", "per output turn", 0.2, 2000.0, log=True, fineness=0.03)
WHOLE = 0.06  # from a whole number, what an order may be off: the motor's own field returns with every turn
FOUND_TO = 0.003  # of an order, to which a line is found where its slower one is missing
HARMONIC = "-harmonic"  # behind the variant of a law that has them
HARMONICS = ("second_sine", "second_cosine", "third_sine", "third_cosine")  # amplitudes of their own
KINEMATIC = (
    2e-3  # rad, of a turn of the output or of a slide's travel, that gears may be off: seven minutes of arc
)
PHASES = tuple(k * math.pi / 3.0 for k in range(-2, 4))  # of a line whose order is known and whose phase is not
_LINES = ("transmission-error", "torque-ripple", "external-vibration")

_PLAIN: tuple[EffectSpec, ...] = (
    *(
        EffectSpec(
            name="transmission-error",
            location="transmission",
            variant=variant,
            family="periodic",
            parameters=(ParameterSpec("amplitude", "rad", 0.0, 1.0, null=0.0), order, PHASE),
            law="q_s + a sin(order angle + phase)",
            revealed_by=("speed-motion",),
            look_alikes=_LINES[1:],
            apply=_error(per_output),
            scale=_error_sizes,
            starts=_starts(orders),
            possible=possible_line(spring=True, per_output=per_output),
            limits=_error_limits,
            residual_starts=_found(per_output, "error"),
        )
        for variant, order, orders, per_output in (
            ("motor-order", MOTOR_ORDER, _MOTOR_ORDERS, False),
            ("output-order", OUTPUT_ORDER, _OUTPUT_ORDERS, True),
        )
    ),
    *(
        EffectSpec(
            name="torque-ripple",
            location="motor",
            variant=variant,
            family="periodic",
            parameters=(ParameterSpec("amplitude", "N m", 0.0, 1e9, null=0.0), order, PHASE),
            law="tau + a sin(order angle + phase)",
            revealed_by=("speed-motion",),
            look_alikes=(_LINES[0], _LINES[2]),
            apply=_ripple(loaded=False),
            scale=_ripple_sizes,
            starts=_starts(orders),
            possible=possible,
            limits=_ripple_limits,
            residual_starts=_found(False, "ripple"),
            sensible=sensible,
            sensible_at=_seen_whole,
        )
        for variant, order, orders, possible, sensible in (
            ("cogging", MOTOR_ORDER, _MOTOR_ORDERS, possible_line(spring=False, per_output=False), of_the_motor),
            ("pitch", SLIDE_ORDER, _SLIDE_ORDERS, _of_a_slide, always),
        )
    ),
    EffectSpec(
        name="torque-ripple",
        location="motor",
        variant="load-proportional",
        family="periodic",
        parameters=(ParameterSpec("share", "1", 0.0, 0.9, null=0.0), MOTOR_ORDER, PHASE),
        law="tau (1 + share sin(order angle + phase))",
        revealed_by=("speed-motion",),
        look_alikes=(_LINES[0], _LINES[2]),
        apply=_ripple(loaded=True),
        scale=lambda problem: (0.005, 0.02, 0.08),
        starts=_starts(_MOTOR_ORDERS),
        possible=possible_line(spring=False, per_output=False),
        residual_starts=_found(False, "ripple"),
        sensible=of_the_motor,
        sensible_at=_seen_whole,
    ),
)


def _with_harmonics(spec: EffectSpec) -> EffectSpec:
    """The law with its second and third harmonic: fitted from where the line alone was found, so one start is enough."""
    amplitude = spec.parameters[0]
    further = tuple(
        replace(amplitude, name=name, lower=-amplitude.upper, null=None, fineness=0.1) for name in HARMONICS
    )
    first = 2.0 if spec.variant.startswith("output-order") else 1.0
    return replace(
        spec,
        variant=f"{spec.variant}{HARMONIC}",
        parameters=(*spec.parameters, *further),
        proportional=tuple(range(3, 3 + len(HARMONICS))),
        law=spec.law.replace(
            "a sin(order angle + phase)",
            "a sin x + h_s sin 2x + h_c cos 2x + g_s sin 3x + g_c cos 3x, x = order angle + phase",
        ),
        starts=lambda problem: ((first, 0.0, *[0.0] * len(HARMONICS)),),
        residual_starts=None,
    )


def _without_work(spec: EffectSpec) -> EffectSpec:
    """The error as gears make it, which store no more than the spring does; fitted from where the line alone was found."""
    per_output = spec.variant == "output-order"
    return replace(
        spec, variant=f"{spec.variant}-reacting", apply=_reacting(per_output),
        law=f"{spec.law}, with dDelta/dq_s T_S at the motor, -dDelta/dq T_S at the arm",
        starts=lambda problem: ((2.0 if per_output else 1.0, 0.0),), residual_starts=None,
    )  # fmt: skip


_REACTING = tuple(_without_work(spec) for spec in _PLAIN if spec.name == "transmission-error")
SPECS: tuple[EffectSpec, ...] = (
    *_PLAIN,
    *_REACTING,
    *(_with_harmonics(spec) for spec in (*_PLAIN, *_REACTING) if spec.variant != "load-proportional"),
)


def turn_of(active: ActiveEffect) -> str:
    """Of what a line's order counts the turns; empty for what is no line."""
    return next((p.unit for p in active.spec.parameters if p.name == "order"), "")


def counted_alike(trial: ActiveEffect, leader: ActiveEffect, ratio: float) -> ActiveEffect:
    """The trial with the leader's order per turn of what the trial counts: a line of a gear is found by either count."""
    mine, theirs = turn_of(trial), turn_of(leader)
    if not (mine and theirs) or mine == theirs:
        return trial
    place = [p.name for p in trial.spec.parameters].index("order")
    order = leader.values[[p.name for p in leader.spec.parameters].index("order")]
    values = list(trial.values)
    values[place] = order * ratio if mine == OUTPUT_ORDER.unit else order / ratio
    return ActiveEffect(trial.spec, tuple(values))
