r"""A structure with several modes, hit while the motor is held: each sensor at its own place on their shapes.

The joint's own mode is the base. Each further one is a modal coordinate that the torque on the arm drives, in units of
J_L, and that sensor k reads by a share s_rk (the product of both shapes, so of either sign):

    J_L (p_r'' + 2 zeta_r w_r p_r' + w_r^2 p_r) = T_ext,    sensor k: shape_k q'' + sum_r s_rk p_r''        shape_1 = 1

That is the whole of a linear structure's response (modal superposition, e.g. Ewins, Modal Testing, chapter 2), without the
one bend's coupling to a law of the transmission. Starts come from the recordings themselves (``diagnosis.modal``).

A bend by which every sensor stops to follow the arm is no bend but the sensors' own resonance.

Facts used as tests: the response is the sum of the modes' own; without shares and with equal shapes it is the base.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

from jointscope.diagnosis.assembly import Bends
from jointscope.diagnosis.effects.spec import Apply, EffectSpec, ParameterSpec, Values, one_start
from jointscope.diagnosis.superposition import accelerometers

if TYPE_CHECKING:
    from jointscope.diagnosis.assembly import Assembly
    from jointscope.diagnosis.problem import Problem

MOST_MODES = 8
MOST_SENSORS = 3
_LARGEST = 1e3  # share of a mode
_FOLLOWING = 0.15  # of the rigid arm's acceleration, less than which a sensor that no longer follows reads


def _apply(modes: int, sensors: int) -> Apply:
    def apply(assembly: Assembly, values: Values, weight: float) -> None:
        width = 2 + sensors
        rows = [values[width * r : width * (r + 1)] for r in range(modes)]
        assembly.bends = Bends(
            frequencies=tuple(row[0] for row in rows),
            dampings=tuple(row[1] for row in rows),
            shares=tuple(row[2:] for row in rows),
            shapes=(1.0, *values[width * modes :]),
        )

    return apply


def _parameters(modes: int, sensors: int) -> tuple[ParameterSpec, ...]:
    found: list[ParameterSpec] = []
    for r in range(1, modes + 1):
        tail = "" if r == 1 else f"_{r}"
        found.append(ParameterSpec(f"frequency{tail}", "Hz", 0.5, 5e3, log=True))
        found.append(ParameterSpec(f"damping{tail}", "1", 1e-5, 0.5, log=True))
        for k in range(1, sensors + 1):
            null = 0.0 if (r, k) == (1, 1) else None
            found.append(ParameterSpec(f"share{tail}_of_{k}", "1", -_LARGEST, _LARGEST, null=null))
    found.extend(ParameterSpec(f"shape_{k}", "1", -_LARGEST, _LARGEST) for k in range(2, sensors + 1))
    return tuple(found)


def possible(problem: Problem) -> str | None:
    """Whether every run is a hit on an arm that its joint alone holds, seen by an accelerometer."""
    if problem.rig.topology == "arm":
        return "an arm's joints have their own modes"
    if any(run.load is None or run.motor_moves or not run.spring for run in problem.runs):
        return "the shapes of several modes are told by hits on a held joint only"
    if not any(accelerometers(run.outputs) for run in problem.runs):
        return "no acceleration of the arm was recorded"
    return None


def _followed(modes: int, sensors: int) -> Callable[[Values], bool]:
    """Whether some sensor still follows the arm above the last bend.

    w^2/(s^2 + 2 zeta w s + w^2) = 1 - s (s + 2 zeta w)/(...): a bend of the share -1 in every sensor is the sensors' own.
    """
    width = 2 + sensors

    def sensible(values: Values) -> bool:
        shapes = (1.0, *values[width * modes :])
        shares = [values[width * r + 2 : width * (r + 1)] for r in range(modes)]
        above = [abs(shape + sum(row[k] for row in shares)) for k, shape in enumerate(shapes)]
        return any(left > _FOLLOWING * abs(shape) for left, shape in zip(above, shapes, strict=True))

    return sensible


def _bends(modes: int, sensors: int) -> EffectSpec:
    width = 2 + sensors
    shares = [width * r + k for r in range(modes) for k in range(2, width)]
    return EffectSpec(
        name="link-flexibility",
        location="load",
        variant=f"{modes}-bends-{sensors}-places",
        family="mode",
        parameters=_parameters(modes, sensors),
        law=f"{modes} bending modes; each of {sensors} sensors sees them by its own shares",
        revealed_by=("hammer",),
        look_alikes=("base-compliance", "neighbour-flexibility", "sensor-resonance"),
        apply=_apply(modes, sensors),
        scale=lambda problem: (0.5, 1.0, 1.5),  # this and the starts come from the recordings: ``started``
        starts=one_start,
        possible=possible,
        sensible=_followed(modes, sensors),
        proportional=tuple(shares[1:]),
    )


SPECS: tuple[EffectSpec, ...] = tuple(
    _bends(modes, sensors) for sensors in range(1, MOST_SENSORS + 1) for modes in range(1, MOST_MODES + 1)
)


def started(modes: int, sensors: int, values: Values) -> EffectSpec:
    """The law of so many modes and sensors that starts at ``values``, in the order of its parameters."""
    spec = next(s for s in SPECS if s.variant == f"{modes}-bends-{sensors}-places")
    size, rest = values[spec.amplitude], (*values[: spec.amplitude], *values[spec.amplitude + 1 :])
    sizes = (0.5 * size, size, 1.5 * size)
    return replace(spec, scale=lambda problem: sizes, starts=lambda problem: (rest,))


__all__ = ["MOST_MODES", "MOST_SENSORS", "SPECS", "possible", "started"]
