r"""A periodic disturbance from outside: a fan, a pump, a neighbouring machine.

    T_ext + a sin(2 pi f t + phase_run)  on the arm, or the mount shaken by that acceleration

Steady from before each run; the phase is another in every run and profiled out (``diagnosis.vibration``).
Fact used as a test: the response is a |H(2 pi f)| at f in every channel, the quiet part of the run included.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from jointscope.diagnosis.effects.lines import Residuals, recorded, spectral_peaks
from jointscope.diagnosis.effects.spec import Apply, EffectSpec, ParameterSpec, Values, needs_accelerometer

if TYPE_CHECKING:
    from jointscope.diagnosis.assembly import Assembly
    from jointscope.diagnosis.problem import Problem

LOWEST = 8.0  # Hz; slower than that, what an observer or a torque log leaves passes for a tone


def _shaken(mount: bool) -> Apply:
    def apply(assembly: Assembly, values: Values, weight: float) -> None:
        assembly.chain.vibration = (values[0], values[1])
        assembly.chain.vibration_mount = mount

    return apply


def _from_residuals(problem: Problem, residuals: Residuals) -> tuple[Values, ...]:
    rate = max((o.rate for run in problem.runs for o in run.outputs), default=1000.0)
    return tuple((f,) for f in spectral_peaks(problem, residuals, LOWEST, 0.4 * rate, 8, narrow=True))


def _starts(problem: Problem) -> tuple[Values, ...]:
    return _from_residuals(problem, recorded(problem)) or ((50.0,),)


def _sizes(problem: Problem) -> tuple[float, float, float]:
    t = problem.scales.torque
    return 0.0005 * t, 0.004 * t, 0.02 * t


def _mount_sizes(problem: Problem) -> tuple[float, float, float]:
    radius = max((o.radius or 1.0 for run in problem.runs for o in run.outputs), default=1.0)
    a = problem.scales.acceleration / radius
    return 0.0005 * a, 0.004 * a, 0.02 * a


SPECS: tuple[EffectSpec, ...] = tuple(
    EffectSpec(
        name="external-vibration",
        location="base",
        variant=variant,
        family="external",
        parameters=(
            ParameterSpec("frequency", "Hz", LOWEST, 5e3, log=True),
            ParameterSpec("amplitude", unit, 0.0, 1e9, null=0.0),
        ),
        law=law,
        revealed_by=("hammer", "torque-sweep", "speed-motion"),
        look_alikes=("torque-ripple", "transmission-error"),
        apply=_shaken(mount),
        scale=scale,
        starts=_starts,
        possible=needs_accelerometer,
        residual_starts=_from_residuals,
        profiled=1,
    )
    for variant, unit, law, mount, scale in (
        ("torque", "N m", "T_ext + a sin(2 pi f t + phase)", False, _sizes),
        ("mount", "rad/s^2", "the mount accelerates by a sin(2 pi f t + phase)", True, _mount_sizes),
    )
)
