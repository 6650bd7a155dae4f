"""Every output channel of every run from the base model and the run's inputs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from jointscope.errors import RefusedError
from jointscope.identification.drive_law import Drive, drive_from_json
from jointscope.identification.model_file import BaseModel
from jointscope.prediction.drift import TOLERABLE, drift_removed, legitimate_from
from jointscope.prediction.integrate import Motion, integrate
from jointscope.prediction.plant import Plant, plant_of
from jointscope.prediction.run_inputs import RunInputs, run_inputs, span
from jointscope.prediction.sensors import read_channel
from jointscope.prediction.torque_log import TorqueLog
from jointscope.recordings.campaign import Campaign, Run, Signal

Real = NDArray[np.float64]

_ACCELERATIONS = ("linear-acceleration", "angular-acceleration", "acceleration")


@dataclass(frozen=True, eq=False)
class ChannelPrediction:
    """One predicted channel.

    Attributes:
        signal: The declared channel.
        times: On the run's clock [s], shape (n,).
        values: SI, shape (n,).
    """

    signal: Signal
    times: Real
    values: Real


@dataclass(frozen=True, kw_only=True, eq=False)
class RunPrediction:
    """One run's prediction.

    Attributes:
        run: The run.
        channels: Its predicted channels, in file order.
        closed_loop: Whether the drive's law took part.
        legitimate: Band in which accelerations may be trusted [Hz]; (0, half the slowest input's rate) in general.
        notes: What a reader must know.
    """

    run: Run
    channels: tuple[ChannelPrediction, ...]
    closed_loop: bool
    legitimate: tuple[float, float]
    notes: tuple[str, ...] = ()


def outputs_of(run: Run, *, declared: bool = False) -> tuple[Signal, ...]:
    """The run's output channels that were recorded, or with ``declared`` all of them; measured FRFs are not outputs."""
    return tuple(
        signal for signal in run.select(role="output", recorded=not declared) if signal.channel.quantity != "frf"
    )


def predict_run(
    model: BaseModel,
    run: Run,
    *,
    declared: bool = False,
    drive: Drive | None = None,
    log: TorqueLog | None = None,
    share: float | None = None,
) -> RunPrediction:
    """Predict ``run`` from its inputs.

    Args:
        model: Base model; its own ``drive`` is used where none is given.
        run: The run; its outputs are not read, only where and when they were measured.
        declared: Also predict channels that were declared and not recorded.
        drive: The drive's law.
        log: What the torque's logger does, where that is known.
        share: Of the law in a closed loop's torque [-]; ``None``: as its identification says; 0 replays the log open loop.

    Raises:
        RefusedError: The model or the run can't carry a prediction; the message says what is missing.
    """
    if model.rig.topology == "arm":
        raise RefusedError(
            "model.json: rig.topology = 'arm' with kind = 'base' holds one joint; predict an arm with the model "
            "that diagnose wrote"
        )
    if drive is None and model.drive is not None:
        drive = drive_from_json(model.drive)
    wanted = outputs_of(run, declared=declared)
    if not wanted:
        return RunPrediction(run=run, channels=(), closed_loop=False, legitimate=(0.0, 0.0), notes=("no outputs",))
    single = [(model, 1.0)] if not model.terms else list(_in_parallel(model))
    parts = []
    for part, _ in single:
        plant = plant_of(part, run)
        inputs = run_inputs(part, run, plant, wanted, drive=drive, log=log, share=share)
        parts.append((plant, inputs, simulate(plant, inputs, run.arm_angle)))
    plant, inputs, motion = parts[0]
    lowest, notes = _trustworthy_from(plant, inputs, motion, run)
    if len(parts) > 1:
        motion = _summed([entry[2] for entry in parts], [weight for _, weight in single], run.arm_angle)
    return RunPrediction(
        run=run,
        channels=tuple(_channel(s, run, motion, plant, model, inputs.fastest, lowest) for s in wanted),
        closed_loop=inputs.loop is not None,
        legitimate=(lowest, 0.5 * inputs.fastest),
        notes=(*inputs.notes, *notes),
    )


def _channel(
    signal: Signal, run: Run, motion: Motion, plant: Plant, model: BaseModel, fastest: float, lowest: float
) -> ChannelPrediction:
    times = channel_times(signal, run)
    values = read_channel(signal, times, motion, plant, model.rig, fastest)
    if lowest > 0.0 and signal.channel.quantity in _ACCELERATIONS:
        values = values[0] + drift_removed(values, signal.sampling_rate, min(lowest, 0.4 * signal.sampling_rate))
    return ChannelPrediction(signal, times, values)


def _trustworthy_from(plant: Plant, inputs: RunInputs, motion: Motion, run: Run) -> tuple[float, tuple[str, ...]]:
    """Lowest frequency at which an open-loop prediction holds [Hz], and what to say of it."""
    if inputs.offset_error == 0.0:
        return 0.0, ()
    moved = replace(inputs, motor_torque=inputs.motor_torque + 2.0 * inputs.offset_error)
    lowest = legitimate_from(motion, simulate(plant, moved, run.arm_angle))
    if lowest == 0.0:
        return 0.0, ()
    return lowest, (
        f"open loop: an offset of {2.0 * inputs.offset_error:.2g} N m in the logged torque moves the arm by more than "
        f"{TOLERABLE:g} rad; accelerations are given above {lowest:.2g} Hz only, angles and speeds drift",
    )


def simulate(plant: Plant, inputs: RunInputs, arm_angle: float) -> Motion:
    """The plant's motion under ``inputs`` from rest at ``arm_angle`` [rad]."""
    return integrate(
        plant,
        start=inputs.start,
        rate=inputs.rate,
        arm_angle=arm_angle,
        motor_torque=inputs.motor_torque,
        load_torque=inputs.load_torque,
        prescribed=inputs.prescribed,
        loop=inputs.loop,
    )


def predict_campaign(
    model: BaseModel, campaign: Campaign, *, declared: bool = False, log: TorqueLog | None = None
) -> Iterator[RunPrediction]:
    """Predict every run of ``campaign`` in turn; see ``predict_run``.

    The motor's electrical figures, which a model from hits alone does not hold, are then the campaign's.
    """
    plate = campaign.rig
    constant, pairs = model.rig.torque_constant, model.rig.pole_pairs
    rig = replace(
        model.rig,
        torque_constant=plate.torque_constant if constant is None else constant,
        pole_pairs=plate.pole_pairs if pairs is None else pairs,
    )
    model = replace(model, rig=rig)
    for run in campaign.runs:
        yield predict_run(model, run, declared=declared, log=log)


def channel_times(signal: Signal, run: Run) -> Real:
    """When the channel's stream has its samples [s]; where its file holds none, over the span of the run's inputs."""
    stream = signal.stream
    if stream.length > 0:
        return stream.times
    _, end = span(list(run.select(role="input")))
    count = max(int(np.floor((end - stream.start) * stream.sampling_rate + 1e-9)) + 1, 1)
    return stream.start + np.arange(count) / stream.sampling_rate


def _in_parallel(model: BaseModel) -> Iterator[tuple[BaseModel, float]]:
    """One single-mode joint per term, each with the motor's parameters (paper, section 2.2.2), and its sign.

    A negative J~ (hit point and sensor move in opposite senses) becomes a positive joint counted with -1.
    """
    for term in model.terms:
        sign = 1.0 if term.inertia > 0.0 else -1.0
        values = {
            "load_inertia": abs(term.inertia),
            "damping": abs(term.damping),
            "stiffness": abs(term.stiffness),
        }
        # the terms are decoupled modes without a place of their own: gravity and b_l are in them already
        joint = {**model.joint, **values, "load_damping": 0.0}
        yield (
            replace(
                model,
                joint=joint,
                terms=(),
                parameters=(),
                covariance=np.zeros((0, 0)),
                rig=replace(model.rig, arm_mass=None, load_damping=None),
            ),
            sign,
        )


def _summed(motions: list[Motion], signs: list[float], arm_angle: float) -> Motion:
    first = motions[0]

    def total(name: str, offset: float = 0.0) -> Real:
        return np.asarray(
            offset + sum(sign * (getattr(m, name) - offset) for m, sign in zip(motions, signs, strict=True))
        )

    return replace(
        first,
        angle=total("angle", arm_angle),
        speed=total("speed"),
        acceleration=total("acceleration"),
        motor_angle=total("motor_angle", arm_angle),
        motor_speed=total("motor_speed"),
        motor_acceleration=total("motor_acceleration"),
    )
