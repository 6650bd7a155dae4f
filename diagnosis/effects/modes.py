r"""Further modes: the arm bends, the mount moves, a neighbour's elasticity couples in.

Each is one modal coordinate p in units of the joint's angle. Arm and neighbour (modal inertia J_p out of J_L):

    J_p (q'' + p'' + 2 zeta w p' + w^2 p) = phi_h T_ext,    sensor: q'' + phi_s p''

Such a neighbour carries neither hammer nor sensor (phi = 0); on a bending arm both ride on it, phi = shape sqrt(J_p/J_L), so
that the mode vanishes with J_p. The mount turns by beta: beta'' + 2 zeta w beta' + w^2 beta = -(share/J_L) T_S, the
arm's acceleration is q'' + beta'', its encoders see q alone. Whatever carries the joint moves a point of the arm at
radius r by (a + b/r) times that: a = 1, b = 0 where it turns about the joint's axis, a = 0, b = X where it slides,
a = X/(X + d), b = d X/(X + d) where it turns about a parallel axis at the distance d, X = J_L/(m l) the radius of the
centre of percussion. A hammer at r_h then adds (share/J_L) (a + b/r_h - 1) T_ext, a sensor at r_s reads (a + b/r_s) beta''.

Facts used as tests: two resonances and one antiresonance in a driving-point response, at the frequencies of the
two-mass eigenproblem; with share 0 the base; the mount's mode is invisible to an encoder's wind-up at standstill.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from jointscope.diagnosis import kernel
from jointscope.diagnosis.assembly import BASE_INDEX
from jointscope.diagnosis.effects.lines import Residuals, spectral_peaks
from jointscope.diagnosis.effects.narrow import narrow_modes
from jointscope.diagnosis.effects.spec import (
    Apply,
    EffectSpec,
    Location,
    ParameterSpec,
    Possible,
    ResidualStarts,
    Starts,
    Values,
    frequencies,
)
from jointscope.diagnosis.effects.witnesses import Place, contradicted

if TYPE_CHECKING:
    from jointscope.diagnosis.assembly import Assembly
    from jointscope.diagnosis.problem import PreparedRun, Problem

_DAMPING = 0.02  # start; narrow enough to be a mode, wide enough for a grid of frequencies to hit it
_GRID = 1.15
_WIDEST = (0.1, 12.0)  # times the joint's resonance, where any mode is looked for


def _two_states(assembly: Assembly, switch: int) -> None:
    assembly.S[switch] = assembly.S[kernel.N_X]
    assembly.S[kernel.N_X] += 2


def _link(assembly: Assembly, values: Values, weight: float) -> None:
    P = assembly.P
    frequency, inertia, damping = values[:3]
    hit = values[3] if len(values) > 3 else 0.0
    sensed = values[4] if len(values) > 4 else hit
    inertia = min(max(inertia, 1e-12 * P[kernel.J_L]), 0.95 * P[kernel.J_L])
    share = math.sqrt(inertia / P[kernel.J_L])
    P[kernel.LINK_J], P[kernel.LINK_OMEGA], P[kernel.LINK_ZETA] = inertia, 2.0 * math.pi * frequency, damping
    P[kernel.LINK_HIT], P[kernel.LINK_SENSE] = hit * share, sensed * share
    _two_states(assembly, kernel.AT_LINK)


def _neighbour(assembly: Assembly, values: Values, weight: float) -> None:
    P = assembly.P
    frequency, share, damping = values
    P[kernel.NEAR_J] = min(share, 0.95) * P[kernel.J_L]
    P[kernel.NEAR_OMEGA], P[kernel.NEAR_ZETA] = 2.0 * math.pi * frequency, damping
    _two_states(assembly, kernel.AT_NEAR)


def carried(assembly: Assembly, values: Values, turn: float, slide: float) -> None:
    """What carries the joint moves the arm at radius r by turn + slide/r times what it moves at the joint."""
    P = assembly.P
    if assembly.S[kernel.AT_BASE] >= 0:  # one thing carries the joint
        return
    P[kernel.BASE_OMEGA], P[kernel.BASE_SHARE], P[kernel.BASE_ZETA] = (
        2.0 * math.pi * values[0],
        values[1],
        values[2],
    )
    P[kernel.BASE_TURN], P[kernel.BASE_SLIDE] = turn, slide
    P[kernel.BASE_HIT] = turn + slide / hammer_radius(assembly.run) - 1.0
    _two_states(assembly, kernel.AT_BASE)


def hammer_radius(run: PreparedRun) -> float:
    """Where a force acts on the arm [m]; infinite for a torque."""
    forces = run.run.select("force", location="arm", role="input")
    return forces[0].channel.radius or math.inf if forces else math.inf


def _base(assembly: Assembly, values: Values, weight: float) -> None:
    carried(assembly, values, 1.0, 0.0)


def _sliding(assembly: Assembly, values: Values, weight: float) -> None:
    carried(assembly, values, 0.0, values[3])


def _carrier(assembly: Assembly, values: Values, weight: float) -> None:
    reach, offset = percussion(assembly.problem, float(assembly.P[kernel.J_L])), values[3]
    both = reach + offset
    carried(assembly, values, reach / both, reach * offset / both)


def percussion(problem: Problem, inertia: float) -> float:
    """Radius of the arm's centre of percussion J_L/(m l) [m], by the maker's mass and centre of mass."""
    mass, radius = problem.rig.arm_mass, problem.rig.arm_com_radius
    return inertia / (mass * radius) if mass and radius else 1.0


def _band(problem: Problem, low: float, high: float) -> tuple[float, float]:
    """Band [Hz] around the resonance, inside what the recordings hold."""
    rate = max((o.rate for run in problem.runs for o in run.outputs), default=1000.0)
    f0 = problem.scales.frequency if any(run.spring for run in problem.runs) else 20.0
    return max(low * f0, 1.0), min(high * f0, 0.42 * rate)


def _grid(low: float, high: float, *tail: float) -> Starts:
    def starts(problem: Problem) -> tuple[Values, ...]:
        return tuple((f, _DAMPING, *tail) for f in frequencies(*_band(problem, low, high), _GRID))

    return starts


def _peaks(low: float, high: float, *tail: float) -> ResidualStarts:
    def starts(problem: Problem, residuals: Residuals) -> tuple[Values, ...]:
        bottom, top = _band(problem, low, high)
        shown = [
            mode for mode in narrow_modes(problem, residuals, *_band(problem, *_WIDEST)) if bottom < mode[0] < top
        ]
        broad = spectral_peaks(problem, residuals, bottom, top, 3, narrow=False)
        found = [*shown, *((f, 0.01) for f in broad)]
        return tuple((f, d, *tail) for f, zeta in found for d in (zeta, 0.03 if zeta < 0.03 else 0.01))

    return starts


def _limits(problem: Problem) -> dict[str, tuple[float, float]]:
    inertia = float(problem.base.start[BASE_INDEX["load_inertia"]])
    low, high = _band(problem, *_WIDEST)
    return {"frequency": (low, high), "inertia": (0.0, 0.9 * inertia)}


def _anything(problem: Problem) -> str | None:
    if any("acceleration" in o.quantity for run in problem.runs for o in run.outputs):
        return None
    if any(run.spring for run in problem.runs):
        return None
    return "neither an acceleration nor an elastic transmission to show a further mode"


def _beside(place: Place) -> Possible:
    """What any mode needs, where no accelerometer at this place or at the other says otherwise."""
    return lambda problem: _anything(problem) or contradicted(problem, place)


def _on_the_arm(problem: Problem) -> str | None:
    if any("acceleration" in o.quantity and o.location != "motor" for run in problem.runs for o in run.outputs):
        return None
    return "no acceleration of the arm was recorded"


def _hit(problem: Problem) -> str | None:
    reason = _on_the_arm(problem)
    if reason is None and all(run.load is None for run in problem.runs):
        return "nothing acts on the arm from outside"
    return reason


def _slides(problem: Problem) -> str | None:
    return levered(problem) or contradicted(problem, "base")


def levered(problem: Problem) -> str | None:
    reason = _on_the_arm(problem)
    if reason is None and not any("linear" in o.quantity for run in problem.runs for o in run.outputs):
        return "a lever shows in a linear acceleration only"
    return reason


def _offset(problem: Problem) -> str | None:
    if not (problem.rig.arm_mass and problem.rig.arm_com_radius):
        return "the arm's mass and centre of mass are not stated"
    return levered(problem) or contradicted(problem, "neighbour")


def _lever_limits(problem: Problem) -> dict[str, tuple[float, float]]:
    reach = percussion(problem, float(problem.base.start[BASE_INDEX["load_inertia"]]))
    levers = {"percussion_radius": (0.2 * reach, 5.0 * reach), "offset": (-0.5 * reach, 10.0 * reach)}
    return {**_limits(problem), **levers}


def _lever_starts(low: float, high: float, share: float) -> Starts:
    """The grid of frequencies with a lever of this share of the centre of percussion's radius."""

    def starts(problem: Problem) -> tuple[Values, ...]:
        reach = share * percussion(problem, float(problem.base.start[BASE_INDEX["load_inertia"]]))
        return _grid(low, high, reach)(problem)

    return starts


def _lever_peaks(low: float, high: float, share: float) -> ResidualStarts:
    def starts(problem: Problem, residuals: Residuals) -> tuple[Values, ...]:
        reach = share * percussion(problem, float(problem.base.start[BASE_INDEX["load_inertia"]]))
        return _peaks(low, high, reach)(problem, residuals)

    return starts


def _inertia_sizes(problem: Problem) -> tuple[float, float, float]:
    inertia = float(problem.base.start[BASE_INDEX["load_inertia"]])
    return 0.003 * inertia, 0.03 * inertia, 0.15 * inertia


def _share_sizes(problem: Problem) -> tuple[float, float, float]:
    return 0.003, 0.03, 0.15


_FREQUENCY = ParameterSpec("frequency", "Hz", 0.5, 5e3, log=True)
_BROADEST = 0.2  # more is no mode
_ZETA = ParameterSpec("damping", "1", 5e-4, _BROADEST, log=True)
_INERTIA = ParameterSpec("inertia", "kg m^2", 0.0, 1e9, null=0.0)
_MODES = ("link-flexibility", "base-compliance", "neighbour-flexibility", "sensor-resonance")


def _shape(name: str) -> ParameterSpec:
    return ParameterSpec(name, "1", -8.0, 8.0, scales_size=True)


def _alike(name: str) -> tuple[str, ...]:
    """Names of the other modes, and of the loss that a broad one resembles."""
    return (*(other for other in _MODES if other != name), "structural-damping")


def _is_a_mode(values: Values) -> bool:
    """Whether the damping is not as large as a search may make it: it is a loss then, or another mode's."""
    return values[2] < 0.99 * _BROADEST


_NEAR: tuple[tuple[str, Place], ...] = (
    ("neighbour-flexibility", "neighbour"),
    ("base-compliance", "base"),
)

_LEVERED: tuple[tuple[tuple[str, Location], str, ParameterSpec, str, Apply, float, Possible], ...] = (
    (
        ("base-compliance", "base"),
        "sliding-mount",
        ParameterSpec("percussion_radius", "m", 1e-3, 1e3, log=True, scales_size=True),
        "the mount slides under force and reaction",
        _sliding,
        1.0,
        _slides,
    ),
    (
        ("neighbour-flexibility", "neighbour"),
        "carrier",
        ParameterSpec("offset", "m", -1e3, 1e3),
        "a neighbour that carries the joint turns about an axis at this distance",
        _carrier,
        0.5,
        _offset,
    ),
)

INBOARD = EffectSpec(
    name="link-flexibility",
    location="load",
    variant="inboard",
    family="mode",
    parameters=(_FREQUENCY, _INERTIA, _ZETA),
    law="an outer part of the arm on its own spring; hammer and sensor are inboard of the bend",
    revealed_by=("hammer", "torque-sweep"),
    look_alikes=_MODES[1:],
    sensible=_is_a_mode,
    apply=_link,
    scale=_inertia_sizes,
    # the neighbour that moves alike is searched for, and lends its numbers (``twins``); so one start is enough
    starts=lambda problem: ((3.0 * _band(problem, 1.0, 1.0)[0], _DAMPING),),
    possible=_anything,
    limits=_limits,
)

SPECS: tuple[EffectSpec, ...] = (
    EffectSpec(
        name="link-flexibility",
        location="load",
        variant="one-shape",
        family="mode",
        parameters=(_FREQUENCY, _INERTIA, _ZETA, _shape("shape")),
        law="bending mode; hammer and sensor ride on it alike",
        sensible=_is_a_mode,
        revealed_by=("hammer", "torque-sweep"),
        look_alikes=_MODES[1:],
        apply=_link,
        scale=_inertia_sizes,
        starts=_grid(0.6, 8.0, 2.0),
        possible=_on_the_arm,
        limits=_limits,
        residual_starts=_peaks(0.6, 10.0, 2.0),
    ),
    EffectSpec(
        name="link-flexibility",
        location="load",
        variant="two-shapes",
        family="mode",
        parameters=(_FREQUENCY, _INERTIA, _ZETA, _shape("hit_shape"), _shape("sensor_shape")),
        law="bending mode; hammer and sensor see it differently",
        sensible=_is_a_mode,
        revealed_by=("hammer", "torque-sweep"),
        look_alikes=_MODES[1:],
        apply=_link,
        scale=_inertia_sizes,
        starts=_grid(0.6, 8.0, 2.0, -2.0),
        possible=_hit,
        limits=_limits,
        residual_starts=_peaks(0.6, 10.0, 2.0, -2.0),
    ),
    *(
        EffectSpec(
            name=name,
            location=location,
            variant=variant,
            family="mode",
            parameters=(_FREQUENCY, ParameterSpec("modal_share", "1", 0.0, upper, null=0.0), _ZETA),
            law=law,
            revealed_by=("hammer", "torque-sweep"),
            look_alikes=_alike(name),
            sensible=_is_a_mode,
            apply=apply,
            scale=_share_sizes,
            starts=_grid(0.15, 5.0),
            possible=_beside(location),
            limits=_limits,
            residual_starts=_peaks(0.15, 6.0),
        )
        for (name, location), variant, upper, law, apply in zip(
            _NEAR,
            ("absorber", "turning-mount"),
            (0.9, 5.0),
            ("a neighbour's inertia on its own spring", "the mount turns under the joint's reaction"),
            (_neighbour, _base),
            strict=True,
        )
    ),
    *(
        EffectSpec(
            name=name,
            location=location,
            variant=variant,
            family="mode",
            parameters=(_FREQUENCY, ParameterSpec("modal_share", "1", 0.0, 5.0, null=0.0), _ZETA, lever),
            law=law,
            revealed_by=("hammer", "torque-sweep"),
            look_alikes=_alike(name),
            sensible=_is_a_mode,
            apply=apply,
            scale=_share_sizes,
            starts=_lever_starts(0.15, 5.0, share),
            possible=possible,
            limits=_lever_limits,
            residual_starts=_lever_peaks(0.15, 6.0, share),
        )
        for (name, location), variant, lever, law, apply, share, possible in _LEVERED
    ),
    INBOARD,
)
