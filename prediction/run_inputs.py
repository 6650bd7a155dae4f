"""A run's inputs on the integrator's clock: forces, motor torque, speed command, prescribed motion.

Only input channels and ``arm_angle`` are read here; nothing of what a run recorded as an output reaches a prediction.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from jointscope.errors import RefusedError
from jointscope.identification.drive_law import Drive
from jointscope.identification.model_file import BaseModel
from jointscope.prediction.closed_loop import close
from jointscope.prediction.drift import resting_offset
from jointscope.prediction.integrate import Loop
from jointscope.prediction.plant import Plant, prescribed_motion
from jointscope.prediction.torque_input import torque_input
from jointscope.prediction.torque_log import TorqueLog
from jointscope.recordings.bandlimited import bandlimited
from jointscope.recordings.campaign import Run, Signal, gearing

Real = NDArray[np.float64]

_STEPS_PER_SAMPLE = 4.0
_SLOWEST = 2000.0  # Hz
_RADIANS_PER_STEP = 0.15  # of the fastest eigenvalue: the scheme's own error stays below 1e-6 of the response
_MOST_STEPS = 20_000_000


@dataclass(frozen=True, kw_only=True, eq=False)
class RunInputs:
    """Everything that acts on the plant, at steps and half steps; arrays of shape (2 n - 1,).

    Attributes:
        start: Time of the first step [s].
        rate: Steps per second [Hz].
        motor_torque: T_e as recorded [N m, motor shaft].
        load_torque: External torque on the load [N m].
        prescribed: Angle, speed, acceleration of the moved side at the output, shape (3, 2 n - 1), or ``None``.
        loop: The speed loop, or ``None``.
        offset_error: What is left uncertain of the motor torque's offset where it acts open loop [N m]; else 0.
        fastest: Highest rate among the inputs [Hz].
        notes: What a reader must know.
    """

    start: float
    rate: float
    motor_torque: Real
    load_torque: Real
    prescribed: Real | None
    loop: Loop | None
    offset_error: float
    fastest: float
    notes: tuple[str, ...] = ()


def run_inputs(
    model: BaseModel,
    run: Run,
    plant: Plant,
    outputs: tuple[Signal, ...],
    *,
    drive: Drive | None = None,
    log: TorqueLog | None = None,
    share: float | None = None,
) -> RunInputs:
    """Read the inputs of ``run`` for ``plant``.

    Args:
        model: Base model.
        run: The run.
        plant: What is integrated.
        outputs: Channels that will be read out; their streams set how long the integration runs.
        drive: The speed law, used where the run declares a speed command.
        log: What the torque's logger does, where that is known.
        share: Of the law in the closed loop's torque [-]; ``None``: as its identification says.

    Raises:
        RefusedError: An input is missing, or the plant is too fast to be integrated over the run.
    """
    read = [signal for signal in run.select(role="input") if signal.channel.quantity != "frf"]
    start, rate, count = _clock(run, plant, [*read, *outputs])
    t = start + np.arange(2 * count - 1) / (2.0 * rate)
    notes: list[str] = []
    torque = torque_input(model, run, plant.ratio * plant.resting_motor_angle(run.arm_angle), log)
    hold = plant.holding_torque(run.arm_angle)
    if torque is not None:
        T_e = torque.value(t)
        notes += [torque.note] if torque.note else []
    else:
        T_e = np.full(t.size, hold)
    loop = None
    commands = run.select("speed-command", role="input")
    if drive is not None and commands and plant.motor == "free":
        command = bandlimited(commands[0].samples, commands[0].sampling_rate, commands[0].stream.start)
        loop = close(drive, command, t, hold, logged=torque is not None, share=share)
    if loop is None and run.select("speed-command", role="input"):
        if torque is None:
            raise RefusedError(
                f"run {run.id!r} has a speed command, no torque, and the model holds no drive law; identify again "
                "from runs that record speed command and torque"
            )
        notes.append("the model holds no drive law: the logged torque is replayed open loop and may drift")
    offset_error = 0.0
    if torque is not None and loop is None and plant.gravity_moment > 0.0 and plant.motor in ("free", "rigid"):
        offset, offset_error = resting_offset(torque.samples, hold)
        T_e = T_e - offset
    load = _load_torque(run, t)
    if model.rig.topology == "single-dof" and plant.motor == "held":
        load = load + plant.gain * (T_e if torque is not None else 0.0)
    return RunInputs(
        start=start,
        rate=rate,
        motor_torque=T_e,
        load_torque=load,
        prescribed=_prescribed(run, plant, t),
        loop=loop,
        offset_error=offset_error,
        fastest=max((signal.sampling_rate for signal in read), default=0.0),
        notes=tuple(notes),
    )


def span(signals: list[Signal]) -> tuple[float, float]:
    """First and last sample time over ``signals`` that hold samples [s]."""
    held = [signal.stream for signal in signals if signal.stream.length > 0]
    if not held:
        return 0.0, 0.0
    return min(stream.start for stream in held), max(
        stream.start + (stream.length - 1) / stream.sampling_rate for stream in held
    )


def _clock(run: Run, plant: Plant, signals: list[Signal]) -> tuple[float, float, int]:
    start, end = span(signals)
    if end <= start:
        raise RefusedError(f"run {run.id!r} holds no input samples; nothing can be predicted from it")
    fastest = max(signal.sampling_rate for signal in signals)
    rate = max(_STEPS_PER_SAMPLE * fastest, _SLOWEST, plant.fastest_rate() / _RADIANS_PER_STEP)
    count = math.ceil((end - start) * rate) + 2
    if count > _MOST_STEPS:
        raise RefusedError(
            f"run {run.id!r}: the model's fastest eigenvalue is {plant.fastest_rate():.3g} rad/s, too fast to integrate "
            f"over {end - start:.3g} s; check stiffness, inertia and damping in model.json"
        )
    return start, rate, count


def _load_torque(run: Run, t: Real) -> Real:
    total = np.zeros(t.size)
    for signal in run.select(role="input"):
        channel = signal.channel
        if channel.quantity not in ("force", "torque") or channel.location not in ("arm", "load"):
            continue
        lever = channel.radius if channel.quantity == "force" and channel.radius is not None else 1.0
        total += lever * bandlimited(signal.samples, signal.sampling_rate, signal.stream.start)(t)
    return total


def _prescribed(run: Run, plant: Plant, t: Real) -> Real | None:
    signal = prescribed_motion(run)
    if signal is None:
        return None
    record = bandlimited(signal.samples, signal.sampling_rate, signal.stream.start)
    ratio = gearing(signal.channel.quantity, signal.channel.location, plant.ratio)
    return np.stack([record(t, order) for order in range(3)]) / ratio
