"""What the catalogue says of an effect: its law, parameters, sizes, look-alikes, and which recordings can show it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.parameters import AGE

if TYPE_CHECKING:
    from jointscope.diagnosis.assembly import Assembly
    from jointscope.diagnosis.effects.lines import Residuals
    from jointscope.diagnosis.problem import PreparedRun, Problem

Location = Literal["motor", "transmission", "load", "base", "neighbour", "acquisition"]
Family = Literal[
    "stiffness", "dissipative", "hysteretic", "periodic", "mode", "sensor-gain", "sensor-time", "input", "gravity",
    "inertia", "contact", "external",
]  # fmt: skip
Values = tuple[float, ...]
Vector = NDArray[np.float64]
IN_TURN = 2e-5  # s between the channels of a multiplexed converter
CALIBRATED_TO = 0.0025  # to which a torque constant or a sensitivity is known at the very best


@dataclass(frozen=True)
class ParameterSpec:
    """One parameter of an effect.

    Attributes:
        name: As in the contract.
        unit: SI, at the joint output.
        lower, upper: What a fit may reach; ``catalogue`` narrows it to the rig at hand.
        log: Whether it is positive and spans decades.
        null: Value at which the effect vanishes; ``None`` for parameters that only shape it.
        fineness: Its finite-difference step relative to the usual one.
        scales_size: Whether what is seen of the effect is its size times this, so that neither is known by itself.
    """

    name: str
    unit: str
    lower: float
    upper: float
    log: bool = False
    null: float | None = None
    fineness: float = 1.0
    scales_size: bool = False


Limits = Callable[["Problem"], "dict[str, tuple[float, float]]"]
Apply = Callable[["Assembly", Values, float], None]
Scale = Callable[["Problem"], tuple[float, float, float]]
Starts = Callable[["Problem"], tuple[Values, ...]]
Possible = Callable[["Problem"], "str | None"]
ResidualStarts = Callable[["Problem", "Residuals"], tuple[Values, ...]]


def always(values: Values) -> bool:
    """Any values are the effect."""
    return True


def no_limits(problem: Problem) -> dict[str, tuple[float, float]]:
    """Bounds as written."""
    return {}


@dataclass(frozen=True)
class EffectSpec:
    """One effect at one location under one law.

    Attributes:
        name, location: As in the contract.
        variant: Which law, where reality knows several; the name stays the same.
        family: Kind of signature.
        parameters: The contract's main parameter first.
        law: The equation, for people.
        revealed_by: Experiments that can show it.
        look_alikes: Names that it is easily taken for.
        apply: Puts the effect into a run's assembly.
        scale: Small, medium and large amplitude for the rig at hand (of the parameter whose ``null`` is not ``None``).
        starts: Starting values of the other parameters, in their order.
        possible: ``None``, or why these recordings can't show it.
        limits: Bounds by parameter name for the rig at hand.
        run_weights: Amplitude's factor in each run (payload: which runs carry it; drift per run: how far), or ``None``.
        residual_starts: Further starts from what a model leaves (per run, per output: data - prediction), or ``None``;
            of all parameters where the size is a frequency, else of all others.
        proportional: Positions of parameters that are resized with the amplitude (a breakaway torque, say).
        profiled: Numbers that are fitted anew in every run, held-out ones too (a phase, say).
        decades: How often a tenth of the smallest size is tried too: a law with a threshold is another one at each.
        local: Whether it acts only where a motion reaches a place or a level: held-out runs that do not say nothing of it.
        exact: Whether nature knows the law in this form only: what it leaves is something else.
        memoryless: Whether it bends every sample by itself: no form of it lags or rings.
        holds: Names of the base's nuisances that it stands for, which stay at their start where it is fitted.
        instead: Base parameters and values at which it stands for a part of what the base took in its place, or ``None``.
        sensible: Whether fitted values are still this effect: a friction that rises with speed is no Stribeck's.
        sensible_at: The same at a rig: a stop that stops nothing is none, nor a ripple of less than a period.
    """

    name: str
    location: Location
    variant: str
    family: Family
    parameters: tuple[ParameterSpec, ...]
    law: str
    revealed_by: tuple[str, ...]
    look_alikes: tuple[str, ...]
    apply: Apply = field(repr=False)
    scale: Scale = field(repr=False)
    starts: Starts = field(repr=False)
    possible: Possible = field(repr=False)
    limits: Limits = field(default=no_limits, repr=False)
    run_weights: tuple[float, ...] | None = None
    residual_starts: ResidualStarts | None = field(default=None, repr=False)
    proportional: tuple[int, ...] = ()
    profiled: int = 0
    decades: int = 0
    local: bool = False
    exact: bool = False
    memoryless: bool = False
    holds: tuple[str, ...] = ()
    instead: Callable[[Vector], tuple[tuple[Vector, Values], ...]] | None = field(default=None, repr=False)
    sensible: Callable[[Values], bool] = field(default=always, repr=False)
    sensible_at: Callable[[Problem, Values], bool] | None = field(default=None, repr=False)

    @property
    def of_own_frequency(self) -> bool:
        """Whether its size is the frequency of a mode, which is absent where that is infinite."""
        null = self.parameters[self.amplitude].null
        return self.family == "mode" and null is not None and math.isinf(null)

    @property
    def amplitude(self) -> int:
        """Position of the parameter that switches the effect off."""
        for position, parameter in enumerate(self.parameters):
            if parameter.null is not None:
                return position
        return 0

    def is_null(self, values: Values) -> bool:
        """Whether these values switch the effect off exactly."""
        return all(v == p.null for v, p in zip(values, self.parameters, strict=True) if p.null is not None)


@dataclass(frozen=True)
class ActiveEffect:
    """An effect with values, in the order of its spec's parameters."""

    spec: EffectSpec
    values: Values

    def apply(self, assembly: Assembly) -> None:
        """Put it into one run's model; at its null value nothing is touched."""
        weights = self.spec.run_weights
        weight = 1.0 if weights is None else weights[assembly.run.index]
        if weight != 0.0 and not self.spec.is_null(self.values):
            self.spec.apply(assembly, self.values, weight)


def beyond_calibration(values: Values) -> bool:
    """Whether a gain lies beyond what any sensor is calibrated to."""
    return abs(values[0] - 1.0) > CALIBRATED_TO


def lasts(values: Values) -> bool:
    """Whether a sensor's time is longer than a recorder leaves open: channels sampled in turn are not exact to less."""
    return abs(values[0]) > IN_TURN


def outlasts_a_cycle(values: Values) -> bool:
    """Whether a time between a drive's log and its torque is longer than a cycle of its current loop."""
    return abs(values[0]) > AGE


def one_start(problem: Problem) -> tuple[Values, ...]:
    """For effects of a single parameter."""
    return ((),)


# --- what recordings can show: shared tests --------------------------------------------------------------------------


def needs_motor(problem: Problem) -> str | None:
    """The motor side turns in some run."""
    if any(run.turns for run in problem.runs):
        return None
    return "the motor is held, absent or rigidly joined in every run"


def needs_drive(problem: Problem) -> str | None:
    """The motor side turns in some run, or a rigid axis is driven."""
    if any(not run.spring and run.run.experiment != "hammer" for run in problem.runs):
        return None
    return needs_motor(problem)


def made_to_show(spec: EffectSpec, runs: Iterable[PreparedRun]) -> bool:
    """Whether one of the runs' experiments is made to show the effect; a free run may be anything."""
    experiments = {run.run.experiment for run in runs}
    return "free" in experiments or bool(experiments & set(spec.revealed_by))


def needs_spring(problem: Problem) -> str | None:
    """Torque passes through the transmission in some run."""
    return None if any(run.spring for run in problem.runs) else "the rig has no elastic transmission"


def needs_travel(problem: Problem) -> str | None:
    """The arm travels far enough for position to matter."""
    if any(run.turns for run in problem.runs) or any(not run.spring for run in problem.runs):
        if problem.scales.travel > 0.02:
            return None
        return f"the arm travels only {problem.scales.travel:.2g} rad"
    return "no run moves the motor"


def needs_accelerometer(problem: Problem) -> str | None:
    """Some run recorded an acceleration."""
    if any("acceleration" in output.quantity for run in problem.runs for output in run.outputs):
        return None
    return "no acceleration was recorded"


def needs_two_clocks(problem: Problem) -> str | None:
    """Two devices with exact starts took part in some run."""
    for run in problem.runs:
        late = run.late_motor or any(output.late for output in run.outputs)
        prompt = any(not output.late for output in run.outputs)
        exact = all(stream.start_uncertainty == 0.0 for stream in run.run.streams)
        if late and prompt and exact:
            return None
    return "no run has signals of two devices whose starts are exact"


def needs_motor_torque(problem: Problem) -> str | None:
    """A logged motor torque drives some run."""
    return None if any(run.motor is not None for run in problem.runs) else "no motor torque was logged"


def share_of(problem: Problem, which: str, *shares: float) -> tuple[float, float, float]:
    """Small, medium, large as shares of one of the campaign's typical sizes."""
    size = max(float(getattr(problem.scales, which)), 1e-12)
    small, medium, large = shares
    return small * size, medium * size, large * size


def frequencies(low: float, high: float, ratio: float) -> tuple[float, ...]:
    """Geometric grid from ``low`` to ``high`` [Hz]."""
    if high <= low:
        return (low,)
    count = max(2, math.ceil(math.log(high / low) / math.log(ratio)) + 1)
    return tuple(low * (high / low) ** (i / (count - 1)) for i in range(count))
