r"""The motor's electromagnetic torque T_e from whatever the run recorded of it as an input.

Torque itself, torque-producing current (T_e = K_t i_q), phase currents (``currents``), or an armature voltage (whose
model values are per volt). One phase alone leaves the paper's envelope \|h[i_a]\| (Equation 28).

Outputs are never read: the encoder that ``recordings.motor_torque`` may use is an output.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from jointscope.errors import RefusedError
from jointscope.identification.model_file import BaseModel
from jointscope.prediction.currents import torque_from_currents
from jointscope.prediction.plant import plant_of
from jointscope.prediction.torque_log import Samples, TorqueLog, undistorted
from jointscope.recordings.bandlimited import Bandlimited, bandlimited
from jointscope.recordings.campaign import Quantity, Run, Signal
from jointscope.recordings.motor_torque import envelope

Real = NDArray[np.float64]

SOURCES: tuple[Quantity, ...] = ("torque", "current", "phase-current", "voltage")


@dataclass(frozen=True, kw_only=True, eq=False)
class TorqueInput:
    """T_e as a function of time [N m, motor shaft] (or the model's input unit).

    Attributes:
        value: Of time [s].
        samples: The log's own [N m], shape (n,).
        source: Quantity it was read from.
        rate: Of the recording [Hz].
        note: What a reader of the prediction must know of it; empty where nothing.
    """

    value: Bandlimited
    samples: Real
    source: Quantity
    rate: float
    note: str = ""


def torque_input(
    model: BaseModel, run: Run, motor_angle: float, log: TorqueLog | None = None
) -> TorqueInput | None:
    """T_e of ``run``, or ``None`` where it declares no motor input.

    Args:
        model: Base model; its nameplate holds torque constant and pole pairs.
        run: The run; input channels only are read.
        motor_angle: n q_s at the start [rad], from which the currents' sign is found.
        log: What the torque's logger does, where that is known.

    Raises:
        RefusedError: A nameplate value that the recording needs is absent, or a declared input was not recorded.
    """
    for quantity in SOURCES:
        declared = run.select(quantity, location="motor", role="input", recorded=False)
        signals = run.select(quantity, location="motor", role="input")
        if declared and not signals:
            raise RefusedError(
                f"run {run.id!r}: the input {declared[0].channel.column!r} is declared but not in "
                f"{declared[0].stream.file}; prediction needs its samples"
            )
        if signals:
            return _read(model, run, quantity, signals, motor_angle, log or TorqueLog())
    return None


def _read(
    model: BaseModel, run: Run, quantity: Quantity, signals: tuple[Signal, ...], motor_angle: float, log: TorqueLog
) -> TorqueInput:
    first = signals[0]
    note = ""
    if quantity == "torque":
        values = first.samples
        if first.channel.side == "output":
            values = values / model.joint.get("reduction_ratio", 1.0)
    elif quantity == "current":
        values = first.samples * _peak(first) * _torque_constant(model, run, first)
    elif quantity == "voltage":
        values = first.samples
    else:
        values, note = _from_phases(model, run, signals, motor_angle)
    read = undistorted(Samples(values, first.sampling_rate, first.stream.start), log)
    return TorqueInput(
        value=bandlimited(read.values, read.rate, read.start),
        samples=read.values,
        source=quantity,
        rate=read.rate,
        note=note,
    )


def _peak(signal: Signal) -> float:
    return math.sqrt(2.0) if signal.channel.per == "rms" else 1.0


def _torque_constant(model: BaseModel, run: Run, signal: Signal) -> float:
    if model.rig.torque_constant is not None:
        return model.rig.torque_constant
    if model.input_unit not in ("N m", "N"):
        return 1.0  # every value of the model is meant per ampere then
    raise RefusedError(
        f"run {run.id!r}: {signal.channel.column!r} is a current and rig.torque_constant is absent; "
        "give it in campaign.toml [N m/A]"
    )


def _from_phases(model: BaseModel, run: Run, signals: tuple[Signal, ...], motor_angle: float) -> tuple[Real, str]:
    """T_e [N m] at the samples of the phases, and what a reader must know of its sign."""
    K_t = _torque_constant(model, run, signals[0])
    same = [signal for signal in signals if signal.device == signals[0].device]
    if len(same) == 1:
        note = "one phase current gives |T_e| only (Hilbert envelope): the torque's sign is lost"
        return K_t * _peak(same[0]) * envelope(same[0].samples), note
    if len(same) == 2:
        run = _with_third_phase(run, same)
    rig = replace(model.rig, torque_constant=K_t)
    found = torque_from_currents(run, rig, plant_of(model, run).holding_torque(run.arm_angle))
    values = found.values
    if not found.anchored:
        # at rest without gravity: the rotor's own angle n q_s is known, and with it which way the vector points
        expected = (rig.pole_pairs or 1) * motor_angle
        lead = np.abs(found.values) > 0.05 * float(np.max(np.abs(found.values)))
        first = int(np.argmax(lead))
        if math.cos(found.electrical_angle[first] - expected) < 0.0:
            values = -values
    places = ", ".join(f"{doubt.start:.3f}-{doubt.end:.3f} s" for doubt in found.doubts)
    return values, f"the phase currents leave the torque's sign open behind {places}" if places else ""


def _with_third_phase(run: Run, phases: list[Signal]) -> Run:
    """The same run with w = -u - v as a channel of the phases' stream."""
    samples = -phases[0].samples - phases[1].samples
    third = replace(phases[1].channel, column=f"{phases[1].channel.column} (third phase)", samples=samples)
    stream = replace(phases[0].stream, channels=(*phases[0].stream.channels, third))
    streams = list(run.streams)
    streams[phases[0].device] = stream
    return replace(run, streams=tuple(streams))
