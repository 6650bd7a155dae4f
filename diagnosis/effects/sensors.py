r"""The accelerometer and the hammer's load cell.

    cos(angle) tangential + sin(angle) radial                 sensor-tilt
    w^2/(s^2 + 2 zeta w s + w^2), or 1/(1 + s/w)              sensor-resonance
    clip(y, +-level), or y / (1 + |y/level|^p)^(1/p)          sensor-saturation
    gain y                                                    sensor-gain (true over stated sensitivity or radius)

Facts used as tests: at standstill a tilted dc sensor reads g cos(q - angle); a resonance amplifies low frequencies by
1 + (f/f_a)^2; clipping leaves everything below its level untouched; a gain multiplies.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from jointscope.diagnosis.assembly import SAME_RADIUS
from jointscope.diagnosis.effects.lines import Residuals, response_peaks
from jointscope.diagnosis.effects.spec import (
    Apply,
    EffectSpec,
    ParameterSpec,
    Values,
    beyond_calibration,
    lasts,
    needs_accelerometer,
    one_start,
)
from jointscope.diagnosis.resolution import clips

if TYPE_CHECKING:
    from jointscope.diagnosis.assembly import Assembly, Sensor
    from jointscope.diagnosis.problem import Problem

DAMPED = 0.7  # from which damping on a mount amplifies nothing


def _tilt(sensor: Sensor, values: Values) -> None:
    sensor.tilt += values[0]


def _resonance(sensor: Sensor, values: Values) -> None:
    sensor.resonance, sensor.resonance_damping = values


def _resonance_limited(sensor: Sensor, values: Values) -> None:
    sensor.resonance, sensor.resonance_damping = values[:2]
    sensor.bandwidth = values[2] * values[0]


def _bandwidth(sensor: Sensor, values: Values) -> None:
    sensor.bandwidth = values[0]


def _saturation(sensor: Sensor, values: Values) -> None:
    sensor.saturation = values[0]
    if len(values) > 1:
        sensor.knee = values[1]


def _gain(sensor: Sensor, values: Values) -> None:
    sensor.gain *= values[0]


PUT: dict[str, Callable[[Sensor, Values], None]] = {
    "radial": _tilt, "mount": _resonance, "mount-limited": _resonance_limited, "bandwidth": _bandwidth,
    "clip": _saturation, "compressing": _saturation, "accelerometer": _gain,
}  # fmt: skip


def _of_all(variant: str) -> Apply:
    """The law in every accelerometer."""

    def apply(assembly: Assembly, values: Values, weight: float) -> None:
        PUT[variant](assembly.chain.sensor, values)

    return apply


def _force_gain(assembly: Assembly, values: Values, weight: float) -> None:
    assembly.chain.force_gain *= values[0]


def _tilt_possible(problem: Problem) -> str | None:
    if any(o.quantity == "linear-acceleration" for run in problem.runs for o in run.outputs):
        return None
    return "no linear accelerometer on a turning arm"


def _gain_possible(problem: Problem) -> str | None:
    found = [o for run in problem.runs for o in run.outputs if "acceleration" in o.quantity]
    if found and not any(o.calibrated for o in found):
        return "no accelerometer's scale is known"
    return needs_accelerometer(problem)


def _force_possible(problem: Problem) -> str | None:
    return None if any(run.load is not None for run in problem.runs) else "no force was recorded"


def _rate(problem: Problem) -> float:
    """Of the accelerometers [Hz]."""
    return max(
        (o.rate for run in problem.runs for o in run.outputs if "acceleration" in o.quantity), default=1000.0
    )


BEYOND_THE_LEVEL = 0.4  # of the largest reading, below which no sensor clips
BEYOND_THE_JOINT = (
    1.3  # times the joint's resonance: nobody mounts a sensor that is slower than what it is to show
)


def _resonance_sizes(problem: Problem) -> tuple[float, float, float]:
    rate = _rate(problem)
    strong = min(0.3 * rate, 2.5 * BEYOND_THE_JOINT * problem.scales.frequency)
    return rate, (rate * strong) ** 0.5, strong


def _ringing(problem: Problem, residuals: Residuals) -> tuple[Values, ...]:
    """Frequency and damping where what a model leaves rings with the input: a light mount is missed by a few per cent."""
    low, high = BEYOND_THE_JOINT * problem.scales.frequency, 0.45 * _rate(problem)
    peaks = response_peaks(problem, residuals, low, high, 3) if low < high else ()
    return tuple((f, damping) for f in peaks for damping in (0.02, 0.1))


def _resonance_limits(problem: Problem) -> dict[str, tuple[float, float]]:
    return {"frequency": (BEYOND_THE_JOINT * problem.scales.frequency, 20.0 * _rate(problem))}


def _levels(problem: Problem) -> tuple[float, float, float]:
    peak = max(problem.scales.acceleration, 1e-9)
    return min(flat_tops(problem), default=0.95 * peak), 0.75 * peak, 0.45 * peak


def flat_tops(problem: Problem, radius: float | None = None) -> list[float]:
    """The readings [m/s^2] at which accelerometers, or those at ``radius`` [m], are seen to clip."""
    near = (
        o
        for run in problem.runs
        for o in run.outputs
        if radius is None or (o.radius is not None and abs(o.radius - radius) < SAME_RADIUS)
    )
    return [float(np.max(np.abs(o.data))) for o in near if clips(o)]


def _level_limits(problem: Problem) -> dict[str, tuple[float, float]]:
    """No reading lies beyond a level at which it is clipped, but for noise and what a filter rings with."""
    return {"level": (BEYOND_THE_LEVEL * _least_peak(problem), 1.5 * max(problem.scales.acceleration, 1e-9))}


def _least_peak(problem: Problem) -> float:
    """The largest reading of the accelerometer that reads least [m/s^2 or rad/s^2]."""
    peaks: dict[tuple[str, str, float | None], float] = {}
    for run in problem.runs:
        for o in run.outputs:
            if "acceleration" in o.quantity and o.data.size:
                key = (o.quantity, o.location, o.radius)
                peaks[key] = max(peaks.get(key, 0.0), float(np.nanmax(np.abs(o.data))))
    return max(min(peaks.values(), default=0.0), 1e-9)


def _soft_levels(problem: Problem) -> tuple[float, float, float]:
    peak = max(problem.scales.acceleration, 1e-9)
    return 10.0 * peak, 4.0 * peak, 1.5 * peak


def _soft_level_limits(problem: Problem) -> dict[str, tuple[float, float]]:
    peak = max(problem.scales.acceleration, 1e-9)
    return {"level": (0.3 * peak, 30.0 * peak)}


_TIMING = ("delay", "drive-lag", "link-flexibility")
_FREQUENCY = ParameterSpec("frequency", "Hz", 1.0, 1e5, log=True, null=math.inf)
_DAMPING = ParameterSpec("damping", "1", 0.003, 1.5, log=True)


def _rings_or_lags(values: Values) -> bool:
    """Whether a mount amplifies what is near its resonance, or else delays by more than a recorder leaves open."""
    frequency, damping = values[:2]
    return damping < DAMPED or lasts((damping / (math.pi * frequency),))


def _lags(values: Values) -> bool:
    return lasts((1.0 / (2.0 * math.pi * values[0]),))


SPECS: tuple[EffectSpec, ...] = (
    EffectSpec(
        name="sensor-tilt",
        location="acquisition",
        variant="radial",
        family="sensor-gain",
        exact=True,
        memoryless=True,
        parameters=(ParameterSpec("angle", "rad", -0.8, 0.8, null=0.0),),
        law="cos(angle) tangential + sin(angle) radial",
        revealed_by=("speed-motion", "torque-sweep"),
        look_alikes=("gravity", "sensor-gain"),
        apply=_of_all("radial"),
        scale=lambda problem: (0.01, 0.05, 0.15),
        starts=one_start,
        possible=_tilt_possible,
    ),
    *(
        EffectSpec(
            name="sensor-resonance",
            location="acquisition",
            variant=variant,
            family="sensor-gain",
            parameters=(_FREQUENCY, *further),
            law=law,
            revealed_by=("hammer", "torque-sweep"),
            look_alikes=_TIMING,
            sensible=_rings_or_lags if further else _lags,
            apply=_of_all(variant),
            scale=_resonance_sizes,
            starts=starts,
            possible=needs_accelerometer,
            limits=_resonance_limits,
            residual_starts=residual_starts,
        )
        for variant, further, law, starts, residual_starts in (
            ("mount", (_DAMPING,), "w^2/(s^2 + 2 zeta w s + w^2)", lambda problem: ((0.05,), (0.3,)), _ringing),
            (
                "mount-limited",  # fitted from where the mount alone was found
                (_DAMPING, ParameterSpec("corner", "1", 0.2, 50.0, log=True)),
                "w^2/((s^2 + 2 zeta w s + w^2) (1 + s/(corner w)))",
                lambda problem: ((0.1, 4.0),),
                None,
            ),
            ("bandwidth", (), "1/(1 + s/w)", one_start, None),
        )
    ),
    *(
        EffectSpec(
            name="sensor-saturation",
            location="acquisition",
            variant=variant,
            family="sensor-gain",
            exact=exact,
            memoryless=True,
            parameters=(ParameterSpec("level", "m/s^2", 1e-6, 1e9, log=True, null=math.inf), *further),
            law=law,
            revealed_by=("hammer", "torque-sweep"),
            look_alikes=("link-flexibility", "stiffness-nonlinearity"),
            apply=_of_all(variant),
            scale=sizes,
            starts=starts,
            possible=needs_accelerometer,
            limits=limits,
            local=True,
        )
        for variant, law, further, sizes, starts, limits, exact in (
            ("clip", "clip(y, +-level)", (), _levels, one_start, _level_limits, True),
            (
                "compressing",
                "y / (1 + |y/level|^knee)^(1/knee)",
                (ParameterSpec("knee", "1", 1.0, 12.0, log=True),),
                _soft_levels,
                lambda problem: ((2.0,),),
                _soft_level_limits,
                False,
            ),
        )
    ),
    EffectSpec(
        name="sensor-gain",
        location="acquisition",
        variant="accelerometer",
        family="sensor-gain",
        exact=True,
        memoryless=True,
        parameters=(ParameterSpec("gain", "1", 0.2, 5.0, null=1.0),),
        law="gain y",
        revealed_by=("hammer", "torque-sweep", "speed-motion"),  # whose acceleration the encoders know
        look_alikes=("torque-gain", "sensor-tilt"),
        apply=_of_all("accelerometer"),
        scale=lambda problem: (1.01, 1.04, 1.12),
        sensible=beyond_calibration,
        starts=one_start,
        possible=_gain_possible,
    ),
    EffectSpec(
        name="sensor-gain",
        location="acquisition",
        variant="force",
        family="sensor-gain",
        exact=True,
        memoryless=True,
        parameters=(ParameterSpec("gain", "1", 0.2, 5.0, null=1.0),),
        law="force / gain",
        revealed_by=("hammer",),
        look_alikes=("torque-gain",),
        apply=_force_gain,
        scale=lambda problem: (1.01, 1.04, 1.12),
        sensible=beyond_calibration,
        starts=one_start,
        possible=_force_possible,
    ),
)
