r"""On the arm: weight that the base lacks, inertia that differs between runs, a stop that it runs into.

    - M cos(q + phi)                       gravity (a constant force on a translational rig)
    J_L + inertia in some of the runs      payload; with its weight, - inertia g / rho cos(q)
    - k (q - q_stop)+ (1 + c_k q')         end-stop, one-sided (Hunt and Crossley: no pull, loss that grows with depth)

Facts used as tests: at standstill the transmission carries exactly the weight; a payload moves the held arm's frequency
by sqrt(J/(J + dJ)); a stop leaves the motion below its angle untouched.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from jointscope.diagnosis import kernel
from jointscope.diagnosis.assembly import BASE_INDEX
from jointscope.diagnosis.effects.spec import Apply, EffectSpec, ParameterSpec, Starts, Values, one_start
from jointscope.diagnosis.parameters import zero_near
from jointscope.models.parameters import STANDARD_GRAVITY

if TYPE_CHECKING:
    from jointscope.diagnosis.assembly import Assembly
    from jointscope.diagnosis.problem import Problem


SOFTEST_STOP = 0.01  # of the smallest size, below which a stop stops nothing
STOPS = (5e-4, 5e-3, 0.015, 0.03, 0.12, 0.3, 0.5)  # of the travel, inward of its end, where a stop is sought
STOPS_OF_HITS = (0.03, 0.12, 0.3, 0.5)  # of where hits reach to
FEW = 0.7  # of the travel, below which hits reach to places of their own
INCLINED = 2.0  # rad: little beyond a right angle, so that the moment and not the phase carries the sign


def _gravity(assembly: Assembly, values: Values, weight: float) -> None:
    moment = values[0]
    phase = values[1] if len(values) > 1 else 0.0
    if assembly.translational:
        assembly.P[kernel.G_CONST] += moment
        return
    assembly.P[kernel.G_COS] += moment * math.cos(phase)
    assembly.P[kernel.G_SIN] += moment * math.sin(phase)


def _gravity_sizes(problem: Problem) -> tuple[float, float, float]:
    s = problem.scales
    size = max(s.motor_torque, abs(float(problem.base.start[BASE_INDEX["gravity_moment"]])), s.torque)
    return 0.01 * size, 0.05 * size, 0.25 * size


def _gravity_limits(problem: Problem) -> dict[str, tuple[float, float]]:
    top = 20.0 * _gravity_sizes(problem)[2]
    return {"moment": (-top, top)}


def _gravity_possible(problem: Problem) -> str | None:
    if problem.base.free[BASE_INDEX["gravity_moment"]]:
        return "the arm's weight is not on the nameplate, so it is a parameter"
    if all(run.mode == "braked" for run in problem.runs):
        return "the motor is held in every run: weight only preloads the transmission"
    unknown = problem.base.free[BASE_INDEX["torque_offset"]] and not zero_near(problem.runs)
    if problem.rig.motion == "translational" and unknown:
        return "a constant force can't be told from the input's unknown zero"
    return None


def _payload(assembly: Assembly, values: Values, weight: float) -> None:
    assembly.P[kernel.J_L] = max(assembly.P[kernel.J_L] + values[0] * weight, 1e-9)


def _heavy_payload(assembly: Assembly, values: Values, weight: float) -> None:
    _payload(assembly, values, weight)
    assembly.P[kernel.G_COS] += weight * values[0] * STANDARD_GRAVITY / values[1]


def _payload_sizes(problem: Problem) -> tuple[float, float, float]:
    inertia = float(problem.base.start[BASE_INDEX["load_inertia"]])
    return 0.01 * inertia, 0.05 * inertia, 0.2 * inertia


def _payload_limits(problem: Problem) -> dict[str, tuple[float, float]]:
    inertia = float(problem.base.start[BASE_INDEX["load_inertia"]])
    reach = _reach(problem)
    return {"inertia": (-0.6 * inertia, 3.0 * inertia), "percussion_radius": (0.1 * reach, 5.0 * reach)}


def _reach(problem: Problem) -> float:
    """How far out [m] the rig's sensors and its arm's centre of mass are; 1 where neither is known."""
    radii = [o.radius for run in problem.runs for o in run.outputs if o.radius]
    return max([*radii, problem.rig.arm_com_radius or 0.0]) or 1.0


def _several_runs(problem: Problem) -> str | None:
    return None if len(problem.runs) > 1 else "one run can't show a difference between runs"


def _lifted(problem: Problem) -> str | None:
    if problem.rig.motion == "translational" or problem.rig.plane != "vertical":
        return "nothing is lifted"
    if all(run.mode == "braked" for run in problem.runs):
        return "the motor is held in every run: weight only preloads the transmission"
    return _several_runs(problem)


def _stop(side: float) -> Apply:
    def apply(assembly: Assembly, values: Values, weight: float) -> None:
        P = assembly.P
        P[kernel.STOP_ANGLE], P[kernel.STOP_K] = values[:2]
        P[kernel.STOP_C] = values[2]
        P[kernel.STOP_SIDE], P[kernel.STOP_EXPONENT] = side, 1.0

    return apply


def _stop_sizes(problem: Problem) -> tuple[float, float, float]:
    b = problem.base.start
    stiffness = float(b[BASE_INDEX["stiffness"]])
    if not any(run.spring for run in problem.runs):
        stiffness = float(b[BASE_INDEX["load_inertia"]]) * (2.0 * math.pi * 10.0) ** 2
    return 0.02 * stiffness, 0.2 * stiffness, 2.0 * stiffness


def _stiff_enough(problem: Problem, values: Values) -> bool:
    return values[1] >= SOFTEST_STOP * _stop_sizes(problem)[0]


def _stop_limits(problem: Problem) -> dict[str, tuple[float, float]]:
    s = problem.scales
    return {
        "angle": (s.angle_low - 0.05 * s.travel, s.angle_high + 0.05 * s.travel),
        "stiffness": (0.0, 100.0 * _stop_sizes(problem)[2]),
        "damping": (0.0, 100.0 / max(s.speed, 1e-9)),
    }


def _stop_starts(side: float) -> Starts:
    """Places inward of the end of the travel, and of where hits on the held joint reach to."""

    def starts(problem: Problem) -> tuple[Values, ...]:
        s = problem.scales
        loss = 0.3 / max(s.speed, 1e-9)
        ranges: dict[tuple[float, float], tuple[float, ...]] = {(s.angle_low, s.angle_high): STOPS}
        if 0.0 < s.held_high - s.held_low < FEW * s.travel:
            ranges[s.held_low, s.held_high] = STOPS_OF_HITS
        return tuple(
            ((high if side > 0.0 else low) - side * share * (high - low), loss)
            for (low, high), shares in ranges.items()
            for share in shares
        )

    return starts


SPECS: tuple[EffectSpec, ...] = (
    *(
        EffectSpec(
            name="gravity",
            location="load",
            variant=variant,
            family="gravity",
            exact=True,
            parameters=parameters,
            law=law,
            revealed_by=("speed-motion", "torque-sweep"),
            look_alikes=("sensor-tilt", "coulomb-friction"),
            apply=_gravity,
            scale=_gravity_sizes,
            starts=starts,
            possible=possible,
            limits=_gravity_limits,
        )
        for variant, law, parameters, starts, possible in (
            (
                "level",
                "-M cos(q)",
                (ParameterSpec("moment", "N m", -1e9, 1e9, null=0.0),),
                one_start,
                _gravity_possible,
            ),
            (
                "inclined",
                "-M cos(q + phi)",
                (
                    ParameterSpec("moment", "N m", -1e9, 1e9, null=0.0),
                    ParameterSpec("phase", "rad", -INCLINED, INCLINED),
                ),
                lambda problem: ((0.5 * math.pi,),),
                lambda problem: (
                    "one direction only on a translational rig"
                    if problem.rig.motion == "translational"
                    else _gravity_possible(problem)
                ),
            ),
        )
    ),
    *(
        EffectSpec(
            name="end-stop",
            location="load",
            variant=variant,
            family="contact",
            parameters=(
                ParameterSpec("angle", "rad", -1e3, 1e3, fineness=0.02),
                ParameterSpec("stiffness", "N m/rad", 0.0, 1e12, null=0.0),
                ParameterSpec("damping", "s/rad", 0.0, 1e9),
            ),
            law="k (q - q_stop)+ (1 + c_k q') on the " + variant + " side",
            revealed_by=("speed-motion", "torque-sweep", "hammer"),
            look_alikes=("stiffness-nonlinearity", "backlash"),
            apply=_stop(side),
            scale=_stop_sizes,
            starts=_stop_starts(side),
            possible=lambda problem: None,
            limits=_stop_limits,
            sensible_at=_stiff_enough,
            local=True,
        )
        for variant, side in (("upper", 1.0), ("lower", -1.0))
    ),
)

_INERTIA = ParameterSpec("inertia", "kg m^2", -1e9, 1e9, null=0.0)
PAYLOADS = tuple(
    EffectSpec(
        name="payload",
        location="load",
        variant=variant,
        family="inertia",
        exact=True,
        parameters=parameters,
        law=law,
        revealed_by=("hammer", "torque-sweep", "speed-motion"),
        look_alikes=("stiffness-drift", "torque-gain"),
        apply=apply,
        scale=_payload_sizes,
        starts=starts,
        possible=possible,
        limits=_payload_limits,
    )
    for variant, law, parameters, apply, starts, possible in (
        ("some-runs", "J_L + inertia in the loaded runs", (_INERTIA,), _payload, one_start, _several_runs),
        (
            "lifted",
            "J_L + inertia and -(inertia g / percussion_radius) cos(q) in the loaded runs",
            (_INERTIA, ParameterSpec("percussion_radius", "m", 1e-3, 1e3, log=True)),
            _heavy_payload,
            lambda problem: ((_reach(problem),),),
            _lifted,
        ),
    )
)
