r"""The recording devices: one stamps late, one's clock runs fast, a slow log holds or averages the torque.

    what happened at t is stamped (t + delay)(1 + ppm 1e-6) by the device that is not the DAQ
    where one device reads two encoders one after the other, q_s(t) - q(t - delay) is written for the wind-up

Facts used as tests: a delay's phase is -w delay with gain 1; at a speed v, an encoder read late adds v delay to the
wind-up; a drift of d ppm shifts the end of a run of length T by d T; averaging over 1/rate has the gain sinc(f/rate) and
half that interval of delay, and is undone below rate/2; a ripple at f, logged at r without a filter, is a line at |f - k r|.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from jointscope.diagnosis.effects.spec import (
    Apply,
    EffectSpec,
    ParameterSpec,
    Values,
    needs_motor_torque,
    needs_two_clocks,
    one_start,
    outlasts_a_cycle,
)
from jointscope.diagnosis.folded import folded_line
from jointscope.diagnosis.wind_up import WIND_UP

if TYPE_CHECKING:
    from jointscope.diagnosis.assembly import Assembly
    from jointscope.diagnosis.problem import Problem


def _delay(assembly: Assembly, values: Values, weight: float) -> None:
    assembly.chain.delay += values[0]


def _encoder_delay(assembly: Assembly, values: Values, weight: float) -> None:
    assembly.chain.encoder_delay += values[0]


def _needs_two_encoders(problem: Problem) -> str | None:
    """One device read the angles on either side of the transmission."""
    if any(output.quantity == WIND_UP for run in problem.runs for output in run.outputs):
        return None
    return "no device read the motor's angle and the arm's"


def _drift(assembly: Assembly, values: Values, weight: float) -> None:
    assembly.chain.clock += values[0] * 1e-6


def _logging(kind: str) -> Apply:
    def apply(assembly: Assembly, values: Values, weight: float) -> None:
        assembly.chain.log_rate, assembly.chain.log_kind = values[0], kind
        assembly.chain.log_age = values[1] if len(values) > 1 else 0.0

    return apply


def _folding(assembly: Assembly, values: Values, weight: float) -> None:
    assembly.chain.log_rate, assembly.chain.log_kind = values[0], "folded"
    assembly.chain.log_line, assembly.chain.log_age = values[1], values[2]


def _folded(problem: Problem) -> float:
    """Frequency of a line that the torque logs have in common [Hz]; 0 without one."""
    logs = [run.motor for run in problem.runs if run.motor is not None and run.motor_moves]
    return folded_line([(log.samples, log.signal.rate) for log in logs])


def _log_rate(problem: Problem) -> float:
    return min((run.motor.signal.rate for run in problem.runs if run.motor is not None), default=500.0)


def _rates(problem: Problem) -> tuple[float, float, float]:
    rate = _log_rate(problem)
    return 1.5 * rate, 0.7 * rate, 0.3 * rate


def _held_rates(problem: Problem) -> tuple[float, float, float]:
    rate = _log_rate(problem)
    return 0.7 * rate, 0.5 * rate, 0.25 * rate


def _seen_rates(problem: Problem) -> tuple[float, float, float]:
    seen = _refreshed(problem) or 0.5 * _log_rate(problem)
    return seen, seen, seen


def _refreshed(problem: Problem) -> float:
    """Rate at which the torque log is seen to repeat its values [Hz]; 0 where it doesn't."""
    return min((run.motor.held for run in problem.runs if run.motor is not None and run.motor.held), default=0.0)


def _log_limits(problem: Problem) -> dict[str, tuple[float, float]]:
    rate, seen = _log_rate(problem), _refreshed(problem)
    if not seen:
        return {"rate": (0.02 * rate, 20.0 * rate)}
    return {"rate": ((1.0 - SEEN) * seen, (1.0 + SEEN) * seen), "age": (-1.0 / rate, 1.0 / rate)}


def _half_a_sample(problem: Problem) -> tuple[Values, ...]:
    half = 0.5 / _log_rate(
        problem
    )  # older: read between two updates; younger: a drive holds its torque for a cycle
    return (half,), (-half,)


def _needs_repeats(problem: Problem) -> str | None:
    return needs_motor_torque(problem) or (
        None if _refreshed(problem) else "the torque log does not repeat its values"
    )


def _needs_no_repeats(problem: Problem) -> str | None:
    return needs_motor_torque(problem) or ("the torque log repeats its values" if _refreshed(problem) else None)


def _drifts(problem: Problem) -> tuple[float, float, float]:
    duration = max(problem.scales.duration, 0.1)
    return 30.0 / duration, 300.0 / duration, 2000.0 / duration


def _own_rates(problem: Problem) -> tuple[float, float, float]:
    rate = _log_rate(problem)
    return rate, rate, rate


def _at_the_line(problem: Problem) -> tuple[Values, ...]:
    return ((_folded(problem), 0.0),)


def _line_limits(problem: Problem) -> dict[str, tuple[float, float]]:
    rate, line = _log_rate(problem), _folded(problem)
    return {"rate": ((1.0 - EXACT) * rate, (1.0 + EXACT) * rate), "line": (line - NEAR_LINE, line + NEAR_LINE)}


def _needs_a_line(problem: Problem) -> str | None:
    return needs_motor_torque(problem) or (
        None if _folded(problem) > 0.0 else "the torque logs have no line in common"
    )


HALF_A_CYCLE = 5e-4  # s; what is read at an instant, a drive holds for a cycle of a millisecond at most
EXACT = 1e-6  # of a log's own rate, which its file states
NEAR_LINE = 0.1  # Hz, within which a line's frequency is read off the logs
_AGE = ParameterSpec("age", "s", -1.0, 1.0)
SEEN = 0.001  # of the rate at which a log is seen to be refreshed, within which it is held there
_TIMING = ("drive-lag", "delay", "torque-logging", "sensor-resonance")

SPECS: tuple[EffectSpec, ...] = (
    *(
        EffectSpec(
            name="delay",
            location="acquisition",
            variant=variant,
            family="sensor-time",
            exact=True,
            parameters=(ParameterSpec("delay", "s", -0.05, 0.05, null=0.0),),
            law=law,
            revealed_by=("torque-sweep", "speed-motion"),
            look_alikes=look_alikes,
            apply=apply,
            scale=lambda problem: (1e-4, 5e-4, 2e-3),
            starts=one_start,
            holds=holds,
            sensible=outlasts_a_cycle,
            possible=possible,
        )
        for variant, law, look_alikes, apply, holds, possible in (
            (
                "constant",
                "stamped t + delay by the device that is not the DAQ",
                tuple(name for name in _TIMING if name != "delay"),
                _delay,
                ("torque_age",),
                needs_two_clocks,
            ),
            (
                "encoder",
                "the arm's encoder read at t - delay when the motor's is at t",
                ("clock-drift",),
                _encoder_delay,
                (),
                _needs_two_encoders,
            ),
        )
    ),
    EffectSpec(
        name="clock-drift",
        location="acquisition",
        variant="constant",
        family="sensor-time",
        exact=True,
        parameters=(ParameterSpec("ppm", "ppm", -2e4, 2e4, null=0.0),),
        law="stamped t (1 + ppm 1e-6)",
        revealed_by=("torque-sweep", "speed-motion"),
        look_alikes=("delay",),
        apply=_drift,
        scale=_drifts,
        starts=one_start,
        possible=needs_two_clocks,
    ),
    *(
        EffectSpec(
            name="torque-logging",
            location="acquisition",
            variant=kind,
            family="sensor-time",
            parameters=(ParameterSpec("rate", "Hz", 1.0, 1e6, log=True, null=math.inf), *more),
            law=law,
            revealed_by=("torque-sweep", "speed-motion"),
            look_alikes=tuple(name for name in _TIMING if name != "torque-logging"),
            apply=_logging(kind),
            scale=scale,
            starts=starts,
            holds=("torque_age",),
            possible=possible,
            limits=_log_limits,
        )
        for kind, law, more, scale, starts, possible in (
            ("averaged", "the log is the mean over the last 1/rate", (), _rates, one_start, _needs_no_repeats),
            ("held", "the log repeats its last update", (), _held_rates, one_start, _needs_no_repeats),
            ("aliased", "the log is thinned without a filter", (), _held_rates, one_start, _needs_no_repeats),
            (
                "seen-held",
                "the log is seen to repeat its last update, which came between two samples",
                (_AGE,),
                _seen_rates,
                _half_a_sample,
                _needs_repeats,
            ),
            (
                "averaged-held",
                "the log is seen to repeat the mean over its last 1/rate",
                (),
                _seen_rates,
                one_start,
                _needs_repeats,
            ),
        )
    ),
    EffectSpec(
        name="torque-logging",
        location="acquisition",
        variant="folded",
        family="sensor-time",
        parameters=(
            ParameterSpec("rate", "Hz", 1.0, 1e6, log=True, null=math.inf),
            ParameterSpec("line", "Hz", 0.0, 1e5),
            ParameterSpec("age", "s", -HALF_A_CYCLE, HALF_A_CYCLE),
        ),
        law="a ripple above half the log's rate stands in it at |f - k rate|, where nothing acts",
        revealed_by=("torque-sweep", "speed-motion"),
        look_alikes=tuple(name for name in _TIMING if name != "torque-logging"),
        apply=_folding,
        scale=_own_rates,
        starts=_at_the_line,
        holds=("torque_age",),
        possible=_needs_a_line,
        limits=_line_limits,
    ),
)
