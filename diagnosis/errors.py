"""The contract's errors on held-out runs: inputs-only prediction against the recording, per experiment and channel."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.assembly import closes
from jointscope.diagnosis.noise import ANGULAR, NoiseModel, block_key
from jointscope.diagnosis.own_hit import departure_columns, is_hit, least_scatter, within_scatter
from jointscope.recordings.drift import FOLLOWING

if TYPE_CHECKING:
    from jointscope.diagnosis.effects import ActiveEffect
    from jointscope.diagnosis.prepare import Output, PreparedRun, Problem

Vector = NDArray[np.float64]


class Free(Protocol):
    """Inputs-only prediction of every declared channel of a run."""

    def __call__(
        self, run: PreparedRun, theta: Vector, effects: tuple[ActiveEffect, ...], problem: Problem
    ) -> tuple[Vector, ...]:
        """One array per ``run.declared``."""
        ...


@dataclass(frozen=True)
class ChannelError:
    """One channel of one run [-].

    Attributes:
        error: RMS(recorded - predicted) over RMS(recorded), or over RMS(recorded - first value) for angles.
        floor: The same for a perfect model; ``nan`` where it is not known.
        apart: The error once a hit's own gain and time are taken off, within three standard deviations of their
            scatter; ``error`` for anything but hits, ``nan`` where it was not asked for.
    """

    run: str
    experiment: str
    channel: str
    error: float
    floor: float
    apart: float = float("nan")


def said(error: float | None) -> str:
    """A relative error for people; silent channels have none."""
    return "not known" if error is None else f"{error:.4f}"


def held_out_lines(held: Mapping[str, Any]) -> list[str]:
    """``held_out`` of diagnosis.json for people."""
    lines = [
        f"held-out runs ({len(held['runs'])}): relative error {said(held['base_error'])} with the base model, "
        f"{said(held['augmented_error'])} with the effects, noise floor {said(held['noise_floor'])}"
    ]
    if "without_drift" in held:
        own = held["without_drift"]
        lines.append(
            f"  without angles that drift off open loop: {said(own['base'])} and {said(own['augmented'])}, "
            f"noise floor {said(own['noise_floor'])}"
        )
    if "wind_up_error" in held:
        lines.append(
            f"  wind-up: {said(held['wind_up_error']['base'])} and {said(held['wind_up_error']['augmented'])}"
        )
    return lines


def _adrift(run: PreparedRun, topology: str, base: Vector) -> bool:
    if topology == "single-dof" and not run.spring:
        return not closes(run, base)
    return run.speed_command is None and (run.motor_moves or not run.spring)


def without_drift(problem: Problem, errors: Sequence[ChannelError]) -> list[ChannelError]:
    """The errors that the model alone decides.

    Open loop the rigid body goes where the torque log's last hundredth carries it, so that its angle tells models nothing.
    """
    adrift = {run.run.id for run in problem.runs if _adrift(run, problem.rig.topology, problem.base.start)}
    return [e for e in errors if not (e.run in adrift and e.channel.startswith(FOLLOWING))]


def rms(x: Vector) -> float:
    """Root of the mean square; 0 of nothing."""
    return float(np.sqrt(np.mean(np.square(x)))) if x.size else 0.0


def relative_error(quantity: str, recorded: Vector, predicted: Vector) -> float:
    """The contract's error of one channel [-]; ``nan`` for a silent one."""
    reference = rms(recorded - recorded[0]) if quantity in ANGULAR else rms(recorded)
    if reference == 0.0:
        return float("nan")
    return rms(recorded - predicted) / reference


def compared(run: PreparedRun, declared: Output) -> Output:
    """The channel as it was compared, thinned perhaps; the declared one where it was not compared at all."""
    return next((o for o in run.outputs if o.channel == declared.channel), declared)


def floor_of(run: PreparedRun, output: Output, noise: NoiseModel, predicted: Vector) -> float:
    """RMS of what a perfect model leaves: the block's noise and, for hits, gain and timing scatter [output's unit]."""
    thin = compared(run, output)
    block = noise.blocks.get(block_key(run, thin))
    if block is None:
        return float("nan")
    variance = block.marginal**2 + thin.taken_off
    if is_hit(run):
        departure = predicted - predicted[0]
        variance += (noise.gain * rms(departure)) ** 2 + (
            noise.timing * rms(np.gradient(departure) * output.rate)
        ) ** 2
    return float(np.sqrt(variance))


def without_own_scatter(
    recorded: Vector, predicted: Vector, scored: NDArray[np.bool_], rate: float, noise: NoiseModel
) -> Vector:
    """The prediction with the gain and the time that this hit seems to have had, by its ``scored`` samples."""
    columns = departure_columns(predicted, rate)
    own = least_scatter(columns[scored], (recorded - predicted)[scored])
    return np.asarray(predicted + columns @ within_scatter(own, noise))


def channel_errors(
    problem: Problem,
    free: Free,
    runs: Sequence[int],
    theta: Vector,
    effects: tuple[ActiveEffect, ...],
    noise: NoiseModel,
) -> tuple[ChannelError, ...]:
    """Errors of every recorded output channel of ``runs`` (positions in ``problem.runs``)."""
    found = []
    for position in runs:
        run = problem.runs[position]
        for output, predicted in zip(run.declared, free(run, theta, effects, problem), strict=True):
            channel = run.run.streams[output.channel[0]].channels[output.channel[1]]
            if channel.samples is None:
                continue
            recorded = np.asarray(channel.samples, dtype=np.float64) / output.scale
            predicted = output.recorded(predicted) / output.scale
            scored = np.isfinite(recorded)
            if output.mask.size == recorded.size and np.any(output.mask):
                scored &= output.mask
            error = relative_error(output.quantity, recorded[scored], predicted[scored])
            reference = (
                rms(recorded[scored] - recorded[scored][0])
                if output.quantity in ANGULAR
                else rms(recorded[scored])
            )
            floor = floor_of(run, output, noise, predicted) / reference if reference > 0.0 else float("nan")
            label = f"{output.quantity}@{output.location}"
            apart = error
            if is_hit(run) and np.all(np.isfinite(predicted)):
                own = without_own_scatter(recorded, predicted, scored, output.rate, noise)
                apart = relative_error(output.quantity, recorded[scored], own[scored])
            found.append(ChannelError(run.run.id, run.run.experiment, label, error, floor, apart))
    return tuple(found)


def mean_error(errors: Sequence[ChannelError]) -> float:
    """Mean over runs' channels, each weighted the same; a diverged prediction counts as 100."""
    values = [min(e.error, 100.0) if np.isfinite(e.error) else 100.0 for e in errors if not np.isnan(e.error)]
    return float(np.mean(values)) if values else float("nan")


def mean_floor(errors: Sequence[ChannelError]) -> float:
    """The same of the floors."""
    values = [e.floor for e in errors if np.isfinite(e.floor)]
    return float(np.mean(values)) if values else float("nan")


def grouped(errors: Sequence[ChannelError]) -> dict[str, dict[str, float]]:
    """Mean error per experiment and channel."""
    table: dict[str, dict[str, list[ChannelError]]] = {}
    for e in errors:
        table.setdefault(e.experiment, {}).setdefault(e.channel, []).append(e)
    return {
        experiment: {channel: mean_error(members) for channel, members in sorted(channels.items())}
        for experiment, channels in sorted(table.items())
    }
